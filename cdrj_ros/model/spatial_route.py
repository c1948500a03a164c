"""Lengths, wraps and directions of one cable in space; see docs/geometry.md, section 3."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import callee, stage
from cdrj_ros.model.records import Grid, Rows
from cdrj_ros.model.spatial_derivatives import lengths_by, seen_by_end, start_by, sweep_by
from cdrj_ros.model.spatial_drums import turn_of_frame, wound_angle, wound_angle_by
from cdrj_ros.model.spatial_lengths import measure_cable
from cdrj_ros.model.spatial_records import (
    PULLEY,
    SpatialNodeNumbers,
    SpatialNodePlan,
    SpatialPose,
    SpatialTwist,
    Touch,
)
from cdrj_ros.model.spatial_sweeps import MOST_SWEEPS, SETTLED, find_path, place_nodes

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


@callee
def _derive(
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    twists: Grid[SpatialTwist],
    touches: Rows[Touch],
    direction: Table,
    joint: int,
    size: float,
) -> None:
    """Derivatives of the lengths by one joint, written to ``length_by`` of every node but the last.

    Args:
        plans, nodes, twists, touches, direction: as ``route_in_space``.
        joint: column of ``twists``; the last one is for drums that turn while all joints rest.
        size: of the cable [m].
    """
    start_by(plans, touches, twists, joint)
    for _ in range(MOST_SWEEPS):
        if not sweep_by(plans, nodes, touches, twists, joint) > SETTLED * max(size, 1.0):
            break
    lengths_by(touches, direction)
    last = len(nodes) - 1
    for k in (0, last):
        if plans[k].kind == PULLEY:
            seen = seen_by_end(plans[k].frame, touches, twists, k, joint)
            wound_by = wound_angle_by(touches[k], seen, k == 0)
            touches[min(k, last - 1)].length_by += nodes[k].reel * wound_by


@stage
def _add_wound(
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    touches: Rows[Touch],
    length: Vector,
) -> None:
    """Add the cable that has come onto the ends since the reference pose to the lengths: (G8)."""
    last = len(nodes) - 1
    for k in (0, last):
        if plans[k].kind == PULLEY:
            wound = wound_angle(nodes[k], touches[k], k == 0)
            length[min(k, last - 1)] += nodes[k].reel * wound


@stage
def route_in_space(
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
        touches: shape (n,), written; of the ends, ``wound`` is given.
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
    size = place_nodes(plans, nodes, poses, touches)
    for k in (0, last):
        if plans[k].kind == PULLEY:
            touches[k].twisted = turn_of_frame(plans[k].frame, twists, touches[k], joint_angle)
    possible = find_path(plans, nodes, touches, size)
    possible &= measure_cable(plans, nodes, touches, length, wrap, direction)
    _add_wound(plans, nodes, touches, length)
    for j in range(joint_angle.size):
        _derive(plans, nodes, twists, touches, direction, j, size)
        for e in range(last):
            length_by_joint[e, j] = touches[e].length_by
    if nodes[0].lead != 0.0:
        touches[0].winding = 1.0
        _derive(plans, nodes, twists, touches, direction, joint_angle.size, size)
        for e in range(last):
            touches[e].length_by_first = touches[e].length_by
        touches[0].winding = 0.0
    if nodes[last].lead != 0.0:
        touches[last].winding = 1.0
        _derive(plans, nodes, twists, touches, direction, joint_angle.size, size)
        for e in range(last):
            touches[e].length_by_last = touches[e].length_by
    return possible
