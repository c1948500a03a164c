"""Laws of a cable in numbers: elasticity (E1), (E21), friction of its pulleys, and contact cells.

A straight wire stretches in proportion to its load.  A stranded cable also lengthens because its
wires and strands settle closer together, which takes little force at first and more and more as
the gaps between them close.  The part of this stretch that comes back with the load is elastic: it
is a second spring in series, which saturates.

    eps(T) = T / EA + e_b T / (T + T_b)                                         (E21)

``e_b`` is the strain of a cable whose strands lie close, and at the tension ``T_b`` half of it is
taken up.  With ``e_b`` = 0 the cable is linear.  Solved for T, (E21) is a quadratic equation.

One contact holds the friction of a whole arc at one place.  Its error grows with the square of the
capstan exponent rho mu beta and falls with the square of the number of cells: docs/model.md,
section 4.  Where the robot file leaves that number open, ``divided`` chooses it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import count
from math import ceil
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import Stribeck
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.robot.description import Cable, FrictionLaw, Pulley, Robot, friction_law

Numeric = TypeVar("Numeric", float, NDArray[np.float64])

UNUSED_TENSION = 1.0
"""Stands for T_b [N] where a cable is linear, so that (E21) divides by no zero."""


class Elasticity(NamedTuple):
    """Tension-strain law of a cable; the fields may be arrays, of one entry per cable or member."""

    axial_stiffness: Any
    """EA, slope of the tension over the strain at high load [N]."""
    bedding_strain: Any = 0.0
    """e_b: strain that the strands' bedding adds at high load [-]; 0 for a linear cable."""
    bedding_tension: Any = UNUSED_TENSION
    """T_b: tension at which half of ``bedding_strain`` is taken up [N]."""


def elasticity_of(cable: Any) -> Elasticity:
    """The law of a cable of a robot, or of a row of ``Constants.cables``."""
    return Elasticity(cable.axial_stiffness, cable.bedding_strain, cable.bedding_tension)


def strain_at(law: Elasticity, tension: Numeric) -> Numeric:
    """(E21): strain at a tension [-].

    Args:
        law: of the cable.
        tension: [N]; below 0 the law goes on with its slope at 0, as if the cable could push.
    """
    taut = np.maximum(tension, 0.0)
    found: Numeric = tension / law.axial_stiffness + law.bedding_strain * tension / (
        taut + law.bedding_tension
    )
    return found


def modulus_at(law: Elasticity, tension: Numeric) -> Numeric:
    """dT / d(strain) at a tension [N]: EA for a linear cable, otherwise less, and rising to EA.

    Args:
        law: of the cable.
        tension: [N]; below 0 the slope at 0 is returned.
    """
    close = np.maximum(tension, 0.0) + law.bedding_tension
    share = law.axial_stiffness * law.bedding_strain * law.bedding_tension / (close * close)
    found: Numeric = law.axial_stiffness / (1.0 + share)
    return found


def secant_at(law: Elasticity, tension: Numeric) -> Numeric:
    """T / strain at a tension that is not negative [N]: EA for a linear cable."""
    found: Numeric = law.axial_stiffness / (
        1.0 + law.axial_stiffness * law.bedding_strain / (tension + law.bedding_tension)
    )
    return found


def tensions_at(law: Elasticity, strain: NDArray[np.float64]) -> NDArray[np.float64]:
    """(E22): tensions at many strains [N], the inverse of (E21), also below 0.

    With b = T_b / EA + e_b - eps the tension is the positive root of T^2 / EA + b T = T_b eps.

    Args:
        law: of the cable.
        strain: of any shape to which the law's fields can be broadcast.
    """
    if not np.any(law.bedding_strain):
        return law.axial_stiffness * strain
    linear = law.bedding_tension / law.axial_stiffness
    taut = np.maximum(strain, 0.0)
    b = linear + law.bedding_strain - taut
    q = 0.5 * (np.abs(b) + np.sqrt(b * b + 4.0 * taut * linear))
    found = np.where(b > 0.0, law.bedding_tension * taut / q, law.axial_stiffness * q)
    found = np.where(strain < 0.0, strain * modulus_at(law, 0.0 * strain), found)
    return np.where(law.bedding_strain == 0.0, law.axial_stiffness * strain, found)


RIGID_BRISTLE: Final = 1e9
"""Contact stiffness [N/m] that stands for a rigid contact in the laws ``euler`` and ``steady``."""

NEVER_SLIDES: Final = 1e9
"""Stribeck speed [m/s] that stands for 'no Stribeck effect'; no slip reaches it."""


def stribeck_of(cable: Cable) -> Stribeck:
    """The cable's Stribeck form, which all of its pulleys share."""
    forms = {pulley.friction.stribeck for pulley in cable.pulleys} or {"printed"}
    return Stribeck[forms.pop()]


def friction_numbers(pulley: Pulley, law: FrictionLaw) -> dict[str, float]:
    """Friction constants of one pulley; what the law does not take has its neutral value."""
    friction = pulley.friction
    if not law.bearing:  # sliding alone
        friction = replace(friction, rho=1.0)
    if not law.static:
        friction = replace(friction, mu_s=friction.mu_c)
    rigid = not law.bristles
    return {
        "rho": friction.rho,
        "mu_c": friction.mu_c,
        "mu_s": friction.mu_s,
        "stribeck_speed": friction.stribeck_speed or NEVER_SLIDES,
        "stribeck_lag": friction.stribeck_lag,
        "bearing_ratio": bearing_ratio(pulley),
        "drag": pulley.bearing_torque / pulley.radius if law.bearing and pulley.radius else 0.0,
        "bristle_stiffness": RIGID_BRISTLE if rigid else friction.bristle_stiffness,
        "bristle_damping": 0.0 if rigid else friction.bristle_damping,
        "viscous": 0.0 if rigid else friction.viscous,
        "breakaway": 1.0 if rigid else friction.breakaway,
    }


def bearing_ratio(pulley: Pulley) -> float:
    """1 / alpha of (41)."""
    if not pulley.radius:  # an eyelet or a sheath
        return 0.0
    return pulley.friction.bearing_friction * pulley.bearing_diameter / pulley.radius


def contact_cells(pulley: Pulley) -> int:
    """Number of contact cells of a pulley; 1 until it has been chosen."""
    return max(pulley.cells, 1)


EXPONENT_PER_CELL: Final = 0.13
"""Largest capstan exponent of one cell [-]."""

MOST_CELLS: Final = 64
"""Largest number of cells of one pulley, as in the schema of robot files."""


def divided(robot: Robot, wrap: Vector) -> Robot:
    """The robot with a number of cells for every pulley, in its document too.

    Robots that differ from it in their numbers only then have the same cells, whatever their
    friction: members of an ensemble, trials of an identification.

    Args:
        robot: the description.
        wrap: of every pulley in the reference pose [rad], shape (pulleys,).
    """
    if all(pulley.cells for cable in robot.cables for pulley in cable.pulleys):
        return robot
    chosen = with_pulleys(
        robot, lambda cable, pulley, k: replace(pulley, cells=_cells(cable, pulley, wrap[k]))
    )
    return replace(chosen, document=_stated(chosen)) if robot.document else chosen


def with_pulleys(robot: Robot, change: Callable[[Cable, Pulley, int], Pulley]) -> Robot:
    """The robot with changed pulleys; ``change`` also takes the cable and the pulley's index."""
    cables, index = [], count()
    for cable in robot.cables:
        inner = (change(cable, pulley, next(index)) for pulley in cable.pulleys)
        cables.append(replace(cable, nodes=(cable.nodes[0], *inner, cable.nodes[-1])))
    return replace(robot, cables=tuple(cables))


def _cells(cable: Cable, pulley: Pulley, wrap: float) -> int:
    if pulley.cells:
        return pulley.cells
    if not friction_law(cable.law).sliding or pulley.kind == "eyelet":
        return 1
    exponent = pulley.friction.rho * pulley.friction.mu_c * wrap
    return min(max(ceil(exponent / EXPONENT_PER_CELL), 1), MOST_CELLS)


def _stated(robot: Robot) -> dict[str, Any]:
    """The robot's document with the cells of every pulley; it may have cables that it has not."""
    document: dict[str, Any] = dict(robot.document)
    cables = {cable.name: cable for cable in robot.cables}
    document["cables"] = [
        {**entry, "nodes": _nodes_with_cells(cables[entry["name"]], entry["nodes"])}
        if entry["name"] in cables
        else entry
        for entry in document["cables"]
    ]
    return document


def _nodes_with_cells(cable: Cable, entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    guides = [
        entry if pulley.kind == "eyelet" else {**entry, "cells": pulley.cells}
        for pulley, entry in zip(cable.pulleys, entries[1:-1], strict=True)
    ]
    return [entries[0], *guides, entries[-1]]
