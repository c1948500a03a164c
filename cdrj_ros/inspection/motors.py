"""What motors tell: whether they turn as far as cables allow, and of joints without encoder.

While the cables are taut, a motor follows the joints.  Angles that follow several times as far, or
a fraction as far, were published before a gear, in another unit, or with the other sign.  Where a
joint has no encoder, the motors' efforts must determine its angle.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from math import isinf, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Matrix, Vector
from cdrj_ros.inspection.ranges import following_motors
from cdrj_ros.model.impossible import Suspicion
from cdrj_ros.model.prepared import Model, shape_at

FEWEST: Final = 8
"""Smallest number of poses that are compared."""

KEPT: Final = 60
"""Number of poses that are kept."""

LEAST_TURN: Final = 0.02
"""Smallest travel of a motor that following the joints needs for a comparison [rad]."""

APART: Final = 2.0
"""Factor by which a travel must differ from the one that the cables allow, or its inverse."""

SCATTER: Final = 0.3
"""Largest deviation from a proportional motion, as a fraction of it."""


class MotorTravel:
    """Compares the motions of motors and joints over the latest poses."""

    def __init__(self, model: Model) -> None:
        """Start without a pose."""
        self._model = model
        self._read: deque[Vector] = deque(maxlen=KEPT)
        self._expected: deque[Vector] = deque(maxlen=KEPT)

    def add(self, motor_angle: Vector, joint_angle: Vector) -> None:
        """Add a pose: the angles of all motors and joints [rad] or [m]."""
        if not self._model.robot.unmeasured:
            self._read.append(motor_angle.copy())
            self._expected.append(following_motors(self._model, joint_angle[None, :])[0])

    def ratios(self) -> dict[str, float]:
        """Travel of every motor in units of the travel that follows the joints.

        Returns:
            By the name of those motors that clearly follow the joints with a factor other than 1:
            outside of 1 / ``APART`` to ``APART``, or negative.
        """
        if len(self._read) < FEWEST:
            return {}
        columns = np.array(self._read).T, np.array(self._expected).T
        found = {}
        for name, read, expected in zip(self._model.layout.motors, *columns, strict=True):
            y, x = read - read.mean(), expected - expected.mean()
            if not np.ptp(x) > LEAST_TURN:  # NaN too: no such pose
                continue
            ratio = float(x @ y / (x @ x))
            scatter = float(np.sqrt(np.mean((y - ratio * x) ** 2)))
            follows_it = scatter < SCATTER * abs(ratio) * float(np.std(x))
            if follows_it and not 1.0 / APART < ratio < APART:
                found[name] = ratio
        return found

    def suspicion(self) -> str:
        """What may be wrong with which motor, and the key that mends it; empty if nothing is."""
        scale = {motor.name: motor.sensor.scale for motor in self._model.robot.motors}
        return "; ".join(
            f"{name} turns {abs(ratio):.3g} times as far as its cables allow"
            + (", the other way" if ratio < 0.0 else "")
            + f": gear ratio, unit or sign? scale: {scale[name] / ratio:.4g} would fit"
            for name, ratio in self.ratios().items()
        )


POSES: Final = 5
"""Poses along the range of each joint without encoder; the others stand at their reference."""

LEAST_SLOPE: Final = 1e-6
"""Singular value of the scaled slopes below which a direction is not determined."""


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
    slopes: Matrix = -signs[:, None] * (robot.drums.T @ (stiffness[:, None] * longer))
    return slopes


def _stddevs(slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviations of the least-squares solution; infinite where it is not unique.

    Args:
        slopes: derivatives of the efforts, each divided by its standard deviation, (m, u).
    """
    size = np.sqrt((slopes**2).sum(axis=0))
    if not np.all(size > 0.0):
        return np.where(size > 0.0, 1.0 / np.maximum(size, 1e-300), np.inf)
    scaled = slopes / size
    _, values, directions = np.linalg.svd(scaled, full_matrices=True)
    found = np.zeros(size.size)
    for k in range(size.size):
        value = values[k] if k < values.size else 0.0
        part = directions[k] ** 2
        if value > LEAST_SLOPE:
            found += part / value**2
        else:
            found = np.where(part > LEAST_SLOPE, np.inf, found)
    return np.asarray(np.sqrt(found) / size)
