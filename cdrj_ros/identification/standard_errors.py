"""Standard errors and correlations of the numbers, and what the data cannot determine.

Residuals of a fitted mechanism are not white noise.  Most of them is error of the model, which
lasts for a good part of a stroke, appears in many references at once and repeats in every cycle of
the motion.  The usual errors, sigma^2 (J'J)^-1, would treat each of a million samples as
independent and be wrong by orders of magnitude.  The standard errors here have two parts:

- Numbers of the file that are not fitted are not exact.  Their errors act in the same direction in
  every cycle, so that the residuals do not show what the fit has absorbed.  Their effect on the
  residuals is computed, and by the fit that on the numbers (``nuisance``).
- What is left of the residuals, as far as it lasts, counts once per state of the mechanism, however
  many cycles, samples and references there are in it (``residual_statistics``).

See (I2), (I3) and (I6) in docs/identification.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.identification.nuisance import (
    Cause,
    Nuisance,
    effects,
    nuisance_causes,
    nuisance_correlation,
)
from cdrj_ros.identification.problem import Problem
from cdrj_ros.identification.residual_statistics import (
    Linear,
    Places,
    cells_of_residuals,
    residual_variance,
    states_of_residuals,
    visited_states,
    white_variance,
)
from cdrj_ros.identification.solver import Minimum, limits, prior_gradient, prior_information
from cdrj_ros.identification.unknowns import Unknown
from cdrj_ros.robot.parameters import joint_range


class Accuracy(NamedTuple):
    """Accuracy of the numbers."""

    stddev: Vector
    """Standard errors [SI], shape (p,)."""
    correlation: Table
    """Correlation matrix, shape (p, p)."""
    findings: tuple[str, ...]
    """Messages about what the data cannot determine."""
    silent: NDArray[np.bool_]
    """Which numbers have neither influence on the data nor a prior, shape (p,)."""
    others: Nuisance
    """Numbers that are not fitted."""
    variance: float
    """(I6)."""


def accuracy(problem: Problem, found: Minimum) -> Accuracy:
    """Standard errors and findings at a solution.

    Args:
        problem: problem with the observations of the residuals and the Jacobian.
        found: the solution.
    """
    coordinates = found.coordinates
    causes = nuisance_causes(problem.begin.robot.uncertainty, problem.unknowns)
    covariance, absorbed, information, variance = _covariance(problem, causes, found)
    slope = problem.slopes(coordinates)
    in_coordinates = np.sqrt(np.diag(covariance))
    most = np.array([(u.upper - u.lower) / np.sqrt(12.0) for u in problem.unknowns])
    correlation = covariance / np.outer(in_coordinates, in_coordinates)
    correlation = correlation * np.outer(np.sign(slope), np.sign(slope))
    np.fill_diagonal(correlation, 1.0)
    stddev = np.minimum(in_coordinates * np.abs(slope), most)
    absorbed = absorbed * (np.sign(slope) * stddev / in_coordinates)[:, None]
    return Accuracy(
        stddev,
        np.clip(correlation, -1.0, 1.0),
        findings(problem, coordinates, information, covariance),
        without_influence(information) & [u.prior is None for u in problem.unknowns],
        nuisance_correlation(causes, absorbed, stddev),
        variance,
    )


def _covariance(
    problem: Problem, causes: Sequence[Cause], found: Minimum
) -> tuple[Table, Table, Table, float]:
    """(I3): covariance of the numbers, their change by each cause, the data's information, (I6).

    All are in coordinates; the information is that of the data alone.

    Args:
        problem: problem with the observations of the residuals.
        causes: of errors of all other numbers.
        found: the solution.
    """
    coordinates, variance, root = found.coordinates, found.variance, np.sqrt(found.weights)
    residuals, slopes = found.residuals * root, found.slopes * root[:, None]
    others = effects(problem, coordinates, causes) * root[:, None]
    known = prior_information(problem, coordinates)
    everything = Linear(
        np.hstack([slopes, others]), residuals,
        np.concatenate([known, np.ones(len(causes))]),
        np.concatenate([prior_gradient(problem, coordinates), np.zeros(len(causes))]),
    )  # fmt: skip
    places = Places(
        states_of_residuals(problem), cells_of_residuals(problem), visited_states(problem)
    )
    noise = max(white_variance(problem, residuals), problem.least_variance)
    left = residual_variance(everything, places, variance, noise)
    square = slopes.T @ slopes
    fitted = np.linalg.inv(square / variance + np.diag(known))
    absorbed = -fitted @ (slopes.T @ others) / variance
    own = fitted @ (square * (left / variance**2) + np.diag(known)) @ fitted
    covariance = np.asarray(own + absorbed @ absorbed.T, dtype=np.float64)
    return covariance, absorbed, square / left, left


CLOSE: Final = 0.05
"""Eigenvalue of the correlation matrix below which the numbers of a combination count as hard to
distinguish; for two numbers, this is a correlation beyond 0.95."""

SILENT: Final = 1e-6
"""Sensitivity relative to the largest one below which a number has no influence."""

MATTERS: Final = 0.02
"""Relative uncertainty below which a combination is not reported."""

UNKNOWN: Final = 0.5
"""Relative uncertainty from which a number counts as undetermined by the data."""

MEMBER: Final = 0.3
"""Component in a direction, relative to the largest one, from which a number belongs to it."""


def without_influence(information: Table) -> NDArray[np.bool_]:
    """Which numbers the fitted references do not depend on, shape (p,).

    Args:
        information: information of the data alone, in coordinates, shape (p, p).
    """
    strength = np.sqrt(np.maximum(np.diag(information), 0.0))
    silent: NDArray[np.bool_] = strength <= SILENT * max(float(strength.max()), 1e-300)
    return silent


def findings(
    problem: Problem, coordinates: Vector, information: Table, covariance: Table
) -> tuple[str, ...]:
    """Messages about numbers without influence, at their bounds, or known only in combination.

    Args:
        problem: the problem that was solved.
        coordinates: the solution's coordinates, shape (p,).
        information: information of the data alone, in coordinates, shape (p, p).
        covariance: covariance in coordinates, shape (p, p).
    """
    unknowns = problem.unknowns
    values, slopes = problem.values(coordinates), problem.slopes(coordinates)
    size = np.maximum(np.abs(values), np.abs(slopes))  # the step's size where a number is near zero
    silent = without_influence(information)
    stddev = np.sqrt(np.diag(covariance))
    together = stddev * np.abs(slopes) / size
    alone = np.abs(slopes) / size / np.sqrt(np.diag(np.linalg.inv(covariance)))
    sign = np.sign(slopes) * np.where(values < 0.0, -1.0, 1.0)
    correlation = covariance / np.outer(stddev, stddev) * np.outer(sign, sign)

    sentences = [
        f"{unknowns[k].name} has no influence on the references that were fitted; it "
        "stays as it was."
        for k in np.flatnonzero(silent)
    ]
    sentences += _at_bounds(problem, coordinates, silent)
    told = set(np.flatnonzero(silent).tolist())
    eigenvalues, vectors = np.linalg.eigh(correlation)
    for direction in np.flatnonzero(eigenvalues < CLOSE):
        share = np.abs(vectors[:, direction])
        members = [
            int(k) for k in np.argsort(-share) if share[k] >= MEMBER * share.max() and not silent[k]
        ]
        if len(members) < 2 or set(members) <= told or max(together[members]) < MATTERS:
            continue
        told |= set(members)
        if len(members) == 2:
            i, j = members
            alike = len({unknowns[k].paths[0].rsplit(".", 1)[-1] for k in members}) == 1
            signless = alike or unknowns[i].lower < 0.0 or unknowns[j].lower < 0.0
            sentences.append(
                _pair(unknowns, i, j, float(correlation[i, j]), signless, alone, together)
            )
        else:
            sentences.append(_several(unknowns, members, alone, together))
    sentences += [
        f"{unknowns[k].name} is hardly determined by the data: {values[k]:.4g}, known only within "
        f"{_percent(together[k])}."
        for k in np.flatnonzero(together >= UNKNOWN)
        if k not in told
    ]
    return tuple(sentences)


def _at_bounds(problem: Problem, coordinates: Vector, silent: NDArray[np.bool_]) -> list[str]:
    lower, upper = limits(problem)
    sentences = []
    for k, unknown in enumerate(problem.unknowns):
        for bound, end in ((lower, "lower"), (upper, "upper")):
            if not silent[k] and abs(coordinates[k] - bound[k]) < 1e-2:
                value = unknown.value(float(coordinates[k]))
                sentences.append(
                    f"{unknown.name} ended at its {end} bound, {value:.5g}: the best fit lies "
                    f"beyond it, or the model is incomplete.{_wider(problem, unknown, end)}"
                )
    return sentences


def _wider(problem: Problem, unknown: Unknown, end: str) -> str:
    """What to do about a zero whose bound is the end of its joint's range in the robot file."""
    span = joint_range(problem.document, unknown.paths[0])
    at_end = span and (unknown.lower == span[0] if end == "lower" else unknown.upper == span[1])
    joint = unknown.paths[0].rpartition(".")[0]
    words = f" This is the end of {joint}.range; widen it if the joint moves further."
    return words if at_end else ""


def _pair(
    unknowns: Sequence[Unknown],
    i: int,
    j: int,
    correlation: float,
    signless: bool,
    alone: Vector,
    together: Vector,
) -> str:
    rising = correlation > 0.0
    if signless:
        combination = "difference" if rising else "sum"
    else:
        combination = "ratio" if rising else "product"
    return (
        f"{unknowns[i].name} and {unknowns[j].name} can hardly be told apart (correlation "
        f"{correlation:+.3f}): the data determine mainly their {combination}. If all other numbers "
        f"were known, they would be known within {_percent(alone[i])} and {_percent(alone[j])}; "
        f"now they are known within {_percent(together[i])} and {_percent(together[j])}."
    )


def _several(
    unknowns: Sequence[Unknown], members: Sequence[int], alone: Vector, together: Vector
) -> str:
    names = [unknowns[k].name for k in members]
    return (
        f"{', '.join(names[:-1])} and {names[-1]} can hardly be told apart: a combined change of "
        "them hardly affects the fit. If all other numbers were known, they would be known within "
        f"{', '.join(_percent(alone[k]) for k in members)}; now they are known within "
        f"{', '.join(_percent(together[k]) for k in members)}."
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 1.0 else f"a factor of {1.0 + share:.1f}"
