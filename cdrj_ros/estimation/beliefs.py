"""What sensors tell about a robot's unknowns, and which sensors are right.

The equations are in ``core/beliefs.cpp`` and ``core/present.cpp``; see docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.estimation.sensors import Sensor
from cdrj_ros.estimation.unknowns import Unknown
from cdrj_ros.foundation.arrays import Vector

FAULTY: Final = 0.1
"""Prior probability that a sensor is wrong, and what it keeps in the variance whatever it reads."""

LARGEST: Final = 1e12
"""Largest number in a state file: squares of larger ones are no tensions."""

ROUNDING: Final = 1e-6
"""Negative variance by rounding, as a share of the largest one."""

VERIFIED: Final = 0.01
"""The same of a sensor that was compared with a spring scale or a known load."""


class Beliefs:
    """The hypotheses about one group of cables, each with a mean and covariance of all unknowns."""

    def __init__(self, unknowns: Sequence[Unknown]) -> None:
        """Begin without sensors.

        Args:
            unknowns: of the robot.
        """
        self.unknowns = unknowns
        self.count = len(unknowns)
        """Number of the robot's unknowns; those of the sensors follow."""
        self.sensors: list[Sensor] = []
        """Those that have been heard."""
        kinds = [one.kind for one in unknowns]
        sizes = [(one.start, one.drift, one.jump, one.error) for one in kinds]
        self.core = _core.Beliefs(*np.array(sizes).reshape(-1, 4).T)

    def hear(self, sensor: Sensor, quantity: int, contributes: NDArray[np.bool_]) -> None:
        """Add a sensor: its errors become unknowns, and hypotheses extend those there are.

        Args:
            sensor: not yet heard.
            quantity: that it reads, among those of the group.
            contributes: whether its cables contribute to each of these, shape (quantities,).
        """
        self.sensors.append(sensor)
        scale, known = sensor.scale, sensor.accuracy
        self.core.hear(
            quantity=quantity, contributes=contributes, scale=scale, balance=sensor.balance,
            prior=(known.bias * scale, sensor.gain), drift=known.drift * scale,
            model=(known.model, known.model_least * scale),
            faulty=VERIFIED if sensor.verified else FAULTY,
        )  # fmt: skip

    def errors_of(self, k: int) -> tuple[int, int]:
        """Indices of a sensor's bias and gain among the unknowns."""
        return self.count + 2 * k, self.count + 2 * k + 1

    def moments(self) -> tuple[Vector, Vector]:
        """Mean and standard deviation of all unknowns over all hypotheses."""
        core = self.core
        mean = core.weight @ core.mean
        variances = np.einsum("bii->bi", core.covariance) + (core.mean - mean) ** 2
        return mean, np.sqrt(core.least_weights @ variances)

    def moment_of(self, share: Vector) -> tuple[float, float]:
        """Mean and standard deviation of a sum of the robot's unknowns, over all hypotheses."""
        core, n = self.core, self.count
        means = core.mean[:, :n] @ share
        mean = float(core.weight @ means)
        variances = np.einsum("i,bij,j->b", share, core.covariance[:, :n, :n], share)
        return mean, float(np.sqrt(core.least_weights @ (variances + (means - mean) ** 2)))

    def probability_right(self, k: int) -> float:
        """Probability that a sensor is not the wrong one: what contradicts all is the model."""
        alone = np.count_nonzero(~self.core.right, axis=1) == 1
        return float(self.core.weight @ (self.core.right[:, k] | ~alone))

    def memory(self) -> dict[str, Any]:
        """What ``recall`` needs to go on, as JSON."""
        stamps = [self.core.heard(k)[0] for k in range(len(self.sensors))]
        return {
            "sensors": [[one.name, at] for one, at in zip(self.sensors, stamps, strict=True)],
            "mean": self.core.mean.tolist(),
            "covariance": self.core.covariance.tolist(),
            "weight": self.core.weight.tolist(),
        }

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Take up the numbers of ``memory``, of the same sensors.

        Raises:
            KeyError, TypeError, ValueError: they are not of this robot; nothing has changed then.
        """
        numbers = [np.array(memory[key], np.float64) for key in ("mean", "covariance", "weight")]
        _, covariance, weight = numbers
        if not all((np.abs(one) <= LARGEST).all() for one in numbers):
            raise ValueError("a number is too large")
        if (weight <= 0.0).any():
            raise ValueError("a weight is not positive")
        variances = np.linalg.eigvalsh(0.5 * (covariance + covariance.swapaxes(1, 2)))
        if (variances < -ROUNDING * variances.max(axis=1, keepdims=True)).any():
            raise ValueError("a variance is negative")
        stamps = np.array([stamp for _, stamp in memory["sensors"]], np.int64)
        self.core.restore(stamps, *numbers)
