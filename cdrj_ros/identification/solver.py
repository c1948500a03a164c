"""Bounded least squares with priors and robust losses: (I1), (I4).

Gauss-Newton steps, damped as by Levenberg and Marquardt where they do not lower the cost.  A number
that a step would take beyond a bound goes to the bound, and the others are chosen accordingly:
numbers that start at a bound, such as a friction of zero, do not shorten the steps of all others.
See docs/identification.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.problem import Loss, Problem, Progress
from cdrj_ros.identification.residual_statistics import (
    by_channel,
    effective_variance,
    noise_stated,
)

STEP: Final = 2e-3
"""Finite-difference step of the Jacobian, in coordinates."""

HUBER: Final = 1.345
"""Threshold of a robust loss, in standard deviations of a channel's residual."""

MOST_STEPS: Final = 60
GAIN: Final = 1e-3
"""A further step that lowers the cost by less, as a fraction, is not taken for its gain."""
SETTLED: Final = 0.3

DAMPING: Final = (0.0, *np.geomspace(0.01, 1000.0, 11).tolist())
"""Shares of the information's diagonal that are added until a step lowers the cost."""

LONGEST: Final = 5.0
"""Longest step, in coordinates."""

AS_LINEAR: Final = 0.5
"""Fraction of the fall of the cost expected of a step that is enough."""

AT_BOUND: Final = 1e-6
"""Distance within which a number counts as at a bound, as a fraction of the range."""


@dataclass(frozen=True)
class Minimum:
    """Where a minimisation ended."""

    coordinates: Vector
    """Shape (p,)."""
    residuals: Vector
    """Without priors, shape (n,)."""
    slopes: Table
    """Their Jacobian, shape (n, p)."""
    weights: Vector
    """Robust weights, shape (n,)."""
    variance: float
    """(I2), which gives residuals and priors their weights."""
    cost: float
    """Squares of residuals and priors in units of their variances."""
    step: Vector
    """The remaining Gauss-Newton step, shape (p,)."""
    size: Vector
    """Its size in standard errors, (I4), shape (p,)."""

    @property
    def rms(self) -> float:
        """Root mean square residual."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def minimise(
    problem: Problem,
    begin: Vector,
    loss: Loss,
    say: Progress,
    *,
    rough: Problem | None = None,
    variance: float | None = None,
    settled: float = SETTLED,
) -> Minimum:
    """Least squares from one start.

    Where most of the cost is noise, a tolerance on its change ends a fit too early, so steps are
    taken while they gain, and once more if they are a considerable fraction of a standard error.
    At a kink, such as friction that reverses, every step promises a gain that none brings.

    Args:
        problem: problem whose residuals are minimised.
        begin: coordinates of the start.
        loss: one of ``LOSSES``; its weights are computed anew at every step.
        say: called with a line for every step.
        rough: problem with the same residuals, over fewer samples, which supplies the Jacobian by
            central differences; None or the problem itself: by one-sided differences.
        variance: weight of the residuals beside the priors; None: (I2), anew at every step.
        settled: largest step that is not taken [standard errors].

    Raises:
        RobotFileError: the start describes no possible robot.
    """
    here = np.clip(begin, *limits(problem))
    problem.model(here)  # raises an error that states the reason
    gains = True
    for taken in range(MOST_STEPS + 1):
        found = _minimum(problem, here, loss, rough, variance)
        say(f"step {taken + 1}: rms residual {found.rms:.5g}")
        enough = (1.0 - GAIN) * found.cost
        slow = _expected(problem, found, found.step) >= enough
        if taken == MOST_STEPS or not gains or (slow and found.size.max() <= settled):
            break
        better, cost = _lower(problem, found)
        if better is None:
            break
        here, gains = better, cost < enough
    return found


def _minimum(
    problem: Problem, here: Vector, loss: Loss, rough: Problem | None, variance: float | None
) -> Minimum:
    """What is known at some coordinates; arguments as of ``minimise``."""
    residuals = problem.residuals(here)
    slopes = jacobian(rough or problem, here, central=rough not in (None, problem))
    weights = robust_weights(problem, loss, residuals)
    if variance is None:
        variance = effective_variance(problem, residuals * np.sqrt(weights))
        weights[noise_stated(problem)] = variance
    cost = _cost(problem, here, residuals, weights, variance)
    found = Minimum(here, residuals, slopes, weights, variance, cost, here, here)
    step, size = _step(problem, found, 0.0)
    return replace(found, step=step, size=size)


def _lower(problem: Problem, found: Minimum) -> tuple[Vector | None, float]:
    """Coordinates with a lower cost, None if no damping helps, and the cost there.

    The damping rises until the cost falls by as much as if the residuals were linear, or by less
    than with the one before.  A step is doubled as long as the cost falls: it leads across kinks.
    """
    best, least = None, found.cost

    def cost(there: Vector) -> float:
        residuals = problem.residuals(there)
        return _cost(problem, there, residuals, found.weights, found.variance)

    for damping in DAMPING:
        step = found.step if damping == 0.0 else _step(problem, found, damping)[0]
        if np.abs(step).max() > LONGEST and damping < DAMPING[-1]:
            continue
        there = found.coordinates + step
        now = cost(there)
        if now < least:
            best, least = there, now
        elif best is not None:
            break
        if found.cost - now >= AS_LINEAR * (found.cost - _expected(problem, found, step)):
            break
    while best is not None and np.abs(best - found.coordinates).max() < LONGEST:
        there = np.clip(2.0 * best - found.coordinates, *limits(problem))
        now = cost(there)
        if not now < least:
            break
        best, least = there, now
    return best, least


def _step(problem: Problem, found: Minimum, damping: float) -> tuple[Vector, Vector]:
    """(I4): a step within the bounds, and its size in standard errors, shape (p,) each.

    The size is 0 for numbers at a bound that the step would violate.
    """
    here, slopes, weights = found.coordinates, found.slopes, found.weights
    information = slopes.T @ (slopes * weights[:, None]) / found.variance
    information += np.diag(prior_information(problem, here))
    uphill = slopes.T @ (found.residuals * weights) / found.variance + prior_gradient(problem, here)
    damped = information + damping * np.diag(np.diag(information))
    lower, upper = limits(problem)
    margin = AT_BOUND * (upper - lower)
    step, size, free = np.zeros(here.size), np.zeros(here.size), np.arange(here.size)
    while free.size:
        rest = uphill[free] + damped[free] @ step - damped[np.ix_(free, free)] @ step[free]
        step[free] = -np.linalg.solve(damped[np.ix_(free, free)], rest)
        beyond = (here + step < lower) | (here + step > upper)
        step = np.clip(here + step, lower, upper) - here
        kept = free[~beyond[free]]
        if kept.size == free.size:
            break
        free = kept
    stddev = np.sqrt(np.diag(np.linalg.inv(information)))
    moving = np.abs(step) > margin
    size[moving] = np.abs(step[moving]) / stddev[moving]
    return step, size


def _expected(problem: Problem, found: Minimum, step: Vector) -> float:
    """Cost after a step if the residuals were linear."""
    there, after = found.coordinates + step, found.residuals + found.slopes @ step
    return _cost(problem, there, after, found.weights, found.variance)


def _cost(
    problem: Problem, here: Vector, residuals: Vector, weights: Vector, variance: float
) -> float:
    priors, _ = prior_residuals(problem, here)
    return float(weights @ residuals**2) / variance + float(priors @ priors)


def limits(problem: Problem) -> tuple[Vector, Vector]:
    """Bounds of all coordinates."""
    pairs = np.array([unknown.limits for unknown in problem.unknowns])
    return pairs[:, 0], pairs[:, 1]


def prior_residuals(problem: Problem, here: Vector) -> tuple[Vector, Vector]:
    """Deviations from the priors [standard deviations] and their slopes, 0 without a prior."""
    mean, stddev = np.array([one.prior or (0.0, np.inf) for one in problem.unknowns]).T
    return (problem.values(here) - mean) / stddev, problem.slopes(here) / stddev


def prior_gradient(problem: Problem, here: Vector) -> Vector:
    """Gradient of the priors' half sum of squares, in coordinates, shape (p,)."""
    off, slope = prior_residuals(problem, here)
    return off * slope


def prior_information(problem: Problem, here: Vector) -> Vector:
    """Information of each number's prior or of its bounds, whichever is larger, in coordinates.

    A number between bounds is given a variance of a twelfth of their squared distance, which is the
    only information about a number without influence on the data.
    """
    lower, upper = limits(problem)
    return np.maximum(12.0 / (upper - lower) ** 2, prior_residuals(problem, here)[1] ** 2)


def jacobian(problem: Problem, coordinates: Vector, *, central: bool = False) -> Table:
    """Finite differences of the residuals by each unknown, to one side or to both, shape (n, p).

    An unknown changes what its own cables contribute, so only these are computed.
    """
    ways, every = _ways(problem, coordinates, central), np.eye(coordinates.size)
    points = [coordinates + way * one for way in ways for one in every]
    chosen = list(problem.moved) * len(ways)
    if not central:
        points += [coordinates] * len(problem.moved)
        chosen += list(problem.moved)
    rows = problem.residuals_of(points, chosen)
    between = ways[0] - (ways[1] if central else 0.0)
    slopes = np.empty((problem.size, coordinates.size))
    for k, (there, back) in enumerate(zip(rows[: len(every)], rows[len(every) :], strict=True)):
        possible = np.isfinite(there).all() and np.isfinite(back).all()
        slopes[:, k] = (there - back) / between[k] if possible else _slope(problem, coordinates, k)
    return slopes


def _ways(problem: Problem, coordinates: Vector, central: bool) -> list[Vector]:
    """Steps to one side, or to both, of all coordinates within their bounds."""
    lower, upper = limits(problem)
    inside = [np.where(coordinates + STEP <= upper, STEP, 0.0),
              np.where(coordinates - STEP >= lower, -STEP, 0.0)]  # fmt: skip
    return inside if central else [np.where(inside[0] > 0.0, *inside)]


def _slope(problem: Problem, coordinates: Vector, k: int) -> Vector:
    """A column of the Jacobian by a step to the only side where a robot is possible."""
    lower, upper = limits(problem)
    for step in (STEP, -STEP):
        there = coordinates.copy()
        there[k] += step
        if lower[k] <= there[k] <= upper[k]:
            change = problem.residuals(there) - problem.residuals(coordinates)
            if np.isfinite(change).all():
                return change / step
    raise UsageError(
        f"{problem.unknowns[k].name} cannot be varied: no robot is possible close to "
        f"{problem.unknowns[k].value(float(coordinates[k])):.6g}"
    )


def _thresholds(problem: Problem, residuals: Vector) -> Vector:
    """Threshold of the robust loss for every residual: ``HUBER`` robust sigmas of its channel."""
    by_name: dict[str, list[Vector]] = {}
    spans = []
    for _, channel, part in by_channel(problem, residuals):
        by_name.setdefault(channel.name, []).append(np.abs(part))
        spans.append((channel.name, part.size))
    bends = {
        name: max(HUBER * 1.4826 * float(np.median(np.concatenate(parts))), 1e-12)
        for name, parts in by_name.items()
    }
    ends = [np.full(size, bends[name]) for name, size in spans]
    return np.concatenate(ends)


def robust_weights(problem: Problem, loss: Loss, residuals: Vector) -> Vector:
    """Derivative of the loss by the squared residual: 1 for small residuals, less for outliers."""
    if loss == "linear":
        return np.ones(residuals.size)
    z = (residuals / _thresholds(problem, residuals)) ** 2
    return np.asarray(1.0 / np.sqrt(np.maximum(z, 1.0)))
