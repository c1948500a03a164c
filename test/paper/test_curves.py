"""Features of curves, on curves whose features are known."""

from __future__ import annotations

import numpy as np
import pytest

from examples.paper import curves

TURN = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
ANGLE = np.cos(TURN)
"""A cycle of the joint from its upper limit down and up again."""


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_a_wave_has_as_many_humps_as_periods(count: int) -> None:
    for shift in np.linspace(0.0, 6.0, 13):
        assert curves.humps(np.sin(count * TURN + shift)) == count


def test_an_ellipse_run_through_with_its_upper_half_rising_has_its_area() -> None:
    # the angle rises in the second half of TURN; the curve is higher there
    values = 5.0 - 0.3 * np.sin(TURN)
    assert curves.loop_area(ANGLE, values) == pytest.approx(np.pi * 0.3, rel=1e-5)
    assert curves.loop_area(ANGLE[::-1], values[::-1]) == pytest.approx(-np.pi * 0.3, rel=1e-5)


def test_an_arch_bulges_up_and_a_trough_down() -> None:
    angle = np.linspace(1.0, -1.0, 501)
    # a parabola at 0 above its values at 10 % and 90 % of the range, x = -+0.8
    assert curves.bulge(angle, 2.0 - angle**2) == pytest.approx(0.64, abs=2e-3)
    assert curves.bulge(angle, 2.0 + angle**2) == pytest.approx(-0.64, abs=2e-3)
    # a slope has no bulge, except for the grid's resolution
    assert curves.bulge(angle, 2.0 + 3.0 * angle) == pytest.approx(0.0, abs=1e-2)
