"""Sensors of the simulated robot: resolution, rate, phase, noise, bias, jitter, losses.

The functions read a truth that is known as a whole; the groups of ``sensor_groups.py``, one that
comes in stretches.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.robot.description import Sensor

Seed = Sequence[int] | np.random.Generator

MOST_JITTER: Final = 0.45
"""Largest jitter of a stamp as a share of the period, so that stamps keep their order."""

SCHEDULED: Final = 1000
"""Number of readings that are scheduled at once."""


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
    burst: float = 0.0
    """Mean duration of a loss [s]; 0: readings are lost independently."""
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

    def __init__(self, sensor: Sampling, begin: float, seed: Seed) -> None:
        """Start at ``begin`` [s]."""
        self._parts = self._scheduled(sensor, begin, np.random.default_rng(seed))
        self._part, self._taken = NONE_YET, 0
        self.next_s = begin + sensor.phase
        """Time before which there is no further reading [s]."""

    @staticmethod
    def _scheduled(
        sensor: Sampling, begin: float, generator: np.random.Generator
    ) -> Iterator[Schedule]:
        """Consecutive schedules of ``SCHEDULED`` readings each."""
        count = 0
        burst = sensor.burst * sensor.rate
        losses = Losses(sensor.dropout, burst, generator) if sensor.dropout > 0.0 else None
        while True:
            times = begin + sensor.phase + np.arange(count, count + SCHEDULED) / sensor.rate
            count += SCHEDULED
            stamps = times
            if sensor.jitter > 0.0:
                most = MOST_JITTER / sensor.rate
                off = generator.normal(0.0, sensor.jitter, SCHEDULED)
                stamps = times + np.clip(off, -most, most)
            if losses is not None:
                kept = ~losses.take(SCHEDULED)
                times, stamps = times[kept], stamps[kept]
            yield Schedule(times, stamps)

    def until(self, end: float) -> Schedule:
        """The readings since the last call and up to ``end`` [s]."""
        found: list[Schedule] = []
        while self.next_s <= end + ROUNDING_S:
            times, stamps = self._part
            first = self._taken
            self._taken = int(times.searchsorted(end + ROUNDING_S, side="right"))
            if self._taken > first:
                found.append(Schedule(times[first : self._taken], stamps[first : self._taken]))
            while self._taken == self._part.times.size:
                self._part, self._taken = next(self._parts), 0
            self.next_s = float(self._part.times[self._taken])
        if not found:
            return NONE_YET
        if len(found) == 1:
            return found[0]
        return Schedule(*(np.concatenate(column) for column in zip(*found, strict=True)))


class Losses:
    """Which readings are lost, in bursts (Gilbert 1960)."""

    def __init__(self, share: float, burst: float, generator: np.random.Generator) -> None:
        """Start anywhere.

        Args:
            share: share of the readings that are lost, in (0, 1).
            burst: mean number of readings lost together.  Independent losses have bursts of
                1 / (1 - share) on average; shorter ones are not possible.
            generator: random generator.
        """
        self._share, self._generator = share, generator
        self._means = (burst * (1.0 - share) / share, burst)  # of readings that arrive, are lost
        self._bursts = burst > 1.0 / (1.0 - share)
        self._gone, self._left = False, 0
        if self._bursts:
            self._gone = bool(generator.random() < share)
            self._left = self._length()

    def take(self, count: int) -> NDArray[np.bool_]:
        """Whether each of the next readings is lost, shape (count,)."""
        if not self._bursts:
            return np.asarray(self._generator.random(count) < self._share)
        lost = np.zeros(count, dtype=np.bool_)
        at = 0
        while at < count:
            end = min(at + self._left, count)
            lost[at:end] = self._gone
            self._left -= end - at
            at = end
            if self._left == 0:
                self._gone = not self._gone
                self._left = self._length()
        return lost

    def _length(self) -> int:
        return int(self._generator.geometric(min(1.0 / self._means[self._gone], 1.0)))


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
