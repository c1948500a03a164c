"""Bounded least squares with robust losses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.residuals import Problem

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

Loss = Literal["linear", "soft_l1", "huber"]
LOSSES: Final[tuple[Loss, ...]] = get_args(Loss)

STEP: Final = 2e-3
"""Finite-difference step of the Jacobian, in coordinates."""

INSIDE: Final = 1e-3
"""Distance of a start from its bounds, in coordinates."""

HUBER: Final = 1.345
"""Threshold of a robust loss, in standard deviations of a channel's residual."""

TOLERANCE: Final = 3e-5
"""Relative change of the cost, or of the coordinates, that ends a round."""

Progress = Callable[[str], None]


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
