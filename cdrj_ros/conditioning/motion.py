"""How fast an axis has moved so far, and how far it may have been from the line between readings.

Equations (C2) to (C5) of docs/conditioning.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Stamps = NDArray[np.int64]
Vector = NDArray[np.float64]

WINDOW_NS: Final = 100_000_000
"""Speed and acceleration are taken over at least this time [ns]."""

MEMORY_S: Final = 10.0
"""Time constant with which earlier speeds and accelerations are forgotten [s]."""

CHORDS: Final = 1.5
"""Accelerations from readings a third of a period apart are too small by this factor."""

EVER_NS: Final = 1 << 62
"""Longer than any interval [ns]."""

LEAP_SPEED: Final = 2.5
"""A leap is at least this many times as fast as the axis has ever been."""

LEAP_ACCELERATION: Final = 10.0
"""A leap needs at least this many times the greatest acceleration so far."""

LEAP_BANDS: Final = 40.0
"""A leap is at least this many times as wide as the sensor's error."""

LEAP_FLOOR: Final = 0.02
"""A leap is at least as wide as this [rad]."""

JITTER_NS: Final = 5_000_000
"""Stamps of readings may be off by this [ns]."""

LEAP_WITHIN_NS: Final = 100_000_000
"""Between readings further apart, a leap cannot be told from a motion [ns]."""

SETTLED_NS: Final = 50_000_000
"""A leap that has lasted for this long is a step of the sensor [ns]."""

TRAVEL: Final = 1.0
"""Until an axis has moved by as much in all, its speeds say nothing of what it can do [rad]."""


class Leap(NamedTuple):
    """A change of reading that is too fast for what the axis has done so far."""

    stamp_ns: int
    """Of the first reading after it."""
    before: float
    """Last angle before it [rad]."""
    after: float
    """First angle after it [rad]."""
    velocity: float
    """Of the axis before it [rad/s]."""

    def judge(self, stamp: int, angle: float) -> str:
        """Return ``glitch``, ``motion`` or ``step`` by a later reading; empty while undecided."""
        angle -= self.velocity * ((stamp - self.stamp_ns) * 1e-9)
        if abs(angle - self.before) < abs(angle - self.after):
            return "glitch"
        if abs(angle - self.after) > 0.5 * abs(self.after - self.before):
            return "motion"
        return "step" if stamp - self.stamp_ns >= SETTLED_NS else ""


@dataclass
class Motion:
    """Running estimates of an axis's speed and acceleration."""

    band: float = 0.0
    """Greatest error of a reading [rad]."""
    negligible: float = 0.0
    """Standard deviation of an angle between readings that is not reported [rad], positive."""
    begin_ns: int = -1
    """Begin of the present window [ns]; -1 before the first reading."""
    begin: float = 0.0
    """Angle there [rad]."""
    span_s: float = 0.0
    """Length of the last window [s]."""
    velocity: float = 0.0
    """Mean over the last window [rad/s]."""
    speed: float = 0.0
    """Speed seen so far [rad/s]: follows an increase at once and forgets it in ``MEMORY_S``."""
    acceleration: float = 0.0
    """Acceleration seen so far, likewise [rad/s^2]."""
    fastest: float = 0.0
    """Greatest speed over a window so far [rad/s]."""
    hardest: float = 0.0
    """Greatest acceleration from window to window so far [rad/s^2]."""
    travelled: float = 0.0
    """Sum of the movements of all windows [rad]."""
    seen_ns: int = EVER_NS
    """Readings at most this far apart leave nothing unseen [ns]."""

    def take(self, stamp: int, angle: float) -> None:
        """Take the next reading of the axis."""
        if self.begin_ns < 0:
            self.begin_ns, self.begin = stamp, angle
        elif stamp - self.begin_ns >= WINDOW_NS:
            self._close((stamp - self.begin_ns) * 1e-9, angle - self.begin)
            self.begin_ns, self.begin = stamp, angle

    def _close(self, span_s: float, moved: float) -> None:
        """End a window of ``span_s`` in which the axis has moved by ``moved`` [rad]."""
        velocity = moved / span_s
        certain = max(abs(moved) - 2.0 * self.band, 0.0)
        speed = certain / span_s
        if self.span_s > 0.0:
            change = max(abs(velocity - self.velocity) - 2.0 * self.band / span_s, 0.0)
            acceleration = change / (0.5 * (span_s + self.span_s))
        else:  # of a slow channel, nothing better is known at first
            acceleration = speed / span_s if span_s > 2e-9 * WINDOW_NS else 0.0
        if span_s > 2e-9 * WINDOW_NS:
            acceleration *= CHORDS
        keep = exp(-span_s / MEMORY_S)
        self.speed = max(speed, _faded(self.speed, speed, keep))
        self.acceleration = max(acceleration, _faded(self.acceleration, acceleration, keep))
        self.fastest = max(self.fastest, speed)
        self.hardest = max(self.hardest, acceleration)
        self.travelled += certain
        self.span_s, self.velocity = span_s, velocity
        self.seen_ns = self._seen()

    def _seen(self) -> int:
        if not (self.speed > 0.0 and self.acceleration > 0.0):
            return EVER_NS
        longest = max(
            sqrt(8.0 * self.negligible / self.acceleration), 3.0 * self.negligible / self.speed
        )
        return int(min(longest, 1e9) * 1e9)

    def curvature(self, span_ns: int) -> float:
        """The bridge between two readings ``span_ns`` apart, (C3) [rad/ns^2].

        The standard deviation of the angle is this times the times to either reading; 0 where it is
        ``negligible`` everywhere.
        """
        if span_ns <= self.seen_ns:
            return 0.0
        span = span_ns * 1e-9
        sagitta = min(self.acceleration * span * span / 8.0, self.speed * span / 3.0)
        return 4.0 * sagitta / (float(span_ns) * float(span_ns))

    def ahead(self, horizon_ns: int, window_ns: int) -> float:
        """Standard deviation of an angle carried on for ``horizon_ns``, (C4) [rad].

        Args:
            horizon_ns: time since the last reading [ns].
            window_ns: time over which the velocity was taken [ns].
        """
        if horizon_ns + window_ns <= self.seen_ns:
            return 0.0
        horizon, window = horizon_ns * 1e-9, window_ns * 1e-9
        drift = 0.5 * self.acceleration * horizon * (horizon + window)
        return min(drift, 2.0 * self.speed * horizon)

    def leap(self, last_ns: int, last: float, stamp: int, angle: float) -> Leap | None:
        """The leap from the last reading to the next one, (C5); None where it is a motion."""
        span_ns = stamp - last_ns
        if not 0 < span_ns <= LEAP_WITHIN_NS:
            return None
        span = span_ns * 1e-9
        if not abs((angle - last) - self.velocity * span) > self.most(span):
            return None
        return Leap(stamp, last, angle, self.velocity)

    def reach(self, span_s: float) -> float:
        """How far the axis may have come in ``span_s`` as it has moved so far [rad]."""
        return max(LEAP_FLOOR, 2.0 * self.band, 2.0 * self.fastest * span_s)

    def most(self, span_s: float) -> float:
        """How far readings may be apart in ``span_s`` without being a leap [rad]."""
        if self.travelled < TRAVEL:
            return float("inf")
        span = max(span_s, JITTER_NS * 1e-9)
        return max(
            LEAP_FLOOR,
            LEAP_BANDS * self.band,
            LEAP_SPEED * self.fastest * span,
            LEAP_ACCELERATION * self.hardest * span * span,
        )


def _faded(before: float, now: float, keep: float) -> float:
    """Root mean square of what was and what is, with the weight ``keep`` of what was."""
    return sqrt(before * before * keep + now * now * (1.0 - keep))


def curvatures(motion: Motion, stamps: Stamps, angles: Vector) -> Vector | None:
    """``Motion.curvature`` before every reading of a channel, (n,); None where a reading leaps.

    The same numbers, bit for bit, as ``leap``, ``take`` and ``curvature`` reading by reading.
    """
    result = np.zeros(stamps.size)
    if stamps.size == 0:
        return result
    spans, moved = np.diff(stamps, prepend=stamps[:1]), np.diff(angles, prepend=angles[:1])
    motion.take(int(stamps[0]), float(angles[0]))
    begin, last = 1, stamps.size - 1
    while begin <= last:
        end = int(np.searchsorted(stamps, motion.begin_ns + WINDOW_NS))
        end = min(max(end, begin), last)
        if _leaps(motion, spans[begin : end + 1], moved[begin : end + 1]):
            return None
        for k in np.flatnonzero(spans[begin:end] > motion.seen_ns).tolist():
            result[begin + k] = motion.curvature(int(spans[begin + k]))
        motion.take(int(stamps[end]), float(angles[end]))
        if spans[end] > motion.seen_ns:  # zeros that are never written to take no memory
            result[end] = motion.curvature(int(spans[end]))
        begin = end + 1
    return result


def _leaps(motion: Motion, spans: Stamps, moved: Vector) -> bool:
    """Whether ``Motion.leap`` finds one in a piece in which the motion is the same."""
    if motion.travelled < TRAVEL:
        return False
    seconds = spans * 1e-9
    far = np.abs(moved - motion.velocity * seconds) > LEAP_FLOOR
    return any(
        motion.leap(0, 0.0, int(spans[k]), float(moved[k])) is not None
        for k in np.flatnonzero(far & (spans <= LEAP_WITHIN_NS)).tolist()
    )
