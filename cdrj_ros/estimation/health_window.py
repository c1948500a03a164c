"""Readings of one cycle of motion beside what the file and every changed robot expect."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from cdrj_ros.foundation.arrays import Vector

TURNED: Final = 0.25
"""A motion has reversed once it has come back by this fraction of its largest swing."""

LEAST_COUNTS: Final = 50.0
"""Smallest swing that counts as motion, in counts of the sensor."""

LEAST_SWING: Final = 1e-3
"""Smallest swing that counts as motion [rad] or [m]."""

FEWEST: Final = 40
"""Smallest number of readings of a window."""

WHOLE: Final = 0.6
"""A window must cover this fraction of the largest motion so far: after shorter strokes the far
ends of the cables keep a tension that no model with one contact per pulley gives."""

SHORTEST_NS: Final = 3_000_000_000
"""Shortest duration of a window [ns]."""

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
    is_effort: bool
    """Whether it is the effort of a motor [N m], not a tension [N]."""


class Turns:
    """Counts the reversals of one axis."""

    def __init__(self, count: float) -> None:
        """Start at rest; ``count`` is the resolution of the sensor [rad]."""
        self._least = max(LEAST_COUNTS * count, LEAST_SWING)
        self._low = self._high = float("nan")
        self._rising = 0
        self._swing = 0.0
        self.reversals = 0
        self._lowest = self._highest = float("nan")
        self._largest = 0.0
        self._begun = 0

    def add(self, angle: float) -> None:
        """Add an angle [rad]."""
        if not self._low <= self._high:  # NaN: the first angle
            self._low = self._high = angle
        if not self._lowest <= self._highest:
            self._lowest = self._highest = angle
        self._lowest, self._highest = min(self._lowest, angle), max(self._highest, angle)
        self._largest = max(self._largest, self._highest - self._lowest)
        self._low, self._high = min(self._low, angle), max(self._high, angle)
        span = self._high - self._low
        least = max(TURNED * max(self._swing, span), self._least)
        if self._rising >= 0 and self._high - angle >= least:
            self._turn(-1, angle, span)
        elif self._rising <= 0 and angle - self._low >= least:
            self._turn(+1, angle, span)

    def begin(self) -> None:
        """Begin a window here."""
        self._begun = self.reversals
        self._lowest = self._highest = float("nan")

    def forget(self) -> None:
        """Take the motion of this window for the usual one."""
        self._largest = self._highest - self._lowest if self._lowest <= self._highest else 0.0

    @property
    def whole(self) -> bool:
        """Whether the axis has gone to and fro since ``begin``, over most of its usual range."""
        moved = self._highest - self._lowest
        return self.reversals - self._begun >= 2 and moved >= WHOLE * self._largest

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
