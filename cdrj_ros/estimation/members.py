"""Random draws for the members of the ensemble, one for every unknown of a robot.

These are parameters (from their covariance), preloads, the tension of the cable on the drums,
initial friction histories, reading errors, and paths between readings.  See docs/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.drawn_numbers import drawn_numbers
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.elasticity import elasticities, strain_at
from cdrj_ros.model.packing import number_views
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.description import Robot, Uncertainty
from cdrj_ros.robot.parameters import writer_of
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.tolerances import within_range

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Made = TypeVar("Made")

PERTURBATIONS: Final = 1021
"""Rows of random reading errors, used by the members in turn; a prime, so that no member always
gets the same rows."""

SATURATED: Final = 0.7
"""Fraction of cables whose pulleys start at their friction bounds, as after a long motion."""

FRONTS: Final = (0.6, 0.25, 0.15)
"""Probabilities that the sign of friction changes at zero, one and two places along a cable."""

WAYS: Final = 61
"""Rows of deviations, used in turn from one interval without readings to the next."""

LEAST_FACTOR: Final = 1e-9
"""Eigenvalue of a correlation matrix below which a direction is not drawn."""

WOUND_SPREAD: Final = 0.3
"""Standard deviation of the logarithm of the tension at which the cable on a drum was wound."""


def draw_members(
    robot: Robot,
    members: int,
    generator: np.random.Generator,
    known: Uncertainty | None = None,
) -> list[Robot]:
    """Robots with parameters drawn from their covariance; empty if all parameters are exact.

    The draws are antithetic pairs.  If there are no more causes of error than pairs, the sample
    covariance equals the given one, so quantities linear in the parameters have the exact spread.
    With more causes, each of them alone has exactly its spread.
    """
    known = known or robot.uncertainty
    draws = _draws(robot, known, members, generator)
    if draws is None or known is None:
        return []
    return [one or robot for one in _members(robot, known, draws, lambda possible: possible)]


def draw_numbers(
    model: Model,
    members: int,
    generator: np.random.Generator,
    known: Uncertainty | None = None,
) -> Table:
    """Numbers of the robots that ``draw_members`` gives, shape (members, numbers)."""
    known = known or model.robot.uncertainty
    draws = _draws(model.robot, known, members, generator)
    if draws is None or known is None:
        return np.repeat(model.numbers[None, :], members, axis=0)
    numbers = drawn_numbers(model, _values(model.robot, known, draws))
    if numbers is None:
        rows = _members(model.robot, known, draws, lambda one: prepare(one, False).numbers)
        numbers = np.stack([model.numbers if one is None else one for one in rows])
    return numbers


def _draws(
    robot: Robot, known: Uncertainty | None, members: int, generator: np.random.Generator
) -> Table | None:
    """Changes of all parameters, shape (members, parameters); None if all are exact."""
    if known is None or not known.parameters or not robot.document:
        return None
    factor = _independent_factors(known)
    pairs, p = members // 2, factor.shape[1]
    normal = generator.standard_normal((pairs, p))
    if pairs >= p:
        normal = np.linalg.qr(normal)[0] * np.sqrt(pairs)
    else:  # at least every factor alone has exactly its spread
        normal /= np.sqrt((normal**2).mean(axis=0))
    draws: Table = np.concatenate([normal, -normal]) @ factor.T
    return draws


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
    robot: Robot, known: Uncertainty, draws: Table, use: Callable[[Robot], Made]
) -> list[Made | None]:
    """What ``use`` makes of the robot with its parameters changed by each of ``draws``.

    Where that robot is invalid, or ``use`` refuses it because its cables have no path, the
    parameters are changed by half, then by a quarter as much; None where this is invalid, too.
    """
    document: Any = {**robot.document, "uncertainty": {"others": "exact"}}  # numbers alone matter
    write = writer_of(document, known.parameters)
    values = [_values(robot, known, share * draws) for share in (1.0, 0.5, 0.25)]
    found: list[Made | None] = []
    for k in range(len(draws)):
        made = None
        for one in values:
            try:
                changed = write([float(v[k]) for v in one.values()])
                made = use(build_robot(changed, robot.source))
                break
            except CdrjError:
                continue
        found.append(made)
    return found


def _values(robot: Robot, known: Uncertainty, draws: Table) -> dict[str, Vector]:
    """Parameters of all members within the schema's ranges, by path [SI], shape (members,) each."""
    document: Any = robot.document
    return {
        path: within_range(document, path, changes)
        for path, changes in zip(known.parameters, draws.T, strict=True)
    }


def wind_differently(model: Model, numbers: Table, generator: np.random.Generator) -> None:
    """Vary the unknown tension at which the cable on each drum was wound.

    Wound cable keeps the tension at which it was wound (E3), not the preload.

    Args:
        model: the prepared robot.
        numbers: numbers of all members, shape (members, numbers), changed in place.
        generator: random generator.
    """
    half = len(numbers) // 2
    cables: Any = number_views(model.sizes, numbers).cables
    for c in range(len(model.robot.cables)):
        normal = generator.standard_normal(half)
        spread = np.exp(WOUND_SPREAD * np.concatenate([normal, -normal]))
        cables["wound_tension"][:, c] *= spread


def preload_differently(
    model: Model, numbers: Table, share: float, generator: np.random.Generator
) -> None:
    """Vary the members' preloads, cable by cable, with standard deviation ``share`` times each."""
    shape = shape_at(model, np.array([joint.reference_angle for joint in model.robot.joints]))
    half = len(numbers) // 2
    cables: Any = number_views(model.sizes, numbers).cables
    elements: Any = number_views(model.sizes, numbers).elements
    element = 0
    for c, cable in enumerate(model.robot.cables):
        normal = generator.standard_normal(half)
        change = 1.0 + share * np.concatenate([normal, -normal])
        preload = cables["preload"][:, c] * np.maximum(change, 0.0)
        cables["preload"][:, c] = preload
        stretch = 1.0 + strain_at(elasticities(cables[:, c]), preload)
        for _ in cable.element_names:
            elements["material"][:, element] = shape.length[element] / stretch
            element += 1


def friction_shares(members: int, pulleys: int, generator: np.random.Generator) -> Table:
    """Friction histories that motions before the start may have left.

    Returns:
        Friction of every pulley as a fraction of its bound, shape (members, pulleys).  The sign
        changes where the last motion ended along the cable; most members have the full bound.
        Members come in pairs of opposite sign.
    """
    half = members // 2
    fronts = generator.integers(0, pulleys + 1, (half, len(FRONTS) - 1))
    there = generator.choice(len(FRONTS), (half, 1), p=FRONTS) > np.arange(len(FRONTS) - 1)
    behind = np.arange(pulleys)[None, :, None] >= fronts[:, None, :]
    passed = (behind & there[:, None, :]).sum(axis=2)
    shares = np.where(passed % 2 == 0, 1.0, -1.0)
    partly = generator.random(half) > SATURATED
    shares[partly] *= generator.random((int(partly.sum()), pulleys))
    return np.concatenate([shares, -shares])


def reading_errors(robot: Robot, generator: np.random.Generator) -> Table:
    """Errors of motor and joint angles from noise and resolution [rad], (PERTURBATIONS, axes)."""
    sensors = [axis.sensor for axis in robot.axes]
    scale = np.array([abs(sensor.scale) for sensor in sensors])
    noise = scale * np.array([sensor.noise for sensor in sensors])
    count = scale * np.array([sensor.resolution for sensor in sensors])
    shape = (PERTURBATIONS, len(sensors))
    errors = noise * generator.standard_normal(shape) + count * (generator.random(shape) - 0.5)
    return np.ascontiguousarray(errors)


def unseen_ways(members: int, axes: int, generator: np.random.Generator) -> NDArray[np.float64]:
    """Deviations of unit variance and zero mean over the members, shape (WAYS, members, axes)."""
    half = generator.standard_normal((WAYS, members // 2, axes))
    half /= np.sqrt((half**2).mean(axis=1, keepdims=True))
    return np.ascontiguousarray(np.concatenate([half, -half], axis=1))
