"""Tables of robot files are interpolated as SciPy does it, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from cdrj_ros.robot.tables import monotone_cubic


def tables() -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Rising, wavy, level, kinked and scattered values, of two points and more."""
    generator = np.random.default_rng(12)
    found: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for n in (2, 3, 4, 9, 40):
        angle = np.cumsum(generator.uniform(0.01, 1.0, n)) - 2.0
        values = (
            angle.copy(),
            np.sin(3.0 * angle),
            np.zeros(n),
            np.abs(angle) - 0.3,
            generator.normal(size=n),
            np.cumsum(generator.exponential(size=n)),
            np.round(generator.normal(size=n)),
        )
        found.extend((angle, value) for value in values)
    return found


@pytest.mark.parametrize("case", range(len(tables())))
def test_values_and_slopes_are_scipys(case: int) -> None:
    angle, value = tables()[case]
    ours, theirs = monotone_cubic(angle, value), PchipInterpolator(angle, value, extrapolate=True)
    inside = np.linspace(angle[0], angle[-1], 257)
    for where in (inside, angle, np.array([angle[0] - 1.0, angle[-1] + 1.0])):
        assert np.array_equal(ours(where), theirs(where))
        assert np.array_equal(ours.derivative()(where), theirs.derivative()(where))


def test_a_table_is_met_and_never_overshot() -> None:
    for angle, value in tables():
        pieces = monotone_cubic(angle, value)
        assert np.allclose(pieces(angle), value, rtol=0.0, atol=1e-14 * (1.0 + np.ptp(value)))
        for k in range(len(angle) - 1):
            inside = pieces(np.linspace(angle[k], angle[k + 1], 33))
            slack = 1e-14 * (1.0 + np.ptp(value))
            assert inside.min() >= min(value[k], value[k + 1]) - slack
            assert inside.max() <= max(value[k], value[k + 1]) + slack
