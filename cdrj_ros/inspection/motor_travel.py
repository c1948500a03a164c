"""Whether the motors turn as far as the joints and the cables between them allow.

While the cables are taut, a motor follows the joints.  Angles that follow several times as far, or
a fraction as far, were published before a gear, in another unit, or with the other sign.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.inspection.ranges import following_motors
from cdrj_ros.model.prepared import Model

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
