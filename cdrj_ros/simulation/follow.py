"""Motor angles at which the drums compensate the joints' motion, as a position controller commands.

A cable keeps its tension if its drums compensate its change of length: r dphi = -dL.  With more
cables than motors this holds in the least-squares sense, and the remainder stretches the cables.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.along import course
from cdrj_ros.model.prepared import Model
from cdrj_ros.simulation.faults import drums_of

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


@dataclass(frozen=True)
class Following:
    """Motor angles that follow the joints."""

    motor_angle: Table
    """[rad], shape (n, motors)."""
    untaken: Table
    """Uncompensated change of length [m], 0 for cables without a winch, shape (n, cables)."""


def follow_joints(model: Model, joint_angle: Table) -> Following:
    """Motor angles that compensate the cables' changes of length, from the reference pose on.

    Args:
        model: the prepared robot.
        joint_angle: shape (n, joints).

    Raises:
        UsageError: the geometry is impossible in one of the poses.
    """
    robot = model.robot
    reference = np.array([[joint.reference_angle for joint in robot.joints]])
    lengths = course(model, np.concatenate([reference, joint_angle])).length
    first = np.cumsum([0] + [len(cable.nodes) - 1 for cable in robot.cables])[:-1]
    total = np.add.reduceat(lengths, first, axis=1)
    longer = total[1:] - total[0]
    drums = np.zeros((len(robot.cables), len(robot.motors)))
    for cable, _, motor, radius in drums_of(robot):
        drums[cable, motor] += radius
    wound = np.any(drums != 0.0, axis=1)
    turned = -longer[:, wound] @ np.linalg.pinv(drums[wound]).T
    untaken = np.where(wound, longer + turned @ drums.T, 0.0)
    rest = np.array([motor.reference_angle for motor in robot.motors])
    return Following(rest + turned, untaken)


def pull_together(model: Model, joint: int) -> Vector:
    """Ratios of the motor speeds that load one joint, scaled to a largest of 1; shape (motors,).

    Raises:
        UsageError: no motor acts on the joint.
    """
    robot = model.robot
    if len(robot.motors) == 1:
        return np.ones(1)
    reference = np.array([axis.reference_angle for axis in robot.joints])
    span = robot.joints[joint].upper - robot.joints[joint].lower
    poses = np.tile(reference, (2, 1))
    step = 1e-3 * span
    poses[1, joint] += step if reference[joint] + step <= robot.joints[joint].upper else -step
    angles = follow_joints(model, poses).motor_angle
    way = angles[1] - angles[0]
    most = float(np.abs(way).max())
    if most < 1e-9:
        raise UsageError(f"no motor's cable acts on {robot.joints[joint].name}")
    return np.asarray(way / most)
