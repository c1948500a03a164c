"""Errors of a sensor that last from reading to reading, as unknowns of every member.

A load cell and a motor's effort alike have a bias, which drifts, and a gain; an effort has friction
of the motor in addition.  Their standard deviations are stated here, relative to the preloads.  A
reading z of a quantity h is

    z = h + b + g h + F d + noise                                                       (U11)

with the bias b, the error g of the gain and the friction F of the motor in the direction d of
``MotorFriction.turn``.

Friction of the cables and friction of the motor both widen the hysteresis of an effort.  The
motor's reverses within a milliradian, the cables' only after the cable has given up its elongation
and its contacts have slipped back.  The direction of the motor's own friction is therefore followed
like the friction of an axis (E13).  See docs/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.draws import root_mean_square
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.robot.axes import DEFAULT_BREAKAWAY_ANGLE
from cdrj_ros.robot.description import Robot

Draw = Callable[[Sequence[Vector]], Vector]
"""Gives numbers of variance 1 in every member, shape (members,), which are independent of the
errors of all sensors and of the vectors given."""

BIAS, GAIN, FRICTION = range(3)
"""Indices of the unknowns."""


class Stated(NamedTuple):
    """How large the errors of a kind of sensor are (standard deviations)."""

    bias: float
    """At its first reading, as a fraction of what the preloads contribute to its reading."""
    drift: float
    """Random-walk spread of the bias after 1 s, as a fraction of the same."""
    gain: float
    """Of the gain [-]."""


CELL: Final = Stated(bias=0.005, drift=0.0005, gain=0.03)
EFFORT: Final = Stated(bias=0.02, drift=0.002, gain=0.05)

FRICTION_DRIFT: Final = 0.05
"""Random-walk spread of a motor's friction after 1 s, as a fraction of its standard deviation."""

DRIFT_S: Final = 0.1
"""Time after which the unknowns drift by the next step [s]."""

CERTAIN: Final = 3.0
"""A sensor is wrong if its error is more standard deviations than this from zero."""


@dataclass
class LastingError:
    """The unknowns of one sensor: (U11)."""

    deviation: Table
    """Every unknown in every member, less ``error``, shape (unknowns, members)."""
    error: Vector
    """Estimate of every unknown [N] or [N m], the gain's [-], shape (unknowns,)."""
    stated: Vector
    """Their standard deviations at the first reading, shape (unknowns,)."""
    drift: Vector
    """Their random-walk spread after 1 s, shape (unknowns,)."""

    waited_s: float = 0.0
    """Time since they drifted last [s]."""

    @classmethod
    def of(cls, kind: Stated, scale: float, friction: float, draw: Draw) -> LastingError:
        """The errors of a sensor that has not been used.

        Args:
            kind: what is stated of such sensors.
            scale: what the preloads contribute to its reading [N] or [N m].
            friction: standard deviation of the motor's friction [N m]; 0 for a load cell.
            draw: gives independent numbers.
        """
        stated = np.array([kind.bias * scale, kind.gain, friction])
        drift = np.array([kind.drift * scale, 0.0, FRICTION_DRIFT * friction])
        deviation = np.zeros((stated.size, draw([]).size))
        for k in np.flatnonzero(stated):
            deviation[k] = stated[k] * draw(list(deviation))
        return cls(deviation, np.zeros(stated.size), stated, drift)

    def pass_time(self, seconds: float, draw: Draw) -> None:
        """Let the unknowns drift, at most ten times a second."""
        self.waited_s += seconds
        if self.waited_s < DRIFT_S:
            return
        for k in np.flatnonzero(self.drift):
            self.deviation[k] += self.drift[k] * sqrt(self.waited_s) * draw([])
        self.waited_s = 0.0

    def correct(self, changes: Vector, gains: Vector, innovation: float) -> None:
        """Take part in a correction.

        Args:
            changes: difference of the reading, with its own noise, from every member, (members,).
            gains: of every unknown, shape (unknowns,).
            innovation: the difference from the estimate, which corrects ``error``.
        """
        self.deviation += gains[:, None] * (changes - innovation)
        self.error += gains * innovation

    def wrong(self, factors: Vector, allowed: float) -> str:
        """Why the sensor is wrong, if bias and gain are certainly larger than stated; else empty.

        Args:
            factors: change of the reading per unit of every unknown, shape (unknowns,).
            allowed: standard deviation of what else makes the readings differ [N] or [N m].
        """
        own = factors[:FRICTION]
        error = float(own @ self.error[:FRICTION])
        size = root_mean_square(own @ self.deviation[:FRICTION])
        stated = float(np.linalg.norm(own * self.stated[:FRICTION]))
        if abs(error) <= CERTAIN * max(size, stated, allowed):
            return ""
        return f"off by {error:.3g}, {abs(error) / size:.1f} standard deviations of that"

    def memory(self) -> list[list[float]]:
        """What is known of the unknowns, as JSON; ``recalled`` reads it."""
        return np.column_stack([self.error, self.stated, self.drift, self.deviation]).tolist()

    @classmethod
    def recalled(cls, memory: Sequence[Sequence[float]], members: int) -> LastingError:
        """The errors of a sensor of an earlier run, from ``memory``.

        Raises:
            TypeError, ValueError: not such a memory.
        """
        table = np.array(memory, dtype=np.float64)
        if table.shape != (FRICTION + 1, members + 3) or not np.all(np.isfinite(table)):
            raise ValueError("not the errors of a sensor")
        error, stated, drift = table[:, :3].T.copy()
        return cls(table[:, 3:].copy(), error, stated, drift)


FRICTION_SHARE: Final = 0.1
"""Standard deviation of a motor's unknown friction, as a fraction of the torque of its preloads."""

FRICTION_KNOWN: Final = 0.3
"""The same as a fraction of the friction that the robot file states."""

COUNTS: Final = 2.0
"""The direction follows the motor after a turn by as many counts of its encoder at least."""


class MotorFriction:
    """Directions of the motors' friction."""

    def __init__(self, robot: Robot) -> None:
        """Begin without direction.

        Args:
            robot: the robot.
        """
        passive = [motor.passive for motor in robot.motors]
        self._bearing_torque = np.array([one.bearing_torque for one in passive])
        self._accuracy = _stated_accuracy(robot)
        breakaway = [
            one.bearing_torque / one.bearing_stiffness
            if one.bearing_stiffness > 0.0 and one.bearing_torque > 0.0
            else DEFAULT_BREAKAWAY_ANGLE
            for one in passive
        ]
        counts = [abs(motor.sensor.scale) * motor.sensor.resolution for motor in robot.motors]
        # floats, because most robots have few motors, and arrays take longer up to ten of them
        self._breakaway = np.maximum(breakaway, COUNTS * np.array(counts)).tolist()
        self._sign = [-float(motor.effort_sign) for motor in robot.motors]
        self.forget()

    def forget(self) -> None:
        """Forget angles and directions."""
        self._angle: list[float] = []
        self._direction = [0.0] * len(self._sign)

    def turn(self, angle: Vector) -> list[float]:
        """Follow the motors: the direction d of (U9).

        Args:
            angle: their angles [rad], shape (motors,).

        Returns:
            Change of every effort per unit of the motor's friction [-], from -1 to 1, shape
            (motors,); a new list.
        """
        before, self._angle = self._angle, angle.tolist()
        if before:
            turns = zip(self._direction, self._angle, before, self._breakaway, strict=True)
            self._direction = [
                min(max(direction + (now - then) / breakaway, -1.0), 1.0)
                for direction, now, then, breakaway in turns
            ]
        return [
            sign * direction for sign, direction in zip(self._sign, self._direction, strict=True)
        ]

    def stddev(self, motor: int, preload_torque: float) -> float:
        """Standard deviation of the unknown friction before any effort was measured [N m].

        Args:
            motor: index of the motor.
            preload_torque: torque of its preloads [N m], see ``Preloads.scale``.
        """
        if motor in self._accuracy:
            return self._accuracy[motor]
        known = FRICTION_KNOWN * float(self._bearing_torque[motor])
        return float(np.hypot(FRICTION_SHARE * preload_torque, known))


def _stated_accuracy(robot: Robot) -> dict[int, float]:
    """Standard deviation of ``bearing_torque`` [N m], by motor, where the file states it."""
    known = robot.uncertainty
    if known is None:
        return {}
    index = {path: k for k, path in enumerate(known.parameters[: known.stated])}
    paths = [f"motors.{motor.name}.bearing_torque" for motor in robot.motors]
    return {
        m: float(np.sqrt(known.covariance[index[path], index[path]]))
        for m, path in enumerate(paths)
        if path in index
    }
