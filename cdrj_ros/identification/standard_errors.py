"""Standard errors and correlations of the numbers, and combinations that are indistinguishable.

Residuals of a fitted mechanism are not white noise.  Most of them is error of the model, which
lasts for a good part of a stroke, appears in many references at once and repeats in every cycle of
the motion.  The usual errors, sigma^2 (J'J)^-1, would treat each of a million samples as
independent and be wrong by orders of magnitude.  The standard errors here have two parts:

- Numbers of the file that are not fitted are not exact.  Their errors act in the same direction in
  every cycle, so that the residuals do not show what the fit has absorbed.  Their effect on the
  residuals is computed, and by the fit that on the numbers (``left_alone``).
- What is left of the residuals, as far as it lasts, counts once per state of the mechanism, however
  many cycles, samples and references there are in it (``left_variance``).

See (I2), (I3) and (I6) in docs/identification.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.identification.findings import findings, without_influence
from cdrj_ros.identification.left_alone import (
    Cause,
    LeftAlone,
    causes_left_alone,
    effects,
    left_alone,
)
from cdrj_ros.identification.left_variance import Linear, Places, variance_left
from cdrj_ros.identification.residuals import Problem
from cdrj_ros.identification.solution import limits
from cdrj_ros.identification.states import cells_of_residuals, states_of_residuals, visited_states

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

AT_BOUND: Final = 1e-6
"""Distance within which a number counts as at a bound, as a fraction of the range."""


class Certainty(NamedTuple):
    """Accuracy of the numbers."""

    stddev: Vector
    """Standard errors [SI], shape (p,)."""
    correlation: Table
    """Correlation matrix, shape (p, p)."""
    findings: tuple[str, ...]
    """Messages about what the data cannot determine."""
    silent: NDArray[np.bool_]
    """Which numbers have neither influence on the data nor a prior, shape (p,)."""
    others: LeftAlone
    """Numbers that are not fitted."""


def certainty(
    problem: Problem, coordinates: Vector, residuals: Vector, jacobian: Table, weights: Vector
) -> Certainty:
    """Standard errors and findings at a solution.

    Args:
        problem: problem with the observations of the residuals and the Jacobian.
        coordinates: the solution's coordinates, shape (p,).
        residuals: residuals without priors, shape (n,).
        jacobian: Jacobian without priors, shape (n, p).
        weights: robust weights, shape (n,); ones for the linear loss.
    """
    root = np.sqrt(weights)
    causes = causes_left_alone(problem.begin.robot.uncertainty, problem.unknowns)
    covariance, absorbed, information = _covariance(
        problem, coordinates, causes, residuals * root, jacobian * root[:, None], root
    )
    slope = np.array(
        [u.slope(float(x)) for u, x in zip(problem.unknowns, coordinates, strict=True)]
    )
    in_coordinates = np.sqrt(np.diag(covariance))
    most = np.array([(u.upper - u.lower) / np.sqrt(12.0) for u in problem.unknowns])
    correlation = covariance / np.outer(in_coordinates, in_coordinates)
    correlation = correlation * np.outer(np.sign(slope), np.sign(slope))
    np.fill_diagonal(correlation, 1.0)
    stddev = np.minimum(in_coordinates * np.abs(slope), most)
    absorbed = absorbed * (np.sign(slope) * stddev / in_coordinates)[:, None]
    return Certainty(
        stddev,
        np.clip(correlation, -1.0, 1.0),
        findings(problem, coordinates, information, covariance),
        without_influence(information) & [u.prior is None for u in problem.unknowns],
        left_alone(causes, absorbed, stddev),
    )


def _covariance(
    problem: Problem,
    coordinates: Vector,
    causes: Sequence[Cause],
    residuals: Vector,
    slopes: Table,
    root: Vector,
) -> tuple[Table, Table, Table]:
    """(I3): covariance of the numbers, their change by each cause, and the data's information.

    All are in coordinates; the information is that of the data alone.

    Args:
        problem: problem with the observations of the residuals.
        coordinates: the solution's coordinates, shape (p,).
        causes: of errors of all other numbers.
        residuals: with robust weights applied, shape (n,).
        slopes: Jacobian with robust weights applied, shape (n, p).
        root: square roots of the robust weights, shape (n,).
    """
    others = effects(problem, coordinates, causes) * root[:, None]
    known = _known_beforehand(problem, coordinates)
    everything = Linear(
        np.hstack([slopes, others]), residuals,
        np.concatenate([known, np.ones(len(causes))]),
        np.concatenate([_pull(problem, coordinates), np.zeros(len(causes))]),
    )  # fmt: skip
    places = Places(
        states_of_residuals(problem), cells_of_residuals(problem), visited_states(problem)
    )
    variance = effective_variance(problem, residuals)
    left = variance_left(everything, places, variance)
    square = slopes.T @ slopes
    fitted = np.linalg.inv(square / variance + np.diag(known))
    absorbed = -fitted @ (slopes.T @ others) / variance
    own = fitted @ (square * (left / variance**2) + np.diag(known)) @ fitted
    covariance = np.asarray(own + absorbed @ absorbed.T, dtype=np.float64)
    return covariance, absorbed, square / left


def remaining_step(
    problem: Problem, coordinates: Vector, residuals: Vector, jacobian: Table, weights: Vector
) -> tuple[Vector, Vector]:
    """(I4): the remaining Gauss-Newton step at a solution; arguments as for ``certainty``.

    Returns:
        The step in coordinates, and its size in standard errors, shape (p,) each; 0 for numbers
        at a bound that the step would violate.
    """
    variance = effective_variance(problem, residuals * np.sqrt(weights))
    information = jacobian.T @ (jacobian * weights[:, None]) / variance
    information += np.diag(_known_beforehand(problem, coordinates))
    uphill = jacobian.T @ (residuals * weights) / variance
    uphill += _pull(problem, coordinates)
    lower, upper = limits(problem)
    margin = AT_BOUND * (upper - lower)
    leaves = ((coordinates <= lower + margin) & (uphill > 0.0)) | (
        (coordinates >= upper - margin) & (uphill < 0.0)
    )
    free = np.flatnonzero(~leaves)
    covariance = np.linalg.inv(information[np.ix_(free, free)])
    step, size = np.zeros(coordinates.size), np.zeros(coordinates.size)
    step[free] = -covariance @ uphill[free]
    size[free] = np.abs(step[free]) / np.sqrt(np.diag(covariance))
    return step, size


def expected_gain(step: Vector, residuals: Vector, jacobian: Table, weights: Vector) -> float:
    """Fraction of the cost by which a step would lower it if the residuals were linear."""
    along = jacobian @ step
    cost = float(weights @ residuals**2)
    return float(-(weights * along) @ (2.0 * residuals + along)) / max(cost, 1e-300)


def effective_variance(problem: Problem, residuals: Vector) -> float:
    """(I2): variance that gives residuals and priors their weights in the fit.

    Args:
        problem: problem with the observations of the residuals.
        residuals: residuals with robust weights applied, shape (n,).
    """
    at = 0
    powers, noise = [], 0.0
    for observed in problem.observations:
        parts = []
        for channel in observed.channels:
            part = residuals[at : at + channel.reference.size]
            at += part.size
            noise += white_power(part)
            parts.append(part)
        powers.append(_powers(parts))
    power = np.concatenate(powers)
    size = max(at, 1)
    mean = float(np.mean(residuals[:at] ** 2))
    white = min(noise / size, mean)
    independent = float(power.sum()) ** 2 / max(float(np.sum(power**2)), 1e-300)
    pieces = max(1.0, min(independent, float(visited_states(problem)), float(size)))
    return max(white + (mean - white) * size / pieces, 1e-300)


def white_power(residuals: Vector) -> float:
    """Sum of squares of white noise on a smooth series, from its second differences."""
    if residuals.size < 3:
        return 0.0
    return float(np.median(np.diff(residuals, 2) ** 2)) / 0.4549 / 6.0 * residuals.size


def _powers(parts: Sequence[Vector]) -> Vector:
    """Power of every principal component of several series at every frequency."""
    n = max(part.size for part in parts)
    common = np.linspace(0.0, 1.0, n)
    series = np.array([np.interp(common, np.linspace(0.0, 1.0, max(p.size, 1)), p) for p in parts])
    _, directions = np.linalg.eigh(series @ series.T)
    return (np.abs(np.fft.fft(directions.T @ series, axis=1)) ** 2 / n).ravel()


def _pull(problem: Problem, coordinates: Vector) -> Vector:
    """Gradient of the priors' half sum of squares, in coordinates."""
    pull = np.zeros(coordinates.size)
    for k, (unknown, x) in enumerate(zip(problem.unknowns, coordinates, strict=True)):
        if unknown.prior is not None:
            off = unknown.value(float(x)) - unknown.prior[0]
            pull[k] = unknown.slope(float(x)) * off / unknown.prior[1] ** 2
    return pull


def _known_beforehand(problem: Problem, coordinates: Vector) -> Vector:
    """Information of the priors and of the bounds, in coordinates.

    A number between bounds is given a variance of at most a twelfth of their squared distance,
    which is the only information about a number without influence on the data.
    """
    lower, upper = limits(problem)
    known = 12.0 / (upper - lower) ** 2
    for k, (unknown, x) in enumerate(zip(problem.unknowns, coordinates, strict=True)):
        if unknown.prior is not None:
            known[k] += (unknown.slope(float(x)) / unknown.prior[1]) ** 2
    return known
