"""An angle between the counts of its sensor: a tracking filter that stays within what was read.

A sensor of low resolution says the same for many samples and then jumps by a count.  The angle
meanwhile moves on.  A critically damped third-order tracking filter (g-h-k, fading memory; E.
Brookner, Tracking and Kalman Filtering Made Easy, 1998, ch. 1; N. Morrison, 1969, ch. 13) follows
constant acceleration without lag, and is kept within half a count and three standard deviations of
every reading: however badly it suits the motion, it errs by no more than twice the sensor's errors.

On request its bandwidth rises with the motion, (C6) of docs/conditioning.md: the lag grows with the
jerk, the counts' error with the bandwidth, and the bandwidth at which their sum is smallest follows
from the speed and the acceleration of the last seconds.
"""

from __future__ import annotations

from math import exp, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import compiled, lean, usable_in_kernels
from cdrj_ros.robot.description import Sensor

Vector = NDArray[np.float64]

NOISE_BAND: Final = 3.0
"""Greatest noise of a reading, in standard deviations."""

FAR: Final = 1e15
"""The filter starts anew where its prediction exceeds this [rad]."""

CHORD_S: Final = 0.03
"""Shortest time over which a mean velocity is taken [s]."""

FORGET_S: Final = 2.0
"""Time constant with which speed and acceleration are forgotten [s]."""

LAG: Final = 6.0 / 2.0625
"""Factor of J^2 / (sigma^2 dt) in (C6)."""

FASTEST: Final = 0.077
"""Largest bandwidth times the interval of readings, where the filter passes their whole error."""

# Columns of the filter's memory: the filter, the chord that is being taken, what is known of the
# motion.
SEEN, ANGLE, SPEED, ACCELERATION, BEGUN, SINCE, CHORD, LENGTH, LARGEST, HARDEST, MOVES, MEMORY = (
    range(12)
)


def new_track() -> Vector:
    """Memory of a filter before its first reading."""
    return np.zeros(MEMORY)


def half_width(sensor: Sensor) -> float:
    """Greatest error of a reading of the sensor [rad]."""
    return abs(sensor.scale) * (0.5 * sensor.resolution + NOISE_BAND * sensor.noise)


@usable_in_kernels
def adapted(memory: Vector, dt: float, reading: float, bandwidth: float, band: float) -> float:
    """Bandwidth at a reading [Hz], (C6) of docs/conditioning.md; not below ``bandwidth``.

    Args:
        memory: shape (MEMORY,), changed.
        dt: time since the reading before [s], positive.
        reading: angle by the sensor [rad].
        bandwidth: at rest and in slow motion [Hz].
        band: greatest error of a reading [rad], positive.
    """
    memory[SINCE] += dt
    length, turned = memory[SINCE], reading - memory[BEGUN]
    moved = max(abs(turned) - 2.0 * band, 0.0)
    if moved > 0.0:
        memory[MOVES] = 1.0
    if length >= CHORD_S:
        kept, chord = exp(-length / FORGET_S), turned / length
        if memory[LENGTH] > 0.0:
            change = max(abs(chord - memory[CHORD]) - 4.0 * band / length, 0.0)
            hardest = 2.0 * change / (length + memory[LENGTH])
            memory[HARDEST] = max(hardest, memory[HARDEST] * kept)
        memory[LARGEST] = max(moved / length, memory[LARGEST] * kept)
        memory[MOVES] = 1.0 if moved > 0.0 else 0.0
        memory[CHORD], memory[LENGTH] = chord, length
        memory[BEGUN], memory[SINCE] = reading, 0.0
    if memory[MOVES] == 0.0 or memory[LARGEST] == 0.0:
        return bandwidth
    jerk = memory[HARDEST] * memory[HARDEST] / memory[LARGEST]
    best = (LAG * (jerk * jerk) / (band * band / 3.0 * dt)) ** (1.0 / 7.0) / (2.0 * pi)
    return max(bandwidth, min(best, FASTEST / dt))


@lean
def track(
    memory: Vector, dt_ns: int, reading: float, bandwidth: float, band: float, adaptive: bool
) -> float:
    """The angle at a reading [rad], (C1) of docs/conditioning.md.

    Args:
        memory: shape (MEMORY,), changed.
        dt_ns: time since the reading before [ns]; ignored at the first one.
        reading: angle by the sensor [rad].
        bandwidth: of the filter [Hz], positive.
        band: greatest difference of angle and reading [rad].
        adaptive: whether the bandwidth rises with the motion, see ``adapted``.

    Returns:
        The angle, within ``band`` of the reading.  After a silence of a whole period of the
        bandwidth the filter starts anew.
    """
    dt = dt_ns * 1e-9
    speed, acceleration = memory[SPEED], memory[ACCELERATION]
    angle = memory[ANGLE] + speed * dt + 0.5 * acceleration * dt * dt
    if memory[SEEN] == 0.0 or dt * bandwidth > 1.0 or not abs(angle) < FAR:
        memory[SEEN], memory[ANGLE], memory[SPEED], memory[ACCELERATION] = 1.0, reading, 0.0, 0.0
        memory[BEGUN], memory[SINCE], memory[LENGTH] = reading, 0.0, 0.0
        return reading
    if adaptive and band > 0.0:
        bandwidth = adapted(memory, dt, reading, bandwidth, band)
    n = memory[SEEN] + 1.0
    memory[SEEN] = min(n, 1e6)
    fade = exp(-2.0 * pi * bandwidth * dt)
    fresh = 1.0 - fade
    # at first all readings count alike (growing memory), later the recent ones more
    many = n * (n + 1.0) * (n + 2.0)
    g = max(1.0 - fade * fade * fade, 3.0 * (3.0 * n * n - 3.0 * n + 2.0) / many)
    h = max(1.5 * (fresh * fresh) * (1.0 + fade), 18.0 * (2.0 * n - 1.0) / many)
    k = max(fresh * fresh * fresh, 60.0 / many)
    if n < 3.0:  # a line through two readings, no parabola yet
        h, k = 1.0, 0.0
    off = reading - angle
    angle += min(g, 1.0) * off
    memory[SPEED] = speed + acceleration * dt + h * off / dt
    memory[ACCELERATION] = acceleration + k * off / (dt * dt)
    memory[ANGLE] = angle = min(max(angle, reading - band), reading + band)
    return float(angle)


@compiled
def track_all(
    stamp_ns: NDArray[np.int64],
    reading: Vector,
    bandwidth: float,
    band: float,
    adaptive: bool,
    angle: Vector,
) -> None:
    """``track`` over a recording without gaps, shape (n,), into ``angle``."""
    memory = np.zeros(MEMORY)
    before = np.int64(0)
    for i in range(reading.size):
        angle[i] = track(memory, stamp_ns[i] - before, reading[i], bandwidth, band, adaptive)
        before = stamp_ns[i]
