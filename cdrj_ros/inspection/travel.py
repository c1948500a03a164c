"""Whether motors turn as far as the cables allow, and the single mistake that explains it if not.

While the cables are taut, a motor follows the joints.  Angles that follow several times as far, or
a fraction as far, were published before a gear, in another unit, or with the other sign; those
that follow other joints were published under the name of another axis.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Matrix, Vector
from cdrj_ros.inspection.ranges import following_motors
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Joint, Motor

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

THINNED: Final = 5
"""Every so many poses are compared where many mistakes are."""

UNIT: Final = 0.1
"""Largest deviation with motors in degrees, beside which gears of 50 and 64 are other mistakes."""

BETTER: Final = 3.0
"""Factor by which a single mistake must reduce the deviation of the motors to be named."""

SLIGHT: Final = 1e-3
"""Change of a joint's angle from which the slopes of the motors' follow [rad] or [m]."""


Indices = NDArray[np.intp]


class Mistake(NamedTuple):
    """A mistake in the readings, and the angles without it."""

    words: str
    motor: Matrix
    """[rad], shape (n, motors)."""
    joint: Matrix
    """[rad] or [m], shape (n, joints)."""
    within: float
    """Largest deviation of the motors without it, as a fraction of their motion [-]."""


class MotorTravel:
    """Compares the motions of motors and joints over the latest poses."""

    def __init__(self, model: Model) -> None:
        """Start without a pose."""
        self._model = model
        self._motor: deque[Vector] = deque(maxlen=KEPT)
        self._joint: deque[Vector] = deque(maxlen=KEPT)
        self._expected: deque[Vector] = deque(maxlen=KEPT)

    def add(self, motor_angle: Vector, joint_angle: Vector) -> None:
        """Add a pose: the angles of all motors and joints [rad] or [m]."""
        if not self._model.robot.unmeasured:
            self._motor.append(motor_angle.copy())
            self._joint.append(joint_angle.copy())
            self._expected.append(following_motors(self._model, joint_angle[None, :])[0])

    def ratios(self) -> dict[str, float]:
        """Travel of every motor in units of the travel that follows the joints.

        Returns:
            By the name of those motors that clearly follow the joints with a factor other than 1:
            outside of 1 / ``APART`` to ``APART``, or negative.
        """
        if len(self._motor) < FEWEST:
            return {}
        columns = np.array(self._motor).T, np.array(self._expected).T
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
        """What may be wrong with which axis, and the key that mends it; empty if nothing is."""
        if mistake := self._mistake():
            return mistake
        scale = {motor.name: motor.sensor.scale for motor in self._model.robot.motors}
        return "; ".join(
            f"{name} turns {abs(ratio):.3g} times as far as its cables allow"
            + (", the other way" if ratio < 0.0 else "")
            + f": gear ratio, unit or sign? scale: {scale[name] / ratio:.4g} would fit"
            for name, ratio in self.ratios().items()
        )

    def _mistake(self) -> str:
        """The single mistake by which all motors follow the joints, if they do not as read."""
        if len(self._motor) < FEWEST:
            return ""
        motor, joint, expected = (
            np.array(one)[::THINNED] for one in (self._motor, self._joint, self._expected)
        )
        present = _deviations(motor, expected)
        if not (wrong := present > SCATTER).any():
            return ""
        robot = self._model.robot
        there, here = robot.reference_pose, robot.reference_motors
        steps = there + SLIGHT * np.eye(len(there))
        slopes = (following_motors(self._model, steps) - here) / SLIGHT
        motors = np.flatnonzero(wrong)
        joints = np.flatnonzero((np.abs(slopes) > LEAST_TURN)[:, wrong].any(axis=1))

        def roughly(one: Mistake) -> float:
            return float(_deviations(one.motor, (one.joint - there) @ slopes).max())

        best = min(self._mistakes(motor, joint, motors, joints), key=roughly)
        found = _deviations(best.motor, following_motors(self._model, best.joint)).max()
        return best.words if found < min(best.within, present.max() / BETTER) else ""

    def _mistakes(
        self, motor: Matrix, joint: Matrix, motors: Indices, joints: Indices
    ) -> Iterator[Mistake]:
        """What may have gone wrong: the unit of all motors or joints, or two names.

        Args:
            motor: angles as read [rad], shape (n, motors).
            joint: angles as read [rad] or [m], shape (n, joints).
            motors: those whose names may be exchanged.
            joints: those whose names may be exchanged.
        """
        robot = self._model.robot
        turns = np.array([one.name not in robot.prismatic_joints for one in robot.joints])
        words = "seem to be in degrees{}: give scale as scale_deg, 1 where the file has none"
        radians = np.where(turns, _in_degrees(robot.joints, joint), joint)
        yield Mistake(f"the joints {words.format('')}", motor, radians, SCATTER)
        words = words.format(" (or before gears of about 57)")
        yield Mistake(f"the motors {words}", _in_degrees(robot.motors, motor), joint, UNIT)
        words = "the readings of {} and {} seem to be swapped: exchange their names"
        for a, b in combinations(motors, 2):
            pair = robot.motors[a].name, robot.motors[b].name
            yield Mistake(words.format(*pair), _swapped(robot.motors, motor, a, b), joint, SCATTER)
        for a, b in combinations(joints, 2):
            pair = robot.joints[a].name, robot.joints[b].name
            yield Mistake(words.format(*pair), motor, _swapped(robot.joints, joint, a, b), SCATTER)


def _in_degrees(axes: Sequence[Motor | Joint], angle: Matrix) -> Matrix:
    """Angles that would follow from the readings if these were in degrees."""
    offset = np.array([axis.sensor.offset for axis in axes])
    radians: Matrix = offset + np.radians(angle - offset)
    return radians


def _swapped(axes: Sequence[Motor | Joint], angle: Matrix, a: int, b: int) -> Matrix:
    """Angles that would follow from the readings if two axes exchanged them."""
    scale = np.array([axis.sensor.scale for axis in axes])
    offset = np.array([axis.sensor.offset for axis in axes])
    order = np.arange(len(axes))
    order[[a, b]] = b, a
    swapped: Matrix = offset + scale * ((angle - offset) / scale)[:, order]
    return swapped


def _deviations(read: Matrix, expected: Matrix) -> Vector:
    """Deviation of every motor from its expected motion, as a fraction of that [-].

    Args:
        read: angles of the motors [rad], shape (n, motors).
        expected: those that follow the joints.

    Returns:
        Shape (motors,); infinite where no motor should move, or a pose is not possible.
    """
    y, x = read - read.mean(axis=0), expected - expected.mean(axis=0)
    if not np.ptp(x, axis=0).max() > LEAST_TURN:
        return np.full(x.shape[1], np.inf)
    motion = np.maximum(x.std(axis=0), 0.25 * LEAST_TURN)
    deviations: Vector = np.sqrt(np.mean((y - x) ** 2, axis=0)) / motion
    return deviations


def travel_suspicion(model: Model, motor_angle: Matrix, joint_angle: Matrix) -> str:
    """What may be wrong with which axis of a recording, and the key that mends it; or empty.

    Args:
        model: the robot.
        motor_angle: [rad], shape (n, motors).
        joint_angle: [rad] or [m], shape (n, joints).
    """
    travel = MotorTravel(model)
    for k in np.linspace(0, len(motor_angle) - 1, KEPT).astype(int):
        travel.add(motor_angle[k], joint_angle[k])
    return travel.suspicion()
