"""Tension and strain of a cable: linear, or stiffening as its strands bed in; (E1), (E21).

A straight wire stretches in proportion to its load.  A stranded cable also lengthens because its
wires and strands settle closer together, which takes little force at first and more and more as
the gaps between them close.  The part of this stretch that comes back with the load is elastic: it
is a second spring in series, which saturates.

    eps(T) = T / EA + e_b T / (T + T_b)                                         (E21)

``e_b`` is the strain of a cable whose strands lie close, and at the tension ``T_b`` half of it is
taken up.  With ``e_b`` = 0 the cable is linear.  Solved for T, (E21) is a quadratic equation.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

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


def elasticities(rows: Any) -> Elasticity:
    """The laws of many rows of ``Constants.cables``; the fields have the shape of ``rows``."""
    return Elasticity(*(rows[name] for name in Elasticity._fields))


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
