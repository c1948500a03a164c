"""Friction at the pulleys and its loops."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdrj_ros.evaluation.pulley_friction import BLOCK, FrictionSums, PulleyFriction
from cdrj_ros.model.loading import load_model

Layout = Any


def pulley_friction(
    layout: Layout, stamps: np.ndarray, tension: np.ndarray, friction: np.ndarray, slip: np.ndarray
) -> tuple[PulleyFriction, ...]:
    """Friction of estimates that have these tensions, frictions and slip speeds."""
    values = np.zeros((len(stamps), layout.size))
    values[:, layout.tension] = tension
    values[:, layout.friction] = friction
    values[:, layout.slip_speed] = slip
    sums = FrictionSums(layout)
    sums.add(stamps, values)
    return sums.result()


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
    # samples of a slack cable do not count in the mean
    assert found["lower/2"].mean_share == 0.0
    # half of the time one side is slack, with share 1, and then the share is 0
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


def test_pieces_of_whole_blocks_change_no_bit_of_the_sums() -> None:
    layout = load_model(str(ROBOT)).layout
    random = np.random.default_rng(11)
    n = 3 * BLOCK + 100
    values = random.normal(10.0, 3.0, (n, layout.size))
    stamps = np.cumsum(random.integers(1, 2_000_000, n))
    whole, pieces = FrictionSums(layout), FrictionSums(layout)
    whole.add(stamps, values)
    for part in (slice(0, 2 * BLOCK), slice(2 * BLOCK, n)):
        pieces.add(stamps[part], values[part])
    for one, other in zip(whole.result(), pieces.result(), strict=True):
        assert (one.mean, one.largest, one.mean_share, one.largest_share) == (
            other.mean, other.largest, other.mean_share, other.largest_share
        )  # fmt: skip
        assert (one.passed is None) == (other.passed is None)
        if one.passed is not None:
            assert one.passed.tobytes() == other.passed.tobytes()


def test_the_loop_is_thinned_but_keeps_its_extremes() -> None:
    layout = load_model(str(ROBOT)).layout
    random = np.random.default_rng(12)
    n = 20 * BLOCK
    values = np.zeros((n, layout.size))
    values[:, layout.tension] = 10.0
    friction = random.normal(size=n)
    values[:, layout.friction] = friction[:, np.newaxis]
    sums = FrictionSums(layout)
    sums.add(np.arange(n, dtype=np.int64) * 1_000_000, values)
    (loop,) = (one.friction for one in sums.result() if one.friction is not None)
    assert len(loop) < n / 20
    assert (loop.min(), loop.max()) == (friction.min(), friction.max())
