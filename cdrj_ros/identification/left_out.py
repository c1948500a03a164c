"""The model's own error, from residuals of recordings that were not fitted.

A fit absorbs part of the model's error in its numbers, so residuals of fitted recordings are too
small.  Residuals of other recordings, less the noise of the sensor, show the error to expect in the
next recording.  See (I5) in docs/identification.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.identification.standard_errors import white_power

Vector = NDArray[np.float64]

ENOUGH: Final = 0.92
"""Smallest share of residuals within two standard deviations that the numbers then explain."""

ENOUGH_OF_A_RUN: Final = 0.8
"""The same for a single recording."""


def model_error(residuals: Sequence[Vector], stddevs: Sequence[Vector]) -> float:
    """Standard deviation of the error of the model itself: (I5).

    Args:
        residuals: estimate less reference for every recording that was left out.
        stddevs: standard deviations of these estimates from the numbers alone.

    Returns:
        0 if the standard deviations of the numbers explain the residuals.
    """
    inside = [float(np.mean(np.abs(r) <= 2.0 * s)) for r, s in zip(residuals, stddevs, strict=True)]
    sizes = np.array([r.size for r in residuals], dtype=float)
    if np.average(inside, weights=sizes) >= ENOUGH and min(inside) >= ENOUGH_OF_A_RUN:
        return 0.0
    squares = np.array([np.mean(r**2) for r in residuals])
    noise = sum(white_power(r) for r in residuals) / sizes.sum()
    between = float(squares.std(ddof=1)) if squares.size > 1 else 0.0
    power = float(np.average(squares, weights=sizes)) + between - noise
    return float(np.sqrt(max(power, 0.0)))
