"""Parts of a robot file: described once, used several times, each use with numbers of its own."""

import re

import numpy as np
import pytest
import yaml
from support.refusal import refusal

from cdrj_ros.commands import commission, identify
from cdrj_ros.commands.check_robot import main
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.document import parse_document
from cdrj_ros.robot.parameters import find_number, number_at
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.writer import with_numbers_in_text

FINGER = """\
name: hand
motors: [{name: wrist_motor}]
joints: [{name: wrist, range_deg: [-30, 30]}]
frames: [{name: palm, motion: revolute, joint: wrist, origin_mm: [5, 0, 0], axis: [0, 0, 1]}]
cables:
  - name: turner
    axial_stiffness: 9000
    preload: 5
    nodes:
      - {type: winch, motor: wrist_motor, winding: 1, radius_mm: 7, position_mm: [-90, 0, 30]}
      - {type: anchor, frame: palm, position_mm: [20, 8, 30]}
parts:
  - name: finger
    motors: [{name: pull, max_speed: 60}]
    joints:
      - {name: knuckle, range_deg: [0, 80]}
      - {name: tip, coupled: {knuckle: 0.5}}
    frames:
      - {name: bone, motion: revolute, joint: knuckle, origin_mm: [0, 4, 0], axis: [0.1, 1, 0.2], rpy_deg: [10, 5, 3]}
      - {name: end, parent: bone, motion: revolute, joint: tip, origin_mm: [40, 0, 0], axis: [0, 1, 0]}
    cables:
      - name: flexor
        axial_stiffness: 8000
        preload: 6
        friction: {mu_c: 0.1}
        nodes:
          - {type: winch, motor: pull, frame: base, winding: 1, radius_mm: 8, position_mm: [-150, 0, -12]}
          - {type: eyelet, position_mm: [-15, 3, -9]}
          - {type: sphere, frame: bone, radius_mm: 3, position_mm: [10, 1, -7], side_mm: [10, 1, -11]}
          - {type: anchor, frame: end, position_mm: [12, 2, -6]}
    used:
      - {prefix: index_, frame: palm, origin_mm: [70, 20, 0]}
      - prefix: thumb_
        frame: palm
        origin_mm: [30, -25, -4]
        rpy_deg: [60, 0, -40]
        mirror: y
        with: {cables.flexor.preload: 7.5, "cables.flexor.nodes.1.position_mm": [-150, -9, -12]}
"""  # noqa: E501

BY_HAND = """\
name: hand
motors: [{name: wrist_motor}, {name: index_pull, max_speed: 60}, {name: thumb_pull, max_speed: 60}]
joints:
  - {name: wrist, range_deg: [-30, 30]}
  - {name: index_knuckle, range_deg: [0, 80]}
  - {name: index_tip, coupled: {index_knuckle: 0.5}}
  - {name: thumb_knuckle, range_deg: [0, 80]}
  - {name: thumb_tip, coupled: {thumb_knuckle: 0.5}}
frames:
  - {name: palm, motion: revolute, joint: wrist, origin_mm: [5, 0, 0], axis: [0, 0, 1]}
  - {name: index_finger, parent: palm, motion: fixed, origin_mm: [70, 20, 0]}
  - {name: index_bone, parent: index_finger, motion: revolute, joint: index_knuckle, origin_mm: [0, 4, 0], axis: [0.1, 1, 0.2], rpy_deg: [10, 5, 3]}
  - {name: index_end, parent: index_bone, motion: revolute, joint: index_tip, origin_mm: [40, 0, 0], axis: [0, 1, 0]}
  - {name: thumb_finger, parent: palm, motion: fixed, origin_mm: [30, -25, -4], rpy_deg: [60, 0, -40]}
  - {name: thumb_bone, parent: thumb_finger, motion: revolute, joint: thumb_knuckle, origin_mm: [0, -4, 0], axis: [-0.1, 1, -0.2], rpy_deg: [-10, 5, -3]}
  - {name: thumb_end, parent: thumb_bone, motion: revolute, joint: thumb_tip, origin_mm: [40, 0, 0], axis: [0, 1, 0]}
cables:
  - name: turner
    axial_stiffness: 9000
    preload: 5
    nodes:
      - {type: winch, motor: wrist_motor, winding: 1, radius_mm: 7, position_mm: [-90, 0, 30]}
      - {type: anchor, frame: palm, position_mm: [20, 8, 30]}
  - name: index_flexor
    axial_stiffness: 8000
    preload: 6
    friction: {mu_c: 0.1}
    nodes:
      - {type: winch, motor: index_pull, frame: base, winding: 1, radius_mm: 8, position_mm: [-150, 0, -12]}
      - {type: eyelet, frame: index_finger, position_mm: [-15, 3, -9]}
      - {type: sphere, frame: index_bone, radius_mm: 3, position_mm: [10, 1, -7], side_mm: [10, 1, -11]}
      - {type: anchor, frame: index_end, position_mm: [12, 2, -6]}
  - name: thumb_flexor
    axial_stiffness: 8000
    preload: 7.5
    friction: {mu_c: 0.1}
    nodes:
      - {type: winch, motor: thumb_pull, frame: base, winding: 1, radius_mm: 8, position_mm: [-150, -9, -12]}
      - {type: eyelet, frame: thumb_finger, position_mm: [-15, -3, -9]}
      - {type: sphere, frame: thumb_bone, radius_mm: 3, position_mm: [10, -1, -7], side_mm: [10, -1, -11]}
      - {type: anchor, frame: thumb_end, position_mm: [12, -2, -6]}
"""  # noqa: E501


def test_parts_expand_to_exactly_what_is_written_by_hand():
    assert parse_document(FINGER, "hand") == parse_document(BY_HAND, "hand")


def test_check_robot_prints_the_file_with_its_parts_written_out(tmp_path, capsys):
    file = tmp_path / "hand.yaml"
    file.write_text(FINGER, encoding="utf-8")
    assert main([str(file), "--expanded"]) == 0
    printed = capsys.readouterr().out
    assert "parts:" not in printed
    assert parse_document(printed, "printed") == parse_document(BY_HAND, "hand")


ALIASES = """\
name: alias
motors: [{name: m}]
joints: []
cables:
  - &rope {name: a, axial_stiffness: 1000, preload: 1, nodes: [{type: winch, motor: m, winding: 1, radius: 0.01}, {type: anchor}], spans: [1]}
  - {<<: *rope, name: b}
"""  # noqa: E501


@pytest.mark.parametrize(
    ("command", "argv"),
    [(commission.main, ["--robot"]), (identify.main, ["no.mcap", "--fit", "preload", "--robot"])],
)
def test_an_alias_is_refused_before_any_bag_is_read(command, argv, tmp_path, capsys):
    file, out = tmp_path / "alias.yaml", str(tmp_path / "out.yaml")
    file.write_text(ALIASES, encoding="utf-8")
    parse_robot(ALIASES)  # may be read
    assert command([*argv, str(file), "--out", out]) == 2
    assert "has an alias in line 6" in capsys.readouterr().err


MIRRORED = """\
name: pair
motors: []
joints: []
cables: []
parts:
  - name: arm
    motors: [{name: m}]
    joints: [{name: q, range_deg: [-60, 60]}, {name: s, range: [0, 0.02]}]
    frames:
      - {name: a, motion: revolute, joint: q, origin_mm: [3, 8, 5], rpy_deg: [20, -30, 40], axis: [1, 2, 3]}
      - {name: b, parent: a, motion: prismatic, joint: s, origin_mm: [40, 2, 1], quaternion: [0.1, 0.7, 0.1, 0.7], axis: [2, 1, 1]}
    cables:
      - name: c
        axial_stiffness: 8000
        preload: 6
        nodes:
          - {type: winch, motor: m, winding: 1, radius_mm: 8, position_mm: [-80, 3, -12], axis: [0.2, 0.1, 1], turn: ccw, pitch_mm: 1.5}
          - {type: pulley, radius_mm: 5, position_mm: [-30, 12, -9], axis: [0.1, 0.2, 1], turn: cw}
          - {type: cylinder, frame: a, radius_mm: 3, position_mm: [12, 1, 3], axis: [0.1, 1, 0.2], turn: ccw}
          - {type: eyelet, frame: a, position_mm: [22, 1, 13]}
          - {type: anchor, frame: b, position_mm: [12, 2, 6]}
    used:
      - {prefix: left_}
      - {prefix: right_, mirror: AXIS}
"""  # noqa: E501


@pytest.mark.parametrize("axis", "xyz")
def test_a_mirrored_part_moves_as_its_original_does_in_a_mirror(axis):
    model = prepare(parse_robot(MIRRORED.replace("AXIS", axis)))
    sign = np.array([-1.0 if one == axis else 1.0 for one in "xyz"])
    for q, s, turn in ((0.0, 0.0, 0.0), (0.5, 0.01, 2.0), (-0.9, 0.02, -1.0)):
        shape = shape_at(model, np.array([q, s, q, s]), np.array([turn, turn]))
        left, right = np.split(shape.length, 2)
        assert right == pytest.approx(left, abs=1e-12)
        assert np.split(shape.wrap, 2)[1] == pytest.approx(np.split(shape.wrap, 2)[0], abs=1e-9)
        arms = shape.lever_arm
        assert arms[len(left) :, 2:] == pytest.approx(arms[: len(left), :2], abs=1e-12)
        one, other = np.split(shape.direction, 2)
        assert other == pytest.approx(one * sign, abs=1e-12)


TAKEN = "'index_' is taken already"
MISTAKES = {
    ("preload: 6\n", "preload: -6\n"): "parts[0].cables[0].preload (line N) must be at least 0",
    ("preload: 7.5", "preload: -7"): (
        "parts[0].used[1].with.cables.flexor.preload (line N, used as thumb_) must be at least 0"
    ),
    ("frame: bone, r", "frame: bonnet, r"): (
        "parts[0].cables[0].nodes[2].frame (line N, used as index_) must be one of base, "
    ),
    ("frame: palm, origin_mm: [70", "frame: plam, origin_mm: [70"): (
        "parts[0].used[0].parent (line N, used as index_) must name an earlier frame"
    ),
    ("x: thumb_", "x: index_"): f"parts[0].used[1].prefix (line N) {TAKEN}",
    ("with: {cables.flexor", "with: {cables.extensor"): (
        "parts[0].used[1].with.cables.extensor.preload (line N) must begin with one of cables.flex"
    ),
    ("nodes.1.position_mm", "nodes.9.position_mm"): (
        "parts[0].used[1].with.cables.flexor.nodes.9.position (line N) must have a number from 1 "
    ),
    ("mirror: y", "miror: y"): "parts[0].used[1].miror (line N) is not a known key; did you mean",
}


@pytest.mark.parametrize(("change", "said"), MISTAKES.items())
def test_an_error_names_the_use_and_the_line(change, said):
    old, new = change
    text = FINGER.replace(old, new, 1)
    line = text[: text.rindex(new)].count("\n") + 1
    message = refusal(parse_robot, text, "hand.yaml")
    assert message.startswith(said.replace("(line N", f"(line {line}"))
    assert message.endswith("(hand.yaml)")


def test_a_name_that_a_part_takes_twice_is_told_by_its_use():
    text = FINGER.replace("name: turner", "name: index_flexor")
    with pytest.raises(RobotFileError, match=r"used as index_.*is taken already"):
        parse_robot(text)


NUMBERS = {
    "cables.index_flexor.preload": 6.25,
    "cables.thumb_flexor.preload": 7.75,
    "cables.index_flexor.nodes.1.radius": 0.0081,
    "cables.thumb_flexor.nodes.1.position.2": -0.0095,
    "cables.thumb_flexor.nodes.2.position.2": -0.0031,
    "cables.thumb_flexor.friction.mu_c": 0.13,
    "joints.index_tip.coupled.index_knuckle": 0.52,
    "joints.thumb_knuckle.offset": 0.01,
    "motors.index_pull.effort_scale": 1.1,
    "frames.index_finger.origin.1": 0.0705,
    "frames.thumb_bone.origin.1": 0.0005,
    "cables.turner.preload": 5.5,
    "friction.rho": 0.5,
}


@pytest.mark.parametrize("prefix", ["", "arm_"])
def test_numbers_are_written_for_each_use(prefix):
    text = FINGER + (f"prefix: {prefix}\n" if prefix else "")
    values = {}
    for path, value in NUMBERS.items():
        values[re.sub("(motors|joints|coupled)[.]", rf"\g<0>{prefix}", path)] = value
    before = parse_document(text, "hand")
    written = with_numbers_in_text(text, values, "hand")
    after = parse_document(written, "hand")
    assert {path: number_at(after, path) for path in values} == pytest.approx(values)
    part = written[written.index("parts:") : written.index("used:")]
    assert part == text[text.index("parts:") : text.index("used:")]
    for path in values:
        place = after
        *keys, last = find_number(after, path).keys
        for key in keys:
            place = place[key]
        if path in ("friction.rho", f"joints.{prefix}thumb_knuckle.offset",
                    f"motors.{prefix}index_pull.effort_scale"):  # fmt: skip
            del place[last]
        else:
            place[last] = number_at(before, path)
    after.pop("friction")
    assert after == before, "a number that was not to be written has changed"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("origin_mm: [40, 0, 0]", "origin_mm: [40, 0]", "mirror.* is possible in space only"),
        ("motion: revolute, joint: tip", "motion: rolling, radius: 1, joint: tip", "mirror.* roll"),
    ],
)
def test_what_cannot_be_mirrored_is_refused(old, new, said):
    with pytest.raises(RobotFileError, match=said):
        parse_robot(FINGER.replace(old, new))


def test_parts_do_not_go_with_the_frames_of_a_urdf():
    document = yaml.safe_load(FINGER)
    document["frames"] = {"urdf": "hand.urdf"}
    with pytest.raises(RobotFileError, match="parts cannot be used with the frames of a URDF"):
        parse_robot(yaml.safe_dump(document))
