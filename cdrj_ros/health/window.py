"""Readings of one cycle of motion beside what the file and every changed robot expect."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

TURNED: Final = 0.25
"""A motion has reversed once it has come back by this fraction of its largest swing."""

LEAST_COUNTS: Final = 50.0
"""Smallest swing that counts as motion, in counts of the sensor."""

LEAST_SWING: Final = 1e-3
"""Smallest swing that counts as motion [rad] or [m]."""

FEWEST: Final = 40
"""Smallest number of readings of a window."""

MOST: Final = 4000
"""Readings after which a window without a whole cycle is discarded."""


class Reading(NamedTuple):
    """One measured value with the values that the models expect at its time."""

    measured: float
    noise: float
    """Standard deviation of the sensor."""
    expected: Vector
    """By the robot file, then by every changed robot, shape (1 + changes,)."""
    spread: float
    """Standard deviation of the file's expectation because of its inexact numbers."""


class Turns:
    """Counts the reversals of one axis."""

    def __init__(self, count: float) -> None:
        """Start at rest; ``count`` is the resolution of the sensor [rad]."""
        self._least = max(LEAST_COUNTS * count, LEAST_SWING)
        self._low = self._high = float("nan")
        self._rising = 0
        self._swing = 0.0
        self.reversals = 0

    def add(self, angle: float) -> None:
        """Add an angle [rad]."""
        if not self._low <= self._high:  # NaN: the first angle
            self._low = self._high = angle
        self._low, self._high = min(self._low, angle), max(self._high, angle)
        span = self._high - self._low
        least = max(TURNED * max(self._swing, span), self._least)
        if self._rising >= 0 and self._high - angle >= least:
            self._turn(-1, angle, span)
        elif self._rising <= 0 and angle - self._low >= least:
            self._turn(+1, angle, span)

    def _turn(self, rising: int, angle: float, span: float) -> None:
        if self._rising:
            self.reversals += 1
            self._swing = span
        self._rising = rising
        if rising > 0:
            self._high = angle
        else:
            self._low = angle


@dataclass
class Window:
    """Readings of one cycle by sensor."""

    rows: dict[str, list[Reading]] = field(default_factory=dict)

    def add(self, channel: str, reading: Reading) -> None:
        """Add a reading of a motor's effort [N m] or of a load cell [N]."""
        self.rows.setdefault(channel, []).append(reading)

    @property
    def size(self) -> int:
        """Number of readings of the sensor that has most."""
        return max((len(rows) for rows in self.rows.values()), default=0)

    def latest(self, count: int) -> Window:
        """The last ``count`` readings of every sensor."""
        return Window({name: rows[-count:] for name, rows in self.rows.items()})
