"""Geometry of a robot in one pose: frames, nodes, and cable paths."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Model, Shape, shape_at
from cdrj_ros.robot.description import Place, Pulley

Vector = NDArray[np.float64]
Points = NDArray[np.float64]

ARC_STEP: Final = pi / 60.0
"""Angle between two points of a drawn arc [rad]."""


@dataclass(frozen=True)
class Pose:
    """Frames and cable geometry of a robot in one pose."""

    frames: dict[str, tuple[float, float, float]]
    """Origin (x, y) [m] and angle [rad] of every frame in the base."""
    shape: Shape


def pose_of(model: Model, joint_angle: Vector) -> Pose:
    """Frames and tangents at joint angles [rad] or [m], shape (joints,)."""
    robot = model.robot
    values = dict(zip(model.layout.joints, joint_angle.tolist(), strict=True))
    frames: dict[str, tuple[float, float, float]] = {}
    for frame in robot.frames:
        x, y, turned = frames[frame.parent] if frame.parent else (0.0, 0.0, 0.0)
        c, s = cos(turned), sin(turned)
        x, y = x + c * frame.x - s * frame.y, y + s * frame.x + c * frame.y
        angle = turned + frame.angle
        q = values[frame.joint] if frame.joint else 0.0
        if frame.motion == "revolute":
            angle += q
        elif frame.motion == "prismatic":
            dx, dy = frame.direction
            x += q * (cos(angle) * dx - sin(angle) * dy)
            y += q * (sin(angle) * dx + cos(angle) * dy)
        elif frame.motion == "rolling":
            x += 2.0 * frame.rolling_radius * cos(angle + q)
            y += 2.0 * frame.rolling_radius * sin(angle + q)
            angle += 2.0 * q
        frames[frame.name] = (x, y, angle)
    return Pose(frames, shape_at(model, joint_angle))


def centre_of(pose: Pose, place: Place) -> tuple[float, float]:
    """A node's centre in the base [m]."""
    x, y, angle = pose.frames[place.frame]
    c, s = cos(angle), sin(angle)
    return x + c * place.x - s * place.y, y + s * place.x + c * place.y


def cable_line(model: Model, pose: Pose, cable: int) -> Points:
    """Path of a cable given by positions, as tangents and arcs in the base [m], shape (n, 2)."""
    path: list[tuple[float, float]] = []
    for start, end, arc in strands_and_arcs(model, pose, cable):
        path += [start, end, *arc]
    return np.array(path)


def strands_and_arcs(
    model: Model, pose: Pose, c: int
) -> Iterator[tuple[tuple[float, float], tuple[float, float], list[tuple[float, float]]]]:
    """Both ends of every element, and the arc around the pulley that follows it."""
    robot = model.robot
    cable = robot.cables[c]
    first = sum(len(other.nodes) - 1 for other in robot.cables[:c])
    wraps = pose.shape.wrap[sum(len(other.pulleys) for other in robot.cables[:c]) :]
    for e in range(len(cable.nodes) - 1):
        ux, uy, _ = pose.shape.direction[first + e]
        ends = []
        for node in cable.nodes[e : e + 2]:
            place = node.place
            assert place is not None
            x, y = centre_of(pose, place)
            arm = place.turn * node.radius  # the tangent point, where the turn moves along u
            ends.append((x + arm * uy, y - arm * ux))
        arc: list[tuple[float, float]] = []
        node = cable.nodes[e + 1]
        if isinstance(node, Pulley):
            assert node.place is not None
            x, y = centre_of(pose, node.place)
            begin = np.arctan2(ends[1][1] - y, ends[1][0] - x)
            steps = max(2, round(wraps[e] / ARC_STEP) + 1)
            angles = begin + node.place.turn * np.linspace(0.0, wraps[e], steps)
            arc = [(x + node.radius * cos(a), y + node.radius * sin(a)) for a in angles]
        yield ends[0], ends[1], arc
