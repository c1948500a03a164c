"""Points on rims: lengths and arms are continuous, whatever the last bit of a position is."""

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.reader import parse_robot

RADIUS = 0.2
SHIFTS = (0.0, 2e-16, -2e-16, 1e-13, -1e-13, -1e-9, -1e-7)
"""By which the point's distance from the axis differs from the radius, over the radius."""

BODIES = {
    "cylinder": "type: cylinder, radius: {r!r}, position: [0, 0, 0], axis: [0, 0, 1]",
    "cylinder, side": "type: cylinder, radius: {r!r}, position: [0, 0, 0], axis: [0, 0, 1], "
    "side: [0.02, 0.5, 0]",
    "cylinder, turn": "type: cylinder, radius: {r!r}, position: [0, 0, 0], axis: [0, 0, 1], "
    "turn: cw",
    "cylinder, turns": "type: cylinder, radius: {r!r}, position: [0, 0, 0], axis: [0, 0, 1], "
    "turn: cw, turns: 1",
    "cylinder, ring": "type: cylinder, radius: {r!r}, position: [0, 0, 0], axis: [0, 0, 1], "
    "inside: true",
    "sphere": "type: sphere, radius: {r!r}, position: [0, 0, 0]",
    "sphere, side": "type: sphere, radius: {r!r}, position: [0, 0, 0], side: [0.02, 0.5, 0.1]",
    "sphere, ring": "type: sphere, radius: {r!r}, position: [0, 0, 0], inside: true",
    "pulley": "type: pulley, radius: {r!r}, position: [0, 0, 0], axis: [0, 0, 1], turn: cw",
}
LOWER = {"cylinder, turn": 1.0, "cylinder, turns": 1.0, "pulley": 1.0}
"""Lower end of the range of the bodies whose cable winds on in the given sense [rad]."""
UPPER = {"cylinder": 1.6, "sphere": 1.4, "sphere, side": 1.4}
"""Upper end where the cable takes the other way beyond: it passes the centre at 1.7 rad."""


def roped(body, rim, *, height=0.0, radius=RADIUS, low=-2.7):
    """A cable from a point at the distance ``rim`` of the axis, which turns, past a body."""
    return prepare(
        parse_robot(
            f"""
name: rope
motors: [{{name: m}}]
joints: [{{name: q, range: [{low}, 2.7], reference_angle: 1.5}}]
frames: [{{name: wheel, motion: revolute, joint: q, origin: [0, 0, 0], axis: [0, 0, 1]}}]
friction: {{mu_c: 0.1}}
uncertainty: {{others: exact}}
cables:
  - name: c
    axial_stiffness: 300
    preload: 20
    nodes:
      - {{type: anchor, frame: wheel, position: [0, {rim!r}, 0]}}
      - {{{body.format(r=radius)}}}
      - {{type: winch, motor: m, winding: 1, radius: 0.01, position: [0.8, 0.1, {height}]}}
"""
        ),
        check_range=False,
    )


def totals(shapes):
    """Length and arm of the whole cable in every pose."""
    return (
        np.array([shape.length.sum() for shape in shapes]),
        np.array([shape.lever_arm.sum() for shape in shapes]),
    )


@pytest.mark.parametrize("height", [0.0, 0.05])
@pytest.mark.parametrize("body", BODIES)
def test_length_and_arm_are_continuous_and_those_of_a_rim_that_is_smaller_by_a_micrometre(
    body, height
):
    low, high = LOWER.get(body, -2.7), UPPER.get(body, 2.7)
    smaller = roped(BODIES[body], RADIUS, height=height, radius=RADIUS - 1e-6, low=low)
    angles = np.linspace(low, high, 901)
    wanted = [shape_at(smaller, np.array([angle])) for angle in angles]
    for shift in SHIFTS:
        model = roped(BODIES[body], RADIUS * (1.0 + shift), height=height, low=low)
        found = [shape_at(model, np.array([angle])) for angle in angles]
        assert all(shape.possible for shape in found)
        length, arm = totals(found)
        other_length, other_arm = totals(wanted)
        np.testing.assert_allclose(length, other_length, atol=2e-5)
        np.testing.assert_allclose(arm, other_arm, atol=2e-3 * RADIUS)
        if body != "pulley" or not height:  # arms out of the plane of a groove: model.md, 13.2
            mean = 0.5 * (arm[1:] + arm[:-1])
            np.testing.assert_allclose(np.diff(length), mean * np.diff(angles), atol=5e-6)
        assert np.abs(np.diff(arm)).max() < 12e-3 * RADIUS


@pytest.mark.parametrize("body", BODIES)
def test_tensions_do_not_depend_on_the_last_bit_of_a_position(body):
    low, high = LOWER.get(body, -2.7), UPPER.get(body, 2.7)
    rows = []
    for shift in SHIFTS[:3]:
        model = roped(BODIES[body], RADIUS * (1.0 + shift), low=low)
        state, found = initial_state(model), []
        for k in range(600):
            angle = 0.5 * (low + high) + 0.4 * (high - low) * np.sin(0.02 * k)
            turned = (shape_at(model, np.array([angle])).length.sum() - 0.9) / 0.01
            sample = Sample(10**9 + k * 10**7, np.array([turned]), np.array([angle]))
            state, estimate = step(model, state, sample)
            assert estimate.solved
            found.append(estimate.tension.copy())
        rows.append(found)
    np.testing.assert_allclose(rows[1], rows[0], atol=1e-4)
    np.testing.assert_allclose(rows[2], rows[0], atol=1e-4)


def past_swivel(origin, axis, point):
    """A cable along z to a swivel at the origin, and on to a point that slides."""
    return prepare(
        parse_robot(
            f"""
name: swivel
motors: []
joints: [{{name: x, range: [-0.01, 0.01], reference_angle: 0.001}}]
frames: [{{name: f, motion: prismatic, joint: x, origin: {origin}, axis: {axis}}}]
friction: {{mu_c: 0.1}}
cables:
  - {{name: c, axial_stiffness: 1e4, preload: 5, nodes: [
      {{type: anchor, position: [0, 0, -0.1]}},
      {{type: swivel, radius: 0.02, position: [0, 0, 0], axis: [0, 0, 1]}},
      {{type: anchor, frame: f, position: {point}}}]}}
"""
        ),
        check_range=False,
    )


def test_a_point_that_moves_through_the_rim_of_a_swivel_changes_nothing_at_once():
    model = past_swivel([0.04, 0.0, -0.01], [1, 0, 0], [0.0, 0.0, 0.01])
    shapes = [shape_at(model, np.array([x])) for x in (0.0, 1e-17, 1e-12, 1e-8)]
    assert all(shape.possible for shape in shapes)
    length, arm = totals(shapes)
    np.testing.assert_allclose(length, length[0], atol=1e-7)
    np.testing.assert_allclose(arm, arm[0], atol=2e-3)
    assert not shape_at(model, np.array([-0.005])).possible


def test_a_straight_cable_past_a_swivel_has_no_wrap_whatever_side_rounding_puts_it_on():
    for aside in (0.0, 1e-18, -1e-18, 1e-12):
        model = past_swivel([0.0, 0.0, 0.1], [0, 0, 1], [aside, 0.0, 0.0])
        shape = shape_at(model, np.array([0.005]))
        assert shape.length.sum() == pytest.approx(0.205, abs=1e-11)
        assert shape.wrap[0] == pytest.approx(0.0, abs=1e-9)
        assert shape.lever_arm.sum() == pytest.approx(1.0)


def test_no_pose_is_possible_where_a_body_begins_to_be_ignored():
    body = BODIES["cylinder, side"] + ", ignored_inside: true"
    assert shape_at(roped(body, RADIUS * (1.0 - 3e-6)), np.array([1.5])).wrap[0] == 0.0
    assert shape_at(roped(body, RADIUS * (1.0 - 0.5e-6)), np.array([1.5])).wrap[0] > 1.0
    with pytest.raises(RobotFileError, match=r"has a point of nodes\[0\] inside"):
        roped(body, RADIUS * (1.0 - 1.5e-6))


UNDECIDED = {
    "past the centre": ("cylinder", 1.5707963267948966),
    "past the centre of a sphere": ("sphere", 1.5707963267948966),
    "opposite to the side": ("cylinder, side", 0.0),
    "opposite to the side of a sphere": ("sphere, side", 0.0),
}


@pytest.mark.parametrize("case", UNDECIDED)
def test_where_rounding_would_decide_between_two_ways_nothing_is_estimated(case):
    name, turned = UNDECIDED[case]
    body = BODIES[name].replace("[0.02, 0.5, 0]", "[0, -0.5, 0]")
    body = body.replace("[0.02, 0.5, 0.1]", "[0, -0.5, 0]")
    model = roped(body.format(r=0.1), 0.3)
    far = np.array([0.8, 0.1])
    angle = np.arctan2(-far[1], -far[0]) - np.pi / 2 if turned else 0.0
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    state, estimate = step(model, initial_state(model), Sample(10**9, np.zeros(1), np.array([1.5])))
    assert estimate.solved
    before, after = (shape_at(model, np.array([angle + d])) for d in (-1e-6, 1e-6))
    assert before.possible
    assert after.possible
    at = np.array([angle])
    assert not shape_at(model, at).possible
    _, estimate = step(model, state, Sample(2 * 10**9, np.zeros(1), at))
    assert (estimate.status == INVALID).all()


def test_where_two_points_coincide_the_length_is_continuous_and_nothing_is_estimated():
    model = prepare(
        parse_robot(
            """
name: meeting
motors: []
joints: [{name: x, range: [-0.1, 0.1], reference_angle: 0.05}]
frames: [{name: f, motion: prismatic, joint: x, origin: [0, 0, 0], axis: [1, 0, 0]}]
friction: {mu_c: 0.1}
cables:
  - {name: c, axial_stiffness: 1e4, preload: 5, nodes: [
      {type: anchor, position: [0, 0.1, 0]}, {type: eyelet, position: [0, 0, 0]},
      {type: eyelet, frame: f, position: [0, 0, 0]},
      {type: anchor, frame: f, position: [0.1, 0.1, 0]}]}
"""
        ),
        check_range=False,
    )
    lengths = [shape_at(model, np.array([x])).length.sum() for x in (-1e-7, 1e-7)]
    assert lengths[0] == pytest.approx(lengths[1], abs=1e-6)
    for x in (0.0, 1e-17, -1e-12):
        assert not shape_at(model, np.array([x])).possible


def test_the_length_of_a_sheath_does_not_depend_on_where_its_ends_are_to_rounding():
    lengths = []
    for shift in (0.0, 1e-16, -1e-16):
        model = prepare(
            parse_robot(
                f"""
name: sheath
motors: []
joints: [{{name: q, range: [-1, 1]}}]
frames: [{{name: f, motion: revolute, joint: q, origin: [0, 0, 0], axis: [0, 0, 1]}}]
friction: {{mu_c: 0.1}}
cables:
  - {{name: c, axial_stiffness: 1e4, preload: 5, nodes: [
      {{type: anchor, position: [-0.3, 0, 0]}},
      {{type: sheath, position: [-0.2, 0, 0], exit: [0, {RADIUS * (1 + shift)!r}, 0],
        exit_frame: f, length: 0.5, bend: 0.3}},
      {{type: cylinder, radius: {RADIUS}, position: [0, 0, 0], axis: [0, 0, 1]}},
      {{type: anchor, position: [0.8, 0.1, 0]}}]}}
"""
            )
        )
        lengths.append([shape_at(model, np.array([q])).length for q in (-0.5, 0.0, 0.3, 1.0)])
    np.testing.assert_allclose(lengths[1], lengths[0], atol=1e-12)
    np.testing.assert_allclose(lengths[2], lengths[0], atol=1e-12)
