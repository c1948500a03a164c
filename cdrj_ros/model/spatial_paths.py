"""Points of contact of cables in space, and the bodies that they meet, for drawing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Model, placed
from cdrj_ros.robot.description import Node, Pulley
from cdrj_ros.robot.space import ContactKind

Vector = NDArray[np.float64]
Points = NDArray[np.float64]

ARC_POINTS: Final = 24
"""Number of points per half turn of a drawn arc."""


@dataclass(frozen=True)
class Body:
    """A round body in one pose, in the base."""

    cable: int
    node: int
    kind: ContactKind
    radius: float
    """[m]."""
    centre: Vector
    """[m], shape (3,)."""
    basis: NDArray[np.float64]
    """Unit vectors of its own axes by row; the last is the axis of a pulley or cylinder."""
    points: Points
    """Where the cable touches it [m], shape (points, 3); none where the cable has lifted off."""


def arc_in_space(node: Node, touch: Any, count: int, *, first: bool) -> Points:
    """Points of a cable on a node in the base [m], shape (points, 3).

    Args:
        node: a node in space.
        touch: its row of the scratch.
        count: points per half turn of an arc.
        first: whether it is the first node of its cable, which has no part before it.
    """
    place = node.space
    assert place is not None
    if touch.touching == 0.0:
        return np.empty((0, 3))
    ends = np.array([touch.entry, touch.exit])
    if place.kind == "sheath":
        return ends
    if place.kind == "point" or not isinstance(node, Pulley):
        return ends[1:] if first else ends[:1]
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


def paths_in_space(model: Model, joint_angle: Vector) -> list[list[NDArray[np.float64]]]:
    """Points at which the cables in space touch their nodes.

    Args:
        model: the robot.
        joint_angle: [rad] or [m], shape (joints,).

    Returns:
        For every cable a list with one array per node, the points of contact in the base [m], shape
        (points, 3): one for a point or an end, both ends of a sheath, an arc for a pulley or a
        round body, none where the cable does not touch the node.  The list of a cable that is not
        described in space is empty.
    """
    touches: Any = placed(model, joint_angle)[1].touches
    paths, node_at = [], 0
    for cable in model.robot.cables:
        pieces = [
            arc_in_space(node, touches[node_at + k], ARC_POINTS, first=k == 0)
            for k, node in enumerate(cable.nodes)
            if cable.spatial
        ]
        node_at += len(cable.nodes)
        paths.append(pieces)
    return paths


def bodies_in_space(model: Model, joint_angle: Vector) -> Iterator[Body]:
    """Pulleys, drums, cylinders and spheres of the cables in space; swivelling pulleys excepted.

    Args:
        model: the robot.
        joint_angle: [rad] or [m], shape (joints,).
    """
    touches: Any = placed(model, joint_angle)[1].touches
    first = 0
    for c, cable in enumerate(model.robot.cables):
        for k, node in enumerate(cable.nodes):
            if node.space is not None and node.space.kind in ("pulley", "cylinder", "sphere"):
                touch = touches[first + k]
                points = arc_in_space(node, touch, ARC_POINTS, first=k == 0)
                yield Body(
                    c, k, node.space.kind, node.radius, touch.centre.copy(),
                    touch.basis.reshape(3, 3).copy(), points,
                )  # fmt: skip
        first += len(cable.nodes)
