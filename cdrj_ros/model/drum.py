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
