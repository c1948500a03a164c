"""Bounded least squares with robust losses, from one start or from several: (I1), (I9).

docs/identification.md.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from itertools import zip_longest
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.problem import Loss, Problem, Progress
from cdrj_ros.identification.residual_statistics import independent_states

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


STEP: Final = 2e-3
"""Finite-difference step of the Jacobian, in coordinates."""

INSIDE: Final = 1e-3
"""Distance of a start from its bounds, in coordinates."""

HUBER: Final = 1.345
"""Threshold of a robust loss, in standard deviations of a channel's residual."""

TOLERANCE: Final = 3e-5
"""Relative change of the cost, or of the coordinates, that ends a round."""


class Solved(NamedTuple):
    """Solution of a round."""

    coordinates: Vector
    cost: float
    """Half the sum of squares, robust loss and priors included."""
    steps: int


def solve(
    problem: Problem,
    begin: Vector,
    loss: Loss,
    most_steps: int,
    say: Progress,
    tolerance: float = TOLERANCE,
) -> Solved:
    """Least squares from one start.

    Args:
        problem: problem whose residuals are minimised.
        begin: coordinates of the start.
        loss: one of ``LOSSES``.
        most_steps: largest number of residual evaluations, not counting those of the Jacobian.
        say: called with a line for every step.
        tolerance: relative change of cost or coordinates that ends the minimisation.

    Raises:
        RobotFileError: the start describes no possible robot.
    """
    from scipy.optimize import least_squares

    lower, upper = limits(problem)
    margin = np.minimum(INSIDE, 0.25 * (upper - lower))
    begin = np.clip(begin, lower + margin, upper - margin)
    problem.model(begin)  # raises an error that states the reason
    size = problem.size
    steps = 0

    def residuals(coordinates: Vector) -> Vector:
        nonlocal steps
        steps += 1
        found = with_priors(problem, coordinates, problem.residuals(coordinates))
        rms = float(np.sqrt(np.mean(found[:size] ** 2)))
        say(f"step {steps}: rms residual {rms:.5g}")
        return found

    def differences(coordinates: Vector) -> Table:
        return jacobian(problem, coordinates)

    first = with_priors(problem, begin, problem.residuals(begin))
    found = least_squares(
        residuals,
        begin,
        differences,
        bounds=(lower, upper),
        loss=_robust(loss, problem, first) if loss != "linear" else "linear",
        max_nfev=most_steps,
        ftol=tolerance,
        xtol=tolerance,
        gtol=1e-12,
    )
    return Solved(found.x, float(found.cost), int(found.nfev))


def limits(problem: Problem) -> tuple[Vector, Vector]:
    """Bounds of all coordinates."""
    pairs = np.array([unknown.limits for unknown in problem.unknowns])
    return pairs[:, 0], pairs[:, 1]


def with_priors(problem: Problem, coordinates: Vector, residuals: Vector) -> Vector:
    """Residuals followed by those of the priors; a new array, which older SciPy scales in place."""
    priors = [
        problem.prior_scale * (unknown.value(float(x)) - unknown.prior[0]) / unknown.prior[1]
        for unknown, x in zip(problem.unknowns, coordinates, strict=True)
        if unknown.prior is not None
    ]
    return np.concatenate([residuals, priors])


def jacobian(problem: Problem, coordinates: Vector, central: bool = False) -> Table:
    """Finite differences of the residuals, priors included, all columns in parallel.

    A column whose step leaves the bounds, or describes no possible robot, steps the other way.
    """
    lower, upper = limits(problem)
    n = coordinates.size
    ahead = _ahead(problem, coordinates)
    points = difference_points(problem, coordinates, central)
    found = problem.residuals_of(points)
    rows = [
        with_priors(problem, point, values) for point, values in zip(points, found, strict=True)
    ]
    here, columns = rows[0], []
    per = 2 if central else 1
    for k in range(n):
        there = rows[1 + per * k]
        back = rows[2 + per * k] if central else None
        outside = not lower[k] <= coordinates[k] - ahead[k] * STEP <= upper[k]
        if (
            back is not None
            and not outside
            and np.isfinite(there).all()
            and np.isfinite(back).all()
        ):
            columns.append((there - back) / (2.0 * ahead[k] * STEP))
            continue
        side = ahead[k]
        if not np.isfinite(there).all():
            side = -side
            point = _beside(coordinates, k, side * STEP)
            there = with_priors(problem, point, problem.residuals(point))
        if not np.isfinite(there).all():
            raise UsageError(
                f"{problem.unknowns[k].name} cannot be varied: no robot is possible close to "
                f"{problem.unknowns[k].value(float(coordinates[k])):.6g}"
            )
        columns.append((there - here) / (side * STEP))
    return np.column_stack(columns)


def difference_points(problem: Problem, coordinates: Vector, central: bool = False) -> list[Vector]:
    """The points of ``jacobian``: the coordinates, then one or two beside them for each."""
    points = [coordinates]
    for k, side in enumerate(_ahead(problem, coordinates)):
        points.append(_beside(coordinates, k, side * STEP))
        if central:
            points.append(_beside(coordinates, k, -side * STEP))
    return points


def _ahead(problem: Problem, coordinates: Vector) -> Vector:
    """Direction of each coordinate's first step, which stays below the upper bound."""
    return np.where(coordinates + STEP <= limits(problem)[1], 1.0, -1.0)


def _beside(coordinates: Vector, k: int, step: float) -> Vector:
    moved = coordinates.copy()
    moved[k] += step
    return moved


def thresholds(problem: Problem, residuals: Vector) -> Vector:
    """Threshold of the robust loss for every residual: ``HUBER`` robust sigmas of its channel."""
    by_name: dict[str, list[Vector]] = {}
    at = 0
    spans = []
    for observed in problem.observations:
        for channel in observed.channels:
            part = residuals[at : at + channel.reference.size]
            by_name.setdefault(channel.name, []).append(np.abs(part))
            spans.append((channel.name, part.size))
            at += part.size
    bends = {
        name: max(HUBER * 1.4826 * float(np.median(np.concatenate(parts))), 1e-12)
        for name, parts in by_name.items()
    }
    ends = [np.full(size, bends[name]) for name, size in spans]
    return np.concatenate([*ends, np.full(residuals.size - at, np.inf)])


def robust_weights(loss: Loss, residuals: Vector, bend: Vector) -> Vector:
    """Derivative of the loss by the squared residual: 1 for small residuals, less for outliers."""
    if loss == "linear":
        return np.ones(residuals.size)
    z = (residuals / bend) ** 2
    if loss == "huber":
        weights: Vector = np.where(z <= 1.0, 1.0, 1.0 / np.sqrt(np.maximum(z, 1.0)))
    else:
        weights = 1.0 / np.sqrt(1.0 + z)
    return weights


def _robust(loss: Loss, problem: Problem, residuals: Vector) -> Callable[[Vector], Any]:
    """The loss for ``least_squares``, with the threshold of each channel."""
    bend2 = thresholds(problem, residuals) ** 2

    def shape(squares: Vector) -> Table:
        z = squares / bend2
        rho = np.empty((3, z.size))
        if loss == "huber":
            far = z > 1.0
            root = np.sqrt(np.maximum(z, 1.0))
            rho[0] = np.where(far, 2.0 * root - 1.0, z)
            rho[1] = np.where(far, 1.0 / root, 1.0)
            rho[2] = np.where(far, -0.5 / root**3, 0.0)
        else:
            t = 1.0 + z
            rho[0] = 2.0 * (np.sqrt(t) - 1.0)
            rho[1] = t**-0.5
            rho[2] = -0.5 * t**-1.5
        finite = np.isfinite(bend2)
        rho[0] = np.where(finite, rho[0] * np.where(finite, bend2, 1.0), squares)
        rho[2] /= bend2
        return rho

    return shape


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
            cost = float(np.sum(with_priors(problem, point, residuals) ** 2))
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
    stddev: dict[str, float] = {}
    if file is not None:
        deviations = np.sqrt(np.diag(file.covariance)).tolist()
        stddev = dict(zip(file.parameters, deviations, strict=True))
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
    problem: Problem,
    count: int,
    seed: int,
    loss: Loss,
    most_steps: int,
    say: Progress,
    first: Vector,
) -> tuple[list[Solved], int]:
    """Minimise from a first start and from random ones.

    Returns:
        The solution of each start, best first by (I9), and the number of starts that reached the
        best minimum.
    """
    begins = [first, *(_promising(problem, count - 1, seed) if count > 1 else ())]
    found = []
    for k, begin in enumerate(begins):
        if len(begins) > 1:
            say(f"start {k + 1} of {len(begins)}")
        found.append(solve(problem, begin, loss, most_steps, say))
    if len(found) > 1:
        before = _before(problem)
        found.sort(
            key=lambda one: _distance(
                problem, before, one.coordinates, problem.residuals(one.coordinates)
            )
        )
    best = found[0]
    same = sum(abs(solved.cost - best.cost) <= best.cost * 0.01 + 1e-12 for solved in found)
    return found, same
