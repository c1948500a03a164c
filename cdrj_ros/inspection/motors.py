"""Whether the efforts of motors determine the angles of joints without encoder, and how well."""

from __future__ import annotations

from collections.abc import Iterator
from math import isinf, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Matrix
from cdrj_ros.model.impossible import Suspicion
from cdrj_ros.model.prepared import Model, shape_at

POSES: Final = 5
"""Poses along the range of each joint without encoder; the others stand at their reference."""

LEAST_SLOPE: Final = 1e-6
"""Singular value of the scaled slopes, relative to the largest, of a direction that is not
determined."""


def encoderless_suspicions(model: Model) -> Iterator[Suspicion]:
    """Whether the efforts determine the joints without encoder, and how well."""
    robot = model.robot
    for joint, stddev in determined_joints(model).items():
        if isinf(stddev):
            yield Suspicion(
                joint,
                "has no encoder, and the efforts of the motors do not determine its angle",
            )
            continue
        unit, factor = ("mm", 1e3) if joint in robot.prismatic_joints else ("deg", 180.0 / pi)
        yield Suspicion(
            joint,
            "has no encoder: while its cables pull, the noise of the efforts alone leaves its "
            f"angle uncertain by {factor * stddev:.2g} {unit} (standard deviation, worst pose)",
            grave=False,
        )


def determined_joints(model: Model) -> dict[str, float]:
    """How well each joint without encoder follows from the efforts, friction left aside.

    A change of a joint's angle stretches its cables, whose tension then turns the motors.  With
    cables that pull, this slope depends on lengths, EA and drums only.

    Returns:
        Largest standard deviation over the poses that follows from the noise of the efforts alone,
        while all cables pull, by joint [rad] or [m]; infinite where they do not determine it.
    """
    robot = model.robot
    noise = np.array([motor.effort_noise for motor in robot.motors])
    reference = robot.reference_pose
    worst = np.zeros(len(robot.unmeasured))
    for k in robot.unmeasured:
        joint = robot.joints[k]
        for angle in np.linspace(joint.lower, joint.upper, POSES):
            pose = reference.copy()
            pose[k] = angle
            slopes = effort_slopes(model, pose)[:, robot.unmeasured] / noise[:, None]
            worst = np.maximum(worst, _stddevs(slopes))
    names = [robot.joints[j].name for j in robot.unmeasured]
    return dict(zip(names, worst.tolist(), strict=True))


def effort_slopes(model: Model, joint_angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivatives of the motors' efforts by the joint angles with taut cables and no friction.

    Args:
        model: the prepared robot.
        joint_angle: the pose [rad] or [m], shape (joints,).

    Returns:
        [N m/rad] or [N m/m], shape (motors, joints).
    """
    robot = model.robot
    shape = shape_at(model, joint_angle)
    starts = [part.start for part in robot.parts]
    length, longer = (np.add.reduceat(one, starts) for one in (shape.length, shape.lever_arm))
    stiffness = [cable.axial_stiffness for cable in robot.cables] / length
    signs = np.array([motor.effort_sign for motor in robot.motors])
    slopes: Matrix = -signs[:, None] * (robot.effective_radii.T @ (stiffness[:, None] * longer))
    return slopes


def _stddevs(slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviations of the least-squares solution; infinite where it is not unique.

    Args:
        slopes: derivatives of the efforts, each divided by its standard deviation, (m, u).
    """
    size = np.sqrt((slopes**2).sum(axis=0))
    scaled = slopes / np.where(size > 0.0, size, 1.0)
    inverse = np.linalg.pinv(scaled, rcond=LEAST_SLOPE)
    known = np.diag(inverse @ scaled)  # 1 where a joint's angle is unique
    stddev = np.sqrt((inverse**2).sum(axis=1)) / np.maximum(size, 1e-300)
    return np.where(known > 1.0 - LEAST_SLOPE, stddev, np.inf)
