"""Random draws for the members of the ensemble, one for every unknown of a robot.

These are preloads, the tension of the cable on the drums, initial friction histories, reading
errors, and paths between readings; ``parameter_draws`` has the parameters.  See
docs/uncertainty.md.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.elasticity import elasticities, strain_at
from cdrj_ros.model.packing import number_views
from cdrj_ros.model.prepared import Model, segments_of, shape_at
from cdrj_ros.robot.description import Robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

PERTURBATIONS: Final = 1021
"""Rows of random reading errors, used by the members in turn; a prime, so that no member always
gets the same rows."""

SATURATED: Final = 0.7
"""Fraction of cables whose pulleys start at their friction bounds, as after a long motion."""

FRONTS: Final = (0.6, 0.25, 0.15)
"""Probabilities that the sign of friction changes at zero, one and two places along a cable."""

WAYS: Final = 61
"""Rows of deviations, used in turn from one interval without readings to the next."""

WOUND_SPREAD: Final = 0.3
"""Standard deviation of the logarithm of the tension at which the cable on a drum was wound."""


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
    segments: Any = number_views(model.sizes, numbers).segments
    for c in range(len(model.robot.cables)):
        normal = generator.standard_normal(half)
        change = 1.0 + share * np.concatenate([normal, -normal])
        preload = cables["preload"][:, c] * np.maximum(change, 0.0)
        cables["preload"][:, c] = preload
        stretch = 1.0 + strain_at(elasticities(cables[:, c]), preload)
        own = segments_of(model, c)
        for segment in range(own.start, own.stop):
            segments["material"][:, segment] = shape.segment[segment] / stretch


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
