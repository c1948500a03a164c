"""Tangents of circles, and the side on which a cable passes one; docs/geometry.md, section 2."""

from __future__ import annotations

from math import sqrt

from cdrj_ros.model.compiled import stage
from cdrj_ros.model.spatial_vectors import (
    Vector3,
    combined,
    cross,
    dot,
    minus,
    norm,
    plus,
    scaled,
)


@stage
def flat(a: Vector3) -> Vector3:
    """Component of a vector normal to the axis z."""
    return a[0], a[1], 0.0


@stage
def tangent_normal(a: Vector3, axis: Vector3, radius: float, sense: float) -> tuple[Vector3, float]:
    """Unit normal where a line from ``a`` becomes tangent to a circle, and the line's length.

    ``a`` lies in the plane of the circle, whose centre is the origin: (G4).  With the opposite
    sense, the result is the normal where a line to ``a`` leaves the circle.
    """
    square = dot(a, a)
    length = sqrt(max(square - radius * radius, 0.0))
    normal = combined(radius / square, a, sense * length / square, cross(axis, a))
    return normal, length


@stage
def _lines_cross(a: Vector3, b: Vector3, c: Vector3, d: Vector3, axis: Vector3) -> bool:
    """Whether the segments a-b and c-d of a plane intersect."""
    ab, cd, ca = minus(b, a), minus(d, c), minus(a, c)
    determinant = dot(axis, cross(ab, cd))
    if abs(determinant) < 1e-15:
        return False
    first = dot(axis, cross(cd, ca)) / determinant
    second = dot(axis, cross(ab, ca)) / determinant
    return 0.0 <= first <= 1.0 and 0.0 <= second <= 1.0


@stage
def _goodness(
    a: Vector3, b: Vector3, axis: Vector3, radius: float, sense: float, side: Vector3
) -> float:
    """Cosine of the angle between one way's arc and the side point; -2 if its two lines cross."""
    first, _ = tangent_normal(a, axis, radius, sense)
    last, _ = tangent_normal(b, axis, radius, -sense)
    if _lines_cross(a, scaled(radius, first), b, scaled(radius, last), axis):
        return -2.0
    middle = plus(first, last)
    return dot(middle, side) / max(norm(middle) * norm(side), 1e-300)


@stage
def way_round(
    a: Vector3, b: Vector3, axis: Vector3, radius: float, turn: float, sided: bool, side: Vector3
) -> tuple[bool, float]:
    """Whether a cable from a to b, both in the plane of a circle, touches it, and in which sense.

    It touches if the straight line from a to b passes through the circle, or passes it on the side
    opposite to the one that ``turn`` or ``side`` demands.
    """
    way = minus(b, a)
    square = dot(way, way)
    share = min(max(-dot(way, a) / square, 0.0), 1.0) if square > 0.0 else 0.0
    nearest = combined(1.0, a, share, way)
    through = dot(nearest, nearest) <= radius * radius
    left = dot(axis, cross(a, b))  # positive: the centre lies to the left of the line
    if turn != 0.0:
        return through or turn * left < 0.0, turn
    if sided:
        if not (through or dot(side, nearest) < 0.0):
            return False, 1.0
        plus_side = _goodness(a, b, axis, radius, 1.0, side)
        minus_side = _goodness(a, b, axis, radius, -1.0, side)
        sense = 1.0 if plus_side > minus_side else -1.0
        return max(plus_side, minus_side) >= -1.0, sense
    return through, 1.0 if left >= 0.0 else -1.0
