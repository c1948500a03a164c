"""Messages about what the data cannot determine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.identification.residuals import Problem
from cdrj_ros.identification.solution import limits
from cdrj_ros.identification.unknowns import Unknown
from cdrj_ros.robot.parameters import find_number

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

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
    values = np.array([u.value(float(x)) for u, x in zip(unknowns, coordinates, strict=True)])
    slopes = np.array([u.slope(float(x)) for u, x in zip(unknowns, coordinates, strict=True)])
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
    joint, _, key = unknown.paths[0].rpartition(".")
    if key != "reference_angle" or not joint.startswith("joints."):
        return ""
    place, bound = ("1", unknown.lower) if end == "lower" else ("2", unknown.upper)
    if find_number(problem.document, f"{joint}.range.{place}").value != bound:
        return ""
    return f" This is the end of {joint}.range; widen it if the joint moves further."


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
