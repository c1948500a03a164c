"""Standard errors and correlations of the numbers, and combinations that are indistinguishable.

Residuals of a fitted mechanism are not white noise.  Most of them is model error, which lasts for
a good part of a stroke, appears in many references at once and repeats in every cycle of the
motion.  The usual errors, sigma^2 (J'J)^-1, would treat each of a million samples as independent
and be wrong by orders of magnitude.  Blocks of time (or a bootstrap over them) would treat every
cycle as independent, which it is not; and neither shows an error that acts the same way
everywhere, because the fit has already absorbed it in the parameters.

Residuals are therefore counted by the information they carry.  Their power is the sum of the
sensors' noise, estimated from second differences, in which every sample is independent, and a
remainder, in which there are only

    D = min((sum lambda)^2 / sum lambda^2,  G)

independent pieces: lambda is the power of the residuals' principal components at every frequency
(the participation ratio of their spectrum: one line for an error that repeats, many for noise),
and G the number of states that the mechanism visited: each of the ``STRETCHES`` stretches of its
main motion, forward and back, in every recording.  With N residuals,

    variance = noise + (mean(r^2) - noise) N / D,        cov = (A / variance + K)^-1,    A = J' W J,

where K is the information of priors and bounds.  docs/identification.md derives and tests it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.identification.findings import findings, without_influence
from cdrj_ros.identification.residuals import Problem, samples_of, thinned
from cdrj_ros.identification.solution import limits

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

STRETCHES: Final = 4
"""Number of stretches into which the main motion is divided, each forward and back."""

VISITED: Final = 0.01
"""Fraction of a recording from which a state counts as visited."""

AT_BOUND: Final = 1e-6
"""Distance within which a number counts as at a bound, as a fraction of the range."""

RATE_WINDOW_S: Final = 0.05
"""Half the window in which the direction of motion is determined [s]."""


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
    information = jacobian.T @ (jacobian * weights[:, None])
    information = information / effective_variance(problem, residuals * np.sqrt(weights))
    known = np.diag(_known_beforehand(problem, coordinates))
    covariance = np.asarray(np.linalg.inv(information + known), dtype=np.float64)
    slope = np.array(
        [u.slope(float(x)) for u, x in zip(problem.unknowns, coordinates, strict=True)]
    )
    in_coordinates = np.sqrt(np.diag(covariance))
    most = np.array([(u.upper - u.lower) / np.sqrt(12.0) for u in problem.unknowns])
    correlation = covariance / np.outer(in_coordinates, in_coordinates)
    correlation = correlation * np.outer(np.sign(slope), np.sign(slope))
    np.fill_diagonal(correlation, 1.0)
    return Certainty(
        np.minimum(in_coordinates * np.abs(slope), most),
        np.clip(correlation, -1.0, 1.0),
        findings(problem, coordinates, information, covariance),
        without_influence(information) & [u.prior is None for u in problem.unknowns],
    )


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
    for k, (unknown, x) in enumerate(zip(problem.unknowns, coordinates, strict=True)):
        if unknown.prior is not None:
            off = unknown.value(float(x)) - unknown.prior[0]
            uphill[k] += unknown.slope(float(x)) * off / unknown.prior[1] ** 2
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
    """Variance that a residual would have if all residuals were independent.

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
    pieces = max(1.0, min(independent, float(_states(problem)), float(size)))
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


def _states(problem: Problem) -> int:
    """Number of stretches of the main motion, forward and back, that the recordings visit."""
    samples = [
        one.samples or thinned(samples_of(problem.begin, one.recorded), one.stride)
        for one in problem.observations
    ]
    angles = [np.hstack([one.motor_angle, one.joint_angle]) for one in samples]
    every = np.concatenate(angles)
    scale = np.maximum(every.std(axis=0), 1e-12)
    centre = every.mean(axis=0)
    _, directions = np.linalg.eigh(np.atleast_2d(np.cov(((every - centre) / scale).T)))
    along = [((angle - centre) / scale) @ directions[:, -1] for angle in angles]
    edges = np.quantile(np.concatenate(along), np.linspace(0.0, 1.0, STRETCHES + 1)[1:-1])
    count = 0
    for one, position in zip(samples, along, strict=True):
        state = 2 * np.searchsorted(edges, position) + _moves_forward(one.stamp_ns, position)
        _, visits = np.unique(state, return_counts=True)
        count += int(np.count_nonzero(visits > VISITED * state.size))
    return count


def _moves_forward(stamp_ns: NDArray[np.int64], position: Vector) -> NDArray[np.int64]:
    """1 where the position rises, 0 where it falls; at rest, the previous value."""
    time = (stamp_ns - stamp_ns[0]) * 1e-9
    earlier = np.interp(time - RATE_WINDOW_S, time, position)
    later = np.interp(time + RATE_WINDOW_S, time, position)
    change = later - earlier
    moving = np.abs(change) > 1e-3 * max(float(np.ptp(position)), 1e-12)
    last = np.maximum.accumulate(np.where(moving, np.arange(time.size), 0))
    forward: NDArray[np.int64] = (change[last] > 0.0).astype(np.int64)
    return forward


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
