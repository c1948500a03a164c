"""A robot in one pose: frames, paths of the cables, and the bodies that they touch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import cos, pi, sin
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Model, Shape, shape_at
from cdrj_ros.model.spatial_paths import Body, paths_in_space
from cdrj_ros.robot.description import Anchor, Place, Pulley, Winch

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


Vector = NDArray[np.float64]
Points = NDArray[np.float64]
Colour = tuple[float, float, float]
Centre = tuple[float, float, float]

Kind = Literal["winch", "pulley", "anchor"]
"""What a cable touches."""

ROW: Final = 3.0
"""Distance between unrolled cables, in radii of the largest pulley [-]."""

LONG_SPAN: Final = 5.0
"""Length of a span at an end, over the size of the rest, beyond which it hides the rest."""

SLACK_COLOUR: Final[Colour] = (0.27, 0.46, 0.87)
TAUT_COLOUR: Final[Colour] = (0.22, 0.62, 0.36)
HIGH_COLOUR: Final[Colour] = (0.94, 0.70, 0.16)
LIMIT_COLOUR: Final[Colour] = (0.84, 0.15, 0.16)


@dataclass(frozen=True)
class Wheel:
    """A winch, pulley or anchor."""

    name: str
    """``cable/node``."""
    kind: Kind
    centre: tuple[float, float, float]
    """[m]; of a node in space the middle of its contact with the cable."""
    radius: float
    """[m]; 0 for an anchor at a point, and in space."""


@dataclass(frozen=True)
class Scene:
    """What is drawn in one pose."""

    elements: tuple[Points, ...]
    """Path of every element [m], shape (n, 3), in the order of ``Layout.elements``.

    An element includes half of the arc on either of its pulleys, so that the cable is complete.
    """
    wheels: tuple[Wheel, ...]
    """In the order of the cables and their nodes."""


def scene_of(model: Model, joint_angle: Vector) -> Scene:
    """The robot at joint angles [rad] or [m], shape (joints,)."""
    robot = model.robot
    pose = pose_of(model, joint_angle)
    in_space = paths_in_space(model, joint_angle) if robot.spatial_frames else []
    elements: list[Points] = []
    wheels: list[Wheel] = []
    row = 0
    for c, cable in enumerate(robot.cables):
        if cable.spatial:
            paths, centres = _elements_in_space(in_space[c])
        elif cable.routed:
            paths = _placed_elements(model, pose, c)
            centres = [(*centre_of(pose, n.place), 0.0) for n in cable.nodes if n.place]
        else:
            paths, centres = _unrolled(model, c, row)
            row += 1
        elements += paths
        for k, (node, centre) in enumerate(zip(cable.nodes, centres, strict=True)):
            kind: Kind = "pulley"
            if isinstance(node, (Winch, Anchor)):
                kind = "winch" if isinstance(node, Winch) else "anchor"
            radius = 0.0 if cable.spatial else node.radius
            wheels.append(Wheel(f"{cable.name}/{k + 1}", kind, centre, radius))
    return Scene(tuple(elements), tuple(wheels))


def inner_size(model: Model, scene: Scene) -> float:
    """Size of the robot without the ends of its cables; of all if there is nothing else [m]."""
    elements = iter(scene.elements)
    paths = [[next(elements) for _ in cable.nodes[1:]] for cable in model.robot.cables]
    inner = [path for own in paths for path in own[1:-1]]
    return float(np.ptp(np.concatenate(inner or scene.elements), axis=0).max())


def _elements_in_space(pieces: list[Points]) -> tuple[list[Points], list[Centre]]:
    """Elements of one cable, and the middle of its contact with every node.

    Args:
        pieces: points of contact with every node [m], shape (n, 3) each; none where it lifted off.
    """
    filled = list(pieces)
    for k, piece in enumerate(pieces):
        if len(piece) == 0:  # on the straight line between the contacts beside it
            before = filled[k - 1][-1]
            after = next(other[0] for other in pieces[k + 1 :] if len(other))
            filled[k] = 0.5 * (before + after)[None]
    paths = [
        np.concatenate([one[len(one) // 2 :], other[: len(other) // 2 + 1]])
        for one, other in pairwise(filled)
    ]
    middles = [piece[len(piece) // 2] for piece in filled]
    return paths, [(float(x), float(y), float(z)) for x, y, z in middles]


def _placed_elements(model: Model, pose: Pose, c: int) -> list[Points]:
    """Tangents of one cable, each with half of the arcs at its ends."""
    paths: list[Points] = []
    before: list[tuple[float, float]] = []
    for start, end, arc in strands_and_arcs(model, pose, c):
        middle = len(arc) // 2
        paths.append(_in_space([*before, start, end, *arc[: middle + 1]]))
        before = arc[middle:]
    return paths


def _unrolled(model: Model, c: int, row: int) -> tuple[list[Points], list[Centre]]:
    """Elements and nodes of a cable as a straight line, in the reference pose."""
    robot = model.robot
    reference = np.array([joint.reference_angle for joint in robot.joints])
    lengths = shape_at(model, reference).length
    first = sum(len(cable.nodes) - 1 for cable in robot.cables[:c])
    cable = robot.cables[c]
    along = np.concatenate([[0.0], np.cumsum(lengths[first : first + len(cable.nodes) - 1])])
    y = -row * ROW * max(node.radius for cable in robot.cables for node in cable.nodes)
    nodes = [(float(x), y) for x in along]
    paths = [_in_space(nodes[e : e + 2]) for e in range(len(nodes) - 1)]
    return paths, [(x, y, 0.0) for x, y in nodes]


def _in_space(points: list[tuple[float, float]]) -> Points:
    return np.column_stack([np.array(points), np.zeros(len(points))])


def tension_colour(tension: float, preload: float, limit: float) -> Colour:
    """Colour of an element: blue without tension, green at the preload, red at the limit.

    Args:
        tension: of the element [N].
        preload: of its cable [N].
        limit: of its cable [N]; infinite: four times the preload, or 100 N without a preload.
    """
    if not np.isfinite(limit):
        limit = 4.0 * preload if preload > 0.0 else 100.0
    preload = min(max(preload, 0.1 * limit), 0.9 * limit)
    at = [0.0, preload, 0.5 * (preload + limit), limit]
    colours = np.array([SLACK_COLOUR, TAUT_COLOUR, HIGH_COLOUR, LIMIT_COLOUR])
    red, green, blue = (float(np.interp(tension, at, colours[:, k])) for k in range(3))
    return red, green, blue


Points = NDArray[np.float64]

CIRCLE_POINTS: Final = 49
"""Points of a drawn circle, the first one twice."""

GENERATORS: Final = 6
"""Lines along a drawn cylinder."""


def outlines(body: Body) -> list[Points]:
    """Lines that show a body, each of shape (points, 3) [m].

    A pulley is a circle, a sphere three great circles; a cylinder is drawn a little further than
    the cable touches it.
    """
    x, y, z = body.basis
    if body.kind == "sphere":
        return [_circle(body, body.centre, u, v) for u, v in ((x, y), (y, z), (z, x))]
    if body.kind == "pulley":
        return [_circle(body, body.centre, x, y)]
    low, high = _heights(body)
    ends = [_circle(body, body.centre + height * z, x, y) for height in (low, high)]
    step = (CIRCLE_POINTS - 1) // GENERATORS
    return [*ends, *(np.array([ends[0][k], ends[1][k]]) for k in range(0, CIRCLE_POINTS - 1, step))]


def _heights(body: Body) -> tuple[float, float]:
    """Lower and upper end of a drawn cylinder along its axis, from its centre [m]."""
    touched = (body.points - body.centre) @ body.basis[2] if len(body.points) else np.zeros(1)
    return float(touched.min()) - body.radius, float(touched.max()) + body.radius


def _circle(body: Body, centre: Points, u: Points, v: Points) -> Points:
    angles = np.linspace(0.0, 2.0 * pi, CIRCLE_POINTS)
    points: Points = centre + body.radius * (
        np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)
    )
    return points
