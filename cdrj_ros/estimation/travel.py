"""Whether motors turn as far as the cables allow, and the single mistake that explains it if not.

While the cables are taut, a motor follows the joints.  Angles that follow several times as far, or
a fraction as far, were published before a gear, in another unit, or with the other sign; those
that follow other joints were published under the name of another axis.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations
from math import radians
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import NEVER, Sample
from cdrj_ros.estimation.model_error import largest_tensions
from cdrj_ros.estimation.verdict_words import swap, turn
from cdrj_ros.foundation.arrays import Matrix, Vector
from cdrj_ros.model.following import following_motors, stiffness_at_preload, whole_lengths
from cdrj_ros.model.prepared import Model, lengths_at
from cdrj_ros.robot.description import Joint, Motor

FEWEST: Final = 4
"""Smallest number of poses that are compared: of a motor that turns too fast, or a joint out of its
range, few readings are accepted."""

KEPT: Final = 60
"""Number of poses that are kept."""

LEAST_TURN: Final = 0.02
"""Smallest travel of a motor that following the joints needs for a comparison [rad],"""

LEAST_TRAVEL: Final = 0.1
"""and for its factor: joints give way by less while motors take up slack."""

POSE_NS: Final = 1_000_000_000
"""Shortest time between two poses that are kept [ns],"""

FIRST_NS: Final = 20_000_000
"""and between the first ones: a wrong unit may end the motion at once."""

UNLIKE: Final = 0.2
"""Difference from 1 from which a factor is told, where the motion is as regular,"""

UNLIKE_HEARD: Final = 0.04
"""where efforts show that no tension explains it: more than drawn radii are off by,"""

STRETCHED: Final = 3.0
"""and the motors differ from the joints by so many times what the efforts' range stretches."""

SCATTER: Final = 0.3
"""Largest deviation from a proportional motion, as a fraction of it."""

THINNED: Final = 15
"""About so many poses are compared where many mistakes are."""

UNIT: Final = 0.1
"""Largest deviation with motors in degrees, beside which gears of 50 and 64 are other mistakes, and
where a motor has a joint's name."""

BETTER: Final = 3.0
"""Factor by which a single mistake must reduce the deviation of the motors to be named."""

RADIAN: Final = radians(1.0)
"""Scale of a joint whose file says that it is read in degrees."""

DEGREES: Final = "give scale as scale_deg, 1 where the file has none"
"""Remedy."""

SLIGHT: Final = 1e-3
"""Change of a joint's angle from which the slopes of the motors' follow [rad] or [m]."""


Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]


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
        self._poses: deque[tuple[Vector, Vector, Vector]] = deque(maxlen=KEPT)
        """Angles of motors and joints, and efforts of motors."""
        self.forget()
        self.use(model)

    def forget(self) -> None:
        """Forget all poses."""
        self._poses.clear()
        self._looked_ns = NEVER
        self._suspected = ""

    def use(self, model: Model) -> None:
        """Continue with other numbers of the same robot."""
        self._model = model
        self._stretch, self._per_effort = _stretches(model)
        """Turns by which the largest tensions stretch the motors' cables [rad], and by effort."""
        self._slopes = _slopes(model)
        """Motion of all motors that follow a joint, by its motion, shape (joints, motors)."""

    def follow(self, samples: Iterable[Sample], effort: Vector, *, whole: bool) -> str:
        """``suspicion`` with the poses of the latest samples, which are added once in ``POSE_NS``.

        Args:
            samples: that have come since the last call, or more.
            effort: the latest of every motor [N m], NaN for none, shape (motors,).
            whole: as for ``suspicion``.
        """
        kept = False
        for sample in samples:
            apart_ns = FIRST_NS if len(self._poses) < FEWEST else POSE_NS
            if sample.stamp_ns - self._looked_ns >= apart_ns:
                self._looked_ns = sample.stamp_ns
                kept |= self.add(sample.motor_angle, sample.joint_angle, effort)
        if kept:
            self._suspected = self.suspicion(whole=whole)
        return self._suspected

    def add(self, motor_angle: Vector, joint_angle: Vector, effort: Vector) -> bool:
        """Add a pose: the angles of all motors and joints [rad] or [m], and efforts [N m].

        Returns:
            Whether it was kept: one in which nothing has moved since the last is not.
        """
        if self._model.robot.unmeasured or not self._model.robot.motors:
            return False
        if self._poses:
            motor, joint, _ = self._poses[-1]
            moved = [motor_angle - motor, (joint_angle - joint) @ self._slopes]
            if not np.abs(moved).max() > LEAST_TURN:
                return False
        self._poses.append((motor_angle.copy(), joint_angle.copy(), effort))
        return True

    def suspicion(self, *, whole: bool = True) -> str:
        """What may be wrong with which axis, and the key that mends it; empty if nothing is.

        Args:
            whole: whether the poses are those of the whole motion, which tells single factors.
        """
        if len(self._poses) < FEWEST:
            return ""
        motor, joint, effort = map(np.array, zip(*self._poses, strict=True))
        expected = following_motors(self._model, joint)
        efforts = np.ptp(effort, axis=0)
        heard = efforts > 0.0
        most = np.where(heard, STRETCHED * efforts * self._per_effort, self._stretch)
        apart = np.ptp(motor - expected, axis=0) > np.minimum(most, self._stretch)
        if not apart.any():
            return ""
        few = slice(None, None, 1 + len(motor) // THINNED)
        mistake = self._mistake(motor[few], joint[few], expected[few], apart)
        if mistake and _deviations(motor, expected)[apart].max() > SCATTER:
            return mistake
        if not whole:
            return ""
        names, least = self._model.layout.motors, np.where(heard, UNLIKE_HEARD, UNLIKE)
        turns = [
            turn(self._model.robot, names[m], ratio)
            for m in np.flatnonzero(apart)
            if (ratio := _ratio(motor[:, m], expected[:, m], least[m])) != 1.0
        ]
        return "; or ".join(one for one in (mistake, "; ".join(turns)) if one)

    def _mistake(self, motor: Matrix, joint: Matrix, expected: Matrix, apart: Flags) -> str:
        """The single mistake by which all motors follow the joints, if they do not as read.

        Args:
            motor, joint: angles as read, shapes (n, motors) and (n, joints).
            expected: angles of the motors that follow the joints [rad], shape (n, motors).
            apart: which motors are further from these than tensions can stretch their cables.
        """
        there, slopes = self._model.robot.reference_pose, self._slopes
        motors = np.flatnonzero(apart)
        joints = np.flatnonzero((np.abs(slopes) > LEAST_TURN)[:, apart].any(axis=1))

        def roughly(one: Mistake) -> float:
            return float(_deviations(one.motor, (one.joint - there) @ slopes).max())

        best = min(self._mistakes(motor, joint, motors, joints), key=roughly)
        found = _deviations(best.motor, following_motors(self._model, best.joint)).max()
        present = _deviations(motor, expected).max()
        return best.words if found < min(best.within, present / BETTER) else ""

    def _mistakes(
        self, motor: Matrix, joint: Matrix, motors: Indices, joints: Indices
    ) -> Iterator[Mistake]:
        """What may have gone wrong: the unit of all motors or joints, or two names.

        Args:
            motor: angles as read [rad], shape (n, motors).
            joint: angles as read [rad] or [m], shape (n, joints).
            motors: those of which at least one name is wrong.
            joints: likewise.
        """
        robot = self._model.robot
        turns = np.array([one.name not in robot.prismatic_joints for one in robot.joints])
        turned = np.where(turns, _in_degrees(robot.joints, joint), joint)
        yield Mistake(f"the joints seem to be in degrees: {DEGREES}", motor, turned, SCATTER)
        stated = any(one.sensor.scale == RADIAN for one in robot.joints)
        other = ", or the joints in radians: scale: 1 in place of scale_deg" if stated else ""
        words = f"in degrees (or before gears of about 57): {DEGREES}{other}"
        turned = _in_degrees(robot.motors, motor)
        yield Mistake(f"the motors seem to be {words}", turned, joint, UNIT)
        # beside one motor alone, a joint under its name looks like another gear
        suspects = [*motors, *(len(robot.motors) + joints)]
        angle, alone = np.hstack([motor, joint]), len(motors) == 1
        for a, b in combinations(range(len(robot.axes)), 2):
            mixed = a < len(robot.motors) <= b
            if (mixed and alone) or not np.isin((a, b), suspects).any():
                continue
            words = swap(robot.axes[a].name, robot.axes[b].name)
            right = _swapped(robot.axes, angle, a, b)
            of_motors, of_joints = np.split(right, [len(robot.motors)], axis=1)
            within = UNIT if mixed else SCATTER
            yield Mistake(words, of_motors, of_joints, within)


def _ratio(read: Vector, expected: Vector, least: float) -> float:
    """By what factor a motor follows the joints, if it clearly follows with another than 1.

    Args:
        read: its angles [rad], shape (n,).
        expected: those that follow the joints; NaN in a pose that is not possible.
        least: difference from 1 from which it is told.
    """
    y, x = read - read.mean(), expected - expected.mean()
    if not np.ptp(x) > LEAST_TRAVEL:
        return 1.0
    ratio = float(x @ y / (x @ x))
    scatter = float(np.sqrt(np.mean((y - ratio * x) ** 2)) / np.std(x))
    if abs(ratio - 1.0) > max(least, scatter / SCATTER) and scatter < SCATTER * abs(ratio):
        return ratio
    return 1.0


def _slopes(model: Model) -> Matrix:
    """Motion of all motors by that of a joint that they follow, shape (joints, motors)."""
    steps = model.robot.reference_pose + SLIGHT * np.eye(len(model.robot.joints))
    slopes: Matrix = (following_motors(model, steps) - model.robot.reference_motors) / SLIGHT
    return slopes


def _stretches(model: Model) -> tuple[Vector, Vector]:
    """Turn of every motor by which the largest tension of its cables stretches them [rad].

    And that by which an effort does [rad/(N m)].
    """
    robot = model.robot
    length = whole_lengths(robot, lengths_at(model, robot.reference_pose[None]))[0]
    radii = np.abs(robot.effective_radii)
    windings = np.divide(1.0, radii, out=np.zeros_like(radii), where=radii > 0.0)
    per_tension = windings / stiffness_at_preload(robot, length)[:, None]
    per_effort = windings * per_tension
    by_largest = per_tension * largest_tensions(robot)[:, None]
    return by_largest.max(axis=0, initial=0.0), per_effort.max(axis=0, initial=0.0)


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
    if not len(motor_angle):
        return ""
    for k in np.linspace(0, len(motor_angle) - 1, KEPT).astype(int):
        travel.add(motor_angle[k], joint_angle[k], np.full(motor_angle.shape[1], np.nan))
    return travel.suspicion()
