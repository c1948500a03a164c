"""Random draws for the members of an ensemble, one for every unknown of a robot.

These are the parameters of the robot file, drawn from their covariance, the preloads, the tension
of the cable on the drums, initial friction histories, errors of readings and efforts, and paths
between readings.  Members come in antithetic pairs.  See docs/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import sqrt
from typing import Any, Final, TypeVar

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.model.laws import elasticities, strain_at
from cdrj_ros.model.packing import constant_views
from cdrj_ros.model.prepared import Model, prepare, read_only, segments_of
from cdrj_ros.robot.description import Robot, Uncertainty
from cdrj_ros.robot.parameters import find_number, writer_of
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.tolerances import within_range

Made = TypeVar("Made")

DRAWS: Final = 20
"""Draws of a member's parameters before smaller deviations are tried."""

SMALLER: Final = (0.5, 0.5)
"""Factors by which the last of them is then reduced; in the end, the member has the robot's own
constants."""

LEAST_FACTOR: Final = 1e-9
"""Eigenvalue of a correlation matrix below which a direction is not drawn."""

READING_ROWS: Final = 1021
"""Rows of random reading errors, used by the members in turn; a prime, so that no member always
gets the same rows."""

SATURATED: Final = 0.7
"""Fraction of cables whose pulleys start at their friction bounds, as after a long motion."""

FRONTS: Final = (0.6, 0.25, 0.15)
"""Probabilities that the sign of friction changes nowhere, once and twice along a cable."""

UNSEEN_ROWS: Final = 61
"""Rows of deviations, used in turn from one interval without readings to the next."""

WOUND_SPREAD: Final = 0.3
"""Standard deviation of the logarithm of the tension at which the cable on a drum was wound."""


@dataclass(frozen=True)
class Draws:
    """What distinguishes the members of an ensemble; arrays are read-only."""

    constants: Table
    """Constants of every member's robot, shape (members, constants)."""
    friction_share: Table
    """Initial friction of every pulley as a share of its bound, shape (members, pulleys)."""
    effort_error: Table
    """Lasting errors of the motors' efforts [N m], shape (members, motors); zero where every joint
    has an encoder."""
    reading_error: Table
    """Errors of motor and joint angles [rad], one row for every update of a member, which they have
    in turn, shape (rows, axes)."""
    unseen_share: Table
    """xi of (U3), one row per interval between readings in turn, shape (rows, members, axes)."""
    generator: np.random.Generator
    """In its state after these draws; copy it to draw more."""


def draw(
    model: Model,
    members: int,
    seed: int = 0,
    preload_share: float = 0.0,
    known: Uncertainty | None = None,
) -> Draws:
    """Draw the members of a robot's ensemble.

    Args:
        model: the prepared robot; its uncertainty and its sensors define what is unknown.
        members: how many, even.
        seed: of the draws; the same seed gives the same members.
        preload_share: standard deviation of every preload in addition to the robot file's, as a
            fraction of the preload.
        known: standard deviations of the parameters; None: those of the robot.
    """
    robot, generator = model.robot, np.random.default_rng(seed)
    constants, zeros = draw_constants(model, members, generator, known)
    wind_differently(model, constants, generator)
    if preload_share > 0.0:
        preload_differently(model, constants, preload_share, generator)
    residuals: Any = constant_views(model.sizes, constants).residuals
    residuals["bound"] = 0.0  # the estimate alone is corrected
    shares = [friction_shares(members, len(cable.pulleys), generator) for cable in robot.cables]
    efforts = np.zeros((members, len(robot.motors)))
    if robot.unmeasured:
        half = generator.standard_normal((members // 2, len(robot.motors)))
        efforts = _paired(half * _effort_stddev(robot))
    errors = reading_errors(robot, zeros, generator)
    axes = len(robot.motors) + len(robot.joints)
    return Draws(
        read_only(constants),
        read_only(np.concatenate(shares, axis=1)),
        read_only(efforts),
        read_only(errors),
        read_only(_unseen_shares(members, axes, np.random.default_rng((seed, 1)))),
        generator,
    )


def draw_constants(
    model: Model, members: int, generator: np.random.Generator, known: Uncertainty | None = None
) -> tuple[Table, Table]:
    """The robots that ``draw_members`` draws, as the core takes them.

    Returns:
        Their constants, shape (members, constants), and the differences of their angles from the
        robot's at the same readings [rad], shape (members, axes): ``offset`` is not one of the
        constants, since readings are converted to angles before any robot sees them.
    """
    known = known or model.robot.uncertainty
    zeros = np.zeros((members, len(model.robot.axes)))
    if members == 0 or known is None or not known.parameters or not model.robot.document:
        return np.repeat(model.constants[None, :], members, axis=0), zeros
    offsets = model.robot.offsets
    made = draw_members(
        model.robot, known, members, generator,
        lambda one: (prepare(one, False).constants, np.subtract(one.offsets, offsets)),
    )  # fmt: skip
    constants = np.stack([model.constants if one is None else one[0] for one in made])
    for k, one in enumerate(made):
        zeros[k] = 0.0 if one is None else one[1]
    return constants, zeros


def draw_members(
    robot: Robot,
    known: Uncertainty,
    members: int,
    generator: np.random.Generator,
    use: Callable[[Robot], Made],
) -> list[Made | None]:
    """What ``use`` makes of the robot with its parameters changed, once for every member.

    If there are no more causes of error than pairs, the sample covariance equals the given one, so
    quantities linear in the parameters have the exact spread.  With more causes, each of them alone
    has exactly its spread.  A draw may be an impossible robot: two pulleys that overlap, a static
    friction below the kinetic one, cables without a path, which ``use`` refuses.  The true robot is
    not impossible, so such a member is drawn again; None if every draw is refused.
    """
    factor = independent_factors(known)
    normal = _normal(members, factor.shape[1], generator)
    redraw = generator.spawn(1)[0]
    given: Any = robot.document
    document: Any = {**given, "uncertainty": {"others": "exact"}}  # numbers alone matter
    write = writer_of(document, known.parameters)
    found: list[Made | None] = [None] * members
    left = np.arange(members)
    for share in (None,) * (DRAWS - 1) + SMALLER + (0.0,):
        changes = dict(zip(known.parameters, (normal @ factor.T).T, strict=True))
        values = _possible_values(given, changes)
        for k in left:
            try:
                changed = write([float(value[k]) for value in values])
                found[k] = use(build_robot(changed, robot.source))
            except CdrjError:
                continue
        left = np.array([k for k in left if found[k] is None], dtype=np.intp)
        if not left.size:
            break
        if share is None:
            normal[left] = redraw.standard_normal((left.size, normal.shape[1]))
        else:
            normal[left] *= share
    return found


def _possible_values(document: Document, changes: Mapping[str, Vector]) -> list[Vector]:
    """Every number after each of several changes, within what the schema allows.

    Where a reference angle would leave its joint's range and its change is reversed, so is that of
    the encoder's zero, which after a tare is the same error.
    """
    values = {path: within_range(document, path, change) for path, change in changes.items()}
    for path, value in values.items():
        zero = path.replace(".reference_angle", ".offset")
        if zero != path and zero in changes:
            reversed_ = (value - find_number(document, path).value) * changes[path] < 0.0
            there = np.where(reversed_, -changes[zero], changes[zero])
            values[zero] = within_range(document, zero, there)
    return list(values.values())


def _normal(members: int, causes: int, generator: np.random.Generator) -> Table:
    """Independent normal draws in antithetic pairs, shape (members, causes)."""
    pairs = members // 2
    normal = generator.standard_normal((pairs, causes))
    if pairs >= causes:
        normal = np.linalg.qr(normal)[0] * np.sqrt(pairs)
    else:  # at least every factor alone has exactly its spread
        normal /= np.sqrt((normal**2).mean(axis=0))
    return _paired(normal)


def _paired(half: Table) -> Table:
    """Draws of one member of every pair, then their opposites of the others."""
    return np.concatenate([half, -half])


def independent_factors(known: Uncertainty) -> Table:
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


def wind_differently(model: Model, constants: Table, generator: np.random.Generator) -> None:
    """Vary the unknown tension at which the cable on each drum was wound.

    Wound cable keeps the tension at which it was wound (E3), not the preload.

    Args:
        model: the prepared robot.
        constants: of all members, shape (members, constants), changed in place.
        generator: random generator.
    """
    half = len(constants) // 2
    cables: Any = constant_views(model.sizes, constants).cables
    for c in range(len(model.robot.cables)):
        cables["wound_tension"][:, c] *= np.exp(
            WOUND_SPREAD * _paired(generator.standard_normal(half))
        )


def preload_differently(
    model: Model, constants: Table, share: float, generator: np.random.Generator
) -> None:
    """Vary the members' preloads, cable by cable, with standard deviation ``share`` times each.

    Every member keeps its own lengths in the reference pose, where it has its preload.
    """
    half = len(constants) // 2
    views: Any = constant_views(model.sizes, constants)
    for c in range(len(model.robot.cables)):
        change = 1.0 + share * _paired(generator.standard_normal(half))
        law, preload = elasticities(views.cables[:, c]), views.cables["preload"][:, c]
        changed = preload * np.maximum(change, 0.0)
        shorter = (1.0 + strain_at(law, preload)) / (1.0 + strain_at(law, changed))
        views.segments["material"][:, segments_of(model, c)] *= shorter[:, None]
        views.cables["preload"][:, c] = changed


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
    return _paired(shares)


def reading_errors(robot: Robot, zeros: Table, generator: np.random.Generator) -> Table:
    """Errors of motor and joint angles from noise, resolution and zeros [rad], (rows, axes).

    Those of joints without encoder have no noise.  Where zeros are in error, row ``r`` is one of
    member ``r % members``.

    Args:
        robot: with the sensors.
        zeros: errors of the members' zeros [rad], shape (members, axes).
        generator: random generator.
    """
    sensors = [axis.sensor for axis in robot.as_read.axes]
    scale = np.array([abs(sensor.scale) for sensor in sensors])
    noise = scale * np.array([sensor.noise for sensor in sensors])
    count = scale * np.array([sensor.resolution for sensor in sensors])
    shape = (READING_ROWS, len(sensors))
    read = noise * generator.standard_normal(shape) + count * (generator.random(shape) - 0.5)
    measured = [True] * len(robot.motors) + [joint.measured for joint in robot.joints]
    errors = np.zeros((READING_ROWS, len(measured)))
    errors[:, measured] = read
    if not zeros.any():
        return errors
    row = np.arange(READING_ROWS * len(zeros))
    return np.asarray(errors[row % READING_ROWS] + zeros[row % len(zeros)])


def _unseen_shares(members: int, axes: int, generator: np.random.Generator) -> Table:
    """Deviations of unit variance and zero mean over the members, (UNSEEN_ROWS, members, axes)."""
    half = generator.standard_normal((UNSEEN_ROWS, members // 2, axes))
    half /= np.sqrt((half**2).sum(axis=1, keepdims=True) / max(members // 2, 1))
    return np.ascontiguousarray(np.concatenate([half, -half], axis=1))


def _effort_stddev(robot: Robot) -> Vector:
    """Lasting error of the motors' efforts, that of the model included [N m], shape (motors,)."""
    known = robot.uncertainty
    given: Mapping[str, float] = dict(known.model_error) if known is not None else {}
    return np.array(
        [given.get(f"effort/{motor.name}", motor.effort_noise) for motor in robot.motors]
    )


def standard(generator: np.random.Generator, members: int, apart: Sequence[Vector] = ()) -> Vector:
    """Random numbers with mean 0 and variance 1 over the members, shape (members,).

    Args:
        generator: random generator.
        members: number of members.
        apart: values in every member with which they are not correlated.  Since members are few,
            they would be by chance, and every correction would reduce the spread of these values.
    """
    normal = generator.standard_normal(members)
    if len(apart) < members // 2:
        basis = _basis(members, b"".join([one.tobytes() for one in apart]))
        normal -= basis @ (basis.T @ normal)
    else:
        normal -= normal.mean()
    normal /= root_mean_square(normal)
    return normal


@lru_cache(maxsize=8)
def _basis(members: int, apart: bytes) -> Table:
    """Orthonormal basis of a constant and of the vectors that ``apart`` holds, (members, vectors).

    Several draws follow each other with the same vectors.  To decompose them takes ten times as
    long as to compare them.
    """
    vectors = np.ones((1 + len(apart) // (8 * members), members))
    vectors[1:] = np.frombuffer(apart).reshape(-1, members)
    return np.linalg.qr(vectors.T)[0]


def root_mean_square(values: Vector) -> float:
    """Standard deviation of values with mean 0."""
    return sqrt(np.add.reduce(values * values) / values.size)
