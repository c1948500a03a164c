"""Contact cells that are fixed to the surface of a body, onto which a joint's motion lays cable."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import initial_state
from cdrj_ros.model.packing import constant_views, state_views
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Pulley, Robot
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation.assembly import make_rig
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
    return parse_robot(f"""
name: crank
motors: [{{name: m}}]
joints:
  - {{name: turn, range: [0.4, 2.2], reference_angle: {pose[0]}}}
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


def walk(model: Model, joints: Table, motor: Table) -> Table:
    """States along a motion."""
    state, states = initial_state(model), np.zeros((len(joints), model.state_size))
    for k, (m, q) in enumerate(zip(motor, joints, strict=True)):
        state, _, solved = model.core.step(state, 10**6 * k, m, q)
        assert solved
        states[k] = state.values
    return states


@pytest.mark.parametrize("guide", GUIDES)
def test_no_material_is_lost_as_cells_come_and_leave(guide: str) -> None:
    rng = np.random.default_rng(4)
    steps = np.cumsum(rng.normal(0.0, 0.02, (2, TIME.size)), axis=1)
    angle = -0.1 + 0.6 * np.sin(steps[0])
    joints = poses(angle, 0.11 - RADIUS * (angle + 0.3) + 0.0005 * np.sin(steps[1]))
    model = make_rig(crank(guide, joints[0]), 24).fine
    states = state_views(model.sizes, walk(model, joints, still()))
    width = constant_views(model.sizes, model.constants).pulleys[0].cell_width
    half = 0.5 * states.covered
    moved = [np.ptp(states.track + side * half) for side in (-1, 1)]
    assert max(moved) > 5.0 * width
    material = states.material.sum(axis=1)
    for drum in states.drums.T:  # the drum takes up cable as its tangent moves
        top = drum["points"].astype(int) - 1
        material += drum["material"][np.arange(top.size), top]
    np.testing.assert_allclose(material, material[0], rtol=1e-12)
    assert states.material.min() > 0.0
