"""Middle of a cable's arc on a body in space, and how far it moves along the body: (E26).

All vectors are in the body's own axes, so that a body that carries guide and cable along changes
nothing.  See docs/geometry.md, section 4.
"""

from __future__ import annotations

from math import asin, cos, sin, sqrt

from cdrj_ros.model.compiled import stage
from cdrj_ros.model.spatial_records import (
    CYLINDER,
    POINT,
    SHEATH,
    SPHERE,
    SWIVEL,
    ArcMiddle,
    SpatialNodeNumbers,
    Touch,
)
from cdrj_ros.model.spatial_vectors import (
    Vector3,
    about,
    combined,
    cross,
    dot,
    load,
    minus,
    norm,
    plus,
    scaled,
    store,
)

Z: Vector3 = (0.0, 0.0, 1.0)

SMALL_CHORD = 1e-4
"""Chord of the unit circle below which two terms of a series give the arc to rounding."""


@stage
def _through_ring(node: SpatialNodeNumbers, touch: Touch, height: float) -> Vector3:
    """Mean of a cable's directions before and after the point at which it bends over a ring.

    It is shorter than 1: where the point moves on the ring by x, the cable before it grows by the
    component of x along its direction, which is the same as that along the direction after it.
    """
    point = scaled(node.radius, load(touch.entry_normal))
    point = (point[0], point[1], point[2] + height)
    came, goes = minus(point, load(touch.before)), minus(load(touch.after), point)
    return combined(0.5 / norm(came), came, 0.5 / norm(goes), goes)


@stage
def find_middle(node: SpatialNodeNumbers, kind: int, touch: Touch, middle: ArcMiddle) -> None:
    """Write the middle of the arc of a node from its points of contact.

    The middle of an eyelet and of a sheath is a point of the body: it never moves.
    """
    normal, tangent, height = Z, Z, 0.0
    half = 0.5 * touch.angle
    if touch.touching == 0.0:
        tangent = (0.0, 0.0, 0.0)
    elif kind == SWIVEL:  # in the plane of the pulley, which swivels with it
        normal, tangent = (-cos(half), sin(half), 0.0), (sin(half), cos(half), 0.0)
    elif kind not in (POINT, SHEATH):
        axis = load(touch.normal) if kind == SPHERE else Z
        if kind == CYLINDER:
            ends = plus(load(touch.entry), load(touch.exit))
            rise = combined(0.5, ends, -1.0, load(touch.centre))
            height = dot((touch.basis[6], touch.basis[7], touch.basis[8]), rise)
        if node.inside == 1.0:
            normal = load(touch.entry_normal)
            tangent = _through_ring(node, touch, height)
        else:
            turned = touch.sense * half
            normal = about(axis, cos(turned), sin(turned), load(touch.entry_normal))
            tangent = scaled(touch.sense, cross(axis, normal))
            if kind == CYLINDER:  # a helix, straight on the unrolled surface
                flat = touch.before_length + node.radius * touch.angle + touch.after_length
                slope = (touch.after[2] - touch.before[2]) / flat
                stretch = sqrt(1.0 + slope * slope)
                tangent = scaled(1.0 / stretch, (tangent[0], tangent[1], slope))
    store(middle.normal, normal)
    store(middle.tangent, tangent)
    middle.height = height


@stage
def clear_middle(middle: ArcMiddle) -> None:
    """Write the middle of a node that has no position."""
    store(middle.normal, (0.0, 0.0, 0.0))
    store(middle.tangent, (0.0, 0.0, 0.0))
    middle.height = 0.0


@stage
def motion_along(radius: float, before: ArcMiddle, now: ArcMiddle) -> float:
    """Motion of the middle of an arc on its body along the cable [m], towards the last node: (E26).

    It is exact on a circle and on a great circle, exact to fourth order of the step on a helix of
    constant slope, and to second order where slope or plane change.  It is 0 where the cable did
    not touch the body in both samples.
    """
    first, last = load(before.tangent), load(now.tangent)
    along = plus(first, last)
    size = norm(along)
    if size == 0.0 or dot(first, first) == 0.0 or dot(last, last) == 0.0:
        return 0.0
    way = minus(load(now.normal), load(before.normal))
    chord = norm(way)
    stretch = 1.0 + chord * chord / 24.0  # arc over chord
    if chord > SMALL_CHORD:
        stretch = 2.0 * asin(min(0.5 * chord, 1.0)) / chord
    moved = radius * stretch * dot(way, along) + (now.height - before.height) * along[2]
    return moved * (0.5 * (norm(first) + norm(last)) / size)
