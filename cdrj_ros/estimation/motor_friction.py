"""Friction of a motor that the robot file does not contain, beside the cables in its effort.

Friction of the cables and friction of the motor both widen the hysteresis of an effort.  The
motor's reverses within a milliradian, the cables' only after the cable has given up its elongation
and its contacts have slipped back.  The direction of the motor's own friction is therefore followed
like the friction of an axis (E13), and its amount is an unknown of the fusion.
See docs/uncertainty.md.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.robot.axes import DEFAULT_BREAKAWAY_ANGLE
from cdrj_ros.robot.description import Robot

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
    place = {path: k for k, path in enumerate(known.parameters[: known.stated])}
    paths = [f"motors.{motor.name}.bearing_torque" for motor in robot.motors]
    return {
        m: float(np.sqrt(known.covariance[place[path], place[path]]))
        for m, path in enumerate(paths)
        if path in place
    }
