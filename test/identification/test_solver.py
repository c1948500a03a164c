"""Random starts, and the choice among minima that the residuals hardly distinguish."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdrj_ros.identification import alternatives
from cdrj_ros.identification.alternatives import REACH, many_starts
from cdrj_ros.identification.unknowns import Unknown
from cdrj_ros.robot.description import Uncertainty

PRELOAD = Unknown(("cables.a.preload",), (1,), 26.0, 0.0, 150.0, 5.2)
DRUM = Unknown(("cables.a.nodes.1.radius",), (1,), 0.015, 0.001, 0.1, 0.003, (0.015, 2.5e-4))
UNKNOWN = Unknown(("friction.viscous",), (1,), 100.0, 0.0, 1e4, 20.0)
STATED = Uncertainty(("cables.a.preload",), np.array([[2.6**2]]))
FAR = -4.0
"""Coordinate of the other minimum, at a preload of 5.2 N: eight standard deviations of the file."""


class TwoMinima:
    """Residuals that vanish at the file's preload and at a quarter of it, but for a remainder."""

    size = 2

    def __init__(self, near: float, far: float, known: Uncertainty | None = STATED) -> None:
        self.unknowns = (PRELOAD,)
        self.begin = SimpleNamespace(robot=SimpleNamespace(uncertainty=known))
        self.remainders = near, far

    def model(self, coordinates: np.ndarray) -> None:
        assert coordinates.shape == (1,)

    def residuals(self, coordinates: np.ndarray) -> np.ndarray:
        x, (near, far) = float(coordinates[0]), self.remainders
        return np.array([30.0 * x * (x - FAR), near + (far - near) * x / FAR])

    def residuals_of(self, points: Sequence[np.ndarray]) -> list[np.ndarray]:
        return [self.residuals(point) for point in points]


@pytest.fixture(autouse=True)
def eight(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alternatives, "independent_states", lambda _: 8)


def preload(problem: Any) -> tuple[float, int]:
    found, same = many_starts(problem, 12, 0, lambda _: None, np.zeros(1))
    return PRELOAD.value(float(found.coordinates[0])), same


def test_of_minima_that_the_residuals_hardly_distinguish_the_one_near_the_file_is_taken() -> None:
    value, same = preload(TwoMinima(near=1.4, far=1.0))
    assert value == pytest.approx(26.0, rel=0.01)
    assert 1 <= same < 12, "other starts ended in the other minimum, whose cost is lower"


def test_residuals_that_are_much_smaller_take_the_numbers_away_from_the_file() -> None:
    assert preload(TwoMinima(near=100.0, far=1.0))[0] == pytest.approx(5.2, rel=0.01)


def test_without_knowledge_of_a_number_the_smallest_residuals_decide() -> None:
    assert preload(TwoMinima(near=1.4, far=1.0, known=None))[0] == pytest.approx(5.2, rel=0.01)


def test_random_starts_keep_to_what_is_known() -> None:
    problem: Any = TwoMinima(1.0, 1.0)
    problem.unknowns = (PRELOAD, DRUM, UNKNOWN)
    before = alternatives._before(problem)
    assert before.numbers == ((26.0, 2.6), DRUM.prior, None)
    generator = np.random.default_rng(0)
    wide, near = (
        np.array([alternatives._random_point(problem, before, generator, way) for _ in range(200)])
        for way in (True, False)
    )
    for points in (wide, near):
        assert np.std([DRUM.value(x) for x in points[:, 1]]) == pytest.approx(2.5e-4, rel=0.2)
        assert points[:, 2].max() > 0.9 * REACH, "nothing is known of it"
    assert np.std([PRELOAD.value(x) for x in near[:, 0]]) == pytest.approx(2.6, rel=0.2)
    assert np.std(wide[:, 0]) > 2.0, "a number that is fitted by name is also sought far away"


def test_a_random_start_is_within_the_bounds() -> None:
    problem: Any = TwoMinima(1.0, 1.0)
    problem.unknowns = (replace(DRUM, lower=0.0149, upper=0.0151),)
    before = alternatives._before(problem)
    generator = np.random.default_rng(0)
    values = [
        problem.unknowns[0].value(
            float(alternatives._random_point(problem, before, generator, True)[0])
        )
        for _ in range(50)
    ]
    assert min(values) >= 0.0149 - 1e-12
    assert max(values) <= 0.0151 + 1e-12
