"""A rolling joint: (1)-(10), as derived and as the source prints them (examples/paper/slips.md).

Two equal circles of radius R roll on each other; the link's centre lies at 2R (cos q, sin q) and
the link turns by 2q.  The load sits L_d beyond it, at 2R (cos q, sin q) + L_d (cos 2q, sin 2q).
(4) and (9) are those of the rig's ``Load``, whose numbers are here those of any masses and lengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.simulation.load import Load


def rolling_load(
    joint_mass: float = 0.2,
    load_mass: float = 0.3,
    rolling_radius: float = 0.04,
    load_distance: float = 0.15,
    gravity: float = 9.81,
    *,
    printed: bool = False,
) -> Load:
    """(5)-(9): what a rolling joint carries, by default as ``make_load("rolling")`` of the rig.

    Args:
        joint_mass: m_joint, a disc of radius R at the link's centre [kg].
        load_mass: m_load, a point [kg].
        rolling_radius: R [m].
        load_distance: L_d from the link's centre to the load [m].
        gravity: [m/s^2], acting against positive joint angles.
        printed: with the factors of (7) and (9) as printed.
    """
    r, d = rolling_radius, load_distance
    along, across = (2.5, 2.0) if printed else (2.0, 4.0)  # of L_d^2 and L_d R cos q in (7)
    return Load(
        inertia=6.0 * joint_mass * r**2 + 2.0 * (along * d**2 + 2.0 * r**2) * load_mass,
        inertia_cos=2.0 * across * d * r * load_mass,
        weight_cos=2.0 * gravity * (joint_mass + load_mass) * r,
        weight_cos_2=2.0 * gravity * load_mass * d,
    )


def kinetic_energy(load: Load, angle: Vector, speed: Vector) -> Vector:
    """(5) + (7): kinetic energy of joint and load [J] at q [rad] and dq/dt [rad/s]."""
    return 0.5 * (load.inertia + load.inertia_cos * np.cos(angle)) * speed**2


def potential_energy(load: Load, angle: Vector) -> Vector:
    """(6) + (8): potential energy of joint and load [J] at q [rad], zero at q = 0."""
    return load.weight_cos * np.sin(angle) + 0.5 * load.weight_cos_2 * np.sin(2.0 * angle)


@dataclass(frozen=True)
class Strands:
    """Two sets of n strands across a rolling joint: kinematics (1), (2) and statics (10)."""

    count: int = 2
    """n, windings of a cable across the joint."""
    distance: float = 0.08
    """d, a strand's length at q = 0: the diameter of the rolling circles [m]; assumed."""
    width: float = 0.06
    """w, installation width of the pulleys [m]; assumed."""

    def lengths(self, angle: Vector) -> tuple[Vector, Vector]:
        """(2): l_up and l_down [m] of the whole sets at q [rad]."""
        change = self.width * np.sin(angle)
        return self.count * (self.distance - change), self.count * (self.distance + change)

    def angle(self, length_change: Vector) -> Vector:
        """(2), inverted: q = arcsin(delta l / (n w)) [rad], by which the upper set shortens [m]."""
        return np.arcsin(length_change / (self.count * self.width))

    def output(self, tension: float, stiffness: float, travel: float) -> tuple[float, float, float]:
        """(1): n T_in [N], n^2 K_cable [N/m] and dx_in / n [m] of the pulley blocks."""
        return self.count * tension, self.count**2 * stiffness, travel / self.count

    def torque(self, angle: Vector, upper: float, lower: float) -> Vector:
        """(10): tau_theta [N m] of the two sets' tensions T_out [N], sums over their strands.

        By virtual work tau dq = -T_up dl_up - T_down dl_down, with dl per strand from (2).
        """
        return self.width * np.cos(angle) * (upper - lower)
