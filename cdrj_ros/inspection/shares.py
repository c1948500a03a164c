"""Shares of the uncertain numbers in the spread of every tension, and how to reduce them.

Each cause of error deviates while all joints move through their ranges and the motors follow.  The
change of a tension per standard deviation is the cause's contribution (U7).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.following import following_motors
from cdrj_ros.model.prepared import Model, mover_of, of_cables, prepare
from cdrj_ros.robot.groups import connected_cables
from cdrj_ros.robot.parameters import find_number, with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.stated import with_covariance
from cdrj_ros.robot.tolerances import Tolerance, default_tolerances, within_range

SAMPLES: Final = 100
"""Samples of the motion, two cycles of the first joint; with four times as many, the standard
deviations of the shipped hand change by 0.7 % at most."""

REACH: Final = 0.45
"""Amplitude of the motion as a fraction of each joint's range."""

GOLDEN_ANGLE: Final = np.pi * (3.0 - 5.0**0.5)
"""Difference of phases whose multiples fall together least [rad]."""

DURATION_S: Final = 40.0
"""Duration of the motion [s]."""

SMALL: Final = 0.01
"""Deviation, in standard deviations: a whole one would make many cables slack, and errors that
cancel, such as those of a joint's zero and of its reference angle, would seem not to."""

MOST_CAUSES: Final = 400
"""Largest number of causes that are compared; each needs a model and a run of its own."""


@dataclass(frozen=True)
class Cause:
    """One cause of uncertainty and its effect on every tension."""

    what: str
    """Path of the number if the file states its accuracy; otherwise a description."""
    measure: str
    """Cheapest measurement that would at least halve the error."""
    share: Vector
    """Share in the variance of every tension [-], shape (elements,); adds up to 1 over causes."""


@dataclass(frozen=True)
class Shares:
    """All causes, the largest first."""

    stddev: Vector
    """Standard deviation of every tension, root mean square over the motion [N], (elements,)."""
    causes: tuple[Cause, ...]


def uncertainty_shares(model: Model) -> Shares | None:
    """Share of every cause in the spread of every tension.

    Cables that share no motor are compared by themselves, since angles are given.

    None if no number is uncertain, or if a group of cables has more than ``MOST_CAUSES``.
    """
    robot = model.robot
    if robot.uncertainty is None or not robot.uncertainty.parameters or not robot.document:
        return None
    groups = connected_cables(robot, by_joints=False)
    if len(groups) == 1:
        return _shares_of(model)
    variance = np.zeros(len(model.layout.elements))
    found: dict[tuple[str, str], Vector] = {}
    for group in groups:
        shares = _shares_of(of_cables(model, group))
        if shares is None:
            return None
        own = np.concatenate([np.r_[robot.parts[c]] for c in group])
        variance[own] = shares.stddev**2
        for cause in shares.causes:
            key = cause.what, cause.measure
            found.setdefault(key, np.zeros(len(variance)))[own] = cause.share
    causes = [Cause(*key, share) for key, share in found.items()]
    causes.sort(key=lambda cause: -float(cause.share @ variance))
    return Shares(np.sqrt(variance), tuple(causes))


def _shares_of(model: Model) -> Shares | None:
    """The shares of a robot whose cables depend on each other."""
    robot = model.robot
    known = robot.uncertainty
    if known is None:
        return Shares(np.zeros(len(model.layout.elements)), ())
    stated = known.parameters[: known.stated]
    stddev = np.sqrt(np.diag(known.covariance))
    causes = [
        Tolerance(path, f"identify --fit {path}, or measure it", {path: float(stddev[k])})
        for k, path in enumerate(stated)
    ]
    others = set(known.parameters[known.stated :])
    for one in default_tolerances(dict(robot.document)):
        factor = {path: value for path, value in one.factor.items() if path in others}
        if factor:
            causes.append(Tolerance(one.what, one.measure, factor))
    if len(causes) > MOST_CAUSES:
        return None
    small = [{path: SMALL * value for path, value in one.factor.items()} for one in causes]
    effect = tension_effects(model, small) / SMALL
    correlation = np.eye(len(causes))
    own = slice(known.stated)
    correlation[own, own] = with_covariance(stated, known.covariance[own, own]).correlation
    joint = np.einsum("kj,jte->kte", correlation, effect)
    contribution = (effect * joint).mean(axis=1)
    variance = np.maximum(contribution.sum(axis=0), 0.0)
    share = contribution / np.where(variance > 0.0, variance, 1.0)
    order = np.argsort(-(contribution.sum(axis=1)))
    return Shares(
        np.sqrt(variance),
        tuple(Cause(causes[k].what, causes[k].measure, share[k]) for k in order.tolist()),
    )


def tension_effects(model: Model, causes: Sequence[Mapping[str, float]]) -> NDArray[np.float64]:
    """Changes of the tensions by each cause [N], shape (causes, samples, elements).

    Args:
        model: the robot.
        causes: deviations of numbers by path [SI].
    """
    robot = model.robot
    motors, joints = sweep(model)
    before = _tensions(model, motors, joints)
    effects = np.zeros((len(causes), *before.shape))
    moved = mover_of(model)
    for k, cause in enumerate(causes):
        deviating = _deviating(model, cause, moved)
        if deviating is not None:
            shift = np.subtract(deviating.robot.offsets, robot.offsets)
            own = motors + shift[: len(robot.motors)], joints + shift[len(robot.motors) :]
            effects[k] = _tensions(deviating, *own) - before
    return effects


def sweep(model: Model, samples: int = SAMPLES) -> tuple[Table, Table]:
    """A motion of ``DURATION_S`` in which all joints move through their ranges.

    Returns:
        Angles of the motors, which follow, and of the joints [rad], shape (samples, axes) each.
    """
    robot = model.robot
    phase = np.linspace(0.0, 2.0, samples)[:, None] * 2.0 * np.pi
    lower = np.array([joint.lower for joint in robot.joints])
    upper = np.array([joint.upper for joint in robot.joints])
    # no two joints move in step, and none more than twice as often as the first
    round_, third = np.divmod(np.arange(len(robot.joints)), 3)
    wave = np.sin((1.0 + 0.5 * third) * phase + GOLDEN_ANGLE * round_)
    joints = 0.5 * (lower + upper) + REACH * (upper - lower) * wave
    return following_motors(model, joints), joints


def _deviating(
    model: Model,
    cause: Mapping[str, float],
    moved: Callable[[Mapping[str, float]], Model | None],
) -> Model | None:
    """The robot with one cause deviating by a standard deviation; None if neither sign works."""
    document: Any = model.robot.document
    numbers = {**document, "uncertainty": {"others": "exact"}}  # numbers alone matter
    for sign in (1.0, -1.0):
        try:
            if found := moved({path: sign * stddev for path, stddev in cause.items()}):
                return found
            values = {}
            for path, stddev in cause.items():
                number = find_number(document, path)
                values[path] = float(within_range(document, number, np.array([sign * stddev]))[0])
            return prepare(
                build_robot(with_numbers(numbers, values), model.robot.source), check_range=False
            )
        except CdrjError:
            continue
    return None


def _tensions(model: Model, motors: Table, joints: Table) -> Table:
    """Tensions along the motion [N], shape (samples, elements)."""
    step_ns = round(1e9 * DURATION_S / len(joints))
    estimates = np.empty((len(joints), model.layout.size))
    unstarted = _core.State(_core.NEVER, np.zeros(model.state_size))
    model.core.run(unstarted, step_ns * np.arange(len(joints)), motors, joints, estimates)
    return estimates[:, model.layout.tension]
