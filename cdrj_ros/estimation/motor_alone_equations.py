"""Normal equations of the angles without encoder, and the step that solves them."""

from __future__ import annotations

from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.motor_alone_records import Unmeasured
from cdrj_ros.model.compiled import callee, stage

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

ITERATIONS: Final = 6
"""Most Gauss-Newton steps of a prediction or a correction."""

TOLERANCE: Final = 0.01
"""A Gauss-Newton step below this fraction of the difference step ends the iteration."""

LARGEST_STEP: Final = 150.0
"""Largest Gauss-Newton step, as a multiple of the difference step."""


@stage
def weigh(joints: Unmeasured, slope: Vector, difference: float, weight: float) -> None:
    """Add an equation, slope times change = difference, to the normal equations."""
    for a in range(slope.size):
        joints.right[a] += weight * slope[a] * difference
        for b in range(slope.size):
            joints.matrix[a, b] += weight * slope[a] * slope[b]


@callee
def invert(matrix: Table, inverse: Table) -> None:
    """Invert a symmetric positive definite matrix by Cholesky's method; ``matrix`` is destroyed."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                matrix[i, i] = sqrt(max(total, 1e-300))
            else:
                matrix[i, j] = total / matrix[j, j]
    for c in range(n):
        for i in range(n):
            total = 1.0 if i == c else 0.0
            for k in range(i):
                total -= matrix[i, k] * inverse[k, c]
            inverse[i, c] = total / matrix[i, i]
        for i in range(n - 1, -1, -1):
            total = inverse[i, c]
            for k in range(i + 1, n):
                total -= matrix[k, i] * inverse[k, c]
            inverse[i, c] = total / matrix[i, i]


@callee
def move(joints: Unmeasured) -> bool:
    """Move the angles by ``inverse`` times ``right``, within limits; True if they have arrived."""
    arrived = True
    for a in range(joints.joints.size):
        change = 0.0
        for b in range(joints.joints.size):
            change += joints.inverse[a, b] * joints.right[b]
        most = LARGEST_STEP * joints.step[a]
        change = min(max(change, -most), most)
        j = joints.joints[a]
        new = min(max(joints.angle[j] + change, joints.lower[a]), joints.upper[a])
        arrived &= abs(new - joints.angle[j]) <= TOLERANCE * joints.step[a]
        joints.angle[j] = new
    return arrived
