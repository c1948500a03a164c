"""Monotone cubic interpolation of tables (PCHIP).

The results equal those of ``scipy.interpolate.PchipInterpolator`` bit for bit, as a test shows.
The import of that module took a fifth of the estimator node's start time, and 30 MB.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Pieces:
    """Polynomials between neighbouring angles, continued beyond the first and the last angle."""

    angle: Vector
    """Increasing, shape (n,)."""
    coefficients: NDArray[np.float64]
    """Coefficients of powers of the distance to the angle before, highest power first, shape
    (order + 1, n - 1)."""

    def __call__(self, angle: Vector) -> Vector:
        """The values at any angles."""
        piece = np.clip(
            np.searchsorted(self.angle, angle, side="right") - 1, 0, len(self.angle) - 2
        )
        distance = angle - self.angle[piece]
        value, power = np.zeros_like(distance), np.ones_like(distance)
        for row in self.coefficients[::-1]:
            value = value + row[piece] * power
            power = power * distance
        return value

    def derivative(self) -> Pieces:
        """The derivative by the angle."""
        order = len(self.coefficients) - 1
        factor = np.arange(order, 0.0, -1.0)
        return Pieces(self.angle, self.coefficients[:-1] * factor[:, None])


def monotone_cubic(angle: Vector, value: Vector) -> Pieces:
    """Cubic pieces through a table that do not overshoot its values (Fritsch, Butland 1984).

    Args:
        angle: increasing, shape (n,), n >= 2.
        value: shape (n,).
    """
    step = np.diff(angle)
    secant = np.diff(value) / step
    slope = _slopes(step, secant)
    bend = (slope[:-1] + slope[1:] - 2 * secant) / step
    return Pieces(
        angle,
        np.stack([bend / step, (secant - slope[:-1]) / step - bend, slope[:-1], value[:-1]]),
    )


def _slopes(step: Vector, secant: Vector) -> Vector:
    """Slopes at the angles: 0 at an extremum, else a weighted harmonic mean of the secants."""
    if len(secant) == 1:
        return np.repeat(secant, 2)
    before, after = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    level = np.sign(secant[1:]) != np.sign(secant[:-1])
    level |= (secant[1:] == 0.0) | (secant[:-1] == 0.0)
    slope = np.zeros(len(secant) + 1)
    inner = slope[1:-1]
    with np.errstate(all="ignore"):
        mean = (before / secant[:-1] + after / secant[1:]) / (before + after)
        inner[~level] = 1.0 / mean[~level]
    slope[0] = _end_slope(step[0], step[1], secant[0], secant[1])
    slope[-1] = _end_slope(step[-1], step[-2], secant[-1], secant[-2])
    return slope


def _end_slope(step: float, next_step: float, secant: float, next_secant: float) -> float:
    """Slope at an end from three points, limited so that the shape is kept (Moler 2004, 3.6)."""
    slope = ((2 * step + next_step) * secant - step * next_secant) / (step + next_step)
    if np.sign(slope) != np.sign(secant):
        return 0.0
    if np.sign(secant) != np.sign(next_secant) and abs(slope) > 3.0 * abs(secant):
        return 3.0 * secant
    return slope
