"""A sample writes every number of the state and of the estimate, so that equal inputs agree."""

from __future__ import annotations

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros.estimation.estimator import initial_state
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.reader import load_robot, parse_robot

FILES = sorted(ROBOTS.glob("*.yaml"))

MIXED = """
name: mixed
motors: [{name: m}]
joints: [{name: q, range: [-1, 1]}]
frames: [{name: arm, motion: revolute, joint: q, origin: [0.3, 0, 0], axis: [0, 1, 0]}]
friction: {mu_c: 0.1}
cables:
  - name: by_tables
    axial_stiffness: 1e4
    preload: 10
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.02}
      - {type: pulley, radius: 0.02, wrap_angle: 1.0}
      - {type: anchor}
    spans: [0.1, 0.1]
  - name: by_positions
    axial_stiffness: 1e4
    preload: 10
    nodes:
      - {type: anchor, position: [0, 0, 0]}
      - {type: sphere, radius: 0.05, position: [0.2, 0.1, 0]}
      - {type: anchor, position: [0.1, 0, 0], frame: arm}
"""


def results(model: Model, odd: float | None) -> np.ndarray:
    """State and estimate after two samples; before each, others of this angle, if it is given."""
    robot = model.robot
    motor, joint = robot.reference_motors, robot.reference_pose
    state = initial_state(model)
    for k in range(2):
        if odd is not None:
            model.core.step(state, 10**9, 0.0 * motor + odd, 0.0 * joint + odd)
        stamp_ns = 10**6 * k
        state, estimate, solved = model.core.step(state, stamp_ns, motor + 1e-3 * k, joint)
        assert solved
    return np.concatenate([state.values, estimate])


@pytest.mark.parametrize(
    "robot", [*map(load_robot, FILES), parse_robot(MIXED)], ids=lambda robot: robot.name
)
def test_what_memory_held_before_does_not_count(robot: Robot) -> None:
    model = prepare(robot, check_range=False)
    first = results(model, None)
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, results(model, np.nan))
    np.testing.assert_array_equal(first, results(model, 0.07))
