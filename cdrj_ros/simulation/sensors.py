"""Sensors of the rig: resolution, rate, phase, noise, bias, jitter, dropouts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.robot.description import Sensor

Vector = NDArray[np.float64]

MOST_JITTER: Final = 0.45
"""Largest jitter of a stamp as a share of the period, so that stamps keep their order."""


@dataclass(frozen=True)
class Encoder:
    """An incremental angle sensor."""

    counts: int
    """Counts per turn; on a prismatic joint, per 2 pi m."""
    rate: float
    """Readings per second [Hz]."""
    phase_s: float = 0.0
    """Time from the recording's start to the first reading [s]."""
    noise: float = 0.0
    """Standard deviation of the noise before quantisation [rad]."""
    bias: float = 0.0
    """Constant added to every reading [rad]."""
    jitter_s: float = 0.0
    """Standard deviation of the stamps about the time of reading [s]."""
    dropout: float = 0.0
    """Share of readings that are lost, in [0, 1)."""
    burst_s: float = 0.0
    """Mean duration of a loss [s]; 0: readings are lost independently."""


@dataclass(frozen=True)
class LoadCells:
    """Reference sensors of force and torque."""

    rate: float = 100.0
    """Readings per second [Hz]."""
    force_noise: float = 0.02
    """Standard deviation of the forces' noise [N]."""
    torque_noise: float = 0.0005
    """Standard deviation of the torques' noise [N m]."""
    force_step: float = 2.0**-7
    """Resolution of the forces [N]."""
    torque_step: float = 2.0**-13
    """Resolution of the torques [N m]."""
    force_bias: float = 0.0
    """Constant added to every force reading [N]."""
    torque_bias: float = 0.0
    """Constant added to every torque reading [N m]."""
    jitter_s: float = 0.0
    """Standard deviation of the stamps about the time of reading [s]."""
    dropout: float = 0.0
    """Share of readings that are lost, in [0, 1)."""
    burst_s: float = 0.0
    """Mean duration of a loss [s]; 0: readings are lost independently."""


@dataclass(frozen=True)
class Schedule:
    """Times of a sensor's readings, and the stamps of its messages."""

    times: Vector
    """Times of the readings that arrive [s], shape (n,), increasing."""
    stamps: Vector
    """Stamps of the messages [s], shape (n,), increasing."""


MOTOR_ENCODER = Encoder(81_920, 1000.0)
JOINT_ENCODER = Encoder(16_384, 500.0, 0.0003)


def reading_times(begin: float, end: float, rate: float, phase_s: float = 0.0) -> Vector:
    """Times [s] at which a sensor of this rate reads within [begin, end]."""
    count = int(np.floor((end - begin - phase_s) * rate + 1e-9)) + 1
    times: Vector = begin + phase_s + np.arange(max(count, 0)) / rate
    return times


def schedule(
    sensor: Encoder | LoadCells, begin: float, end: float, generator: np.random.Generator
) -> Schedule:
    """Readings within [begin, end] [s] with jitter, excluding lost ones."""
    phase_s = sensor.phase_s if isinstance(sensor, Encoder) else 0.0
    times = reading_times(begin, end, sensor.rate, phase_s)
    stamps = times
    if sensor.jitter_s > 0.0:
        most = MOST_JITTER / sensor.rate
        stamps = times + np.clip(generator.normal(0.0, sensor.jitter_s, times.size), -most, most)
    if sensor.dropout > 0.0:
        kept = ~lost(times.size, sensor.dropout, sensor.burst_s * sensor.rate, generator)
        times, stamps = times[kept], stamps[kept]
    return Schedule(times, stamps)


def lost(
    count: int, share: float, burst: float, generator: np.random.Generator
) -> NDArray[np.bool_]:
    """Which of ``count`` readings are lost, in bursts of ``burst`` on average (Gilbert 1960).

    Independent losses have bursts of 1 / (1 - share) on average; shorter ones are not possible.
    """
    if burst <= 1.0 / (1.0 - share):
        return np.asarray(generator.random(count) < share)
    gone = np.zeros(count, dtype=np.bool_)
    good = burst * (1.0 - share) / share  # mean number of readings between losses
    at = 0 if generator.random() < share else int(generator.geometric(min(1.0 / good, 1.0)))
    while at < count:
        length = int(generator.geometric(1.0 / burst))
        gone[at : at + length] = True
        at += length + int(generator.geometric(min(1.0 / good, 1.0)))
    return gone


def read_encoder(
    encoder: Encoder,
    times: Vector,
    truth_time: Vector,
    angle: Vector,
    generator: np.random.Generator | None = None,
    sensor: Sensor | None = None,
) -> Vector:
    """Readings as whole counts at the given times [s].

    Args:
        encoder: encoder with its counts, noise and bias.
        times: times of the readings [s], shape (n,).
        truth_time, angle: the truth [s], [rad].
        generator: random generator; required if the encoder has noise.
        sensor: the robot file's conversion of readings into angles, whose inverse is applied;
            None for no conversion.
    """
    step = 2.0 * np.pi / encoder.counts
    sensor = sensor or Sensor()
    seen = (np.interp(times, truth_time, angle) - sensor.offset) / sensor.scale + encoder.bias
    if encoder.noise > 0.0:
        if generator is None:
            raise ValueError("noise needs a generator")
        seen = seen + generator.normal(0.0, encoder.noise, times.size)
    counted: Vector = np.round(seen / step) * step
    if np.isfinite(sensor.period):  # wraps around half a period from 0
        counted -= sensor.period * np.round(counted / sensor.period)
    return counted


def read_cells(
    values: NDArray[np.float64],
    truth_time: Vector,
    times: Vector,
    noise: float,
    step: float,
    generator: np.random.Generator,
    bias: float = 0.0,
) -> NDArray[np.float64]:
    """Noisy, quantised readings of columns of truth, shape (times, columns)."""
    columns = [np.interp(times, truth_time, column) for column in values.T]
    ideal = np.stack(columns, axis=1) + bias
    read: NDArray[np.float64] = (
        np.round((ideal + generator.normal(0.0, noise, ideal.shape)) / step) * step
    )
    return read
