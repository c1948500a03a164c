"""A coupled joint equals the same robot with that joint measured, and work is kept."""

import numpy as np
import pytest
from support.followers import assert_same_tensions_and_work
from support.refusal import refusal

from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.groups import part_of
from cdrj_ros.robot.names import PREFIX, given
from cdrj_ros.robot.parameters import find_number, matching_paths, with_numbers
from cdrj_ros.robot.reader import build_robot, parse_robot

LEADERS = ("a", "b")
REFERENCE = np.array([0.2, -0.1])
SHARES = {"hinge": (0.7, -0.4), "slide": (0.02, 0.01), "one": (-0.6, 0.0)}
OFFSETS = {"hinge": 0.15, "slide": 0.005, "one": 0.3}
FOLLOWERS = tuple(SHARES)

FINGER = """
name: finger
motors: [{name: m}]
joints:
  - {name: a, range: [-1, 1], reference_angle: 0.2}
  - {name: b, range: [-0.8, 0.8], reference_angle: -0.1}
%s
frames:
  - {name: one, motion: revolute, joint: a, origin: [0.1, 0, 0.01], axis: [0, 0, 1]}
  - {name: two, parent: one, motion: revolute, joint: b, origin: [0.1, 0, 0], axis: [0, 0.2, 1]}
  - {name: three, parent: two, motion: revolute, joint: hinge, origin: [0.1, 0, 0],
     axis: [0.1, 0, 1], rpy: [0.1, 0.2, -0.3], multiplier: 1.2, offset: -0.1}
  - {name: four, parent: three, motion: prismatic, joint: slide, origin: [0.05, 0, 0],
     axis: [1, 0.5, 0]}
  - {name: five, parent: four, motion: rolling, joint: one, origin: [0.02, 0, 0], radius: 0.01}
friction: {mu_c: 0.15}
uncertainty: {others: exact}
cables:
  - name: placed
    axial_stiffness: 600
    preload: 20
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.01, position: [0, 0.02, 0]}
      - {type: cylinder, radius: 0.008, frame: one, position: [0, 0, 0], axis: [0, 0, 1], turn: cw}
      - {type: sphere, radius: 0.006, frame: two, position: [0, 0, 0], side: [0, 0.1, 0]}
      - {type: eyelet, frame: three, position: [0.02, 0.008, 0.002]}
      - {type: eyelet, frame: four, position: [0.01, 0.008, 0]}
      - {type: anchor, frame: five, position: [0.01, 0.01, 0.004]}
  - name: tabled
    axial_stiffness: 600
    preload: 15
    nodes:
      - {type: winch, motor: m, winding: -1, radius: 0.01}
      - {type: pulley, radius: 0.01, wrap_angle: {joint: hinge, offset: 1.5, slope: 0.4}}
      - {type: pulley, radius: 0.01, wrap_angle: {joint: one, offset: 2, sine: 0.2}}
      - {type: anchor}
    spans:
      - {joint: hinge, offset: 0.2, slope: -0.011}
      - [0.1, {joint: one, offset: 0.02, sine: 0.01}, {joint: a, slope: 0.01}]
      - {joint: one, angle: [-0.4, 0, 0.3, 1], value: [0.1, 0.104, 0.11, 0.112]}
"""


def followers(angles):
    """Angles of the followers from those of the leaders."""
    return np.array([OFFSETS[name] + np.dot(SHARES[name], angles) for name in FOLLOWERS])


def coupled_entries():
    lines = []
    for name, shares in SHARES.items():
        given = ", ".join(f"{one}: {s}" for one, s in zip(LEADERS, shares, strict=True) if s)
        lines.append(f"  - {{name: {name}, coupled: {{{given}}}, offset: {OFFSETS[name]}}}")
    return "\n".join(lines)


def measured_entries():
    at = dict(zip(FOLLOWERS, followers(REFERENCE), strict=True))
    ranges = {"hinge": [-1.5, 1.5], "slide": [-0.1, 0.1], "one": [-0.31, 0.91]}
    return "\n".join(
        f"  - {{name: {name}, range: {ranges[name]}, reference_angle: {float(at[name])!r}}}"
        for name in FOLLOWERS
    )


@pytest.fixture(scope="module")
def coupled():
    return prepare(parse_robot(FINGER % coupled_entries()), check_range=False)


@pytest.fixture(scope="module")
def measured():
    return prepare(parse_robot(FINGER % measured_entries()), check_range=False)


MAP = np.array([[1.0, 0.0], [0.0, 1.0], *SHARES.values()])
"""Angles of all joints of the measured robot per angle of the leaders."""


def test_lengths_and_wraps_are_those_of_the_measured_robot_and_arms_follow_by_the_chain_rule(
    coupled, measured
):
    for seed in range(50):
        angles = np.random.default_rng(seed).uniform([-1.0, -0.8], [1.0, 0.8])
        one = shape_at(coupled, angles)
        other = shape_at(measured, np.concatenate([angles, followers(angles)]))
        assert one.possible
        np.testing.assert_allclose(one.length[:5], other.length[:5], atol=1e-15)
        np.testing.assert_allclose(one.wrap[:4], other.wrap[:4], atol=1e-13)
        np.testing.assert_allclose(one.lever_arm[:5], other.lever_arm[:5] @ MAP, atol=1e-14)
        # tables over other ranges have other grids
        np.testing.assert_allclose(one.length[5:], other.length[5:], atol=2e-8)
        np.testing.assert_allclose(one.lever_arm[5:], other.lever_arm[5:] @ MAP, atol=2e-6)


@pytest.mark.parametrize(
    ("cables", "effort", "share"),
    [([0], 1e-9, 1e-11), ([0, 1], 2e-3, 1e-4)],  # tables over other ranges have other grids
)
def test_tensions_are_those_of_the_measured_robot_and_the_efforts_do_the_same_work(
    cables, effort, share, coupled, measured
):
    coupled, measured = (
        prepare(build_robot(part_of(one.robot, cables), "part"), check_range=False)
        for one in (coupled, measured)
    )
    t = 0.01 * np.arange(400)
    motion = REFERENCE + np.stack([0.3 * np.sin(t), -0.2 * np.sin(2.3 * t)], axis=1)
    assert_same_tensions_and_work(
        coupled, measured, lambda angles: np.concatenate([angles, followers(angles)]), motion,
        motors=0.02 * t, compared=slice(5), effort=effort, share=share,
    )  # fmt: skip


def test_a_slide_that_is_coupled_to_a_hinge_leaves_it_a_hinge(coupled):
    assert coupled.robot.prismatic_joints == frozenset()


def test_shares_and_offsets_are_numbers_of_the_file_with_default_standard_deviations():
    text = (FINGER % coupled_entries()).replace("uncertainty: {others: exact}\n", "")
    robot = parse_robot(text)
    assert find_number(robot.document, "joints.hinge.coupled.a").value == 0.7
    assert find_number(robot.document, "joints.one.offset").value == 0.3
    assert matching_paths(robot.document, "joints.hinge.coupled.*") == (
        ("joints.hinge.coupled.a", "joints.hinge.coupled.b"),
    )
    stddev = robot.uncertainty.stddev
    assert stddev["joints.hinge.coupled.a"] == pytest.approx(0.021)
    assert stddev["joints.one.offset"] == pytest.approx(np.pi / 180.0)
    changed = build_robot(with_numbers(robot.document, {"joints.hinge.coupled.b": -0.5}), "x")
    (frame,) = [one for one in changed.frames if one.name == "three"]
    assert frame.multiplier == pytest.approx(-0.6)
    assert "joints.hinge.reference_angle" not in stddev


def test_a_prefix_stands_before_the_joints_that_move_a_coupled_one():
    with given(PREFIX, "left_"):
        robot = parse_robot(FINGER % coupled_entries())
    assert [joint.name for joint in robot.joints] == ["left_a", "left_b"]
    assert {frame.joint for frame in robot.frames} == {None, "left_a", "left_b"}


MISTAKES = {
    "coupled: {c: 1}": "joints[2].coupled must name joints that are not coupled (a, b), got 'c'",
    "coupled: {x: 1}": "joints[2].coupled must name joints that are not coupled (a, b), got 'x'",
    "coupled: {}": "joints[2].coupled must be: ",
    "coupled: {a: 0}": "joints[2].coupled.a must not be 0: leave the joint out",
    "coupled: {a: 1, b: high}": "joints[2].coupled.b must be of type number, got 'high'",
    "coupled: {a: 1}, range: [0, 1]": "joints[2].range is not a known key",
    "coupled: {a: .nan}": "joints[2].coupled.a must be a finite number",
}


@pytest.mark.parametrize("entry", MISTAKES)
def test_a_wrong_coupling_is_one_clear_line(entry):
    text = (FINGER % coupled_entries()).replace("coupled: {a: 0.7, b: -0.4}", entry)
    text = text.replace("name: hinge", "name: c").replace("joint: hinge", "joint: c")
    assert MISTAKES[entry] in refusal(parse_robot, text)


def test_a_sum_is_refused_where_it_would_not_be_linear():
    text = FINGER % coupled_entries()
    for change, message in (
        (("joint: one, origin", "joint: hinge, origin"),
         "frames[4].motion must not be rolling: hinge follows several joints"),
        (("{joint: one, offset: 0.02, sine", "{joint: hinge, offset: 0.02, sine"),
         "cables[1].spans[1][1] must have offset and slope alone, for hinge follows several"),
    ):  # fmt: skip
        assert message in refusal(parse_robot, text.replace(*change))
