"""The rolling joint: equations (1)-(10), as derived and as the source prints them.

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
"""Forms of (7), (9) and (10)."""

FORMS: Final[tuple[Form, ...]] = get_args(Form)


def _check(owner: str, form: Form, **lengths: float) -> None:
    if form not in FORMS:
        raise UsageError(f"{owner}.form must be one of {', '.join(FORMS)}, got {form!r}")
    for name, length in lengths.items():
        if not 0.0 < length < np.inf:
            raise UsageError(f"{owner}.{name} must be positive, got {length:g}")


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
        _check("RollingLoad", self.form, rolling_radius=self.rolling_radius)

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


@dataclass(frozen=True)
class RollingStrands:
    """Two sets of n strands across a rolling joint: kinematics (1), (2) and statics (10)."""

    strands: int = 2
    """n, windings of a cable across the joint."""
    distance: float = 0.08
    """d, a strand's length at q = 0: the diameter of the rolling circles [m]; assumed."""
    width: float = 0.06
    """w, installation width of the pulleys [m]; assumed."""
    form: Form = "corrected"
    """``corrected``, or ``published`` for (10) as printed."""

    def __post_init__(self) -> None:
        _check("RollingStrands", self.form, distance=self.distance, width=self.width)
        if self.strands < 1:
            raise UsageError(f"RollingStrands.strands must be at least 1, got {self.strands}")

    def lengths(self, angle: Array) -> tuple[Array, Array]:
        """(2): l_up and l_down [m] of the whole sets at q [rad]."""
        change = self.length_change(angle)
        neutral = self.strands * self.distance
        return neutral - change, neutral + change

    def length_change(self, angle: Array) -> Array:
        """(2): delta l = n w sin q [m], by which the upper set shortens and the lower lengthens."""
        return self.strands * self.width * np.sin(angle)

    def angle(self, length_change: Array) -> Array:
        """(2), inverted: q = arcsin(delta l / (n w)) [rad].

        Raises:
            UsageError: the change of length exceeds n w.
        """
        sine = np.asarray(length_change) / (self.strands * self.width)
        if not np.all(np.abs(sine) <= 1.0):
            most = self.strands * self.width
            raise UsageError(f"the change of length must be in [{-most:g}, {most:g}] m")
        return np.arcsin(sine)

    def output_travel(self, travel: Array) -> Array:
        """(1): dx_out = dx_in / n [m], travel of the pulley blocks per travel of the winch."""
        return np.asarray(travel) / self.strands

    def output_tension(self, tension: Array) -> Array:
        """(1): T_out = n T_in [N] without friction."""
        return self.strands * np.asarray(tension)

    def output_stiffness(self, stiffness: Array) -> Array:
        """(1): K_out = n^2 K_cable [N/m]."""
        return self.strands**2 * np.asarray(stiffness)

    def lever(self, angle: Array) -> Array:
        """Torque about q per newton of difference between the sets [m]: -dl_up/dq of one strand."""
        width = 0.5 * self.width if self.form == "published" else self.width
        return width * np.cos(angle)

    def torque(self, angle: Array, upper: Array, lower: Array) -> Array:
        """(10): tau_theta [N m] of the two sets' tensions T_out [N], sums over their strands.

        By virtual work tau dq = -T_up dl_up - T_down dl_down, with dl per strand from (2).
        """
        return self.lever(angle) * (np.asarray(upper) - np.asarray(lower))

    def tension_difference(self, angle: Array, torque: Array) -> Array:
        """(10), solved: T_up - T_down of the sets [N] that balances ``torque`` [N m] at q."""
        return np.asarray(torque) / self.lever(angle)
