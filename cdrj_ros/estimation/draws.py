"""Random draws for the members of an ensemble, one for every unknown of a robot.

These are the parameters of the robot file, drawn from their covariance, the preloads, the tension
of the cable on the drums, initial friction histories, errors of readings and efforts, and paths
between readings.  Members come in antithetic pairs.  What is drawn for a cable, an axis or a number
depends on its name alone, not on the rest of the robot.  See docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.model.packing import constant_views
from cdrj_ros.model.prepared import Model, prepare, read_only
from cdrj_ros.robot.description import Joint, Robot, Uncertainty
from cdrj_ros.robot.groups import Owners, connected_cables
from cdrj_ros.robot.parameters import Number, find_number, writer_of
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.stated import related
from cdrj_ros.robot.tolerances import within_range

Made = TypeVar("Made")

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

DRAWS: Final = 20
"""Draws of a member's parameters before smaller deviations are tried."""

SMALLER: Final = (0.5, 0.5)
"""Factors by which the last of them is then reduced; in the end, the member has the robot's own
constants."""

LEAST_FACTOR: Final = 1e-9
"""Eigenvalue of a correlation matrix below which a direction is not drawn."""


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
    zero_error: Table
    """Errors of the members' zeros of these angles [rad], shape (members, axes)."""
    unseen_share: Table
    """xi of (U3), one row per interval between readings in turn, shape (rows, members, axes)."""


def draw(
    model: Model,
    members: int,
    seed: int = 0,
    known: Uncertainty | None = None,
) -> Draws:
    """Draw the members of a robot's ensemble.

    Args:
        model: the prepared robot; its uncertainty and its sensors define what is unknown.
        members: how many, even.
        seed: of the draws; the same seed gives the same members.
        known: standard deviations of the parameters; None: those of the robot.
    """
    robot, streams = model.robot, Streams(seed)
    constants, zeros = draw_constants(model, members, streams, known)
    wind_differently(model, constants, streams)
    residuals: Any = constant_views(model.sizes, constants).residuals
    residuals["bound"] = 0.0  # the estimate alone is corrected
    shares = [
        friction_shares(members, len(cable.pulleys), streams.of("friction", cable.name))
        for cable in robot.cables
    ]
    efforts = np.zeros((members, len(robot.motors)))
    for m, stddev in enumerate(_effort_stddev(robot)) if robot.unmeasured else ():
        half = streams.of("effort", robot.motors[m].name).standard_normal(members // 2)
        efforts[:, m] = paired(half * stddev)
    unseen = [_unseen_shares(members, streams.of("unseen", axis.name)) for axis in robot.axes]
    return Draws(
        read_only(constants),
        read_only(np.concatenate(shares, axis=1)),
        read_only(efforts),
        read_only(reading_errors(robot, streams)),
        read_only(zeros),
        read_only(np.stack(unseen, axis=2)),
    )


def wind_differently(model: Model, constants: Table, streams: Streams) -> None:
    """Vary the unknown tension at which the cable on each drum was wound.

    Wound cable keeps the tension at which it was wound (E3), not the preload.

    Args:
        model: the prepared robot.
        constants: of all members, shape (members, constants), changed in place.
        streams: random generators.
    """
    half = len(constants) // 2
    cables: Any = constant_views(model.sizes, constants).cables
    for c, cable in enumerate(model.robot.cables):
        normal = streams.of("wound", cable.name).standard_normal(half)
        cables["wound_tension"][:, c] *= np.exp(WOUND_SPREAD * paired(normal))


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
    return paired(shares)


def reading_errors(robot: Robot, streams: Streams) -> Table:
    """Errors of motor and joint angles from noise and resolution [rad], (rows, axes).

    Those of joints without encoder have none.
    """
    errors = np.zeros((READING_ROWS, len(robot.axes)))
    for a, axis in enumerate(robot.axes):
        if isinstance(axis, Joint) and not axis.measured:
            continue
        sensor, generator = axis.sensor, streams.of("reading", axis.name)
        noise = sensor.noise * generator.standard_normal(READING_ROWS)
        count = sensor.resolution * (generator.random(READING_ROWS) - 0.5)
        errors[:, a] = abs(sensor.scale) * (noise + count)
    return errors


def _unseen_shares(members: int, generator: np.random.Generator) -> Table:
    """Deviations of unit variance and zero mean over the members, (UNSEEN_ROWS, members)."""
    half = generator.standard_normal((UNSEEN_ROWS, members // 2))
    half /= np.sqrt((half**2).sum(axis=1, keepdims=True) / max(members // 2, 1))
    return np.concatenate([half, -half], axis=1)


def _effort_stddev(robot: Robot) -> Vector:
    """Lasting error of the motors' efforts, that of the model included [N m], shape (motors,)."""
    known = robot.uncertainty
    given: Mapping[str, float] = dict(known.model_error) if known is not None else {}
    return np.array(
        [given.get(f"effort/{motor.name}", motor.effort_noise) for motor in robot.motors]
    )


# --- numbers of the file --------------------------------------------------------------------------


class Streams:
    """Random generators by name: what is drawn under a name does not depend on any other name."""

    def __init__(self, seed: int) -> None:
        """Begin; the same seed gives the same numbers under the same names."""
        self._seed = seed

    def of(self, *names: str) -> np.random.Generator:
        """A new generator; the same names give the same one."""
        digest = blake2b("\0".join(names).encode(), digest_size=16).digest()
        return np.random.default_rng((self._seed, int.from_bytes(digest, "little")))


def draw_constants(
    model: Model, members: int, streams: Streams, known: Uncertainty | None = None
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
        model.robot, known, members, streams,
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
    streams: Streams,
    use: Callable[[Robot], Made],
) -> list[Made | None]:
    """What ``use`` makes of the robot with its parameters changed, once for every member.

    If a group of connected cables has no more causes of error than there are pairs, the sample
    covariance of its numbers equals the given one, so quantities linear in the parameters have the
    exact spread.  With more causes, each of them alone has exactly its spread.  A draw may be an
    impossible robot: two pulleys that overlap, a static friction below the kinetic one, cables
    without a path, which ``use`` refuses.  The true robot is not impossible, so the numbers of the
    groups at fault are drawn again; None if every draw is refused.
    """
    causes = _by_groups(robot, known)
    normal = {group: _normal(members, causes, group, streams) for group in causes}
    given: Any = robot.document
    document: Any = {**given, "uncertainty": {"others": "exact"}}  # numbers alone matter
    numbers = [find_number(given, path) for path in known.parameters]
    write = writer_of(document, numbers)

    def changed(values: Sequence[Vector], k: int) -> Made | None:
        try:
            return use(build_robot(write([float(value[k]) for value in values]), robot.source))
        except CdrjError:
            return None

    def at_fault(group: int | None, k: int) -> bool:
        own = {one: normal[one] if one == group else 0.0 * normal[one] for one in causes}
        return changed(_values(given, numbers, causes, own), k) is None

    found: list[Made | None] = [None] * members
    left = list(range(members))
    for attempt, share in enumerate((None,) * (DRAWS - 1) + SMALLER + (0.0,)):
        values = _values(given, numbers, causes, normal)
        for k in left:
            found[k] = changed(values, k)
        left = [k for k in left if found[k] is None]
        for k in left:
            wrong = [group for group in causes if len(causes) > 1 and at_fault(group, k)]
            for group in wrong or causes:
                for j, cause in enumerate(causes[group]):
                    again = streams.of("cause", cause.name, f"again {attempt}")
                    one = normal[group][k]
                    one[j] = again.standard_normal(members)[k] if share is None else one[j] * share
        if not left:
            break
    return found


class Cause(NamedTuple):
    """Numbers that deviate together, independently of all others."""

    name: str
    """Of the first of these numbers, and which of several causes it is."""
    numbers: NDArray[np.intp]
    """Their indices among all parameters."""
    factor: Vector
    """Their changes [SI] for one standard deviation of the cause."""


Causes = dict[int | None, list[Cause]]
"""By group of cables; ``None``: those of numbers that concern several groups, which come first."""


def _by_groups(robot: Robot, known: Uncertainty) -> Causes:
    """The independent causes of all errors by the groups of cables that they concern."""
    owners = Owners(robot, connected_cables(robot, branches=True))
    causes: Causes = {None: []}
    for cause in independent_causes(known):
        group = owners.group_of_all(known.parameters[k] for k in cause.numbers)
        causes.setdefault(group, []).append(cause)
    return causes


def _values(
    document: Document,
    numbers: Sequence[Number],
    causes: Causes,
    normal: Mapping[int | None, Table],
) -> list[Vector]:
    """Every number of every member, within what the schema allows."""
    members = len(normal[None])
    changes = np.zeros((len(numbers), members))
    for group, own in causes.items():
        for cause, size in zip(own, normal[group].T, strict=True):
            changes[cause.numbers] += cause.factor[:, None] * size
    return _possible_values(document, numbers, changes)


def _possible_values(document: Document, numbers: Sequence[Number], changes: Table) -> list[Vector]:
    """Every number after each of several changes, within what the schema allows.

    Where a reference angle would leave its joint's range and its change is reversed, so is that of
    the encoder's zero, which after a tare is the same error.
    """
    values = [within_range(document, *one) for one in zip(numbers, changes, strict=True)]
    places = {number.path: k for k, number in enumerate(numbers)}
    for k, number in enumerate(numbers):
        zero = places.get(number.path.replace(".reference_angle", ".offset"), k)
        if zero != k:
            reversed_ = (values[k] - number.value) * changes[k] < 0.0
            there = np.where(reversed_, -changes[zero], changes[zero])
            values[zero] = within_range(document, numbers[zero], there)
    return values


def _normal(members: int, causes: Causes, group: int | None, streams: Streams) -> Table:
    """Independent normal draws of a group's causes in antithetic pairs, (members, causes)."""
    pairs = members // 2

    def drawn(own: Sequence[Cause]) -> Table:
        columns = [streams.of("cause", one.name).standard_normal(pairs) for one in own]
        return np.stack(columns, axis=1) if columns else np.empty((pairs, 0))

    normal = drawn(causes[group])
    before = drawn(causes[None]) if group is not None else np.empty((pairs, 0))
    if pairs >= before.shape[1] + normal.shape[1]:
        together = np.concatenate([before, normal], axis=1)
        normal = np.linalg.qr(together)[0][:, before.shape[1] :] * np.sqrt(pairs)
    else:  # at least every cause alone has exactly its spread
        normal /= np.sqrt((normal**2).mean(axis=0))
    return paired(normal)


def paired(half: Table) -> Table:
    """Draws of one member of every pair, then their opposites of the others."""
    return np.concatenate([half, -half])


def independent_causes(known: Uncertainty) -> list[Cause]:
    """Causes whose squared factors add up to the covariance, those of stated numbers first."""

    def among(begin: int, end: int) -> list[Cause]:
        blocks = related(known.covariance[begin:end, begin:end])
        return [one for block in blocks for one in _causes(known, begin + np.array(block))]

    causes = among(0, known.stated)
    # smallest first, whatever the order in the file
    causes.sort(key=lambda one: float((one.factor**2).sum()))
    return causes + among(known.stated, len(known.parameters))


def _causes(known: Uncertainty, block: NDArray[np.intp]) -> Iterator[Cause]:
    """The independent causes of the errors of one block, one for every direction that is drawn.

    The eigenvalues are those of the correlations, which have no units: the variances of a stiffness
    in N/m and of a strain differ by more than the precision of a number.
    """
    covariance = known.covariance[np.ix_(block, block)]
    scale = np.sqrt(np.diag(covariance))
    safe = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    name = min(known.parameters[k] for k in block.tolist())
    for k in np.flatnonzero(values > LEAST_FACTOR).tolist():
        yield Cause(f"{name} {k}", block, scale * vectors[:, k] * np.sqrt(values[k]))
