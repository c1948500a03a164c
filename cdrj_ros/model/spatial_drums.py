"""Ends of a cable in space that wind it: drums, also with a helical groove, and sectors.

See docs/geometry.md, section 2, (G8) and (G10).
"""

from __future__ import annotations

from math import atan2, pi

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import stage
from cdrj_ros.model.records import Grid
from cdrj_ros.model.spatial_records import SpatialNodeNumbers, SpatialTwist, Touch
from cdrj_ros.model.spatial_vectors import Vector3, cross, dot, load, minus

Vector = NDArray[np.float64]


@stage
def turn_of_frame(
    frame: int, twists: Grid[SpatialTwist], touch: Touch, joint_angle: Vector
) -> float:
    """Turn of a frame about an end's axis by all joints [rad]; exact for parallel axes."""
    axis = (touch.basis[6], touch.basis[7], touch.basis[8])
    turned = 0.0
    for j in range(joint_angle.size):
        turned += dot(axis, load(twists[frame, j].angular)) * joint_angle[j]
    return turned


@stage
def wound_angle(node: SpatialNodeNumbers, touch: Touch, first: bool) -> float:
    """Angle of cable that has come onto an end since the reference pose, its motor at rest [rad].

    ``touch.twisted``, the turn of its frame, makes the result continuous over whole turns.
    """
    normal = touch.exit_normal if first else touch.entry_normal
    touch.angle = atan2(normal[1], normal[0])
    turned = (touch.angle + touch.twisted - node.arc_reference + pi) % (2.0 * pi) - pi
    turned -= touch.twisted - node.turn_reference
    return node.turn * (turned if first else -turned)


@stage
def departure(node: SpatialNodeNumbers, touch: Touch, first: bool) -> float:
    """Height at which the cable leaves a helical groove, from the centre of the drum [m]: (G10)."""
    return node.lead * (touch.wound + wound_angle(node, touch, first))


@stage
def moment_about_drum(node: SpatialNodeNumbers, touch: Touch, unit: Vector3, first: bool) -> float:
    """Moment of a cable about the axis of its drum per newton [m], (E27).

    Args:
        node: the end.
        touch: its contact.
        unit: direction of the cable, towards the last node, in the base.
        first: whether it is the first end.
    """
    arm = minus(load(touch.exit) if first else load(touch.entry), load(touch.centre))
    axis = (touch.basis[6], touch.basis[7], touch.basis[8])
    return node.turn * dot(axis, cross(arm, unit))
