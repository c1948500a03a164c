"""Geometry in space: closed forms, differences, virtual work, lift-off, and the plane."""

from math import acos, asin, atan2, cos, hypot, pi, sin, sqrt

import numpy as np
import pytest
from support.refusal import refusal

from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.reader import parse_robot

HEAD = """
name: space
motors: [{name: m}]
joints: [{name: q, range: [-1, 1]}, {name: p, range: [-0.5, 0.5]}]
frames:
  - {name: arm, motion: revolute, joint: q, origin: [0.3, 0.02, 0.01], rpy: [0.1, 0.2, 0.3],
     axis: [0, 1, 1]}
  - {name: hand, parent: arm, motion: prismatic, joint: p, origin: [0.2, 0, 0], axis: [1, 0.2, 0]}
  - {name: knee, parent: arm, motion: rolling, joint: p, origin: [0.1, 0, 0.02], radius: 0.02,
     rpy: [0.3, -0.2, 0.1]}
  - {name: finger, parent: hand, motion: continuous, joint: q, multiplier: -0.7, offset: 0.2,
     axis: [0, 0, 1], quaternion: [0, 0, 0.6, 0.8]}
friction: {mu_c: 0.1}
"""


def model_of(*nodes, head=HEAD, check=False):
    """A robot with one cable through the nodes."""
    cable = "cables:\n  - name: c\n    axial_stiffness: 1e4\n    preload: 10\n    nodes:\n"
    lines = "".join(f"      - {{{node}}}\n" for node in nodes)
    return prepare(parse_robot(head + cable + lines), check_range=check)


def anchor(x, y, z, frame="base"):
    return f"type: anchor, position: [{float(x)!r}, {float(y)!r}, {float(z)!r}], frame: {frame}"


def test_a_cable_lifts_off_and_comes_back_without_a_jump():
    head = HEAD.replace("[-0.5, 0.5]", "[-0.1, 0.1]")
    for body in (
        "type: cylinder, radius: 0.02, position: [0.1, 0, 0], axis: [0, 0, 1], turn: cw",
        "type: cylinder, radius: 0.02, position: [0.1, 0, 0], axis: [0, 0, 1]",
        "type: sphere, radius: 0.02, position: [0.1, 0, 0]",
    ):
        model = model_of(
            anchor(0, 0, 0),
            body,
            "type: eyelet, position: [0, 0, 0], frame: lift",
            anchor(0.3, 0.0, 0.0),
            head=head.replace(
                "friction:",
                "  - {name: lift, motion: prismatic, joint: p, origin: [0.2, 0.04, 0], "
                "axis: [0, 1, 0]}\nfriction:",
            ),
        )
        heights = np.linspace(-0.02, 0.04, 2001)
        shapes = [shape_at(model, np.array([0.0, height])) for height in heights]
        wrap = np.array([shape.wrap[0] for shape in shapes])
        length = np.array([shape.length[:3].sum() for shape in shapes])
        arm = np.array([shape.lever_arm[:3, 1].sum() for shape in shapes])
        off = wrap == 0.0
        assert 100 < off.sum() < 1900
        assert all(shape.possible and np.all(shape.length > 0.0) for shape in shapes)
        # sin of the angle of a line that just touches it
        touches = heights + 0.04 < 0.2 * np.tan(asin(0.2))
        assert np.array_equal(off, ~touches)
        step = heights[1] - heights[0]
        assert np.abs(np.diff(length) - step * (arm[1:] + arm[:-1]) / 2.0).max() < 1e-8
        assert np.abs(np.diff(wrap)).max() < 5e-4


MISTAKES = {
    "axis: [0, 0, 0]": ("axis: [0, 0, 1]", "axis must be a direction, not of the length 0"),
    "turn: up": ("turn: cw", "cables[0].nodes[1].turn must be one of ccw, cw, got 'up'"),
    "position: [0, 0]": ("position: [0, 0, 0]", "nodes[1].position must have three numbers"),
    "": (", turn: cw", "cables[0].nodes[1].turn is missing"),
    "rpy: [0, 0, 0], quaternion: [0, 0, 0, 1]": ("rpy: [0, 0, 0]", "are two orientations"),
    "quaternion: [0, 0, 0, 2]": ("rpy: [0, 0, 0]", "frames[0].quaternion must have the length 1"),
    "angle: 1": ("rpy: [0, 0, 0]", "frames[0].angle describes a frame in the plane; give rpy here"),
    "position: [0.05, 0.01, 0]}": (
        "position: [0.1, 0.1, 0]}", "cables[0].nodes[1] and nodes[2] (c) have no common tangent",
    ),
}  # fmt: skip


@pytest.mark.parametrize("wrong", MISTAKES)
def test_every_mistake_is_one_clear_line(wrong):
    text = """
name: wrong
motors: []
joints: [{name: q, range: [-1, 1]}]
frames: [{name: arm, motion: revolute, joint: q, rpy: [0, 0, 0]}]
cables:
  - name: c
    axial_stiffness: 1e4
    preload: 10
    nodes:
      - {type: anchor, position: [-1, 0, 0]}
      - {type: pulley, radius: 0.1, position: [0, 0, 0], axis: [0, 0, 1], turn: cw}
      - {type: anchor, position: [0.1, 0.1, 0]}
"""
    right, message = MISTAKES[wrong]
    assert right in text
    assert message in refusal(lambda: prepare(parse_robot(text.replace(right, wrong))))


def test_a_point_inside_a_sphere_is_named():
    with pytest.raises(RobotFileError, match=r"cables\[0\].nodes\[1\] \(c/2\) has a point"):
        model_of(
            anchor(0, 0, 0),
            "type: sphere, radius: 0.1, position: [0.15, 0, 0]",
            "type: eyelet, position: [0.2, 0, 0]",
            anchor(0.4, 0, 0),
        )


HELICAL = """
name: helix
motors: [{name: m, reference_angle: 0.5}]
joints: [{name: q, range: [-0.5, 0.5]}]
frames: [{name: arm, motion: prismatic, joint: q, axis: [1, 0, 0]}]
friction: {law: none}
cables:
  - name: c
    axial_stiffness: 1e5
    preload: 30
    nodes:
"""
DRUM = """
      - {type: winch, motor: m, winding: -1, radius: 0.02, pitch: 0.005, position: [0, 0, 0],
         axis: [0, 0, 1], turn: ccw}"""
POINT = "\n      - {type: anchor, frame: arm, position: [0.6, 0.1, 0.03]}"
REVERSED = HELICAL + POINT + DRUM.replace("ccw", "cw")
HELIX = HELICAL + DRUM + POINT
RADIUS, LEAD = 0.02, 0.005 / (2.0 * pi)


def helix_length(joint, motor):
    """Free cable from a helical drum to a point, and the cable that its turning has wound [m]."""
    x, y, z = 0.6 + joint, 0.1, 0.03
    away = hypot(x, y)
    leaves = atan2(y, x) - acos(RADIUS / away)  # counter-clockwise: the drum lies to the left
    start = atan2(0.1, 0.6) - acos(RADIUS / hypot(0.6, 0.1))
    wound = -(motor - 0.5) + (leaves - start)
    free = hypot(sqrt(away**2 - RADIUS**2), z - LEAD * wound)
    return free + hypot(RADIUS, LEAD) * (leaves - start)


def helix_cable(joint, motor):
    """Free cable from the drum to the point [m]."""
    x, y = 0.6 + joint, 0.1
    leaves = atan2(y, x) - acos(RADIUS / hypot(x, y))
    start = atan2(0.1, 0.6) - acos(RADIUS / hypot(0.6, 0.1))
    wound = -(motor - 0.5) + (leaves - start)
    return x - RADIUS * cos(leaves), y - RADIUS * sin(leaves), 0.03 - LEAD * wound


@pytest.mark.parametrize("text", [HELIX, REVERSED], ids=["first end", "last end"])
def test_a_helical_drum_lets_the_point_of_departure_wander(text):
    model = prepare(parse_robot(text))
    generator = np.random.default_rng(0)
    for joint, motor in generator.uniform([-0.4, -30.0], [0.4, 30.0], (50, 2)):
        found = shape_at(model, np.array([joint]), np.array([motor]))
        assert found.length[0] == pytest.approx(helix_length(joint, motor), abs=1e-14)
        x, y, z = helix_cable(joint, motor)
        assert found.lever_arm[0, 0] == pytest.approx(x / sqrt(x * x + y * y + z * z), abs=1e-13)
    at_rest = shape_at(model, np.zeros(1)).length[0]
    assert at_rest == shape_at(model, np.zeros(1), np.array([0.5])).length[0]


def test_the_effort_of_a_helical_drum_is_the_moment_of_its_cable_about_the_axis():
    model = prepare(parse_robot(HELIX))
    state = initial_state(model)
    for k, motor in enumerate(np.linspace(0.5, 0.49, 20)):
        sample = Sample(10**9 + k * 10**6, np.array([motor]), np.zeros(1))
        state, estimate = step(model, state, sample)
    x, y, z = helix_cable(0.0, motor)
    level = hypot(x, y)  # what pulls along the axis has no moment
    expected = estimate.tension[0] * RADIUS * level / hypot(level, z)
    assert estimate.tension[0] > 40.0
    assert estimate.motor_effort[0] == pytest.approx(expected, rel=1e-9)
