"""Lengths, wraps and directions at given joint angles: planar tangents and arcs, and tables.

A cable is a path of directed circles: radius r and turn sigma = +1 where the cable goes round it
counter-clockwise on its way from the first node to the last, -1 clockwise.  Points are circles of
radius 0.  See docs/model.md, section 3.
"""

from __future__ import annotations

from typing import Final, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.records import record_type
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
