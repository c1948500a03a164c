"""Variance of what is left of the residuals after every number of the file has been adjusted.

It has two parts: short errors, such as noise and the counts of encoders, of which every state of
the mechanism shows a sample; and errors that last in a state, of which every state shows one.
See (I6) in docs/identification.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Labels = NDArray[np.int64]

ROUNDS: Final = 30
"""Largest number of rounds in which the variance is computed."""

SETTLED: Final = 0.01
"""Relative change of the variance that ends the rounds."""


@dataclass(frozen=True)
class Linear:
    """A linear problem around a solution."""

    slopes: Table
    """Derivatives of the residuals, shape (n, q)."""
    residuals: Vector
    """Shape (n,)."""
    known: Vector
    """Information that each number has beforehand, shape (q,)."""
    pull: Vector
    """Gradient of the half sum of squares of what is known beforehand, shape (q,)."""


@dataclass(frozen=True)
class Places:
    """Where the residuals belong."""

    states: Labels
    """State of the mechanism, shape (n,)."""
    cells: Labels
    """Finer state and reference, shape (n,)."""
    count: int
    """Number of states that count as independent."""


def variance_left(linear: Linear, places: Places, begin: float) -> float:
    """(I6): variance that a residual would have if all residuals were independent.

    The numbers are adjusted with that variance, so both are found in turns.

    Args:
        linear: the residuals, as a function of all numbers that are not exact.
        places: of the residuals.
        begin: the first guess.
    """
    parts = []
    for state in np.unique(places.states):
        rows = places.states == state
        slopes = linear.slopes[rows]
        parts.append((slopes.T @ slopes, slopes.T @ linear.residuals[rows]))
    square = sum((part for part, _ in parts), np.zeros((linear.known.size,) * 2))
    uphill = sum((part for _, part in parts), np.zeros(linear.known.size))
    repeats = linear.residuals.size / max(places.count, 1)
    variance = begin
    for _ in range(ROUNDS):
        covariance = np.linalg.inv(square / variance + np.diag(linear.known))
        moved = -covariance @ (uphill / variance + linear.pull)
        left = linear.residuals + linear.slopes @ moved
        short = variance * _ratio(parts, covariance, moved, variance)
        before, variance = variance, short + lasting_power(left, places.cells) * repeats
        variance = max(variance, 1e-300)
        if abs(variance - before) < SETTLED * before:
            break
    return variance


def _ratio(
    parts: list[tuple[Table, Vector]], covariance: Table, moved: Vector, variance: float
) -> float:
    """Squared gradients of the states over their expectation for independent residuals."""
    found, expected = 0.0, 0.0
    for square, uphill in parts:
        here = (uphill + square @ moved) / variance
        share = covariance @ square / variance
        found += float(here @ covariance @ here)
        expected += float(np.trace(share) - np.sum(share * share.T))
    return found / expected if found > 0.0 and expected > 0.0 else 1.0


def lasting_power(residuals: Vector, cells: Labels) -> float:
    """Mean square of the residuals' means over cells, less that of white noise.

    Args:
        residuals: shape (n,).
        cells: cell of every residual, shape (n,).
    """
    size = np.bincount(cells)
    used = size > 1
    mean = np.bincount(cells, residuals)[used] / size[used]
    square = np.bincount(cells, residuals**2)[used] / size[used]
    noise = np.maximum(square - mean**2, 0.0) / (size[used] - 1)
    power = float(np.sum(size[used] * (mean**2 - noise)))
    return max(power, 0.0) / max(residuals.size, 1)
