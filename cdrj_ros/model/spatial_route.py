"""Geometry of one cable in space; see docs/geometry.md, section 3."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import stage
from cdrj_ros.model.records import Grid, Rows
from cdrj_ros.model.spatial_drums import moment_about_drum, turn_of_frame, wound_angle
from cdrj_ros.model.spatial_frames import point_velocity
from cdrj_ros.model.spatial_lengths import measure_cable
from cdrj_ros.model.spatial_middle import find_middle
from cdrj_ros.model.spatial_records import (
    POINT,
    PULLEY,
    SHEATH,
    ArcMiddle,
    SpatialNodeNumbers,
    SpatialNodePlan,
    SpatialPose,
    SpatialTwist,
    Touch,
)
from cdrj_ros.model.spatial_sweeps import find_path, place_nodes
from cdrj_ros.model.spatial_vectors import Vector3, dot, load, minus

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


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
def _lever_arm(
    plans: Rows[SpatialNodePlan],
    twists: Grid[SpatialTwist],
    touches: Rows[Touch],
    e: int,
    unit: Vector3,
    joint: int,
) -> float:
    """Lever arm of element e about a joint [m]: (E27).

    It is the velocity, along the cable and per unit of the joint's, of the point at which the cable
    arrives on a body, less that of the point at which it has left one.
    """
    left = plans[e].exit_frame if plans[e].kind == SHEATH else plans[e].frame
    arrives = point_velocity(twists[plans[e + 1].frame, joint], load(touches[e + 1].entry))
    leaves = point_velocity(twists[left, joint], load(touches[e].exit))
    return dot(unit, minus(arrives, leaves))


@stage
def route_in_space(
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    poses: Rows[SpatialPose],
    twists: Grid[SpatialTwist],
    joint_angle: Vector,
    touches: Rows[Touch],
    middles: Rows[ArcMiddle],
    length: Vector,
    lever_arm: Table,
    wrap: Vector,
    arc: Vector,
    direction: Table,
) -> bool:
    """Geometry of one cable of n nodes.

    Args:
        plans, nodes: every node, shape (n,).
        poses, twists: from ``place_spatial_frames``.
        joint_angle: [rad] or [m], shape (j,).
        touches: shape (n,), written; of the ends, ``wound`` is given.
        middles: shape (n,), written.
        length: geometric length of every element with its share of the arcs [m], (n - 1,), written.
        lever_arm: of every element about every joint [m], (n - 1, j), written.
        wrap: angle through which the cable turns at every node between the ends [rad], (n - 2,);
            given for sheaths, otherwise written.
        arc: length of cable on every node between the ends [m], (n - 2,), written.
        direction: unit vector of every element in the base, (n - 1, 3), written.

    Returns:
        False if the path is impossible: a tangent does not exist, a point lies inside a body, a
        wrap on a pulley is negative, or the path was not found.

    Takes 12 arguments because every part of the result is a view of a flat vector.
    """
    last = len(nodes) - 1
    size = place_nodes(plans, nodes, poses, touches)
    for k in (0, last):
        if plans[k].kind == PULLEY:
            touches[k].twisted = turn_of_frame(plans[k].frame, twists, touches[k], joint_angle)
    possible = find_path(plans, nodes, touches, size)
    possible &= measure_cable(plans, nodes, touches, length, wrap, direction)
    _add_wound(plans, nodes, touches, length)
    for k in range(1, last):
        arc[k - 1] = touches[k].arc
        find_middle(nodes[k], plans[k].kind, touches[k], middles[k])
    for k in (0, last):  # cable sticks to an end
        find_middle(nodes[k], POINT, touches[k], middles[k])
    for e in range(last):
        unit = (direction[e, 0], direction[e, 1], direction[e, 2])
        for j in range(joint_angle.size):
            lever_arm[e, j] = _lever_arm(plans, twists, touches, e, unit, j)
    for k, e in ((0, 0), (last, last - 1)):
        if plans[k].kind == PULLEY:
            unit = (direction[e, 0], direction[e, 1], direction[e, 2])
            touches[k].lever = moment_about_drum(nodes[k], touches[k], unit, k == 0)
    return possible
