"""Lengths, wraps and directions at given joint angles: planar tangents and arcs, and tables.

A cable is a path of directed circles: radius r and turn sigma = +1 where the cable goes round it
counter-clockwise on its way from the first node to the last, -1 clockwise.  Points are circles of
radius 0.  See docs/model.md, section 3.
"""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt
from typing import Final, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import lean
from cdrj_ros.model.records import Grid, Rows, record_type
from cdrj_ros.robot.description import FrameMotion

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

MOTIONS: Final[tuple[FrameMotion, ...]] = get_args(FrameMotion)
"""Types of a frame's motion relative to its parent, in the order of the codes."""

FIXED, REVOLUTE, PRISMATIC, ROLLING = range(len(MOTIONS))


class FramePlan:
    """Place of a frame in the tree of frames; parents come first."""

    parent: int
    """Index of the parent frame; -1 for the base."""
    motion: int
    """Code of the motion."""
    joint: int
    """Index of the joint that moves the frame; -1 for a fixed frame."""


class FrameNumbers:
    """Pose of a frame in its parent at joint angle 0."""

    x: float
    """Origin [m]."""
    y: float
    """Origin [m]."""
    angle: float
    """[rad]."""
    direction_x: float
    """Unit vector of a prismatic motion, in the frame [-]."""
    direction_y: float
    """Unit vector of a prismatic motion, in the frame [-]."""
    rolling_radius: float
    """Radius of both circles of a rolling joint [m]."""


class NodePlan:
    """Frame of a node."""

    frame: int
    """-1 where the node has no position."""


class NodeNumbers:
    """Circle of a node in its frame, and the reference of its arc."""

    x: float
    """Centre [m]."""
    y: float
    """Centre [m]."""
    radius: float
    """[m]."""
    turn: float
    """sigma: +1 counter-clockwise, -1 clockwise, 0 for a point."""
    arc_reference: float
    """For an end: direction of its element in the reference pose [rad]."""
    arc_angle: float
    """For a pulley: wrap in the reference pose [rad]; the wrap is continuous within half a turn of
    it.  For an end with a radius, which winds cable as its frame turns: angle of the frame in the
    reference pose [rad], with the sign that makes the arc 0 there."""


class Pose:
    """Pose of a frame in the base."""

    x: float
    """Origin [m]."""
    y: float
    """Origin [m]."""
    angle: float
    """[rad]."""


class Twist:
    """Velocity of a frame per unit of a joint's velocity."""

    turn: float
    """Angular velocity [-]."""
    x: float
    """Velocity of the base's origin, as if it moved with the frame [m]."""
    y: float
    """Velocity of the base's origin, as if it moved with the frame [m]."""


class Cubic:
    """c0 + c1 u + c2 u^2 + c3 u^3, u in [0, 1] over one interval of a table."""

    c0: float
    c1: float
    c2: float
    c3: float


FRAME_PLAN: Final = record_type(FramePlan)
FRAME: Final = record_type(FrameNumbers)
NODE_PLAN: Final = record_type(NodePlan)
NODE: Final = record_type(NodeNumbers)
POSE: Final = record_type(Pose)
TWIST: Final = record_type(Twist)
CUBIC: Final = record_type(Cubic)


@lean
def wrap_to_pi(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


@lean
def tangent(
    x1: float, y1: float, signed_radius1: float, x2: float, y2: float, signed_radius2: float
) -> tuple[float, float, float]:
    """(E4): directed common tangent of two circles given by centre [m] and turn * radius [m].

    Returns the length between the tangent points [m], NaN where no such line exists, its
    direction [rad], and the offset h = sigma2 r2 - sigma1 r1 [m].  With u at the angle
    phi + gamma, where phi is the direction of the line of centres: sin gamma = -h / D,
    length^2 = D^2 - h^2.
    """
    dx = x2 - x1
    dy = y2 - y1
    h = signed_radius2 - signed_radius1
    square = dx * dx + dy * dy - h * h
    if not square > 0.0:
        return np.nan, np.nan, h
    length = sqrt(square)
    return length, atan2(dy, dx) - atan2(h, length), h


@lean
def place_frames(
    plans: Rows[FramePlan],
    frames: Rows[FrameNumbers],
    joint_angle: Vector,
    pose: Rows[Pose],
    twist: Grid[Twist],
) -> None:
    """Pose of every frame in the base, and its velocity per joint.

    Args:
        plans, frames: every frame, parents first, shape (f,).
        joint_angle: [rad] or, for prismatic frames, [m], shape (j,).
        pose: shape (f,), written.
        twist: shape (f, j), written.

    A rolling frame follows two equal circles of radius R: its origin lies at
    2R (cos q, sin q), it turns by 2q, and its instant centre is the point of contact (eq. 5).
    """
    for f in range(len(frames)):
        frame, parent, joint = frames[f], plans[f].parent, plans[f].joint
        px, py, pa = 0.0, 0.0, 0.0
        if parent >= 0:
            px, py, pa = pose[parent].x, pose[parent].y, pose[parent].angle
        for j in range(joint_angle.size):
            moved = twist[f, j]
            if parent >= 0:
                carried = twist[parent, j]
                moved.turn, moved.x, moved.y = carried.turn, carried.x, carried.y
            else:
                moved.turn, moved.x, moved.y = 0.0, 0.0, 0.0
        c, s = cos(pa), sin(pa)
        ox = px + c * frame.x - s * frame.y
        oy = py + s * frame.x + c * frame.y
        angle = pa + frame.angle
        motion = plans[f].motion
        if motion == REVOLUTE:
            twist[f, joint].turn += 1.0
            twist[f, joint].x += oy
            twist[f, joint].y -= ox
            angle += joint_angle[joint]
        elif motion == PRISMATIC:
            c, s = cos(angle), sin(angle)
            dx = c * frame.direction_x - s * frame.direction_y
            dy = s * frame.direction_x + c * frame.direction_y
            twist[f, joint].x += dx
            twist[f, joint].y += dy
            ox += joint_angle[joint] * dx
            oy += joint_angle[joint] * dy
        elif motion == ROLLING:
            q = joint_angle[joint]
            radius = frame.rolling_radius
            c, s = cos(angle + q), sin(angle + q)
            twist[f, joint].turn += 2.0
            twist[f, joint].x += 2.0 * (oy + radius * s)
            twist[f, joint].y -= 2.0 * (ox + radius * c)
            ox += 2.0 * radius * c
            oy += 2.0 * radius * s
            angle += 2.0 * q
        pose[f].x, pose[f].y, pose[f].angle = ox, oy, angle


@lean
def node_centre(node: NodeNumbers, pose: Pose) -> tuple[float, float]:
    """Centre of a node in the base frame [m]; ``pose`` is that of its frame."""
    c, s = cos(pose.angle), sin(pose.angle)
    return pose.x + c * node.x - s * node.y, pose.y + s * node.x + c * node.y


@lean
def route(
    plans: Rows[NodePlan],
    nodes: Rows[NodeNumbers],
    pose: Rows[Pose],
    twist: Grid[Twist],
    length: Vector,
    lever_arm: Table,
    wrap: Vector,
    arc: Vector,
    middle: Vector,
    direction: Table,
) -> bool:
    """Geometry of one cable of n nodes: (E5)-(E7), (E26), (E27).

    Args:
        plans, nodes: every node, shape (n,).
        pose, twist: from ``place_frames``.
        length: geometric length of every element with its share of the arcs [m], (n - 1,), written.
        lever_arm: of every element about every joint [m], (n - 1, j), written.
        wrap: wrap angle of every pulley [rad], (n - 2,), written.
        arc: length of its arc [m], (n - 2,), written.
        middle: place of the middle of its arc on the pulley [m], (n - 2,), written.
        direction: unit vector of every element from its first to its last node, (n - 1, 3); x and y
            are written.

    Returns:
        False where a common tangent does not exist or a wrap is negative.

    Longer than a screen because an element's length and lever arms and the arc before it follow
    from the same tangent, which is computed once.
    """
    n = len(nodes)
    joints = lever_arm.shape[1]
    possible = True
    x1, y1 = node_centre(nodes[0], pose[plans[0].frame])
    angle_before = 0.0
    for e in range(n - 1):
        r1 = nodes[e].turn * nodes[e].radius
        r2 = nodes[e + 1].turn * nodes[e + 1].radius
        x2, y2 = node_centre(nodes[e + 1], pose[plans[e + 1].frame])
        f1, f2 = plans[e].frame, plans[e + 1].frame
        span, angle, _ = tangent(x1, y1, r1, x2, y2, r2)
        if not span > 0.0:
            possible = False
        direction[e, 0], direction[e, 1] = cos(angle), sin(angle)
        # half of the arc at a pulley; the whole arc at an end, which winds cable itself
        turn_at_start = 0.0
        if e == 0:
            turn_at_start = wrap_to_pi(angle - nodes[0].arc_reference)
            arcs = r1 * (nodes[0].arc_angle * nodes[0].turn + turn_at_start)
            arcs -= r1 * pose[f1].angle
        else:
            turn, radius, expected = nodes[e].turn, nodes[e].radius, nodes[e].arc_angle
            beta = expected + wrap_to_pi(turn * (angle - angle_before) - expected)
            if not beta >= 0.0:
                possible = False
            half = 0.5 * radius * beta
            wrap[e - 1], arc[e - 1] = beta, radius * beta
            middle[e - 1] = radius * (turn * (angle_before - pose[f1].angle)) + half
            length[e - 1] += half
            arcs = half
        if e == n - 2:
            arrival = wrap_to_pi(angle - nodes[n - 1].arc_reference)
            arcs += r2 * (nodes[n - 1].arc_angle * nodes[n - 1].turn - arrival)
            arcs += r2 * pose[f2].angle
        length[e] = span + arcs
        for j in range(joints):
            vx = twist[f2, j].x - twist[f2, j].turn * y2 - twist[f1, j].x + twist[f1, j].turn * y1
            vy = twist[f2, j].y + twist[f2, j].turn * x2 - twist[f1, j].y - twist[f1, j].turn * x1
            # relative velocity along the element of the bodies' surfaces where it leaves them
            arm = direction[e, 0] * vx + direction[e, 1] * vy
            lever_arm[e, j] = arm + r2 * twist[f2, j].turn - r1 * twist[f1, j].turn
        angle_before = angle
        x1, y1 = x2, y2
    return possible


@lean
def table_value(cubic: Cubic, share: float) -> tuple[float, float]:
    """Value of a cubic and its derivative by ``share``, the position u in the interval."""
    c1, c2, c3 = cubic.c1, cubic.c2, cubic.c3
    value = cubic.c0 + share * (c1 + share * (c2 + share * c3))
    return value, c1 + share * (2.0 * c2 + 3.0 * share * c3)


def hermite_table(values: Vector, slopes: Vector, step: float) -> Table:
    """Cubic coefficients of a function sampled with its slopes on a uniform grid.

    Args:
        values: shape (k + 1,).
        slopes: derivatives at the same points, shape (k + 1,).
        step: distance of the points.

    Returns:
        Coefficients of the powers of u in [0, 1], one row per interval, shape (k, 4).
    """
    y0, y1 = values[:-1], values[1:]
    d0, d1 = slopes[:-1] * step, slopes[1:] * step
    return np.stack([y0, d0, 3 * (y1 - y0) - 2 * d0 - d1, 2 * (y0 - y1) + d0 + d1], axis=1)
