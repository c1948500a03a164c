"""A robot in one pose: frames, paths of the cables, the bodies that they touch, and its shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from itertools import pairwise, product
from math import cos, pi, sin, sqrt
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Faces, Points, Vector
from cdrj_ros.foundation.files import InputError, read_regular
from cdrj_ros.model.prepared import Model, placed, shape_at
from cdrj_ros.robot.description import Anchor, Node, Pulley, Robot, Winch
from cdrj_ros.robot.space import MESHES, Visual, VisualShape

FramePose = tuple[Vector, NDArray[np.float64]]
"""Origin [m] and orientation of a frame in the base, shapes (3,) and (3, 3)."""

Wxyz = tuple[float, float, float, float]
"""A unit quaternion: w, x, y, z."""

LARGEST_MESH: Final = 20_000_000
"""Largest file of a mesh that is read [bytes]."""

MOST_FACES: Final = 200_000
"""Largest number of triangles of a mesh that is drawn."""

SIDES: Final = 32
"""Corners of a drawn circle."""


class Mesh(NamedTuple):
    """Triangles."""

    vertices: Points
    """Shape (n, 3)."""
    faces: Faces
    """Indices of vertices, shape (f, 3)."""


@dataclass(frozen=True, eq=False)
class PlacedVisual:
    """A shape in the base."""

    shape: VisualShape
    size: Vector
    """As of ``Visual``, shape (3,)."""
    centre: Vector
    """[m], shape (3,)."""
    rotation: NDArray[np.float64]
    """Shape (3, 3)."""
    mesh: str

    @property
    def points(self) -> Points:
        """Points [m] whose convex hull contains it, shape (n, 3); none of an unknown mesh."""
        return self.centre + _own_points(self.shape, self.mesh) * self.size @ self.rotation.T

    @property
    def quaternion(self) -> Wxyz:
        """Its orientation."""
        from scipy.spatial.transform import Rotation  # slow

        x, y, z, w = map(float, Rotation.from_matrix(self.rotation).as_quat())
        return w, x, y, z


def quaternion_to(axis: Vector) -> Wxyz:
    """The rotation that turns the z axis to a unit vector, shape (3,)."""
    x, y, z = map(float, axis)
    if z < -1.0 + 1e-12:
        return 0.0, 1.0, 0.0, 0.0
    w = sqrt(0.5 * (1.0 + z))
    return w, -0.5 * y / w, 0.5 * x / w, 0.0


def placed_visuals(
    visuals: Sequence[Visual], frames: Mapping[str, FramePose]
) -> Iterator[PlacedVisual]:
    """The visuals of a robot, in the base.

    Args:
        visuals: of the robot.
        frames: pose of every frame in the base.
    """
    for one in visuals:
        origin, turned = frames[one.frame]
        yield PlacedVisual(
            one.shape, np.array(one.size), origin + turned @ np.array(one.origin),
            turned @ np.reshape(one.rotation, (3, 3)), one.mesh,
        )  # fmt: skip


@lru_cache(maxsize=256)
def mesh_in(path: str) -> Mesh | None:
    """The mesh in a file; None where none can be read, or trimesh is not installed."""
    try:
        import trimesh
    except ImportError:
        return None
    suffix = Path(path).suffix.lower()
    try:
        if suffix not in MESHES:
            return None
        data = BytesIO(read_regular(path, LARGEST_MESH))
        found: Any = trimesh.load(data, file_type=suffix[1:], force="mesh")
        vertices, faces = np.array(found.vertices, float), np.array(found.faces, np.uint32)
    except InputError:
        return None
    except Exception:  # noqa: BLE001 whatever a library says of a broken file
        return None
    if not len(faces) or len(faces) > MOST_FACES or not np.isfinite(vertices).all():
        return None
    return Mesh(vertices, faces)


def _own_points(shape: VisualShape, mesh: str) -> Points:
    """Points of a shape of size 1."""
    if shape == "mesh":
        known = mesh_in(mesh)
        return np.empty((0, 3)) if known is None else known.vertices
    if shape == "box":
        return np.array(list(product((-0.5, 0.5), repeat=3)))
    angle = np.linspace(0.0, 2.0 * pi, SIDES, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(SIDES)])
    if shape == "cylinder":
        half = np.array([0.0, 0.0, 0.5])
        return np.concatenate([circle - half, circle + half])
    heights = np.sin(angle)[:, None, None]
    rings = np.sqrt(1.0 - heights**2) * circle + heights * np.array([0.0, 0.0, 1.0])
    return np.asarray(rings.reshape(-1, 3))


ARC_STEP: Final = pi / 60.0
"""Angle between two points of a drawn arc [rad]."""


Colour = tuple[float, float, float]

Kind = Literal["winch", "pulley", "anchor"]
"""What a node is to its cable; an eyelet and a round body count as pulleys."""

BodyShape = Literal["disc", "cylinder", "sphere", "point"]
"""Shape of a body."""

UPWARDS: Final = np.array([0.0, 0.0, 1.0])
"""Axis of bodies without an axis of their own."""


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
    """[m], shape (3,); of a point the middle of its contact with the cable."""
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
    views = placed(model, joint_angle)[1]
    poses: Any = views.pose
    touches: Any = views.touches
    frames = {
        frame.name: (row.origin.copy(), row.rotation.reshape(3, 3).copy())
        for frame, row in zip(robot.frames, poses, strict=True)
    }
    elements: list[Points] = []
    bodies: list[Body] = []
    row = first = 0
    for c, cable in enumerate(robot.cables):
        names = [f"{cable.name}/{k + 1}" for k in range(len(cable.nodes))]
        if cable.placed:
            own = touches[first : first + len(cable.nodes)]
            pieces = _without_gaps(
                [_contact(node, own[k], first=k == 0) for k, node in enumerate(cable.nodes)]
            )
            elements += [
                np.concatenate([one[len(one) // 2 :], other[: len(other) // 2 + 1]])
                for one, other in pairwise(pieces)
            ]
            bodies += map(_body, names, cable.nodes, own, pieces)
        else:
            paths, centres = _unrolled(model, c, row)
            row += 1
            elements += paths
            bodies += [
                Body(name, _kind(node), "disc", centre, node.radius, UPWARDS, 0.0)
                for name, node, centre in zip(names, cable.nodes, centres, strict=True)
            ]
        first += len(cable.nodes)
    visuals = tuple(placed_visuals(robot.visuals, frames))
    links = () if visuals else tuple(_links(robot, frames, bodies))
    return Scene(tuple(elements), tuple(bodies), links, visuals)


def _kind(node: Node) -> Kind:
    if isinstance(node, Winch):
        return "winch"
    return "anchor" if isinstance(node, Anchor) else "pulley"


def _contact(node: Node, touch: Any, *, first: bool) -> Points:
    """Points of a cable on a node in the base [m], shape (points, 3); none where it lifted off.

    Args:
        node: a node with a place.
        touch: its row of the scratch.
        first: whether it is the first node of its cable, which has no part before it.
    """
    place = node.place
    assert place is not None
    if touch.touching == 0.0:
        return np.empty((0, 3))
    ends = np.array([touch.entry, touch.exit])
    if place.kind == "sheath":
        return ends
    if place.kind == "point" or not isinstance(node, Pulley):
        return ends[1:] if first else ends[:1]
    shares = np.linspace(0.0, 1.0, max(2, round(touch.angle / ARC_STEP) + 1))
    if place.kind == "swivel":
        out = touch.exit_normal
        local = [
            node.radius * (1.0 - cos(a)) * out + node.radius * sin(a) * UPWARDS
            for a in shares * touch.angle
        ]
    else:
        begin = touch.entry_normal
        across = touch.sense * np.cross(touch.normal, begin)
        local = [node.radius * (cos(a) * begin + sin(a) * across) for a in shares * touch.angle]
    basis = touch.basis.reshape(3, 3)
    points: Points = touch.centre + np.array(local) @ basis
    if place.kind == "cylinder":  # the cable is a helix that rises along the axis
        rise = (ends - touch.centre) @ basis[2]
        points += np.outer(rise[0] + shares * (rise[1] - rise[0]), basis[2])
    return points


def _without_gaps(pieces: list[Points]) -> list[Points]:
    """The pieces; where the cable lifted off, the middle between the contacts beside it."""
    filled = list(pieces)
    for k, piece in enumerate(pieces):
        if len(piece) == 0:
            after = next(other[0] for other in pieces[k + 1 :] if len(other))
            filled[k] = 0.5 * (filled[k - 1][-1] + after)[None]
    return filled


def _body(name: str, node: Node, touch: Any, piece: Points) -> Body:
    """A node as it is drawn: a cylinder a little further than the cable touches it."""
    place, kind, centre = node.place, _kind(node), touch.centre.copy()
    assert place is not None
    axis = touch.basis.reshape(3, 3)[2].copy()
    if place.kind == "sphere":
        return Body(name, kind, "sphere", centre, node.radius, axis, 0.0, place.frame)
    if place.kind == "pulley":
        return Body(name, kind, "disc", centre, node.radius, axis, 0.0, place.frame)
    if place.kind == "cylinder":
        along = (piece - centre) @ axis if touch.touching else np.zeros(1)
        low, high = float(along.min()) - node.radius, float(along.max()) + node.radius
        middle = centre + 0.5 * (low + high) * axis
        return Body(name, kind, "cylinder", middle, node.radius, axis, high - low, place.frame)
    return Body(name, kind, "point", piece[len(piece) // 2], 0.0, UPWARDS, 0.0, place.frame)


def _links(
    robot: Robot, frames: Mapping[str, FramePose], bodies: Sequence[Body]
) -> Iterator[Points]:
    """Ends of the links of frames that move with a joint."""
    for frame in robot.frames:
        if frame.motion == "fixed":
            continue
        start = frames[frame.name][0]
        ends = [frames[one.name][0] for one in robot.frames if one.parent == frame.name]
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


def middle_of(path: Points) -> Vector:
    """The middle of the longest straight piece of a path, in space or in a picture."""
    longest = int(np.argmax(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    return np.asarray(path[longest : longest + 2].mean(axis=0))


def _unrolled(model: Model, c: int, row: int) -> tuple[list[Points], list[Vector]]:
    """Elements and nodes of a cable as a straight line, in the reference pose."""
    robot = model.robot
    reference = robot.reference_pose
    lengths = shape_at(model, reference).length
    along = np.concatenate([[0.0], np.cumsum(lengths[robot.parts[c]])])
    y = -row * ROW * max(node.radius for cable in robot.cables for node in cable.nodes)
    nodes = np.column_stack([along, np.full(len(along), y), np.zeros(len(along))])
    return [nodes[e : e + 2] for e in range(len(nodes) - 1)], list(nodes)


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
