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


def written(model: Model, filler: float) -> np.ndarray:
    """State and estimate after two samples whose memory was full of a number."""
    robot = model.robot
    motor = robot.reference_motors
    joint = robot.reference_pose
    before = initial_state(model).values
    for k in range(2):
        out = np.full(model.out_size, filler)
        assert model.core.step(before, motor + 1e-3 * k, joint, 1e-3 * k, out)
        before = out
    return before[: model.estimate_part.stop]


@pytest.mark.parametrize(
    "robot", [*map(load_robot, FILES), parse_robot(MIXED)], ids=lambda robot: robot.name
)
def test_what_memory_held_before_does_not_count(robot: Robot) -> None:
    model = prepare(robot, check_range=False)
    first = written(model, np.nan)
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, written(model, 7.0))
