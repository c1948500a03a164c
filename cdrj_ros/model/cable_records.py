"""What a cable's solver knows of every contact, segment and drum, and where it keeps its unknowns.

A pulley is one contact, or a row of contact cells, each with friction of its own.  The n contacts
of a cable divide it into n + 1 segments: contact ``i`` lies between segments ``i`` and ``i + 1``.
The unknowns are the fluxes: the unstretched material that moves past the middle of each contact
towards the last node.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.records import record_type

Vector = NDArray[np.float64]


CAPACITY: Final = 64
"""Break points that a drum remembers."""

FIRST_SPACING: Final = 0.1
"""Distance of break points [rad] until the memory is full for the first time."""


class PulleyNumbers:
    """One pulley of the robot: friction constants, and the wrap where it never changes."""

    radius: float
    """From the axis to the cable's centre line [m]."""
    rho: float
    """Share of sliding friction in the blend (42) [-]."""
    mu_c: float
    """Coulomb coefficient [-]."""
    mu_s: float
    """Static coefficient [-]."""
    stribeck_speed: float
    """v_s of (33) [m/s]."""
    stribeck_lag: float
    """Time by which static friction lags behind the slip speed [s], (E10)."""
    bearing_ratio: float
    """1 / alpha of (41) [-]."""
    drag: float
    """Friction force of the bearing without load [N]."""
    bristle_stiffness: float
    """sigma0 [N/m]."""
    bristle_damping: float
    """sigma1 [N s/m]."""
    viscous: float
    """sigma2 [N s/m]."""
    breakaway: float
    """Fraction of the bound up to which pre-sliding is elastic [-]."""
    wrap: float
    """Constant part of the wrap angle [rad]."""
    moved_after: float
    """Motion of the middle of the arc towards the last node as a share of the arc's growth [-]: 1/2
    where the end after it moves, -1/2 where that before it does, 0 where both do.  Only used where
    the wrap is given by tables."""
    cell_width: float
    """Width of contact cells that are fixed to the surface [m]; see ``PulleyPlan.surface``."""
    kinetic_loss: float
    """Loss 1 - eta at high slip speed where the wrap never changes [-]."""
    static_loss: float
    """Further loss at rest where the wrap never changes [-]."""
    half_sine: float
    """sin(wrap / 2) where the wrap never changes."""
    half_cosine: float
    """cos(wrap / 2) where the wrap never changes."""


class Segment:
    """The cable between two neighbouring contacts, or between a contact and an end."""

    length_before: float
    """Geometric length at the sample before [m]."""
    length: float
    """Geometric length now [m]."""
    material_before: float
    """Unstretched length at the sample before [m]."""
    material: float
    """Unstretched length now [m]."""
    tension: float
    """[N]."""


class Contact:
    """One contact: its unknown flux, its friction and its row of the linear system."""

    share: float
    """Share of its pulley's wrap [-]."""
    stiffness: float
    """Its part of sigma0 [N/m]."""
    damping: float
    """Its part of sigma1 [N s/m]."""
    viscous: float
    """Its part of sigma2 [N s/m]."""
    drag: float
    """Its part of the bearing's friction force without load [N]."""
    breakaway: float
    """Fraction of the bound up to which pre-sliding is elastic [-]."""
    shift: float
    """Material by which its middle has moved on the body, towards the last node, in this sample
    [m]: the second term of (E25)."""
    flux: float
    """Material that moves past its middle towards the last node in this sample [m]."""
    bristle_before: float
    """Bristle force at the sample before [N]."""
    bristle: float
    """Bristle force now [N]."""
    loss: float
    """1 - eta at the lagged slip speed [-]."""
    static_share: float
    """Share of static friction that remains at the lagged slip speed [-]."""
    bound: float
    """Largest friction force, g of (34) [N]."""
    trial: float
    """Flux at which the imbalance is evaluated [m]."""
    step: float
    """Newton step of the flux [m]."""
    residual: float
    """Force imbalance at ``trial`` [N]."""
    by_slip: float
    """Derivative of friction by the slip at constant bound [N/m]."""
    by_pull: float
    """Derivative of friction by the tension on the pull side [-]."""
    upper: float
    """Eliminated system: coefficient of the next contact's step [-]."""


class Drum:
    """What a drum holds: cable comes off at the strain at which it went on.

    The rate form ``ds = -r dphi / (1 + t/EA)`` forgets this.  Where winding and unwinding happen at
    different tensions, as friction makes them, it feeds a little cable out in every cycle and the
    preload decays to nothing.  A drum without slip is a stack: last on, first off.  It is kept here
    as a piecewise linear map from the wound angle to the material on the drum.  docs/model.md,
    section 2.
    """

    points: float
    """Break points in use, a whole number."""
    spacing: float
    """Distance of break points [rad]."""
    rate_below: float
    """Unstretched material per radian below the first break point [m/rad]."""
    angle: Vector
    """Wound angle of every break point, increasing [rad], shape (CAPACITY,)."""
    material: Vector
    """Unstretched material up to every break point [m], shape (CAPACITY,)."""


PULLEY: Final = record_type(PulleyNumbers)
SEGMENT: Final = record_type(Segment)
CONTACT: Final = record_type(Contact)
DRUM: Final = record_type(Drum, angle=CAPACITY, material=CAPACITY)
