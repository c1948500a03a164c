"""The strands of a cable across a rolling joint: (1), (2) and (10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from examples.paper.joint import FORMS, Form

Array = NDArray[np.float64]


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
        if self.form not in FORMS:
            known = ", ".join(FORMS)
            raise UsageError(f"RollingStrands.form must be one of {known}, got {self.form!r}")
        for name, length in (("distance", self.distance), ("width", self.width)):
            if not 0.0 < length < np.inf:
                raise UsageError(f"RollingStrands.{name} must be positive, got {length:g}")
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
