"""What another pose changes: the numbers that are fitted, and where the joint's range then ends."""

import numpy as np
import pytest
from support.made_up import recording
from support.places import PROTOTYPE, ROBOTS

from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.identification.fit import identify
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.priors import (
    MARGIN,
    Reach,
    moved_ranges,
    pose_ranges,
    pose_unknowns,
    search_ranges,
)
from cdrj_ros.identification.problem import Settings
from cdrj_ros.identification.unknowns import parse_unknowns, with_bounds
from cdrj_ros.robot.document import parse_document
from cdrj_ros.robot.parameters import number_at, with_numbers
from cdrj_ros.robot.reader import build_robot, load_document

ONE_CABLE = """
name: arm
motors: [{name: winch, spring_stiffness: 0.01}]
joints: [{name: elbow, range: [-1, 1]}]
friction: {mu_c: 0.1}
cables:
  - name: c
    axial_stiffness: 1000
    preload: 10
    nodes:
      - {type: winch, motor: winch, winding: 1, radius: 0.01}
      - {type: pulley, radius: 0.01, wrap_angle: 1.0, bearing_torque: 0.002}
      - {type: pulley, radius: 0.01, wrap_angle: 1.0, friction: {mu_c: 0}}
      - {type: anchor}
    spans: [0.1, 0.1, {joint: elbow, offset: 0.05, slope: 0.02}]
uncertainty: {others: exact, parameters: [cables.c.preload], stddev: [3.0]}
"""


def arm(**numbers):
    document = parse_document(ONE_CABLE, "arm")
    return with_numbers(document, {key.replace("__", "."): v for key, v in numbers.items()})


def recorded(angle):
    stamps = 1_000_000_000 + np.arange(angle.size) * 5_000_000
    series = Series(stamps, stamps, angle)
    return Recorded("bag", {"winch": series}, {"elbow": series}, {})


def test_a_pose_changes_zeros_rests_preloads_wraps_and_drag_and_nothing_else():
    document = arm()
    found = pose_unknowns(document, build_robot(document, "arm"))
    priors = {one.unknown.paths[0]: one.unknown.prior for one in found}
    assert priors == {
        "joints.elbow.reference_angle": None,
        "motors.winch.spring_rest": None,
        "cables.c.preload": pytest.approx((10.0, 3.0)),  # as stated, which is more than a tenth
        "cables.c.nodes.2.wrap_angle": pytest.approx((1.0, 0.5)),
        "cables.c.nodes.2.bearing_torque": pytest.approx((0.002, 0.0006)),
    }


def test_a_robot_with_positions_keeps_its_geometry_in_another_pose():
    document, source = load_document(ROBOTS / "prototype_positions.yaml")
    found = pose_unknowns(document, build_robot(document, source))
    assert {one.unknown.paths[0].rsplit(".", 1)[1] for one in found} == {
        "reference_angle", "preload",
    }  # fmt: skip


def test_a_joint_within_its_range_keeps_it():
    assert moved_ranges(arm(), "arm", [recorded(np.linspace(-1.0, 1.0, 9))]) == {}


def test_a_few_wrong_readings_do_not_widen_the_range():
    angle = np.linspace(-0.9, 0.9, 5001)
    angle[[100, 2000]] = 50.0, np.nan
    assert moved_ranges(arm(), "arm", [recorded(angle)]) == {}
    angle = np.linspace(0.8, 1.8, 5001)
    angle[[100, 2000]] = -50.0, 50.0
    span = moved_ranges(arm(), "arm", [recorded(angle)])["elbow"]
    assert (span.lowest, span.highest) == pytest.approx((0.8, 1.8), abs=2e-3)


def test_the_new_range_ends_a_tenth_of_the_stroke_beyond_the_readings_and_the_zero():
    readings = [recorded(np.linspace(0.8, 1.5, 9)), recorded(np.linspace(1.0, 1.8, 9))]
    moved = moved_ranges(arm(), "arm", readings)
    assert moved == {"elbow": Reach(0.8, 1.8)}
    for zero, ends in ((1.2, (0.8, 1.8)), (2.0, (0.8, 2.0)), (0.5, (0.5, 1.8))):
        numbers = pose_ranges(moved, {"joints.elbow.reference_angle": zero})
        assert numbers == {
            "joints.elbow.range.1": pytest.approx(ends[0] - MARGIN),
            "joints.elbow.range.2": pytest.approx(ends[1] + MARGIN),
        }


def test_a_zero_is_sought_a_stroke_beyond_the_readings_or_as_far_as_the_geometry_allows():
    """The last element has no length left at -2.5 rad."""
    free = search_ranges(arm(), "arm", {"elbow": Reach(1.5, 2.5)})
    assert free["joints.elbow.range.1"] == pytest.approx(0.5)
    assert free["joints.elbow.range.2"] == pytest.approx(3.5)
    narrow = search_ranges(arm(), "arm", {"elbow": Reach(-2.2, -1.2)})
    assert -3.2 < narrow["joints.elbow.range.1"] < -2.2
    assert narrow["joints.elbow.range.2"] == pytest.approx(-0.2)
    with pytest.raises(RobotFileError, match="has the length"):
        search_ranges(arm(), "arm", {"elbow": Reach(-4.0, -3.0)})


def test_the_bounds_of_a_zero_are_its_joints_range_whatever_its_start():
    document = arm(joints__elbow__range__1=-1.5, joints__elbow__range__2=9.0)
    (unknown,) = parse_unknowns(document, "joints.elbow.reference_angle")
    assert (unknown.lower, unknown.upper) == (-1.5, 9.0)


@pytest.mark.parametrize(("bounds", "said"), [(None, True), ((-1.0, 0.2), False)])
def test_a_zero_at_the_end_of_the_range_is_named_with_what_to_widen(bounds, said):
    document, _ = load_document(PROTOTYPE)
    path = "joints.elbow.reference_angle"
    truth = with_numbers(document, {path: 0.4})
    made = recording(truth, 5.0, amplitude=0.2)
    narrow = with_numbers(document, {"joints.elbow.range.1": -0.3, "joints.elbow.range.2": 0.25})
    unknowns = with_bounds(parse_unknowns(narrow, path), {path: bounds} if bounds else {})
    found = identify(narrow, "narrow", unknowns, [made], Settings(coarse=True))
    assert number_at(truth, path) == 0.4
    (sentence,) = [text for text in found.findings if "ended at its upper bound" in text]
    assert path in sentence
    assert ("widen it" in sentence) is said


def test_a_zero_is_found_where_the_cable_is_slack_around_the_start():
    """The start of the fit has no slope at all: only the search over the whole range finds it."""
    document, _ = load_document(PROTOTYPE)
    path = "joints.elbow.reference_angle"
    truth = with_numbers(document, {path: 0.45})
    made = recording(truth, 5.0, amplitude=0.5)
    unknowns = parse_unknowns(with_numbers(document, {path: -0.6}), path)
    found = identify(document, "far", unknowns, [made], Settings(coarse=True, sought=(path,)))
    assert found.values[0] == pytest.approx(0.45, abs=1e-3)
