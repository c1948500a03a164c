"""Wrong units of a robot file are asked for before its geometry is judged."""

import re

import pytest
from support.places import ROBOTS, ROOT

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.impossible import unit_doubts
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.reader import parse_robot

PAGE = (ROOT / "docs" / "robot_file.md").read_text("utf-8")
ONE_JOINT = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[0]

MISTAKES = [
    ("range_deg: [-50, 50]", "range: [-45, 90]", "shoulder", "14.3 turns: is it range_deg?", False),
    (
        "range_deg: [-50, 50]",
        "range_deg: [-0.78, 1.57]",
        "shoulder",
        "in degrees: is it range, in",
        True,
    ),
    ("radius_mm: 15", "radius: 15", "flexor/1", "radius is 15 m: is it radius_mm?", False),
    (
        "radius_mm: 15",
        "radius_mm: 0.015",
        "flexor/1",
        "radius is 0.015 mm: is it radius, in m?",
        True,
    ),
    (
        "position_mm: [150, 60]",
        "position: [150, 60]",
        "flexor/2",
        "150 m away: is it position_mm?",
        True,
    ),
    (
        "frame: arm, radius_mm: 40, position_mm: [0, 0], turn: cw",
        "frame: arm, position: [20, 5]",
        "flexor/3",
        "20.6 m from the origin of its frame, and frames are at most 0.3 m apart: is it",
        False,
    ),
    ("origin_mm: [300, 0]", "origin: [300, 0]", "frame arm", "300 m away: is it origin_mm?", True),
]


@pytest.mark.parametrize(("right", "wrong", "where", "words", "possible"), MISTAKES)
def test_the_reader_or_check_robot_asks_for_the_unit(right, wrong, where, words, possible):
    assert right in ONE_JOINT
    robot = parse_robot(ONE_JOINT.replace(right, wrong, 1))
    doubt = next(unit_doubts(robot))
    assert doubt.where == where
    assert words in doubt.text
    if possible:
        found = find_suspicions(inspect_robot(prepare(robot)))[0]
        assert (found.where, found.text, found.grave) == (where, doubt.text, True)
    else:
        with pytest.raises(RobotFileError, match=re.escape(f"{where}: {doubt.text} With it ")):
            prepare(robot)


@pytest.mark.parametrize("path", sorted(ROBOTS.glob("*.yaml")))
def test_no_robot_of_the_package_is_doubted(path):
    assert list(unit_doubts(load_model(str(path)).robot)) == []
