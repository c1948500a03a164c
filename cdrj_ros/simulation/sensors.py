"""Sensors of the simulated robot: resolution, rate, phase, noise, bias, jitter, losses.

The functions read a truth that is known as a whole; the groups of ``sensor_groups.py``, one that
comes in stretches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.robot.description import Sensor

MOST_JITTER: Final = 0.45
"""Largest jitter of a stamp as a share of the period, so that stamps keep their order."""

ROUNDING_S: Final = 1e-12
"""Error of rounding in the times of readings [s]."""


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """When a sensor reads, and which of its readings arrive."""

    rate: float
    """Readings per second [Hz]."""
    phase: float = 0.0
    """Time from the recording's start to the first reading [s]."""
    jitter: float = 0.0
    """Standard deviation of the stamps about the time of reading [s]."""
    dropout: float = 0.0
    """Share of readings that are lost, in [0, 1)."""
    latency: float = 0.0
    """Time from a reading to its message [s]."""


@dataclass(frozen=True, kw_only=True)
class Encoder(Sampling):
    """An incremental angle sensor."""

    counts: int
    """Counts per turn of the axis; on a prismatic joint, per 2 pi m."""
    noise: float = 0.0
    """Standard deviation of the noise before quantisation [rad]."""
    bias: float = 0.0
    """Constant added to every reading [rad]."""


@dataclass(frozen=True, kw_only=True)
class LoadCells(Sampling):
    """Reference sensors of force and torque."""

    rate: float = 100.0
    """Readings per second [Hz]."""
    noise: float = 0.02
    """Standard deviation of the forces' noise [N]."""
    torque_noise: float = 0.0005
    """Standard deviation of the torques' noise [N m]."""
    step: float = 2.0**-7
    """Resolution of the forces [N]."""
    torque_step: float = 2.0**-13
    """Resolution of the torques [N m]."""
    bias: float = 0.0
    """Constant added to every force reading [N]."""


class Schedule(NamedTuple):
    """Times of a sensor's readings, and the stamps of its messages."""

    times: Vector
    """Times of the readings that arrive [s], shape (n,), increasing."""
    stamps: Vector
    """Stamps of the messages [s], shape (n,), increasing."""


NONE_YET = Schedule(np.empty(0), np.empty(0))

MOTOR_ENCODER = Encoder(counts=81_920, rate=1000.0)
JOINT_ENCODER = Encoder(counts=16_384, rate=500.0, phase=0.0003)
LOAD_CELLS = LoadCells()


class ReadingTimes:
    """The times at which a sensor reads, with jitter and without lost readings."""

    def __init__(self, sensor: Sampling, seed: Sequence[int]) -> None:
        """Start at 0."""
        self._sensor, self._count = sensor, 0
        self._jitter, self._losses = (np.random.default_rng([*seed, k]) for k in range(2))

    def until(self, end: float) -> Schedule:
        """The readings since the last call and up to ``end`` [s]."""
        sensor, first = self._sensor, self._count
        self._count = max(first, 1 + floor((end + ROUNDING_S - sensor.phase) * sensor.rate))
        size = self._count - first
        if size == 0:
            return NONE_YET
        times = sensor.phase + np.arange(first, self._count) / sensor.rate
        stamps = times
        if sensor.jitter > 0.0:
            most = MOST_JITTER / sensor.rate
            off = self._jitter.normal(0.0, sensor.jitter, size)
            stamps = times + np.clip(off, -most, most)
        if sensor.dropout > 0.0:
            kept = self._losses.random(size) >= sensor.dropout
            times, stamps = times[kept], stamps[kept]
        return Schedule(times, stamps)


def angle_of(sensor: Sensor, reading: Vector) -> Vector:
    """Angles [rad] that the robot file assigns to readings, which do not wrap around."""
    angle: Vector = sensor.scale * reading + sensor.offset
    if sensor.corrected_at:
        angle = angle + np.interp(angle, sensor.corrected_at, sensor.correction)
    return angle


def reading_of(sensor: Sensor, angle: Vector) -> Vector:
    """Readings without error, to which the robot file assigns these angles [rad]."""
    if sensor.corrected_at:
        correction = np.array(sensor.correction)
        angle = angle - np.interp(angle, correction + sensor.corrected_at, correction)
    reading: Vector = (angle - sensor.offset) / sensor.scale
    return reading


def counted(encoder: Encoder, angle: Vector, noise: float | Vector, sensor: Sensor) -> Vector:
    """Readings of angles [rad] as whole counts, with noise [rad]; all arrays of shape (n,)."""
    unit = abs(sensor.scale)  # counts, bias and noise are those of the axis
    step = 2.0 * np.pi / encoder.counts / unit
    seen = reading_of(sensor, angle) + (encoder.bias + noise) / unit
    read: Vector = np.round(seen / step) * step
    if np.isfinite(sensor.period):  # wraps around half a period from 0
        read -= sensor.period * np.round(read / sensor.period)
    return read


def measured(
    ideal: Table, noise: float, step: float, generator: np.random.Generator, bias: float = 0.0
) -> Table:
    """Readings of ideal values with their noise, bias and resolution; shape (n, columns)."""
    read: Table = np.round((ideal + bias + generator.normal(0.0, noise, ideal.shape)) / step) * step
    return read
