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

from cdrj_ros.model.compiled import compiled

CAPACITY: Final = 64
"""Break points that a drum remembers."""

FIRST_SPACING: Final = 0.1
"""Distance of break points [rad] until the memory is full for the first time."""

MEMORY_SIZE: Final = 3 + 2 * CAPACITY
"""Floats of one drum: [points in use, spacing, unused-layer strain, angles..., material...]."""

_ANGLE: Final = 3
_MATERIAL: Final = 3 + CAPACITY


@compiled
def start_drum(memory: NDArray[np.float64], angle: float, material: float, rate: float) -> None:
    """Forget everything: below ``angle`` the drum holds ``rate`` [m/rad] of material throughout.

    Args:
        memory: the drum's state, shape (MEMORY_SIZE,), written.
        angle: wound angle, positive winding in [rad].
        material: unstretched material wound on since the reference [m].
        rate: unstretched material per radian of the layers below [m/rad].
    """
    memory[0] = 1.0
    memory[1] = FIRST_SPACING
    memory[2] = rate
    memory[_ANGLE] = angle
    memory[_MATERIAL] = material


@compiled
def material_held(memory: NDArray[np.float64]) -> float:
    """Unstretched material on the drum since the reference [m]."""
    return memory[_MATERIAL + int(memory[0]) - 1]


@compiled
def turn_drum(memory: NDArray[np.float64], angle: float, rate: float) -> float:
    """Turn the drum to a wound angle [rad]; returns the material on it [m].

    New layers go on at ``rate`` [m/rad], that is r_drum / (1 + t/EA) for the present tension;
    old ones come off at the rate at which they went on.
    """
    n = int(memory[0])
    top = n - 1
    if angle >= memory[_ANGLE + top]:
        material = memory[_MATERIAL + top] + rate * (angle - memory[_ANGLE + top])
        if top > 0 and angle - memory[_ANGLE + top - 1] <= memory[1]:
            memory[_ANGLE + top] = angle
            memory[_MATERIAL + top] = material
            return material
        if n == CAPACITY:
            n = _thin_out(memory)
        memory[_ANGLE + n] = angle
        memory[_MATERIAL + n] = material
        memory[0] = n + 1.0
        return material
    while top > 0 and angle <= memory[_ANGLE + top - 1]:
        top -= 1
    if top == 0:
        material = memory[_MATERIAL] + memory[2] * (angle - memory[_ANGLE])
    else:
        below = top - 1
        share = (angle - memory[_ANGLE + below]) / (memory[_ANGLE + top] - memory[_ANGLE + below])
        material = memory[_MATERIAL + below] + share * (
            memory[_MATERIAL + top] - memory[_MATERIAL + below]
        )
    memory[_ANGLE + top] = angle
    memory[_MATERIAL + top] = material
    memory[0] = top + 1.0
    return material


@compiled
def _thin_out(memory: NDArray[np.float64]) -> int:
    """Keep every other break point and the last one; returns how many are left."""
    n = int(memory[0])
    kept = 0
    for k in range(0, n - 1, 2):
        memory[_ANGLE + kept] = memory[_ANGLE + k]
        memory[_MATERIAL + kept] = memory[_MATERIAL + k]
        kept += 1
    memory[_ANGLE + kept] = memory[_ANGLE + n - 1]
    memory[_MATERIAL + kept] = memory[_MATERIAL + n - 1]
    memory[1] *= 2.0
    return kept + 1
