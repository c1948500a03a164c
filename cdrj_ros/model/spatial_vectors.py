"""Operations on vectors of three numbers, kept as tuples, for the geometry in space."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import stage

Vector = NDArray[np.float64]
Vector3 = tuple[float, float, float]


@stage
def load(stored: Vector) -> Vector3:
    """The vector stored in a record."""
    return stored[0], stored[1], stored[2]


@stage
def store(stored: Vector, a: Vector3) -> None:
    """Store a vector in a record."""
    stored[0], stored[1], stored[2] = a[0], a[1], a[2]


@stage
def plus(a: Vector3, b: Vector3) -> Vector3:
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@stage
def minus(a: Vector3, b: Vector3) -> Vector3:
    """a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@stage
def scaled(s: float, a: Vector3) -> Vector3:
    """s a."""
    return s * a[0], s * a[1], s * a[2]


@stage
def combined(s: float, a: Vector3, t: float, b: Vector3) -> Vector3:
    """s a + t b."""
    return s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]


@stage
def dot(a: Vector3, b: Vector3) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@stage
def cross(a: Vector3, b: Vector3) -> Vector3:
    """Vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@stage
def norm(a: Vector3) -> float:
    """Length."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@stage
def rotated(rows: Vector, a: Vector3) -> Vector3:
    """R a, with R stored by rows."""
    return (
        rows[0] * a[0] + rows[1] * a[1] + rows[2] * a[2],
        rows[3] * a[0] + rows[4] * a[1] + rows[5] * a[2],
        rows[6] * a[0] + rows[7] * a[1] + rows[8] * a[2],
    )


@stage
def rotated_back(rows: Vector, a: Vector3) -> Vector3:
    """R^T a, with R stored by rows."""
    return (
        rows[0] * a[0] + rows[3] * a[1] + rows[6] * a[2],
        rows[1] * a[0] + rows[4] * a[1] + rows[7] * a[2],
        rows[2] * a[0] + rows[5] * a[1] + rows[8] * a[2],
    )


@stage
def about(axis: Vector3, cosine: float, sine: float, a: Vector3) -> Vector3:
    """``a`` turned about a unit vector (Rodrigues)."""
    along = (1.0 - cosine) * dot(axis, a)
    return plus(combined(cosine, a, sine, cross(axis, a)), scaled(along, axis))
