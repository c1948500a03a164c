"""A robot in one pose as lines and wheels in space, for live pictures.

Cables given by positions in the plane lie in the plane z = 0 of the base frame.  Cables given by
tables have no positions; they are drawn unrolled, as straight lines one above the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Model, shape_at
from cdrj_ros.model.spatial_paths import paths_in_space
from cdrj_ros.report.pose import Pose, centre_of, pose_of, strands_and_arcs
from cdrj_ros.robot.description import Anchor, Winch

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
