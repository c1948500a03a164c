"""Bodies that guide a cable: where it touches them, as equations for the points of contact.

Every body writes its points of contact by a few unknowns and states as many equations, which say
that the straight pieces before and after it are tangents and that the piece between them is a
geodesic (or lies in the groove).  All functions work on n poses at once, in the body's own axes:
the origin is its centre (the point where the cable enters a swivelling pulley), z its axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Z = np.array([0.0, 0.0, 1.0])

ENDS = ("winch", "anchor")
"""Kinds of nodes at the ends of a cable; with a turn they are drums and sectors, else points."""


@dataclass(frozen=True)
class Node:
    """A node of a cable; lengths in m."""

    kind: str
    """``anchor``, ``winch``, ``pulley``, ``swivel``, ``eyelet``, ``cylinder``, ``sphere`` or
    ``sheath``."""
    position: tuple[float, ...]
    frame: str = "base"
    radius: float = 0.0
    axis: tuple[float, float, float] | None = None
    turn: int = 0
    """+1 where the cable goes round the axis counter-clockwise, -1 clockwise; 0 at a point."""
    mu: float = 0.0
    side: tuple[float, float, float] | None = None
    """Of a sphere: a point on the side on which the cable passes."""
    motor: str = ""
    winding: int = 0
    exit: tuple[float, float, float] = (0.0, 0.0, 0.0)
    exit_frame: str = "base"
    length: float = 0.0
    bend: float = 0.0

    @property
    def is_point(self) -> bool:
        """Whether the cable is straight on both sides of one point."""
        return self.kind == "eyelet" or (self.kind in ENDS and self.turn == 0)

    @property
    def unknowns(self) -> int:
        """Number of unknowns that determine its points of contact."""
        if self.is_point:
            return 0
        sizes = {"pulley": 2, "swivel": 2, "cylinder": 4, "sphere": 6, "sheath": 0}
        return sizes.get(self.kind, 1)


def around(angle: Array) -> Array:
    """Unit vectors at angles about z, shape (n, 3)."""
    return np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)


def along(angle: Array, sense: int) -> Array:
    """Unit tangents of a circle about z, in the sense of the cable, shape (n, 3)."""
    return sense * np.stack([-np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=-1)


def contacts(node: Node, x: Array) -> tuple[Array, Array]:
    """First and last point of contact, shapes (n, 3), from the unknowns of shape (n, unknowns)."""
    r = node.radius
    if node.kind in ENDS:
        point = r * around(x[:, 0])
        return point, point
    if node.kind == "pulley":
        return r * around(x[:, 0]), r * around(x[:, 1])
    if node.kind == "cylinder":
        return r * around(x[:, 0]) + x[:, 2:3] * Z, r * around(x[:, 1]) + x[:, 3:4] * Z
    if node.kind == "sphere":
        return r * x[:, :3], r * x[:, 3:]
    plane, wrap = x.T  # of a swivelling pulley
    leave = (r - r * np.cos(wrap))[:, None] * around(plane) + (r * np.sin(wrap))[:, None] * Z
    return np.zeros_like(leave), leave


def equations(node: Node, x: Array, a: Array, b: Array) -> list[Array]:
    """Residuals [-] of its unknowns, where the cable comes from a and goes to b, shapes (n, 3).

    At an end of the cable both are the neighbouring point.
    """
    r = node.radius
    if node.kind in ENDS:
        return [np.sum(around(x[:, 0]) * b, -1) / r - 1.0]
    if node.kind in {"pulley", "cylinder"}:
        first, last = around(x[:, 0]), around(x[:, 1])
        tangents = [np.sum(first * a, -1) / r - 1.0, np.sum(last * b, -1) / r - 1.0]
        if node.kind == "pulley":
            return tangents
        before = np.sum((r * first - a) * along(x[:, 0], node.turn), -1)
        after = np.sum((b - r * last) * along(x[:, 1], node.turn), -1)
        arc = r * node.turn * (x[:, 1] - x[:, 0])
        rise_in, rise_out = x[:, 2] - a[:, 2], b[:, 2] - x[:, 3]
        # one slope before and behind the first point of contact, and so at the last one
        one = rise_in * (arc + after) - (b[:, 2] - x[:, 2]) * before
        two = rise_out * (arc + before) - (x[:, 3] - a[:, 2]) * after
        scale = r * (before + arc + after)
        return [*tangents, one / scale, two / scale]
    if node.kind == "sphere":
        first, last = x[:, :3], x[:, 3:]
        plane = np.cross(a, b) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1))[:, None]
        residuals = []
        for normal, point in ((first, a), (last, b)):
            residuals.append(np.sum(normal * normal, -1) - 1.0)
            residuals.append(np.sum(normal * point, -1) / r - 1.0)
            residuals.append(np.sum(normal * plane, -1))
        return residuals
    plane, wrap = x.T
    out = np.sum(around(plane) * b, -1) - r
    return [
        np.sum(along(plane, 1) * b, -1) / r,
        (b[:, 2] * np.sin(wrap) - out * np.cos(wrap)) / r - 1.0,
    ]


def guess(node: Node, a: Array, b: Array, last_node: bool) -> Array:
    """Unknowns of one pose, shape (unknowns,), if it alone lay between the points a and b."""
    r, sense = node.radius, node.turn

    def opening(point: Array) -> float:
        return float(np.arccos(min(r / np.hypot(point[0], point[1]), 0.999)))

    if node.kind in ENDS:
        toward = sense if last_node else -sense
        return np.array([np.arctan2(b[1], b[0]) + toward * opening(b)])
    if node.kind in {"pulley", "cylinder"}:
        first = np.arctan2(a[1], a[0]) + sense * opening(a)
        last = np.arctan2(b[1], b[0]) - sense * opening(b)
        last = first + sense * ((sense * (last - first)) % (2.0 * np.pi))
        if node.kind == "pulley":
            return np.array([first, last])
        return np.array([first, last, a[2] + (b[2] - a[2]) / 3.0, b[2] - (b[2] - a[2]) / 3.0])
    if node.kind == "sphere":
        side = np.asarray(node.side) - np.asarray(node.position)
        ahead = (b - a) / np.linalg.norm(b - a)
        up = np.cross(np.cross(a, b), ahead)
        up /= np.linalg.norm(up)
        up *= np.sign(up @ side) or 1.0
        normals = []
        for point, way in ((a, -1.0), (b, 1.0)):
            lean = np.arccos(min(r / np.linalg.norm(point), 0.999))
            height = np.arctan2(point @ up, way * (point @ ahead)) + lean
            normals.append(np.cos(height) * way * ahead + np.sin(height) * up)
        return np.concatenate(normals)
    return np.array([np.arctan2(b[1], b[0]), np.pi / 2.0])
