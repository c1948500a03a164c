"""Friction of a cable on a pulley: equations (29)-(43) of the source and the dynamic laws.

Notation: ``wrap_angle`` beta [rad], ``slip_speed`` v [m/s], ``transmission`` eta = T_hold / T_pull
in (0, 1], ``bound`` g [N] the largest difference T_pull - T_hold that friction can carry.
Equation numbers are those of docs/model.md, which keeps the numbering of the source.  The laws
are functions of the core (``core/friction.hpp``, ``core/law_*.cpp``).
"""

from __future__ import annotations

from typing import Final

from cdrj_ros._core import (
    BOUND_FLOOR,
    MINIMUM_TRANSMISSION,
    Law,
    Stribeck,
    bearing_transmission,
    blended_loss,
    capstan_transmission,
    cell_loss,
    friction_force,
    sliding_loss,
    sliding_transmission,
    stribeck_share,
)

__all__ = [
    "BOUND_FLOOR",
    "MINIMUM_TRANSMISSION",
    "RIGID_BRISTLE",
    "Law",
    "Stribeck",
    "bearing_transmission",
    "blended_loss",
    "capstan_transmission",
    "cell_loss",
    "friction_force",
    "sliding_loss",
    "sliding_transmission",
    "stribeck_share",
]

RIGID_BRISTLE: Final = 1e9
"""Contact stiffness [N/m] that stands for a rigid contact in the laws ``euler`` and ``steady``."""
