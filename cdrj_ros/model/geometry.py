"""From joint angles to lengths, wraps and directions: planar tangents and arcs, and tables.

A cable is a path of directed circles: radius r and turn sigma = +1 where the cable goes round it
counter-clockwise on its way from the first node to the last, -1 clockwise.  Points are circles of
radius 0.  docs/model.md, section 3.
"""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import compiled

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Indices = NDArray[np.int64]

MOTIONS: Final = ("fixed", "revolute", "prismatic", "rolling")
"""How a frame moves in its parent, in the order of the codes."""

FIXED, REVOLUTE, PRISMATIC, ROLLING = range(len(MOTIONS))

# Integer columns of a frame and of a node, then their real columns.
PARENT, MOTION, JOINT, FRAME_INDICES = range(4)
ORIGIN_X, ORIGIN_Y, ANGLE, DIRECTION_X, DIRECTION_Y, ROLLING_RADIUS, FRAME_NUMBERS = range(7)
FRAME, NODE_INDICES = range(2)
X, Y, NODE_RADIUS, TURN, ARC_REFERENCE, ARC_ANGLE, NODE_NUMBERS = range(7)
POSE_X, POSE_Y, POSE_ANGLE, POSE_NUMBERS = range(4)


@compiled
def wrap_to_pi(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


@compiled
def tangent(
    x1: float, y1: float, signed_radius1: float, x2: float, y2: float, signed_radius2: float
) -> tuple[float, float, float]:
    """Directed common tangent of two circles given by centre [m] and turn * radius [m].

    Returns the length between the tangent points [m], NaN where no such line exists, its
    direction [rad], and the offset h = sigma2 r2 - sigma1 r1 [m].  With u at the angle
    phi + gamma, phi the direction of the centres: sin gamma = -h / D, length^2 = D^2 - h^2.
    """
    dx = x2 - x1
    dy = y2 - y1
    h = signed_radius2 - signed_radius1
    square = dx * dx + dy * dy - h * h
    if not square > 0.0:
        return np.nan, np.nan, h
    length = sqrt(square)
    return length, atan2(dy, dx) - atan2(h, length), h


@compiled
def place_frames(
    frame_indices: Indices,
    frame_numbers: Table,
    joint_angle: Vector,
    pose: Table,
    twist: NDArray[np.float64],
) -> None:
    """Pose of every frame in the base, and its velocity per joint.

    Args:
        frame_indices: [PARENT, MOTION, JOINT] of every frame, parents first, shape (f, 3).
        frame_numbers: origin in the parent [m], angle [rad], direction, rolling radius, (f, 6).
        joint_angle: [rad] or, for prismatic frames, [m], shape (j,).
        pose: x, y [m] and angle [rad], shape (f, 3), written.
        twist: angular velocity and velocity of the base's origin, as if it moved with the frame,
            per unit of joint velocity, shape (f, j, 3), written.

    A rolling frame follows two equal circles of radius R: its origin lies at
    2R (cos q, sin q), it turns by 2q, and its instant centre is the point of contact (eq. 5).
    """
    for f in range(pose.shape[0]):
        parent = frame_indices[f, PARENT]
        px, py, pa = 0.0, 0.0, 0.0
        if parent >= 0:
            px, py, pa = pose[parent, POSE_X], pose[parent, POSE_Y], pose[parent, POSE_ANGLE]
            twist[f] = twist[parent]
        else:
            twist[f] = 0.0
        c, s = cos(pa), sin(pa)
        ox = px + c * frame_numbers[f, ORIGIN_X] - s * frame_numbers[f, ORIGIN_Y]
        oy = py + s * frame_numbers[f, ORIGIN_X] + c * frame_numbers[f, ORIGIN_Y]
        angle = pa + frame_numbers[f, ANGLE]
        motion = frame_indices[f, MOTION]
        joint = frame_indices[f, JOINT]
        if motion == REVOLUTE:
            twist[f, joint, 0] += 1.0
            twist[f, joint, 1] += oy
            twist[f, joint, 2] -= ox
            angle += joint_angle[joint]
        elif motion == PRISMATIC:
            c, s = cos(angle), sin(angle)
            dx = c * frame_numbers[f, DIRECTION_X] - s * frame_numbers[f, DIRECTION_Y]
            dy = s * frame_numbers[f, DIRECTION_X] + c * frame_numbers[f, DIRECTION_Y]
            twist[f, joint, 1] += dx
            twist[f, joint, 2] += dy
            ox += joint_angle[joint] * dx
            oy += joint_angle[joint] * dy
        elif motion == ROLLING:
            q = joint_angle[joint]
            radius = frame_numbers[f, ROLLING_RADIUS]
            c, s = cos(angle + q), sin(angle + q)
            twist[f, joint, 0] += 2.0
            twist[f, joint, 1] += 2.0 * (oy + radius * s)
            twist[f, joint, 2] -= 2.0 * (ox + radius * c)
            ox += 2.0 * radius * c
            oy += 2.0 * radius * s
            angle += 2.0 * q
        pose[f, POSE_X] = ox
        pose[f, POSE_Y] = oy
        pose[f, POSE_ANGLE] = angle


@compiled
def node_centre(node_numbers: Vector, frame_pose: Vector) -> tuple[float, float]:
    """Centre of a node in the base frame [m]."""
    c, s = cos(frame_pose[POSE_ANGLE]), sin(frame_pose[POSE_ANGLE])
    return (
        frame_pose[POSE_X] + c * node_numbers[X] - s * node_numbers[Y],
        frame_pose[POSE_Y] + s * node_numbers[X] + c * node_numbers[Y],
    )


@compiled
def route(
    node_indices: Indices,
    node_numbers: Table,
    pose: Table,
    twist: NDArray[np.float64],
    length: Vector,
    length_by_joint: Table,
    wrap: Vector,
    direction: Table,
) -> bool:
    """Lengths, wraps and directions of one cable of n nodes.

    Args:
        node_indices: frame of every node, shape (n, 1).
        node_numbers: position in its frame [m], radius [m], turn (+1, -1, 0), ARC_REFERENCE and
            ARC_ANGLE [rad]; shape (n, 6).  For a pulley ARC_ANGLE is the wrap in the reference
            pose, about which the wrap is continuous within half a turn.  An end with a radius
            winds cable as its frame turns: ARC_REFERENCE is its element's direction in the
            reference pose and ARC_ANGLE its arc there, less the turn of its frame.
        pose, twist: from ``place_frames``.
        length: geometric length of every element with its share of the arcs [m], (n - 1,), written.
        length_by_joint: its derivative by every joint, (n - 1, j), written.
        wrap: wrap angle of every pulley [rad], (n - 2,), written.
        direction: unit vector of every element from its first to its last node, (n - 1, 2),
            written.

    Returns:
        False where a common tangent does not exist or a wrap is negative.
    """
    n = node_numbers.shape[0]
    joints = length_by_joint.shape[1]
    possible = True
    length_by_joint[:] = 0.0
    x1, y1 = node_centre(node_numbers[0], pose[node_indices[0, FRAME]])
    angle_before = 0.0
    for e in range(n - 1):
        r1 = node_numbers[e, TURN] * node_numbers[e, NODE_RADIUS]
        r2 = node_numbers[e + 1, TURN] * node_numbers[e + 1, NODE_RADIUS]
        x2, y2 = node_centre(node_numbers[e + 1], pose[node_indices[e + 1, FRAME]])
        span, angle, h = tangent(x1, y1, r1, x2, y2, r2)
        if not span > 0.0:
            possible = False
        dx, dy = x2 - x1, y2 - y1
        square = dx * dx + dy * dy
        direction[e, 0], direction[e, 1] = cos(angle), sin(angle)
        # half of the arcs at both ends; the whole arc at an end that winds cable itself
        turn_at_start = 0.0
        if e == 0:
            turn_at_start = wrap_to_pi(angle - node_numbers[0, ARC_REFERENCE])
            arcs = r1 * (node_numbers[0, ARC_ANGLE] * node_numbers[0, TURN] + turn_at_start)
            arcs -= r1 * pose[node_indices[0, FRAME], POSE_ANGLE]
        else:
            middle = node_numbers[e, ARC_ANGLE]
            wrap[e - 1] = middle + wrap_to_pi(
                node_numbers[e, TURN] * (angle - angle_before) - middle
            )
            if not wrap[e - 1] >= 0.0:
                possible = False
            half = 0.5 * node_numbers[e, NODE_RADIUS] * wrap[e - 1]
            length[e - 1] += half
            arcs = half
        if e == n - 2:
            arrival = wrap_to_pi(angle - node_numbers[n - 1, ARC_REFERENCE])
            arcs += r2 * (node_numbers[n - 1, ARC_ANGLE] * node_numbers[n - 1, TURN] - arrival)
            arcs += r2 * pose[node_indices[n - 1, FRAME], POSE_ANGLE]
        length[e] = span + arcs
        for j in range(joints):
            f1, f2 = node_indices[e, FRAME], node_indices[e + 1, FRAME]
            vx = twist[f2, j, 1] - twist[f2, j, 0] * y2 - twist[f1, j, 1] + twist[f1, j, 0] * y1
            vy = twist[f2, j, 2] + twist[f2, j, 0] * x2 - twist[f1, j, 2] - twist[f1, j, 0] * x1
            along = dx * vx + dy * vy  # D dD
            span_by = along / span
            angle_by = (dx * vy - dy * vx) / square + h * along / (square * span)
            # arcs: r1 turns with the departing direction, r2 against the arriving one
            share1, share2 = 0.5 * r1, 0.5 * r2
            length_by_joint[e, j] += span_by
            if e == 0:
                share1 = r1
                length_by_joint[e, j] -= r1 * twist[f1, j, 0]
            else:
                length_by_joint[e - 1, j] += share1 * angle_by
            if e == n - 2:
                share2 = r2
                length_by_joint[e, j] += r2 * twist[f2, j, 0]
            else:
                length_by_joint[e + 1, j] -= share2 * angle_by
            length_by_joint[e, j] += share1 * angle_by - share2 * angle_by
        angle_before = angle
        x1, y1 = x2, y2
    return possible


@compiled
def table_value(coefficients: Vector, base: int, share: float) -> tuple[float, float]:
    """Value and derivative by ``share`` of the cubic at ``base``: c0 + c1 u + c2 u^2 + c3 u^3."""
    c1 = coefficients[base + 1]
    c2 = coefficients[base + 2]
    c3 = coefficients[base + 3]
    value = coefficients[base] + share * (c1 + share * (c2 + share * c3))
    return value, c1 + share * (2.0 * c2 + 3.0 * share * c3)


def hermite_table(values: Vector, slopes: Vector, step: float) -> Table:
    """Cubic coefficients of a function sampled with its slopes on a uniform grid.

    Args:
        values: shape (k + 1,).
        slopes: derivatives at the same points, shape (k + 1,).
        step: distance of the points.

    Returns:
        Shape (k, 4): powers of the share u in [0, 1] of each interval.
    """
    y0, y1 = values[:-1], values[1:]
    d0, d1 = slopes[:-1] * step, slopes[1:] * step
    return np.stack([y0, d0, 3 * (y1 - y0) - 2 * d0 - d1, 2 * (y0 - y1) + d0 + d1], axis=1)
