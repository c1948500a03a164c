"""Numbers of the robot file that are not fitted, and what their errors do to the residuals.

An error of a number that is not fitted, such as a pulley's radius, acts in the same direction in
every cycle.  The fit absorbs it in the numbers that it adjusts, so the residuals do not show it.
See (I3) in docs/identification.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cdrj_ros.estimation.draws import independent_causes
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.identification.observations import Observations, changes_conditioning
from cdrj_ros.identification.problem import Problem, residuals_of_one
from cdrj_ros.identification.unknowns import Unknown, values_by_path
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Uncertainty
from cdrj_ros.robot.parameters import find_number, with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.stated import related
from cdrj_ros.robot.tolerances import within_range

Cause = Mapping[str, float]
"""One standard deviation of numbers that deviate together [SI], by path, signed."""

STEP: Final = 0.5
"""Deviation at which the effect of a cause is computed [standard deviations]."""

NEGLIGIBLE: Final = 1e-9
"""Correlation below which numbers count as independent."""


@dataclass(frozen=True)
class Nuisance:
    """Numbers that are not fitted, and how the errors of the fitted ones go with theirs."""

    paths: tuple[str, ...]
    stddev: Vector
    """Standard deviations [SI], shape (q,)."""
    correlation: Table
    """Correlation among them, shape (q, q)."""
    with_fitted: Table
    """Correlation of the fitted numbers with them, shape (p, q)."""
    groups: tuple[tuple[int, ...], ...]
    """Indices of numbers that deviate together; the groups are independent."""


def nuisance_causes(known: Uncertainty | None, unknowns: Sequence[Unknown]) -> tuple[Cause, ...]:
    """Independent causes of error among the numbers that a fit does not adjust.

    Args:
        known: standard deviations and correlations of the file's numbers, stated and default.
        unknowns: the numbers that the fit adjusts.
    """
    if known is None:
        return ()
    fitted = {_same(path) for unknown in unknowns for path in unknown.paths}
    rest = [k for k, path in enumerate(known.parameters) if _same(path) not in fitted]
    stated = sum(k < known.stated for k in rest)
    paths = tuple(known.parameters[k] for k in rest)
    covariance = known.covariance[np.ix_(rest, rest)]
    stddev = np.sqrt(np.diag(covariance))
    causes = []
    for one in independent_causes(Uncertainty(paths, covariance, stated)):
        largest = int(np.abs(one.factor / stddev[one.numbers]).argmax())
        sizes = np.sign(one.factor[largest]) * one.factor
        moved = zip(one.numbers.tolist(), sizes.tolist(), strict=True)
        causes.append({paths[k]: size for k, size in moved if size != 0.0})
    return tuple(causes)


def effects(problem: Problem, coordinates: Vector, causes: Sequence[Cause]) -> Table:
    """Change of the residuals by one standard deviation of every cause, shape (n, causes).

    Args:
        problem: the fit.
        coordinates: of the fitted numbers, shape (p,).
        causes: of errors of all other numbers.
    """
    here = problem.residuals(coordinates)
    fitted = values_by_path(problem.unknowns, problem.values(coordinates))
    document = with_numbers(problem.numbers_alone, fitted)
    columns = np.zeros((here.size, len(causes)))
    for k, cause in enumerate(causes):
        observed: Sequence[Observations] = problem.observations
        if changes_conditioning(cause):  # then readings become other angles
            observed = [replace(one, samples=None) for one in observed]
        models = [_deviating(document, problem.source, cause, way) for way in (STEP, -STEP)]
        there = [one for one in models if one is not None]
        parts = list(
            problem.pool.map(
                residuals_of_one,
                [model for model in there for _ in observed],
                [one for _ in there for one in observed],
            )
        )
        size = len(observed)
        found = [np.concatenate(parts[at : at + size]) for at in range(0, len(parts), size)]
        problem.evaluations += len(there)
        if len(found) == 2:
            columns[:, k] = (found[0] - found[1]) / (2.0 * STEP)
        elif len(found) == 1:
            columns[:, k] = (found[0] - here) / (STEP if models[0] is not None else -STEP)
    columns[:, ~np.isfinite(columns).all(axis=0)] = 0.0
    return columns


def nuisance_correlation(causes: Sequence[Cause], absorbed: Table, stddev: Vector) -> Nuisance:
    """Errors of the numbers that are not fitted beside those of the fitted ones: (I7).

    Args:
        causes: of errors of all other numbers.
        absorbed: change of the fitted numbers if the file has one standard deviation too much of
            a cause [SI], shape (p, causes).
        stddev: standard errors of the fitted numbers [SI], shape (p,).
    """
    paths = tuple(dict.fromkeys(path for cause in causes for path in cause))
    roots = np.array([[cause.get(path, 0.0) for cause in causes] for path in paths])
    roots = roots.reshape(len(paths), len(causes))
    spread = np.sqrt((roots**2).sum(axis=1))
    roots = roots / spread[:, None]
    correlation = np.clip(roots @ roots.T, -1.0, 1.0)
    safe = np.where(stddev > 0.0, stddev, 1.0)
    with_fitted = np.clip((absorbed / safe[:, None]) @ roots.T, -1.0, 1.0)
    groups = tuple(map(tuple, related(correlation, NEGLIGIBLE)))
    return Nuisance(paths, spread, correlation, with_fitted, groups)


def _deviating(document: Document, source: str, cause: Cause, way: float) -> Model | None:
    """The model with some numbers deviating; None if no robot can have them."""
    changed = {}
    for path, size in cause.items():
        number = find_number(document, path)
        changed[path] = float(within_range(document, number, np.array([way * size]))[0])
        if abs(changed[path] - number.value - way * size) > 1e-9 * abs(size):
            return None
    try:
        return prepare(build_robot(with_numbers(document, changed), source), check_range=False)
    except RobotFileError:
        return None


def _same(path: str) -> str:
    """One name for the numbers that stand for each other: EA and the modulus of a cable."""
    return path.replace(".youngs_modulus", ".axial_stiffness")
