"""Friction of a cable on a pulley: equations (29)-(43) of the source and the dynamic laws.

Notation: ``wrap_angle`` beta [rad], ``slip_speed`` v [m/s], ``transmission`` eta = T_hold / T_pull
in (0, 1], ``bound`` g [N] the largest difference T_pull - T_hold that friction can carry.
Equation numbers are those of docs/model.md, which keeps the numbering of the source.  The laws
are functions of the core (``core/friction.hpp``).
"""

from __future__ import annotations

from typing import Final, get_args

from cdrj_ros._core import (
    BOUND_FLOOR,
    MINIMUM_TRANSMISSION,
    bearing_transmission,
    blended_loss,
    capstan_transmission,
    cell_loss,
    friction_force,
    sliding_loss,
    sliding_transmission,
    stribeck_share,
)
from cdrj_ros.robot.description import LAWS, StribeckForm

__all__ = [
    "BOUND_FLOOR",
    "CAPSTAN",
    "ELASTOPLASTIC",
    "EULER",
    "LUGRE",
    "MINIMUM_TRANSMISSION",
    "NONE",
    "PRINTED",
    "RIGID_BRISTLE",
    "STEADY",
    "STRIBECK_FORMS",
    "bearing_transmission",
    "blended_loss",
    "capstan_transmission",
    "cell_loss",
    "friction_force",
    "sliding_loss",
    "sliding_transmission",
    "stribeck_share",
]

# The code of a law or a form is its place among the words of a robot file.
NONE, EULER, STEADY, LUGRE, ELASTOPLASTIC = range(len(LAWS))

STRIBECK_FORMS: Final[tuple[StribeckForm, ...]] = get_args(StribeckForm)
"""How static friction enters: (35) as printed, or the capstan equation with mu_s."""

PRINTED, CAPSTAN = range(len(STRIBECK_FORMS))

RIGID_BRISTLE: Final = 1e9
"""Contact stiffness [N/m] that stands for a rigid contact in the laws ``euler`` and ``steady``."""
