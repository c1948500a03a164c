"""How well the numbers are known: standard errors, correlations, and what cannot be told apart.

Residuals of a fitted mechanism are no white noise: most of them is what the model leaves out, it
lasts for a good part of a stroke, and it comes back in every cycle of the motion.  The usual
errors, sigma^2 (J'J)^-1, would count each of a million samples as news and be wrong by orders of
magnitude; blocks of time would count every cycle as news, which it is not.

What the model leaves out depends on where the mechanism is and which way it moves.  So the samples
of all recordings are divided by their state: along the mechanism's main motion in ``STRETCHES``
stretches, forward and back, ``2 STRETCHES`` groups.  The standard errors are those of the
jackknife over these groups: with the groups' shares of information and score,

    A_g = J_g' W J_g,    s_g = J_g' W r_g,    d_g = -(A - A_g)^-1 (s - s_g),
    cov = (G - 1) / G  sum_g (d_g - mean d) (d_g - mean d)',

where d_g is how far the fit would move if group g had not been recorded.  Whatever dependence
there is within a group, over cycles, recordings and channels, is allowed for; between groups there
must be little, which the groups' size is for.  docs/identification.md derives and tests it.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.identification.residuals import Problem, samples_of, thinned
from cdrj_ros.estimation.identification.solution import limits
from cdrj_ros.estimation.identification.unknowns import Unknown
from cdrj_ros.model.plan import Model

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

STRETCHES: Final = 8
"""Stretches of the main motion, each forward and back."""

RATE_WINDOW_S: Final = 0.05
"""Half the time over which the direction of motion is looked at [s]."""

CLOSE: Final = 0.95
"""Correlation from which two numbers count as hard to tell apart."""

UNKNOWN: Final = 0.5
"""Relative uncertainty from which a direction counts as not seen by the data."""

MEMBER: Final = 0.25
"""Share in a direction from which a number belongs to it."""


class Certainty(NamedTuple):
    """What the data say about the numbers."""

    stddev: Vector
    """[SI], shape (p,)."""
    correlation: Table
    """Shape (p, p)."""
    findings: tuple[str, ...]
    """What they do not say, in sentences."""


def certainty(
    problem: Problem, coordinates: Vector, residuals: Vector, jacobian: Table, weights: Vector
) -> Certainty:
    """Standard errors and findings at a solution.

    Args:
        problem: with the observations that residuals and Jacobian are of.
        coordinates: of the solution, shape (p,).
        residuals: without priors, shape (n,).
        jacobian: without priors, shape (n, p).
        weights: robust, shape (n,); ones for the linear loss.
    """
    group = groups_of(problem, problem.model(coordinates))
    weighted = jacobian * weights[:, None]
    known = np.diag(_known_beforehand(problem, coordinates))
    there = np.unique(group)
    shares = [weighted[group == g].T @ jacobian[group == g] for g in there]
    score = np.array([weighted[group == g].T @ residuals[group == g] for g in there])
    information = np.sum(shares, axis=0)
    covariance = _jackknife(np.array([*shares, known]), score)
    # what only priors and bounds know does not show in the jackknife: add it
    inverse = np.linalg.inv(information + known)
    covariance = covariance + inverse @ known @ inverse
    slope = np.array(
        [u.slope(float(x)) for u, x in zip(problem.unknowns, coordinates, strict=True)]
    )
    in_coordinates = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    stddev = in_coordinates * np.abs(slope)
    most = np.array([(u.upper - u.lower) / np.sqrt(12.0) for u in problem.unknowns])
    correlation = covariance / np.outer(in_coordinates, in_coordinates)
    correlation = correlation * np.outer(np.sign(slope), np.sign(slope))
    np.fill_diagonal(correlation, 1.0)
    findings = _findings(problem, coordinates, information, covariance)
    return Certainty(np.minimum(stddev, most), np.clip(correlation, -1.0, 1.0), findings)


def _jackknife(information: Table, score: Table) -> Table:
    """Covariance of the coordinates.

    Args:
        information: of every group, the last one of priors and bounds, shape (g + 1, p, p).
        score: of every group, shape (g, p).
    """
    whole, total = information.sum(axis=0), score.sum(axis=0)
    moved = np.array(
        [
            -np.linalg.solve(whole - own, total - part)
            for own, part in zip(information[:-1], score, strict=True)
        ]
    )
    moved -= moved.mean(axis=0)
    groups = len(moved)
    return (groups - 1) / groups * (moved.T @ moved)


def groups_of(problem: Problem, model: Model) -> NDArray[np.int64]:
    """Group of every residual by the mechanism's state, shape (n,)."""
    samples = [
        one.samples or thinned(samples_of(model, one.recorded), one.stride)
        for one in problem.observations
    ]
    angles = [np.hstack([one.motor_angle, one.joint_angle]) for one in samples]
    every = np.concatenate(angles)
    scale = np.maximum(every.std(axis=0), 1e-12)
    centre = every.mean(axis=0)
    _, _, directions = np.linalg.svd((every - centre) / scale, full_matrices=False)
    along = [((angle - centre) / scale) @ directions[0] for angle in angles]
    edges = np.quantile(np.concatenate(along), np.linspace(0.0, 1.0, STRETCHES + 1)[1:-1])
    groups = []
    for observed, one, position in zip(problem.observations, samples, along, strict=True):
        forward = _moves_forward(one.stamp_ns, position)
        state = 2 * np.searchsorted(edges, position) + forward
        for channel in observed.channels:
            at = np.searchsorted(one.stamp_ns, channel.stamp_ns)
            groups.append(state[np.minimum(at, state.size - 1)])
    return np.concatenate(groups)


def _moves_forward(stamp_ns: NDArray[np.int64], position: Vector) -> NDArray[np.int64]:
    """1 where the position rises, 0 where it falls; at rest, as before."""
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

    A number lies between its bounds, whatever the data say: that is a variance of a twelfth of
    their squared distance, and all that remains of a number that the data do not see.
    """
    lower, upper = limits(problem)
    known = 12.0 / (upper - lower) ** 2
    for k, (unknown, x) in enumerate(zip(problem.unknowns, coordinates, strict=True)):
        if unknown.prior is not None:
            known[k] += (unknown.slope(float(x)) / unknown.prior[1]) ** 2
    return known


def _findings(
    problem: Problem, coordinates: Vector, information: Table, covariance: Table
) -> tuple[str, ...]:
    """What the data cannot tell, in plain words."""
    unknowns = problem.unknowns
    lower, upper = limits(problem)
    sentences = []
    strength = np.sqrt(np.maximum(np.diag(information), 0.0))
    silent = strength <= 1e-6 * max(float(strength.max()), 1e-300)
    for k in np.flatnonzero(silent):
        sentences.append(f"{unknowns[k].name} has no influence on the references that were fitted.")
    for k, unknown in enumerate(unknowns):
        for bound, end in ((lower, "lower"), (upper, "upper")):
            if not silent[k] and abs(coordinates[k] - bound[k]) < 1e-2:
                value = unknown.value(float(coordinates[k]))
                sentences.append(
                    f"{unknown.name} ended at its {end} bound, {value:.5g}: the data want it "
                    "beyond, or the model lacks something."
                )
    stddev = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(stddev, stddev)
    relative = stddev * [_relative(u, float(x)) for u, x in zip(unknowns, coordinates, strict=True)]
    alone = np.array([_alone(covariance, k) for k in range(len(unknowns))]) * relative / stddev
    told: set[int] = set(np.flatnonzero(silent).tolist())
    values, vectors = np.linalg.eigh(correlation)
    for direction in np.flatnonzero(values < 1.0 - CLOSE):
        vector = vectors[:, direction]
        members = [
            k
            for k in np.argsort(-np.abs(vector))
            if abs(vector[k]) >= MEMBER * np.abs(vector).max() and not silent[k]
        ]
        if len(members) >= 2 and not set(members) <= told:
            told |= set(members)
            sentences.append(
                _together(unknowns, coordinates, members, correlation, alone, relative)
            )
    for k in np.flatnonzero(relative >= UNKNOWN):
        if k not in told:
            value = unknowns[k].value(float(coordinates[k]))
            sentences.append(
                f"{unknowns[k].name} is hardly seen by the data: {value:.4g} within "
                f"{_percent(relative[k])}."
            )
    return tuple(sentences)


def _relative(unknown: Unknown, coordinate: float) -> float:
    """Relative change of the number with its coordinate, of its step where it is near zero."""
    value = abs(unknown.value(coordinate))
    slope = abs(unknown.slope(coordinate))
    return slope / max(value, slope)


def _alone(covariance: Table, k: int) -> float:
    """Standard deviation of a number if all others were known."""
    information = np.linalg.pinv(covariance, rcond=1e-14, hermitian=True)
    return float(1.0 / np.sqrt(max(information[k, k], 1e-300)))


def _together(
    unknowns: tuple[Unknown, ...],
    coordinates: Vector,
    members: list[int],
    correlation: Table,
    alone: Vector,
    relative: Vector,
) -> str:
    names = [unknowns[k].name for k in members]
    if len(members) == 2:
        i, j = members
        same_sign = unknowns[i].value(float(coordinates[i])) * unknowns[j].value(
            float(coordinates[j])
        )
        rising = correlation[i, j] * (1.0 if same_sign >= 0.0 else -1.0) > 0.0
        combination = "ratio" if rising else "product"
        if any(unknowns[k].step != 0.0 and relative[k] > 1.0 for k in members):
            combination = "difference" if rising else "sum"
        return (
            f"{names[0]} and {names[1]} are hard to tell apart (correlation "
            f"{correlation[i, j]:+.3f}): the data fix something like their {combination}; alone "
            f"they would be known within {_percent(alone[i])} and {_percent(alone[j])}, together "
            f"they are known within {_percent(relative[i])} and {_percent(relative[j])}."
        )
    return (
        f"{', '.join(names[:-1])} and {names[-1]} are hard to tell apart: changed together, they "
        f"leave the fit as it is; each alone would be known within "
        f"{', '.join(_percent(alone[k]) for k in members)}, together within "
        f"{', '.join(_percent(relative[k]) for k in members)}."
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 1.0 else f"a factor of {1.0 + share:.1f}"
