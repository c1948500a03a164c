"""Tables I and II, and what follows from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cdrj_ros.robot.reader import load_robot
from examples.paper.tables import (
    TABLE_I,
    TABLE_II,
    friction_parameters,
    pulleys,
    transmissions,
    wrap_range,
)

ROBOT = load_robot(Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml")

# Computed independently from Tables I and II, pulley 6 at 78.5 degrees.
ETA_R = (0.99367, 0.98564, 0.99499, 0.99113, 0.98604, 0.97802, 0.98441)
ETA_D_REST = (0.8646, 0.6785, 0.8925, 0.8131, 0.7523, 0.4990, 0.7201)
ETA_D_FAST = (0.8985, 0.7589, 0.9194, 0.8598, 0.8142, 0.6242, 0.7901)


def test_the_prototype_has_the_pulleys_of_table_1() -> None:
    for cable in ROBOT.cables:
        for (diameter, bearing, wrap), pulley in zip(TABLE_I, cable.pulleys, strict=True):
            assert 2e3 * pulley.radius == pytest.approx(diameter)
            assert 1e3 * pulley.bearing_diameter == pytest.approx(bearing)
            low, high = wrap_range(pulley)
            printed = [float(end) for end in wrap.split("-")]
            assert (low, high) == pytest.approx((printed[0], printed[-1]))


def test_the_prototype_has_the_friction_of_table_2_or_says_why_not() -> None:
    table = friction_parameters(ROBOT)
    assert [row[0] for row in table.rows] == [symbol for symbol, _, _ in TABLE_II]
    for _, printed, ours, why in table.rows:
        assert (printed == ours) == (why == "")
    assert sum(printed != ours for _, printed, ours, _ in table.rows) == 2


def test_transmissions_are_those_computed_independently() -> None:
    found = [transmissions(pulley) for pulley in ROBOT.cables[0].pulleys]
    for ours, eta_r, at_rest, fast in zip(found, ETA_R, ETA_D_REST, ETA_D_FAST, strict=True):
        assert ours[0] == pytest.approx(eta_r, abs=5e-6)
        assert ours[1] == pytest.approx(at_rest, abs=5e-5)
        assert ours[2] == pytest.approx(fast, abs=5e-5)
        assert ours[1] < ours[3] < ours[0], "(43) with its inequalities reversed"
    assert len(pulleys(ROBOT).rows) == 7
    assert sum(ours[1] < 0.8 for ours in found) == 4


def test_the_blend_is_that_of_rho() -> None:
    pulley = ROBOT.cables[0].pulleys[1]
    for rho in (0.0, 0.3, 1.0):
        blended = replace(pulley, friction=replace(pulley.friction, rho=rho))
        eta_r, at_rest, _, eta = transmissions(blended)
        assert eta == pytest.approx(rho * at_rest + (1.0 - rho) * eta_r, abs=1e-12)
