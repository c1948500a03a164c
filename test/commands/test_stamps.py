"""Stamps of zero and of other clocks in recordings, as every command takes them."""

import json
from pathlib import Path

import pytest
from support.places import ROBOT
from support.restamped import SECOND, restamped

from cdrj_ros.commands import identify, simulate, validate

MOTORS, JOINTS = "/cdrj/motor_states", "/cdrj/joint_states"
REFERENCES = ("/reference/tensions", "/reference/nodal_forces", "/reference/efforts")
THREE_HOURS = 3 * 3600 * SECOND
APART = (
    "the stamps of elbow are 10800.0 s ahead of those of winch: synchronise the clocks, or add "
    "-10800.0 to the clock_offset of elbow in the robot file"
)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = str(tmp_path_factory.mktemp("stamps") / "bag")
    assert simulate.main([path, "--robot", ROBOT, "--duration", "4", "--cells", "1"]) == 0
    return path


def figures(bag, folder):
    out = folder / f"{Path(bag).name}.json"
    assert validate.main([bag, "--robot", ROBOT, "--json", str(out)]) == 0
    return json.loads(out.read_text())


def test_stamps_of_zero_are_replaced_by_log_times_which_is_said_once_per_topic(
    bag, tmp_path, capsys
):
    unstamped = restamped(bag, tmp_path / "zero", dict.fromkeys((MOTORS, JOINTS, *REFERENCES)))
    with_stamps, without = figures(bag, tmp_path), figures(unstamped, tmp_path)
    said = capsys.readouterr().out.replace("\n", " ")
    for topic in (MOTORS, JOINTS, *REFERENCES):
        assert said.count(f"{topic}: header stamps are zero, so the log times are used") == 1
    errors = [
        one["all"]["channels"]["tension/upper/8"]["mean_relative_error"]
        for one in (with_stamps, without)
    ]
    assert errors[1] < errors[0] + 0.01


def test_one_topic_without_stamps_fits_one_with_stamps(bag, tmp_path):
    found = figures(restamped(bag, tmp_path / "one", {JOINTS: None}), tmp_path)
    assert found["all"]["channels"]["tension/upper/8"]["mean_relative_error"] < 0.02


def test_another_clock_is_named_with_axis_difference_and_remedy(bag, tmp_path, capsys):
    ahead = restamped(bag, tmp_path / "ahead", {JOINTS: THREE_HOURS})
    assert validate.main([ahead, "--robot", ROBOT]) == 2
    assert APART in capsys.readouterr().err
    fit = ["--fit", "rho", "--out", str(tmp_path / "out.yaml")]
    assert identify.main([ahead, "--robot", ROBOT, *fit]) == 2
    assert APART in capsys.readouterr().err


def test_references_of_another_clock_are_an_error_not_an_empty_comparison(bag, tmp_path, capsys):
    ahead = restamped(bag, tmp_path / "ahead", dict.fromkeys(REFERENCES, THREE_HOURS))
    assert validate.main([ahead, "--robot", ROBOT]) == 2
    error = capsys.readouterr().err
    assert "no reference value has an estimate beside it" in error
    assert "begin 10799" in error or "begin 10800" in error
