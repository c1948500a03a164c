"""The compiled core gives the results of the present kernels, bit for bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros import _core
from cdrj_ros.model.mechanism import advance_all
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import LAWS, Law, Robot
from cdrj_ros.robot.reader import load_robot

ROBOTS = sorted((Path(__file__).parents[2] / "config" / "robots").glob("*.yaml"))
SAMPLES = 1500


def motion(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Angles of motors and joints that move against each other."""
    time = np.arange(SAMPLES)[:, None] * 1e-3
    lower, upper, middle = np.array(
        [(joint.lower, joint.upper, joint.reference_angle) for joint in robot.joints]
    ).T
    room = 0.25 * np.minimum(upper - middle, middle - lower)
    joints = middle + room * np.sin(2 * np.pi * time * (0.5 + 0.3 * np.arange(middle.size)))
    rest = np.array([motor.reference_angle for motor in robot.motors])
    motors = rest + 0.2 * np.sin(2 * np.pi * time * (0.4 + 0.3 * np.arange(rest.size)))
    return np.ascontiguousarray(motors), np.ascontiguousarray(joints)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_the_core_steps_every_robot_as_the_kernels_do(path: Path, law: Law) -> None:
    robot = load_robot(path)
    robot = replace(robot, cables=tuple(replace(cable, law=law) for cable in robot.cables))
    model = prepare(robot, check_range=False)
    motors, joints = motion(robot)
    dt = np.full(SAMPLES, 1e-3)
    estimates = np.empty((2, SAMPLES, model.layout.size))
    states = np.zeros((2, model.state_size))
    advance_all(model.plan, model.numbers, states[0], motors, joints, dt, estimates[0])
    _core.Robot(model.plan, model.numbers).run(states[1], motors, joints, dt, estimates[1])
    assert np.array_equal(estimates[0], estimates[1])
    assert np.array_equal(states[0], states[1])
