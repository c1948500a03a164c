"""Bodies that a cable ignores or never touches are named with the reason."""

import pytest

from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.prepared import prepare
from cdrj_ros.model.untouched import untouched_bodies
from cdrj_ros.robot.reader import parse_robot

WHEEL = """
name: wheel
motors: []
joints: [{{name: q, range: [-0.6, 0.6]}}]
frames: [{{name: arm, motion: revolute, joint: q, origin: [0, 0, 0], axis: [0, 0, 1]}}]
friction: {{mu_c: 0.1}}
cables:
  - name: c
    axial_stiffness: 1e4
    preload: 5
    nodes:
      - {{type: anchor, frame: arm, position: [{a}]}}
      - {{type: {kind}, radius: 0.05, position: [0, 0, 0], {more}}}
      - {{type: anchor, position: [{b}]}}
"""
CYLINDER = "axis: [0, 0, 1], ignored_inside: true"
CASES = {
    ("cylinder", CYLINDER, "-0.049, 0, 0", "0.0499, 0, 0"): (
        "the cylinder is ignored in all poses, for node 1 lies inside it, 49 mm from its centre, "
        "the radius is 50 mm: the cable passes up to 98.9 mm straight through it"
    ),
    ("sphere", "ignored_inside: true", "-0.3, 0, 0", "0.02, 0, 0"): (
        "the sphere is ignored in all poses, for node 3 lies inside it, 20 mm from its centre, "
        "the radius is 50 mm: the cable passes up to 70 mm straight through it"
    ),
    ("cylinder", CYLINDER, "-0.3, 0.2, 0", "0.3, 0.2, 0"): (
        "the cylinder is never touched: the straight cable passes it at a distance of "
    ),
    ("cylinder", "axis: [0, 0, 1], inside: true", "-0.08, 0.0, 0", "0.3, 0.01, 0"): (
        "the ring is never touched: the straight cable passes through its inside"
    ),
    ("sphere", "side: [0, 0.1, 0]", "-0.3, -0.01, 0", "0.3, 0, 0"): "",
}


@pytest.mark.parametrize("case", CASES)
def test_a_body_without_effect_is_named_with_the_reason(case):
    kind, more, a, b = case
    model = prepare(parse_robot(WHEEL.format(kind=kind, more=more, a=a, b=b)), check_range=False)
    found = list(untouched_bodies(model))
    if not CASES[case]:
        assert found == []
        return
    (one,) = found
    assert one.where == "c/2"
    assert one.text.startswith(CASES[case])
    assert one.grave == ("ignored" in one.text)
    assert one in find_suspicions(inspect_robot(model))


def test_a_body_that_is_ignored_in_some_poses_is_named_for_its_length_jumps():
    text = WHEEL.format(
        kind="sphere", more="ignored_inside: true", a="-0.3, 0, 0", b="0.3, 0.02, 0"
    )
    text = text.replace("motion: revolute", "motion: prismatic").replace(
        "axis: [0, 0, 1]", "axis: [1, 0, 0]"
    )
    (one,) = untouched_bodies(prepare(parse_robot(text), check_range=False))
    assert one.text.startswith("the sphere is ignored in 7 % of the poses, where node 1 lies ")
    assert one.text.endswith("the length jumps on the way")
    assert one.grave
