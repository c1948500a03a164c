"""A passive cable with a length of its own may be a spring, whose strain is no fault."""

from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

SPRING = """
name: x
motors: []
joints: [{name: a, range: [-0.1, 0.1]}]
frames: [{name: f, motion: revolute, joint: a, origin: [0.1, 0]}]
cables:
  - {name: c, axial_stiffness: 20, %s, nodes: [
      {type: anchor, position: [0, 0.1]}, {type: anchor, frame: f, position: [0.1, 0]}]}
"""


def test_only_a_cable_given_by_its_preload_is_said_to_be_stretched_too_much():
    for given, expected in (("rest_length: 0.15", False), ("preload: 8", True)):
        found = find_suspicions(inspect_robot(prepare(parse_robot(SPRING % given))))
        assert any("the preload alone stretches it" in one.text for one in found) is expected
