"""The load of a rolling joint: equations (4)-(9), as derived and as the source prints them.

Two equal circles of radius R roll on each other; the link's centre lies at 2R (cos q, sin q) and
the link turns by 2q.  The load sits L_d beyond it, at 2R (cos q, sin q) + L_d (cos 2q, sin 2q).

The printed equations differ from these (examples/paper/slips.md).  ``form`` selects ``corrected``,
or ``published``, which reproduces the source's curves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError

Array = NDArray[np.float64]

Form = Literal["corrected", "published"]
"""Forms of (7) and (9)."""

FORMS: Final[tuple[Form, ...]] = get_args(Form)


@dataclass(frozen=True)
class RollingLoad:
    """Masses carried by a rolling joint under gravity; angles, speeds and torques are arrays."""

    joint_mass: float = 0.2
    """m_joint, a disc of radius R at the link's centre [kg]."""
    load_mass: float = 0.3
    """m_load, a point [kg]."""
    rolling_radius: float = 0.04
    """R [m]; not given in the source, assumed."""
    load_distance: float = 0.15
    """L_d from the link's centre to the load [m]; not given in the source, assumed."""
    gravity: float = 9.81
    """[m/s^2], acting against positive joint angles."""
    form: Form = "corrected"
    """``corrected``, or ``published`` for (7) and (9) as printed."""

    def __post_init__(self) -> None:
        if self.form not in FORMS:
            known = ", ".join(FORMS)
            raise UsageError(f"RollingLoad.form must be one of {known}, got {self.form!r}")
        if not 0.0 < self.rolling_radius < np.inf:
            raise UsageError(
                f"RollingLoad.rolling_radius must be positive, got {self.rolling_radius:g}"
            )

    def kinetic_energy(self, angle: Array, speed: Array) -> Array:
        """(5) + (7): kinetic energy of joint and load [J] at q [rad] and dq/dt [rad/s]."""
        return 0.5 * self.inertia(angle) * speed**2

    def potential_energy(self, angle: Array) -> Array:
        """(6) + (8): potential energy of joint and load [J] at q [rad], zero at q = 0."""
        arm, reach = 2.0 * self.rolling_radius, self.load_distance
        joint = self.joint_mass * arm * np.sin(angle)
        load = self.load_mass * (arm * np.sin(angle) + reach * np.sin(2.0 * angle))
        return self.gravity * (joint + load)

    def inertia(self, angle: Array) -> Array:
        """D(q) of (4) [kg m^2]: the factor of q'' in (9), twice that of q'^2 in (5) + (7)."""
        r, d = self.rolling_radius, self.load_distance
        along, across = self._load_terms()
        load = along * d**2 + 2.0 * r**2 + across * d * r * np.cos(angle)
        return 6.0 * self.joint_mass * r**2 + 2.0 * load * self.load_mass

    def centrifugal_torque(self, angle: Array, speed: Array) -> Array:
        """C(q, q') of (4) [N m]: D'(q) q'^2 / 2."""
        _, across = self._load_terms()
        lever = across * self.load_distance * self.rolling_radius * self.load_mass
        return -lever * np.sin(angle) * speed**2

    def weight_torque(self, angle: Array) -> Array:
        """G(q) of (4) [N m]: derivative of the potential energy by q."""
        r, d = self.rolling_radius, self.load_distance
        joint = self.joint_mass * r * np.cos(angle)
        load = self.load_mass * (r * np.cos(angle) + d * np.cos(2.0 * angle))
        return 2.0 * self.gravity * (joint + load)

    def torque(self, angle: Array, speed: Array, acceleration: Array) -> Array:
        """(4) as (9), inverse dynamics: tau_theta [N m] that the cables must exert about the angle.

        Args:
            angle: q [rad].
            speed: dq/dt [rad/s].
            acceleration: d2q/dt2 [rad/s^2].

        Returns:
            Generalised torque [N m], same shape.
        """
        carried = self.centrifugal_torque(angle, speed) + self.weight_torque(angle)
        return self.inertia(angle) * acceleration + carried

    def acceleration(self, angle: Array, speed: Array, torque: Array) -> Array:
        """(9) solved for q'' [rad/s^2], forward dynamics under ``torque`` [N m]."""
        carried = self.centrifugal_torque(angle, speed) + self.weight_torque(angle)
        return (torque - carried) / self.inertia(angle)

    def _load_terms(self) -> tuple[float, float]:
        """Factors of L_d^2 and L_d R cos q in (7)."""
        return (2.5, 2.0) if self.form == "published" else (2.0, 4.0)
