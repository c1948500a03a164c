"""Random draws of a robot's parameters from their covariance, one for every member.

A draw may be an impossible robot: two pulleys that overlap, a static friction below the kinetic
one.  The true robot is not impossible, so such a draw is replaced by another one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.drawn_numbers import drawn_numbers, is_friction
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.prepared import Model, prepare, read_only
from cdrj_ros.robot.description import Robot, Uncertainty
from cdrj_ros.robot.parameters import writer_of
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.tolerances import within_range

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Made = TypeVar("Made")

DRAWS: Final = 20
"""Draws of a member's parameters before smaller deviations are tried."""

SMALLER: Final = (0.5, 0.5)
"""Factors by which the last of them is then reduced; in the end, the member has the robot's own
numbers."""

LEAST_FACTOR: Final = 1e-9
"""Eigenvalue of a correlation matrix below which a direction is not drawn."""


@dataclass(frozen=True)
class Draw:
    """Parameters of all members, and the numbers that follow from them."""

    document: Mapping[str, Any]
    """Content of the robot file from which they were drawn."""
    first: Table
    """Independent normal draws, before impossible ones were replaced, shape (members, causes)."""
    normal: Table
    """The draws that were used, shape (members, causes)."""
    changes: Mapping[str, Vector]
    """What they change in the robot's numbers, by path [SI], shape (members,) each."""
    numbers: Table
    """Shape (members, numbers); read-only."""


def draw_members(
    robot: Robot,
    members: int,
    generator: np.random.Generator,
    known: Uncertainty | None = None,
) -> list[Robot]:
    """Robots with parameters drawn from their covariance; empty if all parameters are exact.

    The draws are antithetic pairs.  If there are no more causes of error than pairs, the sample
    covariance equals the given one, so quantities linear in the parameters have the exact spread.
    With more causes, each of them alone has exactly its spread.  Impossible draws are replaced by
    independent ones.
    """
    known = known or robot.uncertainty
    if known is None or not known.parameters or not robot.document:
        return []
    factor = _independent_factors(known)
    normal = _normal(members, factor.shape[1], generator)
    redraw = generator.spawn(1)[0]
    models = _members(robot, known, factor, normal, redraw, lambda one: prepare(one, False))
    return [robot if one is None else one.robot for one in models]


def draw_numbers(
    model: Model,
    members: int,
    generator: np.random.Generator,
    known: Uncertainty | None = None,
    before: Draw | None = None,
) -> Draw:
    """Numbers of the robots that ``draw_members`` gives.

    Args:
        model: the prepared robot.
        members: how many, even.
        generator: random generator.
        known: standard deviations of the parameters; None: those of the robot.
        before: an earlier result.  If only friction differs between both robots, its geometry is
            used again, which gives the same result in a fraction of the time.
    """
    known = known or model.robot.uncertainty
    document = model.robot.document
    if known is None or not known.parameters or not document:
        same = read_only(np.repeat(model.numbers[None, :], members, axis=0))
        return Draw(document, np.empty((members, 0)), np.empty((members, 0)), {}, same)
    factor = _independent_factors(known)
    first = _normal(members, factor.shape[1], generator)
    redraw = generator.spawn(1)[0]
    if before is not None:
        again = _again(model, known, factor, first, before)
        if again is not None:
            return again
    normal = first.copy()
    changes = _changes(known, normal, factor)
    numbers = drawn_numbers(model, _values(document, changes))
    if numbers is None:
        rows = _members(
            model.robot, known, factor, normal, redraw, lambda one: prepare(one, False).numbers
        )
        numbers = np.stack([model.numbers if one is None else one for one in rows])
        changes = _changes(known, normal, factor)
    return Draw(document, first, normal, changes, read_only(numbers))


def _again(
    model: Model, known: Uncertainty, factor: Table, first: Table, before: Draw
) -> Draw | None:
    """The draws for other friction; None if more than friction differs, or it is not allowed."""
    document = model.robot.document
    if not (
        np.array_equal(first, before.first)
        and _without_friction(document) == _without_friction(before.document)
    ):
        return None
    changes = _changes(known, before.normal, factor)
    rest = [path for path in changes if not is_friction(path)]
    if rest != [path for path in before.changes if not is_friction(path)]:
        return None
    if not all(np.array_equal(changes[path], before.changes[path]) for path in rest):
        return None
    if any(path.endswith(".bearing_diameter") for path in rest):  # friction depends on it
        return None
    friction = {path: change for path, change in changes.items() if is_friction(path)}
    numbers = drawn_numbers(model, _values(document, friction), before.numbers)
    if numbers is None:
        return None
    return Draw(document, first, before.normal, changes, read_only(numbers))


def _without_friction(document: Any) -> Any:
    """A copy without the entries of friction, wherever they are."""
    if isinstance(document, Mapping):
        return {k: _without_friction(v) for k, v in document.items() if k != "friction"}
    if isinstance(document, list | tuple):
        return [_without_friction(one) for one in document]
    return document


def _normal(members: int, causes: int, generator: np.random.Generator) -> Table:
    """Independent normal draws in antithetic pairs, shape (members, causes)."""
    pairs = members // 2
    normal = generator.standard_normal((pairs, causes))
    if pairs >= causes:
        normal = np.linalg.qr(normal)[0] * np.sqrt(pairs)
    else:  # at least every factor alone has exactly its spread
        normal /= np.sqrt((normal**2).mean(axis=0))
    return np.concatenate([normal, -normal])


def _independent_factors(known: Uncertainty) -> Table:
    """F with F Fᵀ = covariance, one column per independent cause, shape (p, causes)."""
    stated, size = known.stated, len(known.parameters)
    left = _factors(known.covariance[:stated, :stated])
    right = _factors(known.covariance[stated:, stated:])
    factors = np.zeros((size, left.shape[1] + right.shape[1]))
    # smallest first, whatever the order in the file
    factors[:stated, : left.shape[1]] = left[:, np.argsort((left**2).sum(axis=0), kind="stable")]
    factors[stated:, left.shape[1] :] = right
    return factors


def _factors(covariance: Table) -> Table:
    """F with F Fᵀ = covariance, one column per direction that is drawn.

    The eigenvalues are those of the correlations, which have no units: the variances of a stiffness
    in N/m and of a strain differ by more than the precision of a number.
    """
    scale = np.sqrt(np.diag(covariance))
    safe = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    kept = values > LEAST_FACTOR
    factors: Table = scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    return factors


def _members(
    robot: Robot,
    known: Uncertainty,
    factor: Table,
    normal: Table,
    generator: np.random.Generator,
    use: Callable[[Robot], Made],
) -> list[Made | None]:
    """What ``use`` makes of the robot with its parameters changed by each of ``normal``.

    A member whose robot is invalid, or refused by ``use`` because its cables have no path, is drawn
    again, and its row of ``normal`` replaced; None if every draw is refused.
    """
    document: Any = {**robot.document, "uncertainty": {"others": "exact"}}  # numbers alone matter
    write = writer_of(document, known.parameters)
    found: list[Made | None] = [None] * len(normal)
    left = np.arange(len(normal))
    for share in (None,) * (DRAWS - 1) + SMALLER + (0.0,):
        values = _values(robot.document, _changes(known, normal, factor))
        for k in left:
            try:
                changed = write([float(v[k]) for v in values.values()])
                found[k] = use(build_robot(changed, robot.source))
            except CdrjError:
                continue
        left = np.array([k for k in left if found[k] is None], dtype=np.intp)
        if not left.size:
            break
        if share is None:
            normal[left] = generator.standard_normal((left.size, normal.shape[1]))
        else:
            normal[left] *= share
    return found


def _changes(known: Uncertainty, normal: Table, factor: Table) -> dict[str, Vector]:
    """Changes of all parameters by path [SI], shape (members,) each."""
    return dict(zip(known.parameters, (normal @ factor.T).T, strict=True))


def _values(document: Any, changes: Mapping[str, Vector]) -> dict[str, Vector]:
    """Parameters of all members within the schema's ranges, by path [SI], shape (members,) each."""
    return {path: within_range(document, path, change) for path, change in changes.items()}
