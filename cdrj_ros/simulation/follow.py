"""Motor angles at which the drums compensate the joints' motion, as a position controller commands.

``follow_joints`` gives them for whole motions, ``program_of`` step by step for the live rig.

A cable keeps its tension if its drums compensate its change of length: r dphi = -dL.  With more
cables than motors this holds in the least-squares sense, and the remainder stretches the cables.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Joint
from cdrj_ros.simulation import motion
from cdrj_ros.simulation.assembly import course
from cdrj_ros.simulation.drives import Program
from cdrj_ros.simulation.load import AT_AN_END

MotionName = Literal["none"] | motion.MotionKind

MOTIONS: Final[tuple[MotionName, ...]] = ("none", *motion.MOTIONS)

BEGIN_S: Final = 1.0
"""Rest before the motion [s]."""

SHARE: Final = 0.6
"""Amplitude, as a share of the distance to the nearer end of the range."""

FREQUENCY_HZ: Final = 0.2
"""Frequency of the cycle, or the highest frequency of a random motion [Hz]."""

APPROACH_S: Final = 2.0
"""Duration of the move to the middle of the range if the reference is at its end [s]."""

AHEAD: Final = 50
"""Number of steps that are computed at once."""


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
    reference = robot.reference_pose[None]
    lengths = course(model, np.concatenate([reference, joint_angle])).length
    total = np.add.reduceat(lengths, [part.start for part in robot.parts], axis=1)
    longer, drums = total[1:] - total[0], robot.drums
    wound = np.any(drums != 0.0, axis=1)
    turned = -longer[:, wound] @ np.linalg.pinv(drums[wound]).T
    untaken = np.where(wound, longer + turned @ drums.T, 0.0)
    rest = robot.reference_motors
    return Following(rest + turned, untaken)


def pull_together(model: Model, joint: int) -> Vector:
    """Ratios of the motor speeds that load one joint, scaled to a largest of 1; shape (motors,).

    Raises:
        UsageError: no motor acts on the joint.
    """
    robot = model.robot
    if len(robot.motors) == 1:
        return np.ones(1)
    reference = robot.reference_pose
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


def program_of(
    model: Model, joint: int, rate: float, kind: MotionName, seed: int = 0
) -> Program | None:
    """Motor angles by step of a rig, as in ``simulate --mode forward``.

    The free joint moves about the reference, or about the middle of its range if the reference is
    at an end of it.

    Args:
        model: the prepared robot.
        joint: index of the free joint.
        rate: steps per second [Hz].
        kind: of the motion; if it is none, the function returns None.
        seed: of a random motion.
    """
    if kind == "none":
        return None
    angle_at = _angle_of(model.robot.joints[joint], kind, seed)
    reference = model.robot.reference_pose

    @lru_cache(maxsize=1)
    def block(number: int) -> Table:
        poses = np.tile(reference, (AHEAD, 1))
        poses[:, joint] = angle_at(np.arange(number * AHEAD, (number + 1) * AHEAD) / rate)
        return follow_joints(model, poses).motor_angle

    return lambda step: block(step // AHEAD)[step % AHEAD].copy()


def _angle_of(axis: Joint, kind: motion.MotionKind, seed: int) -> Callable[[Vector], Vector]:
    """Angle of the joint as a function of time."""
    centre, begin = axis.reference_angle, BEGIN_S
    most = min(centre - axis.lower, axis.upper - centre)
    if most < AT_AN_END * (axis.upper - axis.lower):
        centre, begin = 0.5 * (axis.lower + axis.upper), BEGIN_S + APPROACH_S
        most = 0.5 * (axis.upper - axis.lower)
    move = motion.named_motion(kind, SHARE * most, FREQUENCY_HZ, seed, begin, centre)
    away = axis.reference_angle - centre

    def angle(time: Vector) -> Vector:
        return move(time) + away * (1.0 - motion.smooth_step((time - BEGIN_S) / APPROACH_S))

    return angle
