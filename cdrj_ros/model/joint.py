"""The rolling joint: equations (1)-(10).

Two equal circles of radius R roll on each other; the link's centre lies at 2R (cos q, sin q) and
the link turns by 2q.  The load sits L_d beyond it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RollingLoad:
    """Masses that a rolling joint carries in gravity."""

    joint_mass: float = 0.2
    """m_joint, at the link's centre [kg]."""
    load_mass: float = 0.3
    """m_load [kg]."""
    rolling_radius: float = 0.04
    """R [m]; not given in the source, assumed."""
    load_distance: float = 0.15
    """L_d from the link's centre to the load [m]; not given in the source, assumed."""
    gravity: float = 9.81
    """[m/s^2], against the direction of positive joint angle."""

    def torque(self, angle: Array, speed: Array, acceleration: Array) -> Array:
        """tau_theta of the corrected (9): what the cables must exert about the joint angle.

        Args:
            angle: q [rad].
            speed: dq/dt [rad/s].
            acceleration: d2q/dt2 [rad/s^2].

        Returns:
            Generalised torque [N m], same shape.  The printed (7) and (9) differ, see
            docs/paper_slips.md; this is the derivative of 2R (cos q, sin q) + L_d (cos 2q, sin 2q).
        """
        m_j, m_l = self.joint_mass, self.load_mass
        r, d, g = self.rolling_radius, self.load_distance, self.gravity
        inertia = 6 * m_j * r**2 + (4 * d**2 + 4 * r**2 + 8 * d * r * np.cos(angle)) * m_l
        centrifugal = -4 * d * r * np.sin(angle) * m_l
        weight = (
            2 * g * (m_j * r * np.cos(angle) + m_l * (r * np.cos(angle) + d * np.cos(2 * angle)))
        )
        return inertia * acceleration + centrifugal * speed**2 + weight
