"""The point at which a cable that runs through the inside of a ring touches it.

The ring is a circle in the plane of its centre and of the points a and b, both outside.  If the
straight line from a to b passes through the circle, the cable runs free.  Otherwise it is drawn
to the near side of the circle, to the point at which both of its parts make the same angle with the
radius; there the path is shortest.  These are the rules of MuJoCo's tendons; docs/geometry.md,
section 2, (G6).
"""

from __future__ import annotations

from math import acos, atan2, cos, hypot, sin

from cdrj_ros.model.compiled import stage
from cdrj_ros.model.spatial_vectors import (
    Vector3,
    combined,
    cross,
    dot,
    minus,
    norm,
)

MOST_STEPS = 100
"""Largest number of Newton or bisection steps for the angle of the point."""


@stage
def _slope(distance: float, radius: float, angle: float) -> tuple[float, float]:
    """Change of the distance from a point to the circle per angle [m/rad], and its derivative.

    Args:
        distance: of the point from the centre [m].
        radius: of the circle [m].
        angle: between the radius to the point on the circle and the line to the point [rad].
    """
    way = hypot(distance - radius * cos(angle), radius * sin(angle))
    slope = radius * distance * sin(angle) / way
    return slope, (radius * distance * cos(angle) - slope * slope) / way


@stage
def point_inside(a: Vector3, b: Vector3, axis: Vector3, radius: float) -> tuple[bool, Vector3]:
    """Whether a cable from a to b touches the inside of a circle, and the unit vector to the point.

    Args:
        a, b: points outside the circle, in its plane; the origin is its centre.
        axis: unit normal of the plane.
        radius: of the circle [m].
    """
    way = minus(b, a)
    square = dot(way, way)
    share = -dot(way, a) / square if square > 0.0 else 0.0
    nearest = combined(1.0, a, share, way)
    free = 0.0 < share < 1.0 and dot(nearest, nearest) <= radius * radius
    from_a, from_b = norm(a), norm(b)
    whole = atan2(dot(axis, cross(a, b)), dot(a, b))
    sense = 1.0 if whole >= 0.0 else -1.0
    whole = abs(whole)
    # the point is seen from a and from b: between these angles the slope increases
    low = max(0.0, whole - acos(min(radius / from_b, 1.0)))
    high = min(whole, acos(min(radius / from_a, 1.0)))
    angle = 0.5 * (low + high)
    for _ in range(MOST_STEPS):
        slope_a, curve_a = _slope(from_a, radius, angle)
        slope_b, curve_b = _slope(from_b, radius, whole - angle)
        slope, curve = slope_a - slope_b, curve_a + curve_b
        if slope > 0.0:
            high = angle
        else:
            low = angle
        step = angle - slope / curve if curve > 0.0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - angle) <= 1e-16:
            break
        angle = step
    c, s = cos(sense * angle) / from_a, sin(sense * angle) / from_a
    return not free, combined(c, a, s, cross(axis, a))
