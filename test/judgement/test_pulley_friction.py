"""What friction holds at the pulleys."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.judgement.pulley_friction import pulley_friction
from cdrj_ros.model.loading import load_model

ROBOT = Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml"


def test_shares_are_of_the_larger_tension_and_the_loop_is_that_of_the_largest() -> None:
    layout = load_model(str(ROBOT)).layout
    n, elements, pulleys = 200, len(layout.elements), len(layout.pulleys)
    tension = np.full((n, elements), 10.0)
    tension[:, layout.elements.index("upper/4")] = 8.0
    tension[:100, layout.elements.index("lower/1")] = 0.0
    tension[:100, layout.elements.index("lower/2")] = 0.0
    place = {name: k for k, name in enumerate(layout.elements)}
    after = [place[name] for name in layout.pulleys]
    friction = tension[:, after] - tension[:, [k - 1 for k in after]]
    slip = np.zeros((n, pulleys))
    slip[:, layout.pulleys.index("upper/4")] = 0.01
    stamps = np.arange(n, dtype=np.int64) * 10_000_000
    found = {one.name: one for one in pulley_friction(layout, stamps, tension, friction, slip)}
    assert list(found) == list(layout.pulleys)
    for name in ("upper/4", "upper/5"):
        assert found[name].mean == pytest.approx(2.0)
        assert found[name].mean_share == pytest.approx(0.2)
    assert found["upper/3"].largest_share == 0.0
    # a slack cable holds nothing and does not dilute the mean
    assert found["lower/2"].mean_share == 0.0
    # slack on one side for half of the time: all of the other side's tension, and then nothing
    assert found["lower/3"].mean_share == pytest.approx(0.5)
    looped = [one for one in found.values() if one.friction is not None]
    assert [one.name for one in looped] == ["lower/3"]


def test_material_passed_is_the_integral_of_the_slip_speed() -> None:
    layout = load_model(str(ROBOT)).layout
    n = 100
    tension = np.full((n, len(layout.elements)), 10.0)
    friction = np.zeros((n, len(layout.pulleys)))
    slip = np.full((n, len(layout.pulleys)), 0.25)
    stamps = np.arange(n, dtype=np.int64) * 10_000_000
    (loop,) = (
        one
        for one in pulley_friction(layout, stamps, tension, friction, slip)
        if one.passed is not None
    )
    assert loop.passed is not None
    assert loop.passed[0] == 0.0
    assert loop.passed[-1] == pytest.approx(0.25 * 0.99)
