"""What a cable's solver knows of every pulley and element, and where it keeps its unknowns.

A cable of n nodes has n - 1 elements and n - 2 pulleys.  Arrays count elements and pulleys from 0:
pulley ``i`` lies between elements ``i`` and ``i + 1``.  The unknowns are the slips of the pulleys:
the unstretched material that moves past each towards the last node.
"""

from __future__ import annotations

from typing import Final

from cdrj_ros.model.records import record_type


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
    cells: float
    """Number of equal contact cells of the whole pulley, of which this is one; a whole number."""
    wrap: float
    """Constant part of the wrap angle [rad]."""
    kinetic_loss: float
    """Loss 1 - eta at high slip speed where the wrap never changes [-]."""
    static_loss: float
    """Further loss at rest where the wrap never changes [-]."""
    half_sine: float
    """sin(wrap / 2) where the wrap never changes."""
    half_cosine: float
    """cos(wrap / 2) where the wrap never changes."""


class SolverElement:
    """One element in the solver."""

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
    """One pulley in the solver: its unknown slip, its friction and its row of the linear system."""

    slip: float
    """Material that moves past the pulley towards the last node in this sample [m]."""
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
    """Slip at which the imbalance is evaluated [m]."""
    step: float
    """Newton step of the slip [m]."""
    residual: float
    """Force imbalance at ``trial`` [N]."""
    by_slip: float
    """Derivative of friction by the slip at constant bound [N/m]."""
    by_pull: float
    """Derivative of friction by the tension on the pull side [-]."""
    upper: float
    """Eliminated system: coefficient of the next pulley's step [-]."""


PULLEY: Final = record_type(PulleyNumbers)
SOLVER_ELEMENT: Final = record_type(SolverElement)
CONTACT: Final = record_type(Contact)
