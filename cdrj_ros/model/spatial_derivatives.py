"""Derivatives of the lengths of one cable in space by one joint or by the turn of a drum.

They include the motion of the points of contact, swept as in ``spatial_sweeps``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import stage
from cdrj_ros.model.records import Grid, Rows
from cdrj_ros.model.spatial_contacts import meet_by
from cdrj_ros.model.spatial_drums import departure_by
from cdrj_ros.model.spatial_frames import point_velocity
from cdrj_ros.model.spatial_lengths import LEAST_SHARE, straight
from cdrj_ros.model.spatial_records import (
    POINT,
    SHEATH,
    SpatialNodeNumbers,
    SpatialNodePlan,
    SpatialTwist,
    Touch,
)
from cdrj_ros.model.spatial_sweeps import FIRST, NEXT, PREVIOUS, neighbour
from cdrj_ros.model.spatial_vectors import (
    Vector3,
    dot,
    load,
    minus,
    norm,
    plus,
    rotated,
    rotated_back,
    store,
)

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


@stage
def sweep_by(
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
        came = neighbour(touches, k, PREVIOUS) if k > 0 else 1
        goes = neighbour(touches, k, NEXT) if k < last else came
        a_by = _seen(touch, twist, load(touches[came].exit), load(touches[came].exit_by))
        b_by = _seen(touch, twist, load(touches[goes].entry), load(touches[goes].entry_by))
        if k == 0:
            a_by = b_by
        entry_by, exit_by = meet_by(nodes[k], kind, touch, a_by, b_by)
        if nodes[k].lead != 0.0:
            rise = departure_by(nodes[k], touch, b_by if k == 0 else a_by, k == 0)
            entry_by, exit_by = plus(entry_by, (0.0, 0.0, rise)), plus(exit_by, (0.0, 0.0, rise))
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
def start_by(
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
def lengths_by(touches: Rows[Touch], direction: Table) -> None:
    """Derivatives of the lengths of all elements, arcs included; written to their first nodes."""
    last = len(touches) - 1
    p = FIRST
    while p < last:
        q = neighbour(touches, p, NEXT)
        line_by = _line_by(touches, p, q, direction)
        line = straight(touches, p, q)[1]
        begin, begin_by = 0.0, 0.0
        for e in range(p, q):
            inside = e + 1 < q
            end = touches[e + 1].share if inside else 1.0
            end_by = touches[e + 1].share_by if inside else 0.0
            touches[e].length_by = (end - begin) * line_by + (end_by - begin_by) * line
            begin, begin_by = end, end_by
        p = q
    for k in range(1, last):
        if touches[k].touching == 1.0:
            touches[k - 1].length_by += 0.5 * touches[k].arc_by
            touches[k].length_by += 0.5 * touches[k].arc_by


@stage
def seen_by_end(
    frame: int, touches: Rows[Touch], twists: Grid[SpatialTwist], k: int, joint: int
) -> Vector3:
    """Velocity of the point to which the cable leads from an end, in the end's own axes."""
    other = touches[neighbour(touches, k, NEXT if k == 0 else PREVIOUS)]
    twist = twists[frame, joint]
    if k == 0:
        return _seen(touches[k], twist, load(other.entry), load(other.entry_by))
    return _seen(touches[k], twist, load(other.exit), load(other.exit_by))
