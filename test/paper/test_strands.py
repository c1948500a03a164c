"""The strands across the rolling joint against virtual work."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from examples.paper.strands import RollingStrands

ANGLES = np.linspace(-0.7, 0.7, 29)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_amplification_keeps_the_work_and_gives_n_squared_the_stiffness(count: int) -> None:
    strands, tension, travel = RollingStrands(strands=count), 17.0, 2e-3
    work_out = strands.output_tension(tension) * strands.output_travel(travel)
    assert work_out == pytest.approx(tension * travel)
    stiffness = strands.output_tension(tension) / strands.output_travel(travel)
    assert strands.output_stiffness(tension / travel) == pytest.approx(stiffness)
    assert stiffness == pytest.approx(count**2 * tension / travel)


def test_torque_is_the_virtual_work_of_the_strands() -> None:
    strands, small = RollingStrands(strands=4, width=0.07), 1e-6
    upper, lower = 55.0, 31.0  # of one cable each, the same in all its strands
    up, down = (
        (ahead - behind) / (2 * small)
        for ahead, behind in zip(
            strands.lengths(ANGLES + small), strands.lengths(ANGLES - small), strict=True
        )
    )
    torque = strands.torque(ANGLES, strands.output_tension(upper), strands.output_tension(lower))
    np.testing.assert_allclose(torque, -(upper * up + lower * down), rtol=1e-8)
    difference = strands.tension_difference(ANGLES, torque)
    np.testing.assert_allclose(difference, 4 * (upper - lower))
    printed = replace(strands, form="published")
    np.testing.assert_allclose(printed.tension_difference(ANGLES, torque), 2 * difference)
