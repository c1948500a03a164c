"""What the latest readings of sensors say about every unknown, whatever was believed before.

The beliefs hold what is known; the evidence says what the readings of the last seconds alone show,
so that a change can be named.  For readings z with the model's quantities h, errors v of variance R
and the slopes a of all unknowns x, (B3), it is the normal equations of

    z - h = a x + v:     M = sum a a' / R,    u = sum a (z - h) / R,                         (B5)

in which older readings fade.  See docs/estimation.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import Final

import numpy as np

from cdrj_ros.estimation.estimator import NEVER
from cdrj_ros.estimation.sensors import Sensor
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.robot.description import Robot

FADES_S: Final = 5.0
"""Time after which a reading weighs a third [s]: a few strokes of a slow joint."""

LASTS_S: Final = FADES_S / 16.0
"""Time for which errors of the model last [s]: part of a stroke, as in (I5)."""

RECENT_S: Final = 0.5
"""The same for a cable that carries nothing [s], which a few readings show."""


@dataclass
class Sums:
    """The sums over the readings of one sensor; the unknowns are the robot's and its own three."""

    information: Table
    """M of (B5)."""
    vector: Vector
    """u of (B5)."""
    contributions: Table
    """See ``contributions``."""
    recent: Vector
    """Of the last readings alone: sums of (z - h)^2 / R with what h would be without each cable of
    the sensor, then with all cables, and their number."""
    squares: float = 0.0
    """Sum of (z - h)^2 / R."""
    weight: float = 0.0
    """Sum of 1 / R."""
    number: float = 0.0
    """Number of readings whose errors are independent."""
    stamp_ns: int = NEVER

    def add(
        self, stamp_ns: int, difference: float, slopes: Vector, noise: float, lasting: float,
        values: Vector,
    ) -> None:  # fmt: skip
        """Add a reading.

        Args:
            stamp_ns: its time [ns].
            difference: z - h [N] or [N m].
            slopes: a of (B5).
            noise: variance of its own error.
            lasting: variance of errors that last.
            values: of all quantities of the robot, its tensions first.
        """
        first = self.stamp_ns == NEVER
        passed = FADES_S if first else max((stamp_ns - self.stamp_ns) * 1e-9, 1e-3)
        variance = noise + lasting * max(1.0, LASTS_S / passed)
        kept = 0.0 if first else exp(-passed / FADES_S)
        self.information = kept * self.information + np.outer(slopes, slopes / variance)
        self.vector = kept * self.vector + slopes * (difference / variance)
        number = (noise + lasting) / variance
        parts = self.contributions @ values[: self.contributions.shape[1]]
        now = np.array([*(difference + parts) ** 2, difference**2, number * variance]) / variance
        self.recent = (0.0 if first else exp(-passed / RECENT_S)) * self.recent + now
        self.squares = kept * self.squares + difference**2 / variance
        self.weight = kept * self.weight + 1.0 / variance
        self.number = kept * self.number + number
        self.stamp_ns = stamp_ns

    def faded(self, stamp_ns: int) -> Sums:
        """The same at a later time [ns]."""
        kept = exp(-max(stamp_ns - self.stamp_ns, 0) * 1e-9 / FADES_S)
        return Sums(
            kept * self.information, kept * self.vector, self.contributions, self.recent,
            kept * self.squares, kept * self.weight, kept * self.number, stamp_ns,
        )  # fmt: skip


def nothing(unknowns: int, contributions: Table) -> Sums:
    """The sums over no reading of a sensor; ``unknowns`` includes its own."""
    return Sums(
        np.zeros((unknowns, unknowns)), np.zeros(unknowns), contributions,
        np.zeros(len(contributions) + 2),
    )  # fmt: skip


def contributions(robot: Robot, sensor: Sensor) -> Table:
    """What every element's tension contributes to a reading, per cable of the sensor.

    Returns:
        Shape (cables of the sensor, elements of the robot).
    """
    found = np.zeros((len(sensor.cables), robot.parts[-1].stop))
    for row, c in zip(found, sensor.cables, strict=True):
        part = robot.parts[c]
        for element, share in sensor.pulls:
            row[element] += share * (part.start <= element < part.stop)
    return found
