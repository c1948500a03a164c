"""What a winch drum holds: cable comes off at the strain at which it went on.

The rate form ``ds = -r dphi / (1 + t/EA)`` forgets this.  Where winding and unwinding happen at
different tensions, as friction makes them, it feeds a little cable out in every cycle and the
preload decays to nothing.  A drum without slip is a stack: last on, first off.  It is kept here as
a piecewise linear map from the wound angle to the material on the drum.  docs/model.md, section 2.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import callee, lean
from cdrj_ros.model.records import record_type

Vector = NDArray[np.float64]

CAPACITY: Final = 64
"""Break points that a drum remembers."""

FIRST_SPACING: Final = 0.1
"""Distance of break points [rad] until the memory is full for the first time."""


class Drum:
    """Memory of one drum; see ``cdrj_ros.model.records``."""

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


DRUM: Final = record_type(Drum, angle=CAPACITY, material=CAPACITY)


@lean
def start_drum(drum: Drum, angle: float, material: float, rate: float) -> None:
    """Forget everything: below ``angle`` the drum holds ``rate`` [m/rad] of material throughout.

    Args:
        drum: the drum's memory, written.
        angle: wound angle, positive winding in [rad].
        material: unstretched material wound on since the reference [m].
        rate: unstretched material per radian of the layers below [m/rad].
    """
    drum.points = 1.0
    drum.spacing = FIRST_SPACING
    drum.rate_below = rate
    drum.angle[0] = angle
    drum.material[0] = material


@lean
def material_held(drum: Drum) -> float:
    """Unstretched material on the drum since the reference [m]."""
    return drum.material[int(drum.points) - 1]


@lean
def turn_drum(drum: Drum, angle: float, rate: float) -> float:
    """(E3): turn the drum to a wound angle [rad]; returns the material on it [m].

    New layers go on at ``rate`` [m/rad], that is r_drum / (1 + t/EA) for the present tension;
    old ones come off at the rate at which they went on.
    """
    n = int(drum.points)
    top = n - 1
    if angle >= drum.angle[top]:
        material = drum.material[top] + rate * (angle - drum.angle[top])
        if top > 0 and angle - drum.angle[top - 1] <= drum.spacing:
            drum.angle[top] = angle
            drum.material[top] = material
            return material
        if n == CAPACITY:
            n = _thin_out(drum)
        drum.angle[n] = angle
        drum.material[n] = material
        drum.points = n + 1.0
        return material
    while top > 0 and angle <= drum.angle[top - 1]:
        top -= 1
    if top == 0:
        material = drum.material[0] + drum.rate_below * (angle - drum.angle[0])
    else:
        below = top - 1
        share = (angle - drum.angle[below]) / (drum.angle[top] - drum.angle[below])
        material = drum.material[below] + share * (drum.material[top] - drum.material[below])
    drum.angle[top] = angle
    drum.material[top] = material
    drum.points = top + 1.0
    return material


@callee
def _thin_out(drum: Drum) -> int:
    """Keep every other break point and the last one; returns how many are left."""
    n = int(drum.points)
    kept = 0
    for k in range(0, n - 1, 2):
        drum.angle[kept] = drum.angle[k]
        drum.material[kept] = drum.material[k]
        kept += 1
    drum.angle[kept] = drum.angle[n - 1]
    drum.material[kept] = drum.material[n - 1]
    drum.spacing *= 2.0
    return kept + 1
