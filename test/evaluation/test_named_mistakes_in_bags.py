"""A recording of a finger, compared by files with a mistake in names or efforts."""

import re

import numpy as np
import pytest
from support.places import ROBOTS

import cdrj_ros as cdrj
from cdrj_ros.commands import simulate
from cdrj_ros.robot.names import naming_hint

FLEXORS = ("deep", "superficial", "extensor")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("finger") / "bag"
    assert simulate.main([str(path), "--robot", "finger", "--duration", "8", "--cells", "1"]) == 0
    return path


@pytest.mark.parametrize(("one", "other"), [("mcp", "pip"), ("deep_motor", "extensor_motor")])
def test_the_first_note_names_the_swap(bag, tmp_path, one, other):
    text = (ROBOTS / "finger.yaml").read_text("utf-8")
    swapped = tmp_path / "swapped.yaml"
    swapped.write_text(text.replace(one, "?").replace(other, one).replace("?", other), "utf-8")
    (compared,) = cdrj.validate(swapped, bag, uncertainty=False).bags
    words = [f"{a} and {b} seem to be swapped" for a, b in ((one, other), (other, one))]
    assert any(word in compared.notes[0] for word in words)
    assert not any("its preload is" in note for note in compared.notes), "it is not the reason"
    (right,) = cdrj.validate("finger", bag, uncertainty=False).bags
    assert not any(note.startswith("Readings do not fit") for note in right.notes)


def test_an_effort_of_the_other_sign_is_answered_with_the_key(bag, tmp_path):
    text = (ROBOTS / "finger.yaml").read_text("utf-8")
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(text.replace("deep_motor, max", "deep_motor, effort_sign: -1, max"), "utf-8")
    (compared,) = cdrj.validate(wrong, bag, uncertainty=False).bags
    (note,) = (one for one in compared.notes if one.startswith("Recorded efforts"))
    assert note.startswith("Recorded efforts by the estimates: deep_motor -")
    assert note.endswith("times, effort_sign: +1 fits.")


def test_a_joint_of_which_a_part_is_out_of_range_is_named_with_its_range(bag, tmp_path):
    """The motion of mcp goes up to 40 degrees."""
    text = (ROBOTS / "finger.yaml").read_text("utf-8")
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(text.replace("range_deg: [-10, 85]", "range_deg: [-10, 30]"), "utf-8")
    (compared,) = cdrj.validate(wrong, bag, uncertainty=False).bags
    (note,) = (one for one in compared.notes if "out_of_range" in one)
    assert re.search("joint mcp at 0.706.*, its range is -0.1745 to 0.5236, correct scale", note)


def test_a_cable_without_tension_by_a_wrong_zero_is_said_to_be_slack(bag, tmp_path):
    """The extensor has 18 N and 2,000 N/rad at mcp; 2 degrees leave nothing of it."""
    text = (ROBOTS / "finger.yaml").read_text("utf-8")
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(text.replace("name: mcp,", "name: mcp, offset_deg: -2,"), "utf-8")
    (compared,) = cdrj.validate(wrong, bag, uncertainty=False).bags
    notes = [note for note in compared.notes if note.startswith("Cable extensor is slack by ")]
    assert len(notes) == 1
    assert "where 18" in notes[0]


def test_a_wrong_prefix_is_answered_with_the_one_that_fits(tmp_path):
    log = {"t": [0.0, 0.01], **{f"left_{k}": [0.0, 0.0] for k in range(5)}}
    motors = {f"left_{name}_motor": f"left_{k}" for k, name in enumerate(FLEXORS)}
    joints = {"left_mcp": "left_3", "left_pip": "left_4"}
    recording = cdrj.read_table(
        {name: np.array(column) for name, column in log.items()},
        time="t", motors=motors, joints=joints,
    )  # fmt: skip
    text = (ROBOTS / "finger.yaml").read_text("utf-8")
    for prefix in ("", "prefix: lift_\n"):
        wrong = tmp_path / "wrong.yaml"
        wrong.write_text(prefix + text, "utf-8")
        with pytest.raises(cdrj.BagError, match="prefix: left_ in the robot file would fit"):
            cdrj.validate(wrong, recording, uncertainty=False)


def test_names_without_the_prefix_or_in_other_letters_are_answered_likewise():
    missing, document = ["Arm/Elbow", "Arm/Winch"], {"prefix": "Arm/"}
    fits = "prefix: '' in the robot file would fit"
    assert naming_hint(["Elbow", "Winch"], missing, document) == fits
    differ = "upper and lower case differ"
    assert naming_hint(["arm/elbow", "arm/winch"], missing, document) == differ
    assert naming_hint(["Elbow"], missing, document) == ""
