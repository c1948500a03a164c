"""Minimisation from several starts, and the choice among minima: (I9).

docs/identification.md.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import zip_longest
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.identification.problem import Problem, Progress
from cdrj_ros.identification.residual_statistics import independent_states
from cdrj_ros.identification.solver import Minimum, limits, minimise, prior_residuals

DRAWS: Final = 12
"""Random points evaluated for each random start."""

REACH: Final = 5.0
"""Distance of random starts from the file's numbers, in coordinates."""

SOUGHT: Final = 41
"""Values of a number that is sought over its whole range."""


def _promising(problem: Problem, count: int, seed: int) -> list[Vector]:
    """The points with the smallest cost among ``DRAWS`` times as many random ones.

    Every other one is the best of points as near to the file as its numbers are known.
    """
    generator = np.random.default_rng(seed)
    before = _before(problem)
    near, wide = (
        _cheapest(
            problem,
            [_random_point(problem, before, generator, far) for _ in range(DRAWS * some)],
        )[:some]
        for far, some in ((False, (count + 1) // 2), (True, count // 2))
    )
    pairs = zip_longest(near, wide)
    return [point for pair in pairs for point in pair if point is not None]


def _cheapest(problem: Problem, drawn: Sequence[Vector]) -> list[Vector]:
    """Points that describe a possible robot, the one with the smallest cost first."""
    ranked = []
    for begin in range(0, len(drawn), DRAWS):  # in batches to limit memory
        some = drawn[begin : begin + DRAWS]
        for point, residuals in zip(some, problem.residuals_of(some), strict=True):
            priors = prior_residuals(problem, point)
            cost = float(residuals @ residuals + priors @ priors)
            if np.isfinite(cost):
                ranked.append((cost, point))
    ranked.sort(key=lambda pair: pair[0])
    return [point for _, point in ranked]


class _Before(NamedTuple):
    """What is known before the fit."""

    numbers: tuple[tuple[float, float] | None, ...]
    """Mean and standard deviation of every number [SI]; None where unknown."""
    independent: int
    """Number of residuals that count as independent."""


def _before(problem: Problem) -> _Before:
    """The priors; a number without one has the standard deviation that the file leaves it."""
    file = problem.begin.robot.uncertainty
    stddev = file.stddev if file else {}
    numbers: list[tuple[float, float] | None] = []
    for unknown in problem.unknowns:
        own = stddev.get(unknown.paths[0], 0.0)
        numbers.append(unknown.prior or ((unknown.start, own) if own > 0.0 else None))
    return _Before(tuple(numbers), independent_states(problem))


def _random_point(
    problem: Problem,
    before: _Before,
    generator: np.random.Generator,
    far: bool,
) -> Vector:
    """A random start: numbers within what is known of them, all others within ``REACH``.

    Args:
        problem: problem with the numbers.
        before: what is known of them.
        generator: random generator.
        far: whether numbers without a prior lie within ``REACH``, whatever the file says.
    """
    point = generator.uniform(-REACH, REACH, len(problem.unknowns))
    for k, (unknown, own) in enumerate(zip(problem.unknowns, before.numbers, strict=True)):
        if own is not None and not (far and unknown.prior is None):
            value = float(generator.normal(*own))
            point[k] = unknown.coordinate(min(max(value, unknown.lower), unknown.upper))
    return np.clip(point, *limits(problem))


def _distance(problem: Problem, before: _Before, coordinates: Vector, residuals: Vector) -> float:
    """(I9): by which minima are compared, twice a negative log-likelihood.

    Args:
        problem: problem with the numbers.
        before: what is known of them.
        coordinates: of the numbers, shape (p,).
        residuals: there, without priors, shape (n,).
    """
    off = [
        (unknown.value(float(x)) - own[0]) / own[1]
        for unknown, x, own in zip(problem.unknowns, coordinates, before.numbers, strict=True)
        if own is not None
    ]
    squares = max(float(residuals @ residuals), 1e-300)
    return before.independent * float(np.log(squares)) + float(np.square(off).sum())


def sought(problem: Problem, paths: Collection[str]) -> Vector:
    """Coordinates of the start, with some numbers replaced by the best between their bounds.

    Around a wrong zero a cable may be slack throughout, and the cost does not change.

    Args:
        problem: problem whose residuals are compared.
        paths: of the numbers, one of which is varied after the other.
    """
    lower, upper = limits(problem)
    here = np.zeros(lower.size)
    for k, unknown in enumerate(problem.unknowns):
        if not paths or unknown.paths[0] not in paths:
            continue
        points = []
        for x in np.linspace(lower[k], upper[k], SOUGHT):
            points.append(here.copy())
            points[-1][k] = x
        costs = [float(np.sum(found**2)) for found in problem.residuals_of(points)]
        here = points[int(np.argmin(costs))]
    return here


def many_starts(
    problem: Problem, count: int, seed: int, say: Progress, first: Vector
) -> tuple[Minimum, int]:
    """Minimise from a first start and from random ones.

    Returns:
        The best minimum by (I9), and the number of starts that reached it.
    """
    begins = [first, *(_promising(problem, count - 1, seed) if count > 1 else ())]
    found = []
    for k, begin in enumerate(begins):
        if len(begins) > 1:
            say(f"start {k + 1} of {len(begins)}")
        found.append(minimise(problem, begin, "linear", say, variance=1.0, settled=np.inf))
    if len(found) == 1:
        return found[0], 1
    before = _before(problem)
    best = min(found, key=lambda one: _distance(problem, before, one.coordinates, one.residuals))
    same = sum(abs(one.cost - best.cost) <= best.cost * 0.01 + 1e-12 for one in found)
    return best, same
