"""Tables I and II, and what follows from them."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdrj_ros.robot.reader import load_robot
from examples.paper.tables import (
    TABLE_I,
    TABLE_II,
    friction_parameters,
    wrap_range,
)

ROBOT = load_robot(Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml")


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
