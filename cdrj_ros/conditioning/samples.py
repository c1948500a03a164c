"""Encoder readings of all motors and joints, brought to one time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class Sample(NamedTuple):
    """Encoder readings of all motors and joints at one time."""

    stamp_ns: int
    """Time since the clock's epoch [ns]."""
    motor_angle: Vector
    """[rad], shape (motors,), in the robot's order."""
    joint_angle: Vector
    """[rad], shape (joints,), in the robot's order."""


@dataclass(frozen=True)
class Samples:
    """Encoder readings over time."""

    stamp_ns: NDArray[np.int64]
    """Increasing [ns], shape (n,)."""
    motor_angle: NDArray[np.float64]
    """[rad], shape (n, motors)."""
    joint_angle: NDArray[np.float64]
    """[rad], shape (n, joints)."""
