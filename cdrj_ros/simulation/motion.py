"""Motions of a joint: functions from times [s] to angles [rad], or [m] of a prismatic joint.

Every motion rests at 0 until time 0 and has a continuous speed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Literal, get_args

import numpy as np

from cdrj_ros.foundation.arrays import Vector

BLEND: Final = 0.2
"""Share of a move's duration spent accelerating, and the same share decelerating."""

RANDOM_TONES: Final = 4
"""Number of sines in a random motion."""


Motion = Callable[[Vector], Vector]

MotionKind = Literal["sine", "ramps", "dwell", "random"]
MOTIONS: Final[tuple[MotionKind, ...]] = get_args(MotionKind)
"""Names of the motions with amplitude and frequency."""


def named_motion(kind: MotionKind, amplitude: float, frequency: float, seed: int) -> Motion:
    """One of ``MOTIONS``; ``seed`` is that of a random one."""
    if kind == "random":
        return random(amplitude, frequency, seed)
    return {"sine": sine, "ramps": ramps, "dwell": dwell}[kind](amplitude, frequency)


def differences(time: Vector, angle: Vector) -> tuple[Vector, Vector, Vector]:
    """Angle, speed and acceleration, by central differences; shapes (n,), n at least 2."""
    speed = np.gradient(angle, time)
    return angle, speed, np.gradient(speed, time)


def sine(amplitude: float, frequency: float) -> Motion:
    """A sine [Hz] that grows to its amplitude over the first period."""

    def angle(time: Vector) -> Vector:
        moving = np.maximum(time, 0.0)
        wave = np.sin(2.0 * np.pi * frequency * moving)
        return amplitude * smooth_step(moving * frequency) * wave

    return angle


def ramps(amplitude: float, frequency: float) -> Motion:
    """Move from end to end at constant speed, with ``frequency`` cycles per second."""
    return moves((amplitude, -amplitude), 0.5 / frequency, 0.0)


def dwell(amplitude: float, frequency: float) -> Motion:
    """As ``ramps``, with rests at the ends, halfway and in the middle, reached from both sides."""
    half = 0.5 * amplitude
    stations = (half, amplitude, half, 0.0, -half, -amplitude, -half, 0.0)
    each = 1.0 / (frequency * len(stations))
    return moves(stations, 0.5 * each, 0.5 * each)


def moves(stations: Sequence[float], move_s: float, rest_s: float) -> Motion:
    """Visit the stations repeatedly in order, with a trapezoidal speed profile.

    Args:
        stations: angles [rad]; the first move starts at 0.
        move_s: duration of a move [s], positive.
        rest_s: rest after a move [s].
    """
    places = np.asarray(stations, dtype=np.float64)
    blend = BLEND * move_s
    top = 1.0 / (move_s - blend)  # speed of a move of 1 rad

    def angle(time: Vector) -> Vector:
        moving = np.maximum(time, 0.0)
        index = np.floor(moving / (move_s + rest_s)).astype(np.int64)
        at = np.minimum(moving - index * (move_s + rest_s), move_s)
        left = move_s - at
        share = np.where(
            at < blend,
            0.5 * top * at**2 / blend,
            np.where(left < blend, 1.0 - 0.5 * top * left**2 / blend, top * (at - 0.5 * blend)),
        )
        start = np.where(index > 0, places[(index - 1) % places.size], 0.0)
        return start + (places[index % places.size] - start) * share

    return angle


def random(amplitude: float, frequency: float, seed: int) -> Motion:
    """Sines of random frequency in [0.1, 1] ``frequency`` [Hz] and random phase.

    Their amplitudes add up to ``amplitude``, which the motion therefore cannot exceed.
    """
    generator = np.random.default_rng([seed, 0x6D6F7665])
    edges = np.linspace(0.1, 1.0, RANDOM_TONES + 1)
    share = generator.uniform(edges[:-1], edges[1:])  # one in each part of the band
    pulsation = 2.0 * np.pi * frequency * share
    phase = generator.uniform(0.0, 2.0 * np.pi, RANDOM_TONES)

    def angle(time: Vector) -> Vector:
        moving = np.maximum(time, 0.0)
        wave = np.sin(np.multiply.outer(moving, pulsation) + phase).mean(axis=-1)
        return amplitude * smooth_step(moving * frequency) * wave

    return angle


def smooth_step(share: Vector) -> Vector:
    """3 u^2 - 2 u^3 of a share u, from 0 below 0 to 1 above 1, both at rest."""
    inside = np.clip(share, 0.0, 1.0)
    return np.asarray(inside * inside * (3.0 - 2.0 * inside))
