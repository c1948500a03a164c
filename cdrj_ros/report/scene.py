"""A robot in one pose: frames, paths of the cables, and the bodies that they touch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import atan2, cos, pi, sin
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Model, Shape, placed, shape_at
from cdrj_ros.model.spatial_paths import Body as SpatialBody
from cdrj_ros.model.spatial_paths import bodies_in_space, paths_in_space
from cdrj_ros.report.visuals import PlacedVisual, placed_visuals
from cdrj_ros.robot.description import Anchor, Frame, Node, Place, Pulley, Robot, Winch
from cdrj_ros.robot.space import SpatialFrame

Vector = NDArray[np.float64]
Points = NDArray[np.float64]

ARC_STEP: Final = pi / 60.0
"""Angle between two points of a drawn arc [rad]."""


@dataclass(frozen=True)
class Pose:
    """Frames and cable geometry of a robot in one pose."""

    frames: dict[str, tuple[float, float, float]]
    """Origin (x, y) [m] and angle [rad] of every planar frame in the base."""
    origins: dict[str, Vector]
    """Origin of every frame, planar or in space, in the base [m], shape (3,)."""
    rotations: dict[str, NDArray[np.float64]]
    """Orientation of every frame in the base, shape (3, 3)."""
    shape: Shape


def pose_of(model: Model, joint_angle: Vector) -> Pose:
    """Frames and tangents at joint angles [rad] or [m], shape (joints,)."""
    robot = model.robot
    shape, views = placed(model, joint_angle)
    rows: Any = views.pose
    frames = {
        frame.name: (*row.origin[:2].tolist(), atan2(row.rotation[3], row.rotation[0]))
        for frame, row in zip(robot.frames, rows, strict=False)
    }
    names = [frame.name for frame in robot.frames]
    names += [frame.name for frame in robot.spatial_frames]
    origins = {name: row.origin.copy() for name, row in zip(names, rows, strict=True)}
    turned = {n: row.rotation.reshape(3, 3).copy() for n, row in zip(names, rows, strict=True)}
    return Pose(frames, origins, turned, shape)


def _centre_of(pose: Pose, place: Place) -> tuple[float, float]:
    """A node's centre in the base [m]."""
    x, y, angle = pose.frames[place.frame]
    c, s = cos(angle), sin(angle)
    return x + c * place.x - s * place.y, y + s * place.x + c * place.y


Colour = tuple[float, float, float]

Kind = Literal["winch", "pulley", "anchor"]
"""What a node is to its cable; an eyelet and a round body count as pulleys."""

BodyShape = Literal["disc", "cylinder", "sphere", "point"]
"""Shape of a body."""

UPWARDS: Final = np.array([0.0, 0.0, 1.0])
"""Axis of the bodies of cables in the plane."""

CIRCLE_POINTS: Final = 49
"""Points of a drawn circle, the first one twice."""

GENERATORS: Final = 6
"""Lines along a drawn cylinder."""

ROW: Final = 3.0
"""Distance between unrolled cables, in radii of the largest pulley [-]."""

LONG_SPAN: Final = 2.5
"""Length of a span at an end, over the size of the rest, beyond which it hides the rest."""

SLACK_COLOUR: Final[Colour] = (0.27, 0.46, 0.87)
TAUT_COLOUR: Final[Colour] = (0.22, 0.62, 0.36)
HIGH_COLOUR: Final[Colour] = (0.94, 0.70, 0.16)
LIMIT_COLOUR: Final[Colour] = (0.84, 0.15, 0.16)


@dataclass(frozen=True, eq=False)
class Body:
    """A winch, pulley, round body, eyelet or anchor."""

    name: str
    """``cable/node``."""
    kind: Kind
    shape: BodyShape
    centre: Vector
    """[m], shape (3,); of a point in space the middle of its contact with the cable."""
    radius: float
    """[m]; 0 of a point."""
    axis: Vector
    """Unit vector of the axis of a disc or cylinder, shape (3,)."""
    length: float
    """Of a cylinder along its axis [m]; 0 of other shapes."""
    frame: str = ""
    """The frame that carries it; empty where the robot file gives no position."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What is drawn in one pose."""

    pose: Pose
    elements: tuple[Points, ...]
    """Path of every element [m], shape (n, 3), in the order of ``Layout.elements``.

    An element includes half of the arc on either of its pulleys, so that the cable is complete.
    """
    bodies: tuple[Body, ...]
    """In the order of the cables and their nodes."""
    links: tuple[Points, ...]
    """Both ends of every link [m], shape (2, 3): from the origin of a moving frame to the origin of
    the frame that it carries, or to the farthest node on it; none where there are visuals."""
    visuals: tuple[PlacedVisual, ...]
    """Shapes of the robot's bodies."""


def scene_of(model: Model, joint_angle: Vector) -> Scene:
    """The robot at joint angles [rad] or [m], shape (joints,)."""
    robot = model.robot
    pose = pose_of(model, joint_angle)
    in_space = paths_in_space(model, joint_angle) if robot.spatial_frames else []
    round_bodies = {
        (body.cable, body.node): body
        for body in (bodies_in_space(model, joint_angle) if robot.spatial_frames else ())
    }
    elements: list[Points] = []
    bodies: list[Body] = []
    row = 0
    for c, cable in enumerate(robot.cables):
        if cable.spatial:
            paths, centres = _elements_in_space(in_space[c])
        elif cable.routed:
            paths = _placed_elements(model, pose, c)
            centres = [np.array([*_centre_of(pose, n.place), 0.0]) for n in cable.nodes if n.place]
        else:
            paths, centres = _unrolled(model, c, row)
            row += 1
        elements += paths
        for k, (node, centre) in enumerate(zip(cable.nodes, centres, strict=True)):
            name, kind, place = f"{cable.name}/{k + 1}", _kind(node), node.space or node.place
            if (c, k) in round_bodies:
                body = _round_body(name, kind, round_bodies[c, k])
            elif cable.spatial:
                body = Body(name, kind, "point", centre, 0.0, UPWARDS, 0.0)
            else:
                body = Body(name, kind, "disc", centre, node.radius, UPWARDS, 0.0)
            bodies.append(replace(body, frame=place.frame if place else ""))
    visuals = tuple(placed_visuals(robot.visuals, pose.origins, pose.rotations))
    links = () if visuals else tuple(_links(robot, pose, bodies))
    return Scene(pose, tuple(elements), tuple(bodies), links, visuals)


def _kind(node: Node) -> Kind:
    if isinstance(node, Winch):
        return "winch"
    return "anchor" if isinstance(node, Anchor) else "pulley"


def _round_body(name: str, kind: Kind, body: SpatialBody) -> Body:
    """A round body as it is drawn: a cylinder a little further than the cable touches it."""
    axis = body.basis[2]
    if body.kind == "sphere":
        return Body(name, kind, "sphere", body.centre, body.radius, axis, 0.0)
    if body.kind == "pulley":
        return Body(name, kind, "disc", body.centre, body.radius, axis, 0.0)
    along = (body.points - body.centre) @ axis if len(body.points) else np.zeros(1)
    low, high = float(along.min()) - body.radius, float(along.max()) + body.radius
    middle = body.centre + 0.5 * (low + high) * axis
    return Body(name, kind, "cylinder", middle, body.radius, axis, high - low)


def _links(robot: Robot, pose: Pose, bodies: Sequence[Body]) -> Iterator[Points]:
    """Ends of the links of frames that move with a joint."""
    frames: tuple[Frame | SpatialFrame, ...] = (*robot.frames, *robot.spatial_frames)
    for frame in frames:
        if frame.motion == "fixed":
            continue
        start = pose.origins[frame.name]
        ends = [pose.origins[one.name] for one in frames if one.parent == frame.name]
        ends = ends or [body.centre for body in bodies if body.frame == frame.name]
        away = [float(np.linalg.norm(end - start)) for end in ends]
        if max(away, default=0.0) > 0.0:
            yield np.array([start, ends[int(np.argmax(away))]])


def by_cable(robot: Robot, scene: Scene) -> list[tuple[list[Points], list[Body]]]:
    """Elements and bodies of every cable."""
    elements, bodies = iter(scene.elements), iter(scene.bodies)
    return [
        ([next(elements) for _ in cable.nodes[1:]], [next(bodies) for _ in cable.nodes])
        for cable in robot.cables
    ]


def inner_size(model: Model, scene: Scene) -> float:
    """Size of the robot without the ends of its cables; of all if there is nothing else [m]."""
    inner = [path for paths, _ in by_cable(model.robot, scene) for path in paths[1:-1]]
    return float(np.ptp(np.concatenate(inner or scene.elements), axis=0).max())


def straight_piece(path: Points) -> Points:
    """Both ends of the longest straight piece of a path, shape (2, 3)."""
    longest = int(np.argmax(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    return path[longest : longest + 2]


def _elements_in_space(pieces: list[Points]) -> tuple[list[Points], list[Vector]]:
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
    return paths, [piece[len(piece) // 2] for piece in filled]


def _placed_elements(model: Model, pose: Pose, c: int) -> list[Points]:
    """Tangents of one cable, each with half of the arcs at its ends."""
    paths: list[Points] = []
    before: list[tuple[float, float]] = []
    for start, end, arc in _strands_and_arcs(model, pose, c):
        middle = len(arc) // 2
        paths.append(_in_space([*before, start, end, *arc[: middle + 1]]))
        before = arc[middle:]
    return paths


def _strands_and_arcs(
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
            x, y = _centre_of(pose, place)
            arm = place.turn * node.radius  # the tangent point, where the turn moves along u
            ends.append((x + arm * uy, y - arm * ux))
        arc: list[tuple[float, float]] = []
        node = cable.nodes[e + 1]
        if isinstance(node, Pulley):
            assert node.place is not None
            x, y = _centre_of(pose, node.place)
            begin = np.arctan2(ends[1][1] - y, ends[1][0] - x)
            steps = max(2, round(wraps[e] / ARC_STEP) + 1)
            angles = begin + node.place.turn * np.linspace(0.0, wraps[e], steps)
            arc = [(x + node.radius * cos(a), y + node.radius * sin(a)) for a in angles]
        yield ends[0], ends[1], arc


def _unrolled(model: Model, c: int, row: int) -> tuple[list[Points], list[Vector]]:
    """Elements and nodes of a cable as a straight line, in the reference pose."""
    robot = model.robot
    reference = np.array([joint.reference_angle for joint in robot.joints])
    lengths = shape_at(model, reference).length
    first = sum(len(cable.nodes) - 1 for cable in robot.cables[:c])
    cable = robot.cables[c]
    along = np.concatenate([[0.0], np.cumsum(lengths[first : first + len(cable.nodes) - 1])])
    y = -row * ROW * max(node.radius for cable in robot.cables for node in cable.nodes)
    nodes = _in_space([(float(x), y) for x in along])
    return [nodes[e : e + 2] for e in range(len(nodes) - 1)], list(nodes)


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


def across(axis: Vector) -> tuple[Vector, Vector]:
    """Two unit vectors at right angles to an axis and to each other, shape (3,) each."""
    least = np.eye(3)[int(np.argmin(np.abs(axis)))]
    one = np.cross(axis, least)
    one /= np.linalg.norm(one)
    return one, np.cross(axis, one)


def outlines(body: Body) -> list[Points]:
    """Lines that show a body, each of shape (points, 3) [m]; none of a point.

    A disc is a circle, a sphere three great circles; a cylinder has lines along its side.
    """
    if body.shape == "point":
        return []
    x, y = across(body.axis)
    if body.shape == "sphere":
        return [
            _circle(body, body.centre, u, v) for u, v in ((x, y), (y, body.axis), (body.axis, x))
        ]
    half = 0.5 * body.length * body.axis
    ends = [_circle(body, body.centre + end, x, y) for end in (-half, half)]
    if body.shape == "disc":
        return ends[:1]
    step = (CIRCLE_POINTS - 1) // GENERATORS
    return [*ends, *(np.array([ends[0][k], ends[1][k]]) for k in range(0, CIRCLE_POINTS - 1, step))]


def _circle(body: Body, centre: Vector, u: Vector, v: Vector) -> Points:
    angles = np.linspace(0.0, 2.0 * pi, CIRCLE_POINTS)[:, None]
    return np.asarray(centre + body.radius * (np.cos(angles) * u + np.sin(angles) * v))
