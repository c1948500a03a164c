"""The model's own error, from residuals of recordings that were not fitted.

A fit absorbs part of the model's error in its numbers, so residuals of fitted recordings are too
small.  Residuals of other recordings show the error to expect in the next recording.  They contain
the errors of the numbers, which the estimator adds itself.  See (I5) in docs/identification.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

ENOUGH: Final = 0.95
"""Smallest share of all residuals within two standard deviations."""

ENOUGH_OF_A_RUN: Final = 0.8
"""The same for every single recording."""

DIGITS: Final = 1e-3
"""Relative accuracy of the error."""


def model_error(residuals: Sequence[Vector], stddevs: Sequence[Vector]) -> float:
    """Standard deviation of the error of the model itself: (I5).

    Args:
        residuals: estimate less reference for every recording that was left out.
        stddevs: standard deviations of these estimates from the numbers alone.

    Returns:
        0 if the standard deviations of the numbers explain the residuals.
    """
    if _covered(residuals, stddevs, 0.0):
        return 0.0
    low, high = 0.0, max(float(np.abs(r).max(initial=0.0)) for r in residuals)
    while high - low > DIGITS * high:
        middle = 0.5 * (low + high)
        if _covered(residuals, stddevs, middle):
            high = middle
        else:
            low = middle
    return high


def _covered(residuals: Sequence[Vector], stddevs: Sequence[Vector], error: float) -> bool:
    """Whether the numbers and an error of the model explain enough of the residuals."""
    inside = [
        float(np.mean(np.abs(r) <= 2.0 * np.hypot(s, error)))
        for r, s in zip(residuals, stddevs, strict=True)
    ]
    overall = np.average(inside, weights=[r.size for r in residuals])
    return bool(overall >= ENOUGH and min(inside) >= ENOUGH_OF_A_RUN)
