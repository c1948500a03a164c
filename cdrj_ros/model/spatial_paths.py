"""Points of contact of cables in space, for drawing."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.robot.description import Node, Pulley

Points = NDArray[np.float64]


def arc_in_space(node: Node, touch: Any, count: int) -> Points:
    """Points of a cable on a node in the base [m], shape (points, 3).

    Args:
        node: a node in space.
        touch: its row of the scratch.
        count: points per half turn of an arc.
    """
    place = node.space
    assert place is not None
    if touch.touching == 0.0:
        return np.empty((0, 3))
    ends = np.array([touch.entry, touch.exit])
    if place.kind == "sheath":
        return ends
    if place.kind == "point" or not isinstance(node, Pulley):
        return ends[1:] if place.kind != "point" else ends[:1]
    shares = np.linspace(0.0, 1.0, max(2, round(touch.angle / pi * count) + 1))
    if place.kind == "swivel":
        out = touch.exit_normal
        local = [
            node.radius * (1.0 - cos(a)) * out + node.radius * sin(a) * np.array([0.0, 0.0, 1.0])
            for a in shares * touch.angle
        ]
    else:
        first, axis = touch.entry_normal, touch.normal
        across = touch.sense * np.cross(axis, first)
        local = [node.radius * (cos(a) * first + sin(a) * across) for a in shares * touch.angle]
    basis = touch.basis.reshape(3, 3)
    points: Points = touch.centre + np.array(local) @ basis
    if place.kind == "cylinder":  # the cable is a helix that rises along the axis
        rise = (ends - touch.centre) @ basis[2]
        points += np.outer(rise[0] + shares * (rise[1] - rise[0]), basis[2])
    return points
