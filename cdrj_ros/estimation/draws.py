"""Random draws for the members of an ensemble, one for every unknown of a robot.

These are the parameters of the robot file, drawn from their covariance, the preloads, the tension
of the cable on the drums, initial friction histories, errors of readings and efforts, and paths
between readings.  Members come in antithetic pairs.  What is drawn for a cable, an axis or a number
depends on its name alone, not on the rest of the robot.  See docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cdrj_ros.estimation.parameter_draws import Streams, draw_constants, paired
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.packing import constant_views
from cdrj_ros.model.prepared import Model, read_only
from cdrj_ros.robot.description import Joint, Robot, Uncertainty

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
