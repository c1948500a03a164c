"""What the rig's sensors report of the truth: resolution, rate, phase and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Encoder:
    """An angle sensor that counts."""

    counts: int
    """Counts per turn."""
    rate: float
    """Readings per second [Hz]."""
    phase_s: float = 0.0
    """Time of its first reading after the recording's start [s]."""


@dataclass(frozen=True)
class LoadCells:
    """Reference sensors of force and torque."""

    rate: float = 100.0
    """Readings per second [Hz]."""
    force_noise: float = 0.02
    """Standard deviation [N]."""
    torque_noise: float = 0.0005
    """Standard deviation [N m]."""
    force_step: float = 2.0**-7
    """Resolution [N]."""
    torque_step: float = 2.0**-13
    """Resolution [N m]."""


MOTOR_ENCODER = Encoder(81_920, 1000.0)
JOINT_ENCODER = Encoder(16_384, 500.0, 0.0003)


def reading_times(begin: float, end: float, rate: float, phase_s: float = 0.0) -> Vector:
    """Times [s] at which a sensor of this rate reads within [begin, end]."""
    count = int(np.floor((end - begin - phase_s) * rate + 1e-9)) + 1
    times: Vector = begin + phase_s + np.arange(max(count, 0)) / rate
    return times


def read_encoder(encoder: Encoder, times: Vector, truth_time: Vector, angle: Vector) -> Vector:
    """Angles [rad] as whole counts at the given times [s]."""
    step = 2.0 * np.pi / encoder.counts
    counted: Vector = np.round(np.interp(times, truth_time, angle) / step) * step
    return counted


def read_cells(
    values: NDArray[np.float64],
    truth_time: Vector,
    times: Vector,
    noise: float,
    step: float,
    generator: np.random.Generator,
) -> NDArray[np.float64]:
    """Noisy, quantised readings of columns of truth, shape (times, columns)."""
    columns = [np.interp(times, truth_time, column) for column in values.T]
    ideal = np.stack(columns, axis=1)
    read: NDArray[np.float64] = (
        np.round((ideal + generator.normal(0.0, noise, ideal.shape)) / step) * step
    )
    return read
