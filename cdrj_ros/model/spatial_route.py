"""Lengths, wraps and directions of one cable in space; see docs/geometry.md, section 3.

The points of contact of neighbouring round bodies depend on each other.  Sweeps along the cable
recompute each node from the points of its neighbours until no point moves any more.  A point that
moves along a tangent does not move the tangent, so two circles in a plane converge quadratically.
The result depends on the pose alone, not on the samples before it.
"""

from __future__ import annotations

from math import atan2, pi
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import lean, stage
from cdrj_ros.model.records import Grid, Rows
from cdrj_ros.model.spatial_contacts import Z, measure, meet, meet_by
from cdrj_ros.model.spatial_frames import point_velocity
from cdrj_ros.model.spatial_records import (
    POINT,
    PULLEY,
    SHEATH,
    SpatialNodeNumbers,
    SpatialNodePlan,
    SpatialPose,
    SpatialTwist,
    Touch,
)
from cdrj_ros.model.spatial_vectors import (
    Vector3,
    cross,
    dot,
    load,
    minus,
    norm,
    plus,
    rotated,
    rotated_back,
    scaled,
    store,
)

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

MOST_SWEEPS = 200
"""Largest number of sweeps for a path, and for its derivatives by one joint."""

SETTLED = 4e-15
"""Motion of the points of contact, relative to the size of the cable, at which sweeps stop."""

ACCEPTED = 1e-12
"""Largest such motion in the last sweep; with a larger one the path counts as impossible."""

# Typed numbers: for them numba compiles a function once, for literals once per value.
FIRST: Final[Any] = np.int64(0)
NEXT: Final[Any] = np.int64(1)
PREVIOUS: Final[Any] = np.int64(-1)

LEAST_SHARE = 1e-3
"""Smallest distance of neighbouring nodes along a line that misses some, over its length [-]."""


@stage
def _place_nodes(
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    poses: Rows[SpatialPose],
    touches: Rows[Touch],
) -> float:
    """Place all nodes in the base, with contact at the centres; returns the cable's size [m]."""
    size = 0.0
    for k in range(len(nodes)):
        node, touch, pose = nodes[k], touches[k], poses[plans[k].frame]
        centre = plus(load(pose.origin), rotated(pose.rotation, load(node.centre)))
        store(touch.centre, centre)
        store(touch.entry, centre)
        store(touch.exit, centre)
        touch.touching, touch.angle, touch.wrap, touch.arc = 1.0, 0.0, 0.0, 0.0
        touch.arc_by, touch.share, touch.share_by = 0.0, 0.0, 0.0
        store(touch.normal, Z)
        if plans[k].kind == SHEATH:
            far = poses[plans[k].exit_frame]
            store(touch.exit, plus(load(far.origin), rotated(far.rotation, load(node.exit))))
            touch.arc = node.length
        elif plans[k].kind != POINT:
            for i in range(3):
                row = (node.basis[3 * i], node.basis[3 * i + 1], node.basis[3 * i + 2])
                turned = rotated(pose.rotation, row)
                for j in range(3):
                    touch.basis[3 * i + j] = turned[j]
        if k > 0:
            size += norm(minus(centre, load(touches[k - 1].centre))) + node.radius
    return size


@stage
def _neighbour(touches: Rows[Touch], k: int, step: int) -> int:
    """Index of the next node that the cable touches, in the direction of ``step``."""
    k += step
    while touches[k].touching == 0.0:
        k += step
    return k


@stage
def _sweep(
    plans: Rows[SpatialNodePlan], nodes: Rows[SpatialNodeNumbers], touches: Rows[Touch]
) -> tuple[bool, float]:
    """Compute every contact once; returns whether all are possible and the largest motion [m]."""
    possible = True
    moved = 0.0
    last = len(nodes) - 1
    for k in range(last + 1):
        kind = plans[k].kind
        if kind in (POINT, SHEATH):
            continue
        touch = touches[k]
        centre = load(touch.centre)
        came = load(touches[_neighbour(touches, k, PREVIOUS)].exit) if k > 0 else centre
        goes = load(touches[_neighbour(touches, k, NEXT)].entry) if k < last else came
        if k == 0:
            came = goes
        store(touch.before, rotated(touch.basis, minus(came, centre)))
        store(touch.after, rotated(touch.basis, minus(goes, centre)))
        was = touch.touching
        fits, entry, leave = meet(nodes[k], kind, touch)
        possible &= fits
        entry = plus(centre, rotated_back(touch.basis, entry))
        leave = plus(centre, rotated_back(touch.basis, leave))
        if touch.touching != was:
            moved = np.inf
        if touch.touching == 0.0:
            entry, leave = centre, centre
        moved = max(moved, norm(minus(entry, load(touch.entry))))
        moved = max(moved, norm(minus(leave, load(touch.exit))))
        store(touch.entry, entry)
        store(touch.exit, leave)
    return possible, moved


@stage
def _find_path(
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    touches: Rows[Touch],
    size: float,
) -> bool:
    """Find the points of contact of all nodes; False if a tangent does not exist."""
    coupled = False  # one sweep is exact if both neighbours of every round body are points
    for k in range(1, len(nodes)):
        coupled |= not (plans[k].kind in (POINT, SHEATH) or plans[k - 1].kind in (POINT, SHEATH))
    possible, moved = _sweep(plans, nodes, touches)
    if not coupled:
        return possible
    for _ in range(MOST_SWEEPS):
        if moved <= SETTLED * size:
            break
        possible, moved = _sweep(plans, nodes, touches)
    return possible and moved <= ACCEPTED * size


@stage
def _end_arc(node: SpatialNodeNumbers, touch: Touch, first: bool, twisted: float) -> float:
    """Cable that an end has paid out by turning, since the reference pose [m]: (G8).

    Args:
        node, touch: the end.
        first: whether it is the first node.
        twisted: turn of its frame about its axis [rad]; with it the result is continuous.
    """
    normal = touch.exit_normal if first else touch.entry_normal
    touch.angle = atan2(normal[1], normal[0])
    turned = (touch.angle + twisted - node.arc_reference + pi) % (2.0 * pi) - pi
    turned -= twisted - node.turn_reference
    return node.radius * node.turn * (turned if first else -turned)


@stage
def _twisted(frame: int, twists: Grid[SpatialTwist], touch: Touch, joint_angle: Vector) -> float:
    """Turn of a frame about an end's axis by all joints [rad]; exact for parallel axes."""
    axis = (touch.basis[6], touch.basis[7], touch.basis[8])
    turned = 0.0
    for j in range(joint_angle.size):
        turned += dot(axis, load(twists[frame, j].angular)) * joint_angle[j]
    return turned


@stage
def _line(touches: Rows[Touch], p: int, q: int) -> tuple[Vector3, float]:
    """Direction and length of the straight line from node p to node q."""
    way = minus(load(touches[q].entry), load(touches[p].exit))
    length = norm(way)
    return scaled(1.0 / length, way), length


@stage
def _share_line(touches: Rows[Touch], p: int, q: int) -> None:
    """Set positions along the line from p to q of the nodes between, which it misses: (G9)."""
    begin = load(touches[p].exit)
    way = minus(load(touches[q].entry), begin)
    least = 0.0
    for k in range(p + 1, q):
        share = dot(minus(load(touches[k].centre), begin), way) / dot(way, way)
        most = 1.0 - (q - k) * LEAST_SHARE
        least += LEAST_SHARE
        touches[k].share = min(max(share, least), most)
        least = touches[k].share


@stage
def _measure_cable(
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    touches: Rows[Touch],
    length: Vector,
    wrap: Vector,
    direction: Table,
) -> bool:
    """Compute lengths without the arcs of ends, wraps and directions; False if impossible."""
    possible = True
    last = len(nodes) - 1
    p = FIRST
    while p < last:
        q = _neighbour(touches, p, NEXT)
        unit, line = _line(touches, p, q)
        possible &= line > 0.0
        _share_line(touches, p, q)
        begin = 0.0
        for e in range(p, q):
            end = touches[e + 1].share if e + 1 < q else 1.0
            length[e] = (end - begin) * line
            direction[e, 0], direction[e, 1], direction[e, 2] = unit
            begin = end
        p = q
    for k in range(1, last):
        kind, touch = plans[k].kind, touches[k]
        if touch.touching == 0.0:
            wrap[k - 1] = 0.0
            continue
        if kind == POINT:
            u = (direction[k - 1, 0], direction[k - 1, 1], direction[k - 1, 2])
            v = (direction[k, 0], direction[k, 1], direction[k, 2])
            touch.wrap = atan2(norm(cross(u, v)), dot(u, v))
        elif kind == SHEATH:
            touch.wrap = wrap[k - 1]  # given by a constant and tables
        else:
            measure(nodes[k], kind, touch)
        wrap[k - 1] = touch.wrap
        possible &= touch.wrap >= 0.0
        length[k - 1] += 0.5 * touch.arc
        length[k] += 0.5 * touch.arc
    return possible


@stage
def _sweep_by(
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    touches: Rows[Touch],
    twists: Grid[SpatialTwist],
    joint: int,
) -> float:
    """Recompute the derivatives of all points of contact once; returns their largest change."""
    last = len(nodes) - 1
    changed = 0.0
    for k in range(last + 1):
        touch, kind = touches[k], plans[k].kind
        if kind in (POINT, SHEATH) or touch.touching == 0.0:
            continue
        twist = twists[plans[k].frame, joint]
        came = _neighbour(touches, k, PREVIOUS) if k > 0 else 1
        goes = _neighbour(touches, k, NEXT) if k < last else came
        a_by = _seen(touch, twist, load(touches[came].exit), load(touches[came].exit_by))
        b_by = _seen(touch, twist, load(touches[goes].entry), load(touches[goes].entry_by))
        if k == 0:
            a_by = b_by
        entry_by, exit_by = meet_by(nodes[k], kind, touch, a_by, b_by)
        entry_by = plus(
            point_velocity(twist, load(touch.entry)), rotated_back(touch.basis, entry_by)
        )
        exit_by = plus(point_velocity(twist, load(touch.exit)), rotated_back(touch.basis, exit_by))
        changed = max(changed, norm(minus(entry_by, load(touch.entry_by))))
        changed = max(changed, norm(minus(exit_by, load(touch.exit_by))))
        store(touch.entry_by, entry_by)
        store(touch.exit_by, exit_by)
    return changed


@stage
def _seen(touch: Touch, twist: SpatialTwist, point: Vector3, point_by: Vector3) -> Vector3:
    """Velocity of a point relative to a node, in the node's own axes."""
    return rotated(touch.basis, minus(point_by, point_velocity(twist, point)))


@stage
def _start_by(
    plans: Rows[SpatialNodePlan], touches: Rows[Touch], twists: Grid[SpatialTwist], joint: int
) -> None:
    """Start the derivatives of all points of contact as if they were fixed to their nodes."""
    for k in range(len(touches)):
        touch = touches[k]
        twist = twists[plans[k].frame, joint]
        store(touch.entry_by, point_velocity(twist, load(touch.entry)))
        if plans[k].kind == SHEATH:
            twist = twists[plans[k].exit_frame, joint]
        store(touch.exit_by, point_velocity(twist, load(touch.exit)))
        touch.arc_by = 0.0


@stage
def _line_by(touches: Rows[Touch], p: int, q: int, direction: Table) -> float:
    """Derivative of the length of the line from p to q; writes those of the nodes' shares."""
    unit = (direction[p, 0], direction[p, 1], direction[p, 2])
    begin, begin_by = load(touches[p].exit), load(touches[p].exit_by)
    way = minus(load(touches[q].entry), begin)
    way_by = minus(load(touches[q].entry_by), begin_by)
    square = dot(way, way)
    for k in range(p + 1, q):
        touch = touches[k]
        # a missed node is fixed to its frame: entry_by is the velocity of its centre
        from_begin = minus(load(touch.centre), begin)
        share = dot(from_begin, way) / square
        share_by = dot(minus(load(touch.entry_by), begin_by), way) + dot(from_begin, way_by)
        share_by = share_by / square - 2.0 * share * dot(way, way_by) / square
        touch.share_by = share_by if touch.share == share else 0.0
        if touch.share == touches[k - 1].share + LEAST_SHARE and k > p + 1:
            touch.share_by = touches[k - 1].share_by
    return dot(unit, way_by)


@stage
def _lengths_by(
    touches: Rows[Touch],
    direction: Table,
    length_by_joint: Table,
    joint: int,
) -> None:
    """Derivatives of the lengths of all elements by one joint, arcs included."""
    last = len(touches) - 1
    p = FIRST
    while p < last:
        q = _neighbour(touches, p, NEXT)
        line_by = _line_by(touches, p, q, direction)
        line = _line(touches, p, q)[1]
        begin, begin_by = 0.0, 0.0
        for e in range(p, q):
            inside = e + 1 < q
            end = touches[e + 1].share if inside else 1.0
            end_by = touches[e + 1].share_by if inside else 0.0
            length_by_joint[e, joint] = (end - begin) * line_by + (end_by - begin_by) * line
            begin, begin_by = end, end_by
        p = q
    for k in range(1, last):
        if touches[k].touching == 1.0:
            length_by_joint[k - 1, joint] += 0.5 * touches[k].arc_by
            length_by_joint[k, joint] += 0.5 * touches[k].arc_by


@stage
def _seen_by_end(
    frame: int, touches: Rows[Touch], twists: Grid[SpatialTwist], k: int, joint: int
) -> Vector3:
    """Velocity of the point to which the cable leads from an end, in the end's own axes."""
    other = touches[_neighbour(touches, k, NEXT if k == 0 else PREVIOUS)]
    twist = twists[frame, joint]
    if k == 0:
        return _seen(touches[k], twist, load(other.entry), load(other.entry_by))
    return _seen(touches[k], twist, load(other.exit), load(other.exit_by))


@stage
def _end_arc_by(node: SpatialNodeNumbers, touch: Touch, seen: Vector3, first: bool) -> float:
    """Derivative of ``_end_arc`` from the velocity ``seen`` of the far point."""
    normal = load(touch.exit_normal) if first else load(touch.entry_normal)
    span = touch.after_length if first else touch.before_length
    return -node.radius * dot(normal, seen) / span


@lean
def route_in_space(  # noqa: PLR0913, PLR0917
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    poses: Rows[SpatialPose],
    twists: Grid[SpatialTwist],
    joint_angle: Vector,
    touches: Rows[Touch],
    length: Vector,
    length_by_joint: Table,
    wrap: Vector,
    direction: Table,
) -> bool:
    """Lengths, wraps and directions of one cable of n nodes.

    Args:
        plans, nodes: every node, shape (n,).
        poses, twists: from ``place_spatial_frames``.
        joint_angle: [rad] or [m], shape (j,).
        touches: shape (n,), written.
        length: geometric length of every element with its share of the arcs [m], (n - 1,), written.
        length_by_joint: its derivative by every joint, (n - 1, j), written.
        wrap: angle through which the cable turns at every node between the ends [rad], (n - 2,);
            given for sheaths, otherwise written.
        direction: unit vector of every element in the base, (n - 1, 3), written.

    Returns:
        False if the path is impossible: a tangent does not exist, a point lies inside a body, a
        wrap on a pulley is negative, or the path was not found.

    Takes 10 arguments because every part of the result is a view of a flat vector.
    """
    last = len(nodes) - 1
    size = _place_nodes(plans, nodes, poses, touches)
    possible = _find_path(plans, nodes, touches, size)
    possible &= _measure_cable(plans, nodes, touches, length, wrap, direction)
    for k in (0, last):
        if plans[k].kind == PULLEY:
            twisted = _twisted(plans[k].frame, twists, touches[k], joint_angle)
            length[min(k, last - 1)] += _end_arc(nodes[k], touches[k], k == 0, twisted)
    for j in range(joint_angle.size):
        _start_by(plans, touches, twists, j)
        for _ in range(MOST_SWEEPS):
            if not _sweep_by(plans, nodes, touches, twists, j) > SETTLED * max(size, 1.0):
                break
        _lengths_by(touches, direction, length_by_joint, j)
        for k in (0, last):
            if plans[k].kind == PULLEY:
                seen = _seen_by_end(plans[k].frame, touches, twists, k, j)
                by = _end_arc_by(nodes[k], touches[k], seen, k == 0)
                length_by_joint[min(k, last - 1), j] += by
    return possible
