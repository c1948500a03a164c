"""Figure 8 in numbers: eta_d of (37) and eta_r of (41), one parameter at a time."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import Stribeck, bearing_transmission, sliding_transmission

Vector = NDArray[np.float64]

CENTRE: Final = {
    "mu_c": 0.15,
    "mu_s": 0.20,
    "speed": 1.0,
    "f_d": 0.01,
    "bearing_mm": 10.0,
    "radius_mm": 11.0,
    "wrap_deg": 105.4,
}
"""Parameters that are not varied: Table II, pulley 3 of Table I, slip at the Stribeck speed."""

WRAPS_DEG: Final = (32.1, 105.4, 180.0)
"""Pulleys 4, 3 and 7 of Table I."""


@dataclass(frozen=True)
class Sensitivity:
    """One panel: a transmission over one parameter, a curve for each value of another."""

    transmission: str
    """``eta_d`` or ``eta_r``."""
    parameter: str
    """Key of ``CENTRE``; ``speed`` is v / v_s."""
    low: float
    high: float
    family: str
    """Key of ``CENTRE``."""
    values: tuple[float, ...]
    """Values of the family's parameter."""

    @property
    def grid(self) -> Vector:
        """Values of the parameter, shape (61,)."""
        return np.linspace(self.low, self.high, 61)

    def curve(self, value: float) -> Vector:
        """The transmission over ``grid`` for one value of the family, shape (61,)."""
        fixed = {**CENTRE, self.family: value}
        if self.parameter == "mu_c":  # static friction is not below kinetic friction
            fixed["mu_s"] = max(CENTRE["mu_s"], self.high)
        return np.array(
            [_transmission(self.transmission, {**fixed, self.parameter: x}) for x in self.grid]
        )


SENSITIVITIES: Final = (
    Sensitivity("eta_d", "mu_c", 0.1, 0.3, "wrap_deg", WRAPS_DEG),
    Sensitivity("eta_d", "mu_s", 0.2, 0.4, "wrap_deg", WRAPS_DEG),
    Sensitivity("eta_d", "wrap_deg", 0.0, 180.0, "mu_c", (0.10, 0.15, 0.20)),
    Sensitivity("eta_d", "speed", 0.0, 3.0, "wrap_deg", WRAPS_DEG),
    Sensitivity("eta_r", "f_d", 0.002, 0.05, "wrap_deg", WRAPS_DEG),
    Sensitivity("eta_r", "bearing_mm", 2.0, 10.0, "wrap_deg", WRAPS_DEG),
    Sensitivity("eta_r", "radius_mm", 4.0, 20.0, "wrap_deg", WRAPS_DEG),
    Sensitivity("eta_r", "wrap_deg", 0.0, 180.0, "f_d", (0.005, 0.01, 0.02)),
)
"""The panels of figure 8: ranges of mu_c and mu_s as in the source's text."""


def _transmission(name: str, p: dict[str, float]) -> float:
    wrap = radians(p["wrap_deg"])
    if name == "eta_r":
        return bearing_transmission(wrap, p["f_d"] * p["bearing_mm"] / p["radius_mm"])
    return sliding_transmission(p["speed"], p["mu_c"], p["mu_s"], 1.0, wrap, Stribeck.printed)
