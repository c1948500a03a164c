"""Contact cells that are fixed to the surface of a body, onto which a joint's motion lays cable."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.packing import number_views
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.model.state import state_views
from cdrj_ros.robot.description import Pulley, Robot
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation.assembly import divide_contacts, make_rig
from cdrj_ros.simulation.truth import simulate

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

RADIUS, MU, PRELOAD, STIFFNESS = 0.02, 0.2, 50.0, 6000.0
TIME = np.arange(4001) * 1e-3

PLANE = """
  - {name: arm, motion: revolute, joint: turn}
  - {name: slide, parent: arm, motion: prismatic, joint: out, direction: [1, 0]}
"""
SPACE = """
  - {name: arm, motion: revolute, joint: turn, axis: [0, 0, 1]}
  - {name: slide, parent: arm, motion: prismatic, joint: out, axis: [1, 0, 0]}
"""
GUIDES = {
    "plane": (
        PLANE,
        """
      - {type: winch, motor: m, winding: 1, radius: 0.01, position: [-0.2, -0.03], turn: ccw}
      - {type: pulley, radius: 0.02, position: [0, 0], turn: ccw}
      - {type: anchor, frame: slide, position: [0.1, 0]}
        """,
    ),
    "mirrored plane": (
        PLANE,
        """
      - {type: winch, motor: m, winding: 1, radius: 0.01, position: [-0.2, 0.03], turn: cw}
      - {type: pulley, radius: 0.02, position: [0, 0], turn: cw}
      - {type: anchor, frame: slide, position: [0.1, 0]}
        """,
    ),
    "reversed plane": (
        PLANE,
        """
      - {type: anchor, frame: slide, position: [0.1, 0]}
      - {type: pulley, radius: 0.02, position: [0, 0], turn: cw}
      - {type: winch, motor: m, winding: 1, radius: 0.01, position: [-0.2, -0.03], turn: cw}
        """,
    ),
    "space": (  # a helix of constant slope
        SPACE,
        """
      - {type: winch, motor: m, winding: 1, radius: 0.01, position: [-0.2, -0.03, 0], turn: ccw,
         axis: [0, 0, 1]}
      - {type: cylinder, radius: 0.02, position: [0, 0, 0], axis: [0, 0, 1], turn: ccw}
      - {type: anchor, frame: slide, position: [0.1, 0, 0.03]}
        """,
    ),
}


def crank(guide: str, pose: Vector) -> Robot:
    """A cable over a round body; its anchor moves about the body's axis and away from it.

    Args:
        guide: of ``GUIDES``.
        pose: of the preload [rad] and [m].
    """
    frames, nodes = GUIDES[guide]
    sign = -1 if guide.startswith("mirrored") else 1
    lower, upper = sorted((0.4 * sign, 2.2 * sign))
    return parse_robot(f"""
name: crank
motors: [{{name: m}}]
joints:
  - {{name: turn, range: [{lower}, {upper}], reference_angle: {pose[0]}}}
  - {{name: out, range: [-0.05, 0.05], reference_angle: {pose[1]}}}
frames: {frames}
friction: {{mu_c: {MU}, rho: 1}}
cables:
  - name: c
    axial_stiffness: {STIFFNESS}
    preload: {PRELOAD}
    nodes: {nodes}
        """)


def with_guide(robot: Robot, **values: Any) -> Robot:
    """The robot with other values of the pulleys of its only cable."""
    (cable,) = robot.cables
    nodes = tuple(replace(n, **values) if isinstance(n, Pulley) else n for n in cable.nodes)
    return replace(robot, cables=(replace(cable, nodes=nodes),))


def poses(angle: Vector, span: Vector) -> Table:
    """Poses in which the cable leaves the body at an angle, with a free span behind it."""
    x = RADIUS * np.cos(angle) - span * np.sin(angle)
    y = RADIUS * np.sin(angle) + span * np.cos(angle)
    return np.stack([np.arctan2(y, x), np.hypot(x, y) - 0.1], axis=-1)


def involute(angle: Vector) -> Table:
    """Poses along an involute of the body, on which a cable keeps its length."""
    return poses(angle, 0.1 - RADIUS * (angle - angle[0]))


def still(time: Vector = TIME) -> Table:
    return np.zeros((time.size, 1))


@pytest.mark.parametrize("cells", [2, 8, 31])
@pytest.mark.parametrize("guide", GUIDES)
def test_cable_that_is_laid_on_and_taken_off_along_an_involute_keeps_its_tension(
    guide: str, cells: int
) -> None:
    joints = involute(-0.6 + 0.5 * (1.0 - np.cos(2.0 * np.pi * 0.5 * TIME)))
    joints[:, 0] *= -1 if guide.startswith("mirrored") else 1
    rig = make_rig(crank(guide, joints[0]), cells)
    truth = simulate(rig.lumped.robot, TIME, joints, motor_angle=still(), cells=cells)
    assert rig.fine.sizes.surfaces == 1
    np.testing.assert_allclose(truth.tension, PRELOAD, rtol=0.0, atol=1e-6)


def test_cable_keeps_the_tension_with_which_it_was_laid_on() -> None:
    """The tension rises more slowly along the arc than friction can hold, so nothing slides."""
    angle = -0.6 + 0.5 * (1.0 - np.cos(np.pi * TIME / TIME[-1]))
    tension = PRELOAD * np.exp(0.5 * MU * (angle - angle[0]))
    laid = RADIUS / (1.0 + tension / STIFFNESS)
    taken = np.cumsum(0.5 * (laid[1:] + laid[:-1]) * np.diff(angle), dtype=np.float64)
    material = 0.11 / (1.0 + PRELOAD / STIFFNESS) - np.concatenate([[0.0], taken])
    joints = poses(angle, material * (1.0 + tension / STIFFNESS))
    robot = crank("plane", joints[0])
    friction = robot.cables[0].pulleys[0].friction
    rigid = with_guide(robot, friction=replace(friction, bristle_stiffness=1e12))
    errors = []
    for cells in (4, 8, 16, 32):
        truth = simulate(rigid, TIME, joints, motor_angle=still(), cells=cells)
        np.testing.assert_allclose(truth.tension[:, 0], PRELOAD, rtol=0.0, atol=1e-6)
        errors.append(np.abs(truth.tension[:, 1] - tension).max())
    rise = tension[-1] - PRELOAD
    assert rise > 5.0
    assert errors[-1] < 0.003 * rise
    assert all(more > 1.7 * less for more, less in pairwise(errors))


def dragged() -> tuple[Table, Table]:
    """Motor and joint angles of a cable that slides to and fro while an end of its arc moves."""
    angle = -0.3 + 0.5 * np.sin(2.0 * np.pi * 0.4 * TIME)
    motor = 0.5 * np.sin(2.0 * np.pi * 0.3 * TIME) * RADIUS
    return motor[:, None], poses(angle, 0.11 - RADIUS * (angle + 0.3))


@pytest.mark.parametrize("guide", ["plane", "space"])
def test_a_cable_dragged_over_a_body_converges_with_the_number_of_cells(guide: str) -> None:
    motor, joints = dragged()
    robot = crank(guide, joints[0])
    found = {
        n: simulate(robot, TIME, joints, motor_angle=motor, cells=n).tension for n in (2, 6, 18, 90)
    }
    assert np.ptp(found[90][:, 1] / found[90][:, 0]) > 0.02, "friction is at work"
    errors = [np.abs(found[n] - found[90]).mean() for n in (2, 6, 18)]
    assert errors[0] > 2.0 * errors[1] > 4.0 * errors[2]
    assert errors[2] < 1e-4 * PRELOAD


def test_a_sliding_cable_obeys_eulers_formula_for_the_arc_of_the_moment() -> None:
    angle = -0.4 + 0.3 * np.sin(2.0 * np.pi * 0.4 * TIME)
    motor = -0.6 * TIME[:, None]  # pays out
    joints = poses(angle, 0.11 - RADIUS * (angle + 0.4) + 0.006 * TIME)
    truth = simulate(crank("plane", joints[0]), TIME, joints, motor_angle=motor, cells=8)
    start = np.arctan2(-0.03, -0.2)
    offset = np.arcsin((RADIUS - 0.01) / np.hypot(0.2, 0.03))
    entry = start + np.pi - offset  # direction of the cable before the pulley
    wrap = np.mod(angle + 0.5 * np.pi - entry + np.pi, 2.0 * np.pi) - np.pi
    sliding = TIME > 1.0
    ratio = truth.tension[sliding, 1] / truth.tension[sliding, 0]
    # only cable that has just been laid on does not slide yet
    capstan = np.exp(MU * wrap[sliding])
    assert np.all(ratio < capstan * (1.0 + 1e-9))
    np.testing.assert_allclose(ratio, capstan, rtol=2e-4)
    np.testing.assert_allclose(np.median(ratio / capstan), 1.0, atol=1e-9)


def half_turn() -> Robot:
    return parse_robot("""
        name: half_turn
        motors: [{name: m}]
        joints: []
        friction: {mu_c: 0.15, mu_s: 0.2, stribeck_speed: 0.01, rho: 0.8, bearing_friction: 0.05}
        cables:
          - name: c
            axial_stiffness: 6283
            preload: 30
            nodes:
              - {type: winch, motor: m, winding: 1, radius: 0.015}
              - {type: pulley, radius: 0.01, bearing_diameter: 0.004, wrap_angle_deg: 180}
              - {type: anchor}
            spans: [0.2, 0.2]
        """)


def test_where_no_end_of_an_arc_moves_its_cells_are_equal_parts() -> None:
    divided = divide_contacts(half_turn(), 8)
    assert [(pulley.cells, pulley.cell_width) for pulley in divided.cables[0].pulleys] == [(8, 0.0)]


def test_cells_on_a_surface_are_those_of_an_arc_that_does_not_move() -> None:
    time = np.arange(3000) * 1e-3
    motor = (0.1 * np.sin(2.0 * np.pi * 0.7 * time))[:, None]
    samples = Samples(1 + np.arange(3000) * 1_000_000, motor, np.empty((3000, 0)))
    found = []
    for values in ({"cells": 8}, {"cells": 9, "cell_width": 0.01 * np.pi / 8}):
        model = prepare(with_guide(half_turn(), **values))
        estimates = run(model, initial_state(model), samples)[1].values
        found.append(estimates[:, : model.layout.iterations.start])
    assert np.ptp(found[0][:, 0]) > 1.0
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9, atol=1e-9)


def walk(model: Model, joints: Table, motor: Table) -> Table:
    """States along a motion."""
    out, states = np.zeros(model.out_size), np.zeros((len(joints), model.state_size))
    state = np.zeros(model.state_size)
    for k, (m, q) in enumerate(zip(motor, joints, strict=True)):
        assert model.core.step(state, m, q, 1e-3 if k else 0.0, out)
        state = out[model.state_part].copy()
        states[k] = state
    return states


@pytest.mark.parametrize("guide", GUIDES)
def test_no_material_is_lost_as_cells_come_and_leave(guide: str) -> None:
    rng = np.random.default_rng(4)
    steps = np.cumsum(rng.normal(0.0, 0.02, (2, TIME.size)), axis=1)
    angle = -0.1 + 0.6 * np.sin(steps[0])
    joints = poses(angle, 0.11 - RADIUS * (angle + 0.3) + 0.0005 * np.sin(steps[1]))
    joints[:, 0] *= -1 if guide.startswith("mirrored") else 1
    model = make_rig(crank(guide, joints[0]), 24).fine
    states = state_views(model.sizes, walk(model, joints, still()))
    width = number_views(model.sizes, model.numbers).pulleys[0].cell_width
    half = 0.5 * states.covered
    moved = [np.ptp(states.track + side * half) for side in (-1, 1)]
    assert max(moved) > 5.0 * width
    material = states.material.sum(axis=1)
    for drum in states.drums.T:  # the drum takes up cable as its tangent moves
        top = drum["points"].astype(int) - 1
        material += drum["material"][np.arange(top.size), top]
    np.testing.assert_allclose(material, material[0], rtol=1e-12)
    assert states.material.min() > 0.0


def arm() -> Robot:
    """Two joints in series, moved by two cables over a pulley on the first joint's axis."""
    cable = """
  - name: {name}
    axial_stiffness: 8000
    preload: 40
    nodes:
      - {{type: winch, motor: {name}, radius_mm: 10, winding: 1, position_mm: [-60, {y}],
         turn: {turn}}}
      - {{type: pulley, radius_mm: 12, position_mm: [0, 0], turn: {turn}}}
      - {{type: pulley, radius_mm: 9, frame: link1, position_mm: [90, 0], turn: {turn}}}
      - {{type: anchor, frame: link2, position_mm: [60, {end}]}}
"""
    return parse_robot(
        """
name: arm
motors: [{name: up}, {name: down}]
joints:
  - {name: shoulder, range_deg: [-35, 35]}
  - {name: elbow, range_deg: [-35, 35]}
frames:
  - {name: link1, motion: revolute, joint: shoulder}
  - {name: link2, parent: link1, motion: revolute, joint: elbow, origin_mm: [90, 0]}
friction: {mu_c: 0.2, rho: 1}
cables:
"""
        + cable.format(name="up", y=60, end=40, turn="ccw")
        + cable.format(name="down", y=-60, end=-40, turn="cw")
    )


def test_rig_and_estimator_agree_on_an_arm_whose_arcs_grow_and_shrink() -> None:
    robot = arm()
    time = np.arange(8001) * 1e-3
    joints = np.stack([0.55 * np.sin(1.9 * time), 0.5 * np.sin(2.7 * time)], axis=1)
    truth = simulate(robot, time, joints, cells=24)
    assert make_rig(robot, 24).fine.sizes.surfaces >= 2
    model = prepare(robot)
    samples = Samples(1 + np.arange(time.size) * 1_000_000, truth.motor_angle, joints)
    estimate = run(model, initial_state(model), samples)[1].values[:, model.layout.tension]
    error = np.abs(estimate - truth.tension) / truth.tension
    assert np.ptp(truth.tension, axis=0).max() > 10.0
    assert error.mean(axis=0).max() < 0.0015


def over_a_bar() -> Robot:
    """A cable that a joint lifts off a bar."""
    return parse_robot("""
name: over_a_bar
motors: [{name: m}]
joints: [{name: height, range: [-0.05, 0.1]}]
frames: [{name: hook, motion: prismatic, joint: height, axis: [0, 1, 0]}]
friction: {mu_c: 0.3, rho: 1}
cables:
  - name: c
    axial_stiffness: 6000
    preload: 50
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.01, position: [-0.2, 0, 0]}
      - {type: cylinder, radius: 0.02, position: [0, 0, 0], axis: [0, 0, 1], side: [0, 1, 0]}
      - {type: anchor, frame: hook, position: [0.2, 0, 0]}
        """)


def test_a_cable_that_has_been_lifted_off_has_forgotten_its_friction() -> None:
    robot, time = over_a_bar(), np.arange(6001) * 1e-3
    up = np.clip((time - 2.0) / 1.0, 0.0, 1.0) - np.clip((time - 4.0) / 1.0, 0.0, 1.0)
    height = np.where(time < 2.0, 0.0, 0.08 * up)
    pulled = 0.06 * np.sin(np.pi * np.minimum(time, 1.5) / 1.5) * np.exp(-time)
    pulled[time > 1.5] = 0.0
    one, other = (
        simulate(robot, time, height, motor_angle=motor, cells=12).tension
        for motor in (pulled, np.zeros_like(pulled))
    )
    touching, lifted, back = (time > 1.6) & (time < 2.0), (time > 3.0) & (time < 4.0), time > 5.5
    assert np.abs(one - other)[touching].max() > 1.0
    np.testing.assert_allclose(one[lifted, 0], one[lifted, 1], rtol=1e-9)
    np.testing.assert_allclose(one[back], other[back], rtol=1e-5)
    assert np.ptp(one[back][0]) > 0.1, "friction holds a difference again"


def test_mirrored_robots_have_the_same_tensions() -> None:
    motor, joints = dragged()
    found = []
    for guide, sign in (("plane", 1.0), ("mirrored plane", -1.0)):
        course = joints * [sign, 1.0]
        robot = with_guide(crank(guide, course[0]), cells=9, cell_width=0.005)
        model = prepare(robot)
        samples = Samples(1 + np.arange(TIME.size) * 1_000_000, motor, course)
        estimates = run(model, initial_state(model), samples)[1].values
        found.append(estimates[:, model.layout.tension])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-7)
