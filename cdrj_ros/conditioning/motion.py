"""Speed and acceleration of an axis, and the motion that they allow between two readings.

Equations (C2) to (C5) of docs/conditioning.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, sqrt
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import usable_in_kernels

Stamps = NDArray[np.int64]
Vector = NDArray[np.float64]

WINDOW_NS: Final = 100_000_000
"""Speed and acceleration are averaged over at least this time [ns]."""

MEMORY_S: Final = 10.0
"""Time constant with which the weight of earlier speeds and accelerations decays [s]."""

CHORDS: Final = 1.5
"""Correction factor for accelerations from readings a third of a period apart; these would be
too small."""

WINDOWS: Final = 3
"""Windows of a channel slower than ``WINDOW_NS`` after which its motion is known."""

FAR_NS: Final = 1_000_000_000
"""Between readings further apart than this an axis that moves may have been anywhere [ns]."""

STILL: Final = 0.01
"""An axis that moves by no more than this between two readings is at rest [rad]."""

EVER_NS: Final = 1 << 62
"""Longer than any interval [ns]."""

LEAP_SPEED: Final = 2.5
"""A leap is faster than the axis so far by at least this factor."""

LEAP_ACCELERATION: Final = 10.0
"""A leap exceeds the greatest acceleration so far by at least this factor."""

LEAP_BANDS: Final = 40.0
"""A leap is wider than the sensor's greatest error by at least this factor."""

LEAP_FLOOR: Final = 0.02
"""Smallest leap [rad]."""

JITTER_NS: Final = 5_000_000
"""Error of the stamps that the thresholds allow for [ns]."""

LEAP_WITHIN_NS: Final = 100_000_000
"""Longest interval over which a leap can be distinguished from a motion [ns]."""

SETTLED_NS: Final = 50_000_000
"""A leap that lasts for this long is a step of the sensor [ns]."""

TRAVEL: Final = 1.0
"""Leaps are looked for only after an axis has travelled this far in total [rad]."""


LASTING: Final = ("speed", "acceleration", "fastest", "hardest", "travelled", "windows")
"""Fields of ``Motion`` that do not depend on the clock of the readings."""

Verdict = Literal["", "glitch", "motion", "step"]
"""What a leap was; empty while undecided."""


class Leap(NamedTuple):
    """A change of reading that is too fast for the motion of the axis so far."""

    stamp_ns: int
    """Stamp of the first reading after it [ns]."""
    before: float
    """Last angle before it [rad]."""
    after: float
    """First angle after it [rad]."""
    velocity: float
    """Velocity of the axis before it [rad/s]."""

    def judge(self, stamp: int, angle: float) -> Verdict:
        """Classify the leap by a later reading."""
        angle -= self.velocity * ((stamp - self.stamp_ns) * 1e-9)
        if abs(angle - self.before) < abs(angle - self.after):
            return "glitch"
        if abs(angle - self.after) > 0.5 * abs(self.after - self.before):
            return "motion"
        return "step" if stamp - self.stamp_ns >= SETTLED_NS else ""


class Moving(Protocol):
    """Fields of ``Motion``, which kernels have in a record."""

    band: float
    negligible: float
    begin_ns: int
    begin: float
    span_s: float
    velocity: float
    speed: float
    acceleration: float
    fastest: float
    hardest: float
    travelled: float
    windows: float
    seen_ns: int


@dataclass
class Motion:
    """Running estimates of an axis's speed and acceleration."""

    band: float = 0.0
    """Greatest error of a reading [rad]."""
    negligible: float = 0.0
    """Standard deviations up to this are not reported [rad], positive."""
    begin_ns: int = -1
    """Stamp of the first reading of the current window [ns]; -1 before the first reading."""
    begin: float = 0.0
    """Angle at the beginning of the window [rad]."""
    span_s: float = 0.0
    """Length of the last window [s]."""
    velocity: float = 0.0
    """Mean over the last window [rad/s]."""
    speed: float = 0.0
    """Speed so far [rad/s], V of (C2): rises at once and decays with ``MEMORY_S``."""
    acceleration: float = 0.0
    """Acceleration so far [rad/s^2], A of (C2)."""
    fastest: float = 0.0
    """Greatest speed over any window so far [rad/s]."""
    hardest: float = 0.0
    """Greatest acceleration between any two windows so far [rad/s^2]."""
    travelled: float = 0.0
    """Sum of the displacements of all windows [rad]."""
    windows: float = 0.0
    """Number of windows so far."""
    seen_ns: int = EVER_NS
    """Deviations between readings at most this far apart are negligible [ns]."""

    def take(self, stamp: int, angle: float) -> None:
        """Take the next reading of the axis, (C2)."""
        take_angle(self, stamp, angle)

    def elsewhen(self) -> Motion:
        """Copy the fields ``LASTING``, which stay valid when the clock of the readings changes."""
        known = {name: getattr(self, name) for name in LASTING}
        later = Motion(self.band, self.negligible, **known)
        later.seen_ns = seen_of(later)
        return later

    def knows(self, span_ns: int) -> bool:
        """Whether the motion so far tells what may happen between readings so far apart."""
        if span_ns <= WINDOW_NS:
            return True
        still = self.speed * span_ns * 1e-9 <= STILL
        return self.windows > WINDOWS and (span_ns <= FAR_NS or still)

    def curvature(self, span_ns: int) -> float:
        """Curvature of (C3) between two readings ``span_ns`` apart, 4 s / T^2 [rad/ns^2].

        The standard deviation of the angle is this times the times to both readings.  0 where it
        is ``negligible`` everywhere between them, infinite where it is unknown.
        """
        seen = span_ns <= self.seen_ns
        if seen and span_ns <= WINDOW_NS:  # as between most readings
            return 0.0
        if not self.knows(span_ns):
            return inf
        if seen:
            return 0.0
        span = span_ns * 1e-9
        bend = self.acceleration * span
        unresolved = max(bend / self.speed, 1.0) if self.speed > 0.0 else 1.0
        sagitta = min(bend * span / 8.0 * unresolved * unresolved, self.speed * span / 3.0)
        return 4.0 * sagitta / (float(span_ns) * float(span_ns))

    def ahead(self, horizon_ns: int, window_ns: int) -> float:
        """Standard deviation of an angle extrapolated by ``horizon_ns``, (C4) [rad].

        Args:
            horizon_ns: time since the last reading [ns].
            window_ns: time over which the velocity was averaged [ns].
        """
        if horizon_ns + window_ns <= self.seen_ns:
            return 0.0
        horizon, window = horizon_ns * 1e-9, window_ns * 1e-9
        drift = 0.5 * self.acceleration * horizon * (horizon + window)
        return min(drift, 2.0 * self.speed * horizon)

    def leap(self, last_ns: int, last: float, stamp: int, angle: float) -> Leap | None:
        """The leap from the last reading to the next one, (C5); None if it may be a motion."""
        span_ns = stamp - last_ns
        if not 0 < span_ns <= LEAP_WITHIN_NS:
            return None
        span = span_ns * 1e-9
        if not abs((angle - last) - self.velocity * span) > self.most(span):
            return None
        return Leap(stamp, last, angle, self.velocity)

    def reach(self, span_s: float) -> float:
        """Greatest displacement in ``span_s`` at up to twice the greatest speed so far [rad]."""
        return max(LEAP_FLOOR, 2.0 * self.band, 2.0 * self.fastest * span_s)

    def most(self, span_s: float) -> float:
        """Greatest deviation over ``span_s`` that is not a leap, (C5) [rad]."""
        if self.travelled < TRAVEL:
            return float("inf")
        span = max(span_s, JITTER_NS * 1e-9)
        return max(
            LEAP_FLOOR,
            LEAP_BANDS * self.band,
            LEAP_SPEED * self.fastest * span,
            LEAP_ACCELERATION * self.hardest * span * span,
        )


@usable_in_kernels
def _faded(before: float, now: float, keep: float) -> float:
    """Weighted root mean square of the old and the new value; ``keep`` weighs the old one."""
    return sqrt(before * before * keep + now * now * (1.0 - keep))


@usable_in_kernels
def seen_of(motion: Moving) -> int:
    """``Motion.seen_ns`` by the speed and the acceleration so far [ns]."""
    if not (motion.speed > 0.0 and motion.acceleration > 0.0):
        return EVER_NS
    slow = 3.0 * motion.negligible / motion.speed
    smooth = sqrt(8.0 * motion.negligible / motion.acceleration)
    resolved = motion.acceleration * smooth <= motion.speed
    return int(min(max(slow, smooth) if resolved else slow, 1e9) * 1e9)


@usable_in_kernels
def _close(motion: Moving, span_s: float, moved: float) -> None:
    """End a window of ``span_s`` in which the axis has moved by ``moved`` [rad]."""
    velocity = moved / span_s
    certain = max(abs(moved) - 2.0 * motion.band, 0.0)
    speed = certain / span_s
    if motion.span_s > 0.0:
        change = max(abs(velocity - motion.velocity) - 2.0 * motion.band / span_s, 0.0)
        acceleration = change / (0.5 * (span_s + motion.span_s))
    else:  # the first window of a slow channel gives no better estimate
        acceleration = speed / span_s if span_s > 2e-9 * WINDOW_NS else 0.0
    if span_s > 2e-9 * WINDOW_NS:
        acceleration *= CHORDS
    keep = exp(-span_s / MEMORY_S)
    motion.speed = max(speed, _faded(motion.speed, speed, keep))
    motion.acceleration = max(acceleration, _faded(motion.acceleration, acceleration, keep))
    motion.fastest = max(motion.fastest, speed)
    motion.hardest = max(motion.hardest, acceleration)
    motion.travelled += certain
    motion.windows += 1.0
    motion.span_s, motion.velocity = span_s, velocity
    motion.seen_ns = seen_of(motion)


@usable_in_kernels
def take_angle(motion: Moving, stamp: int, angle: float) -> None:
    """Take the next reading of an axis, (C2)."""
    if motion.begin_ns < 0 or stamp < motion.begin_ns:  # the clock went back during a restart
        motion.begin_ns, motion.begin = stamp, angle
    elif stamp - motion.begin_ns >= WINDOW_NS:
        _close(motion, (stamp - motion.begin_ns) * 1e-9, angle - motion.begin)
        motion.begin_ns, motion.begin = stamp, angle


def curvatures(motion: Motion, stamps: Stamps, angles: Vector) -> Vector | None:
    """``Motion.curvature`` before every reading of a channel, shape (n,).

    None if there is a leap, or a curvature that is unknown.  The results equal those of ``leap``,
    ``take`` and ``curvature`` reading by reading, bit for bit.
    """
    result = np.zeros(stamps.size)
    if stamps.size == 0:
        return result
    spans, moved = np.diff(stamps, prepend=stamps[:1]), np.diff(angles, prepend=angles[:1])
    # most recordings are dense, and their windows need not be searched
    longest, furthest = int(spans.max()), float(np.abs(moved).max())
    motion.take(int(stamps[0]), float(angles[0]))
    begin, last = 1, stamps.size - 1
    while begin <= last:
        end = int(np.searchsorted(stamps, motion.begin_ns + WINDOW_NS))
        end = min(max(end, begin), last)
        window = slice(begin, end + 1)
        may_leap = furthest + abs(motion.velocity) * (longest * 1e-9) > LEAP_FLOOR
        if may_leap and _leaps(motion, spans[window], moved[window]):
            return None
        sparse = longest > WINDOW_NS and spans[window].max() > WINDOW_NS
        if sparse and motion.windows < WINDOWS + 1:
            return None
        if longest > motion.seen_ns:
            for k in np.flatnonzero(spans[begin:end] > motion.seen_ns).tolist():
                result[begin + k] = motion.curvature(int(spans[begin + k]))
        motion.take(int(stamps[end]), float(angles[end]))
        if spans[end] > motion.seen_ns:  # zeros that are never written to take no memory
            result[end] = motion.curvature(int(spans[end]))
        begin = end + 1
    return None if np.isinf(result).any() else result


def _leaps(motion: Motion, spans: Stamps, moved: Vector) -> bool:
    """Whether ``Motion.leap`` finds a leap within a window; there ``motion`` is constant."""
    if motion.travelled < TRAVEL:
        return False
    seconds = spans * 1e-9
    far = np.abs(moved - motion.velocity * seconds) > LEAP_FLOOR
    return any(
        motion.leap(0, 0.0, int(spans[k]), float(moved[k])) is not None
        for k in np.flatnonzero(far & (spans <= LEAP_WITHIN_NS)).tolist()
    )
