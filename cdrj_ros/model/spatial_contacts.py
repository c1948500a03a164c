"""Points of contact and arc of a cable at one node, between given neighbouring points.

All vectors are in the node's own axes: z is the axis of a round body and the origin its centre.
``before`` is the point a from which the cable comes, ``after`` the point b to which it goes.
See docs/geometry.md, section 2.
"""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin, sqrt

from cdrj_ros.model.compiled import lean, stage
from cdrj_ros.model.spatial_inside import point_inside
from cdrj_ros.model.spatial_records import (
    CYLINDER,
    PULLEY,
    SPHERE,
    SWIVEL,
    SpatialNodeNumbers,
    Touch,
)
from cdrj_ros.model.spatial_tangents import (
    flat,
    tangent_normal,
    way_round,
)
from cdrj_ros.model.spatial_vectors import (
    Vector3,
    combined,
    cross,
    dot,
    load,
    minus,
    norm,
    scaled,
    store,
)

PARALLEL = 1e-12
"""Sine below which two directions count as parallel."""

Z: Vector3 = (0.0, 0.0, 1.0)


@stage
def _arc_angle(axis: Vector3, sense: float, first: Vector3, last: Vector3) -> float:
    """Angle in [0, 2 pi) from one normal to another; rounding below 0 counts as 0."""
    angle = sense * atan2(dot(axis, cross(first, last)), dot(first, last))
    if angle < -1e-9:
        angle += 2.0 * pi
    return max(angle, 0.0)


@stage
def _meet_circle(node: SpatialNodeNumbers, touch: Touch, a: Vector3, b: Vector3) -> bool:
    """Points of contact with a circle in the plane z = 0; False where a tangent does not exist."""
    radius, sense = node.radius, node.turn
    touch.sense = sense
    first, length_before = tangent_normal(flat(a), Z, radius, sense)
    last, length_after = tangent_normal(flat(b), Z, radius, -sense)
    store(touch.entry_normal, first)
    store(touch.exit_normal, last)
    touch.before_length, touch.after_length = length_before, length_after
    return length_before > 0.0 and length_after > 0.0


@stage
def _meet_swivel(node: SpatialNodeNumbers, touch: Touch, b: Vector3) -> bool:
    """Angle of the arc on a pulley whose plane contains its axis and the leaving cable: (G7)."""
    out = hypot(b[0], b[1])
    x, y = out - node.radius, b[2]
    square = x * x + y * y
    length = sqrt(max(square - node.radius * node.radius, 0.0))
    touch.angle = atan2(length * x + node.radius * y, length * y - node.radius * x)
    if touch.angle < 0.0:
        touch.angle += 2.0 * pi
    touch.after_length = length
    store(touch.exit_normal, (b[0] / out, b[1] / out, 0.0))  # direction of the pulley's plane
    return length > 0.0 and out > 0.0


@stage
def _meet_inside(
    node: SpatialNodeNumbers, touch: Touch, a: Vector3, b: Vector3, axis: Vector3
) -> bool:
    """The point at which a cable that runs through the inside of a body touches it: (G6)."""
    radius = node.radius
    touching, normal = point_inside(a, b, axis, radius)
    touch.touching = 1.0 if touching else 0.0
    touch.sense = 1.0
    store(touch.normal, axis)
    store(touch.entry_normal, normal)
    store(touch.exit_normal, normal)
    point = scaled(radius, normal)
    touch.before_length, touch.after_length = norm(minus(a, point)), norm(minus(b, point))
    return True


@stage
def _meet_body(node: SpatialNodeNumbers, kind: int, touch: Touch, a: Vector3, b: Vector3) -> bool:
    """Points of contact with a cylinder or a sphere, or none; False if that is impossible."""
    axis, side = Z, load(touch.side)
    if kind == SPHERE:
        axis = cross(a, b)
        size = norm(axis)
        if size > PARALLEL * norm(a) * norm(b):
            axis = scaled(1.0 / size, axis)
        else:  # a, b and the centre lie on one line: choose any plane through it
            axis = cross(a, (1.0, 0.0, 0.0) if abs(a[0]) < 0.5 * norm(a) else (0.0, 1.0, 0.0))
            axis = scaled(1.0 / norm(axis), axis)
        side = combined(1.0, side, -dot(side, axis), axis)
    else:
        a, b, side = flat(a), flat(b), flat(side)
    radius = node.radius
    if not (dot(a, a) > radius * radius and dot(b, b) > radius * radius):
        touch.touching = 0.0
        store(touch.entry_normal, Z)
        store(touch.exit_normal, Z)
        return node.ignored_inside == 1.0
    if node.inside == 1.0:
        return _meet_inside(node, touch, a, b, axis)
    touching, sense = way_round(a, b, axis, radius, node.turn, node.sided == 1.0, side)
    touch.touching = 1.0 if touching or node.turns > 0.0 else 0.0
    touch.sense = sense
    store(touch.normal, axis)
    first, touch.before_length = tangent_normal(a, axis, radius, sense)
    last, touch.after_length = tangent_normal(b, axis, radius, -sense)
    store(touch.entry_normal, first)
    store(touch.exit_normal, last)
    return True


@lean
def meet(node: SpatialNodeNumbers, kind: int, touch: Touch) -> tuple[bool, Vector3, Vector3]:
    """Find where a cable touches a node; ``before`` and ``after`` are given.

    Returns:
        Whether the contact is possible, and the first and last point of contact in the node's own
        axes.
    """
    a, b, radius = load(touch.before), load(touch.after), node.radius
    if kind == PULLEY:
        possible = _meet_circle(node, touch, a, b)
        first, last = load(touch.entry_normal), load(touch.exit_normal)
        return possible, scaled(radius, first), scaled(radius, last)
    if kind == SWIVEL:
        possible = _meet_swivel(node, touch, b)
        out = scaled(radius * (1.0 - cos(touch.angle)), load(touch.exit_normal))
        return possible, (0.0, 0.0, 0.0), (out[0], out[1], radius * sin(touch.angle))
    possible = _meet_body(node, kind, touch, a, b)
    first, last = load(touch.entry_normal), load(touch.exit_normal)
    entry, leave = scaled(radius, first), scaled(radius, last)
    if kind == CYLINDER:
        angle = 0.0
        if node.inside == 0.0:
            angle = _arc_angle(Z, touch.sense, first, last) + 2.0 * pi * node.turns
        rise = b[2] - a[2]
        whole = touch.before_length + radius * angle + touch.after_length
        entry = (entry[0], entry[1], a[2] + rise * touch.before_length / whole)
        leave = (leave[0], leave[1], b[2] - rise * touch.after_length / whole)
    return possible, entry, leave


@stage
def measure(node: SpatialNodeNumbers, kind: int, touch: Touch) -> None:
    """Angle, length and wrap of the arc from the points of contact: (G5) to (G7)."""
    radius = node.radius
    if kind == PULLEY:
        first, last = load(touch.entry_normal), load(touch.exit_normal)
        angle = node.turn * atan2(dot(Z, cross(first, last)), dot(first, last))
        middle = node.arc_reference
        touch.angle = middle + (angle - middle + pi) % (2.0 * pi) - pi
        touch.wrap, touch.arc = touch.angle, radius * touch.angle
    elif kind == SWIVEL:
        touch.wrap, touch.arc = touch.angle, radius * touch.angle
    else:
        axis = load(touch.normal)
        first, last = load(touch.entry_normal), load(touch.exit_normal)
        touch.angle = _arc_angle(axis, touch.sense, first, last) + 2.0 * pi * node.turns
        touch.wrap, touch.arc = touch.angle, radius * touch.angle
        if kind == CYLINDER:
            flat_length = touch.before_length + touch.arc + touch.after_length
            rise = touch.after[2] - touch.before[2]
            stretch = sqrt(1.0 + (rise / flat_length) ** 2)  # 1 / cos of the helix angle
            touch.wrap /= stretch
            touch.arc *= stretch
