"""Records of the geometry: constants of frames and nodes, their values in a pose, and tables.

Cables are described in space; those of a robot in the plane lie at z = 0, with all axes along z.
See docs/model.md.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.records import record_type

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


class FramePlan:
    """Place of a frame in the tree of frames; parents come first."""

    parent: int
    """Index of the parent frame; -1 for the base."""
    motion: int
    """Code of ``_core.FrameMotion``."""
    joint: int
    """Index of the joint that moves the frame; -1 for a fixed frame."""


class FrameNumbers:
    """Pose of a frame in its parent, and its motion."""

    origin: Vector
    """[m], shape (3,)."""
    rotation: Vector
    """Orientation in the parent without motion, by rows, shape (9,)."""
    axis: Vector
    """Unit vector of its motion, in the frame, shape (3,)."""
    rolling_radius: float
    """Radius of both circles of a rolling joint [m]."""
    multiplier: float
    """Its motion per motion of its joint [-]."""
    offset: float
    """Its motion at joint angle 0 [rad] or [m]."""


class NodePlan:
    """Shape of a node and the frames that carry it."""

    kind: int
    """Code of ``_core.Guide``."""
    frame: int
    """-1 where the node has no position."""
    exit_frame: int
    """Frame of the far end of a sheath, or of the side point of a round body."""


class NodeNumbers:
    """A node in its frame.  The z axis of its own axes is the axis of a round body."""

    centre: Vector
    """Centre, point or entry [m], shape (3,)."""
    basis: Vector
    """Unit vectors of its own axes, one by row, shape (9,)."""
    exit: Vector
    """Far end of a sheath, or the point on the side that the cable passes, in ``exit_frame`` [m],
    shape (3,)."""
    sided: float
    """1 where a side is given, otherwise 0."""
    ignored_inside: float
    """1 where a body does not touch the cable while a neighbouring point lies inside it; 0 where
    such a pose is impossible."""
    radius: float
    """[m]."""
    turn: float
    """+1 counter-clockwise about the axis, -1 clockwise, 0 where it follows from the position."""
    inside: float
    """1 where the cable runs through the inside of a round body, as through a ring."""
    turns: float
    """Whole turns in addition to the wrap."""
    lead: float
    """Rise of a drum's groove along its axis per radian of cable wound in [m/rad]; 0 in the
    reference pose, and for all other nodes."""
    reel: float
    """Cable on a drum or a sector per radian [m/rad]."""
    length: float
    """Length of a sheath [m]."""
    arc_reference: float
    """For a pulley: wrap in the reference pose [rad]; the wrap is continuous within half a turn of
    it.  For an end that winds cable: angle of its tangent point in the reference pose, plus
    ``turn_reference`` [rad]."""
    turn_reference: float
    """For an end: turn of its frame about its axis in the reference pose [rad]."""


class Pose:
    """Pose of a frame in the base."""

    rotation: Vector
    """By rows, shape (9,)."""
    origin: Vector
    """[m], shape (3,)."""


class Twist:
    """Velocity of a frame per unit of a joint's velocity."""

    angular: Vector
    """[-], shape (3,)."""
    linear: Vector
    """Velocity of the base's origin, as if it moved with the frame [m], shape (3,)."""


class Touch:
    """Contact of a cable with a node in one pose."""

    centre: Vector
    """In the base [m], shape (3,)."""
    basis: Vector
    """Unit vectors of the node's own axes in the base, one by row, shape (9,)."""
    entry: Vector
    """First point of contact in the base [m], shape (3,)."""
    exit: Vector
    """Last point of contact in the base [m], shape (3,)."""
    before: Vector
    """Point from which the cable comes, in the node's own axes [m], shape (3,)."""
    after: Vector
    """Point to which the cable goes, in the node's own axes [m], shape (3,)."""
    side: Vector
    """Point on the side that the cable passes, in the node's own axes [m], shape (3,)."""
    normal: Vector
    """Axis of the arc in the node's own axes, shape (3,)."""
    entry_normal: Vector
    """Unit vector to the first point of contact, normal to the axis of the arc, shape (3,)."""
    exit_normal: Vector
    """Unit vector to the last point of contact, normal to the axis of the arc, shape (3,); for a
    swivel pulley, the direction of its plane."""
    before_length: float
    """Free length before the contact, in the plane of the arc [m]."""
    after_length: float
    """Free length after the contact, in the plane of the arc [m]."""
    sense: float
    """+1: the cable goes round ``normal`` counter-clockwise, -1: clockwise."""
    touching: float
    """1 where the cable touches the node, otherwise 0."""
    angle: float
    """Angle of the arc about its axis [rad]."""
    wrap: float
    """Angle through which the cable turns at the node [rad]."""
    arc: float
    """Length of cable on the node [m]."""
    share: float
    """If the cable does not touch: position of the node along the straight line past it [-]."""
    twisted: float
    """Turn of the frame of an end about its axis by all joints [rad]."""
    wound: float
    """Angle of cable that the motor of an end has wound in since the reference pose [rad]."""
    lever: float
    """Of an end that winds cable: moment of the cable about its axis per newton [m], (E27)."""


class ArcMiddle:
    """Middle of an arc in the axes of its body, from which its motion along the cable follows."""

    normal: Vector
    """Unit vector from the axis, of a sphere from the centre, to the middle, shape (3,)."""
    tangent: Vector
    """Direction of the cable there, shape (3,): a unit vector, on a ring the mean of both units; 0
    where the cable does not touch the body."""
    height: float
    """Along the axis of a cylinder [m]; 0 for other bodies."""


class Cubic:
    """c0 + c1 u + c2 u^2 + c3 u^3, u in [0, 1] over one interval of a table."""

    c0: float
    c1: float
    c2: float
    c3: float


FRAME_PLAN: Final = record_type(FramePlan)
FRAME: Final = record_type(FrameNumbers, origin=3, rotation=9, axis=3)
NODE_PLAN: Final = record_type(NodePlan)
NODE: Final = record_type(NodeNumbers, centre=3, basis=9, exit=3)
POSE: Final = record_type(Pose, rotation=9, origin=3)
TWIST: Final = record_type(Twist, angular=3, linear=3)
TOUCH: Final = record_type(
    Touch,
    centre=3,
    basis=9,
    entry=3,
    exit=3,
    before=3,
    after=3,
    side=3,
    normal=3,
    entry_normal=3,
    exit_normal=3,
)
ARC_MIDDLE: Final = record_type(ArcMiddle, normal=3, tangent=3)
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
