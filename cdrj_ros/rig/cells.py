"""Division of contacts: every pulley becomes a chain of cells, each with its own bristle.

A divided cable is described by tables of spans and wraps over the joint angles.  For a cable given
by positions the tables are computed here.  They are exact (up to the tables' step) where spans and
wraps are sums of functions of single joints.  This always holds for one joint, and for several
joints if no span crosses two joints at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.description import (
    TABLE_INTERVALS,
    Anchor,
    Cable,
    Node,
    Profile,
    Pulley,
    Robot,
    Winch,
)

Vector = NDArray[np.float64]

SMALLEST_WRAP: Final = 1e-3
"""A pulley whose smallest wrap is below this is not divided [rad]."""

LENGTH_TOLERANCE: Final = 1e-8
"""Largest deviation of a table from the positions [m]."""

WRAP_TOLERANCE: Final = 1e-5
"""Largest deviation of a table from the positions [rad]."""

CHECKED_POSES: Final = 64
"""Number of random poses in which tables are compared with positions."""

_EMPTY: Final[Vector] = np.empty(0)


@dataclass(frozen=True)
class Divided:
    """A robot with contact cells, and the relation of its elements to the undivided robot's."""

    robot: Robot
    spans: NDArray[np.int64]
    """For each element of the undivided robot, its index in the divided one, shape (elements,)."""
    whole: tuple[str, ...]
    """Pulleys and cables that could not be divided, with the reason."""


def divide_contacts(robot: Robot, cells: int) -> Robot:
    """The same robot with every pulley cut into ``cells`` equal contact cells.

    Points, pulleys that the cable nearly leaves, and cables given by positions that depend on
    several joints at once, stay whole: see ``divide``.
    """
    return divide(robot, cells).robot


def divide(robot: Robot, cells: int) -> Divided:
    """Divide as ``divide_contacts`` does, and return the relation of the elements as well."""
    cables, columns, whole = [], [], []
    at = 0
    placed = any(cable.routed or cable.spatial for cable in robot.cables)
    model = prepare(robot) if cells > 1 and placed else None
    for index, cable in enumerate(robot.cables):
        tabulated: Cable | None = cable
        if cable.routed or cable.spatial:
            tabulated = _tabulated(model, index) if model else None
        counts = [1] * len(cable.pulleys)
        inside = [_length_inside(pulley) for pulley in cable.pulleys]
        if tabulated is None:
            if cells > 1:
                whole.append(f"{cable.name}: its spans depend on several joints at once")
            tabulated = cable
        elif cells > 1:
            for p, pulley in enumerate(tabulated.pulleys):
                if not (pulley.radius or inside[p]):
                    whole.append(f"{cable.pulley_names[p]}: a point has no arc to divide")
                elif sum(float(profile.value.min()) for profile in pulley.wrap) >= SMALLEST_WRAP:
                    counts[p] = cells
                else:
                    whole.append(f"{cable.pulley_names[p]}: the cable nearly leaves it")
        cables.append(_cut(tabulated, counts, inside))
        columns += [at + before for before in np.cumsum([0, *counts]).tolist()]
        at += sum(counts) + 1
    return Divided(
        replace(robot, cables=tuple(cables)), np.array(columns, dtype=np.int64), tuple(whole)
    )


def _length_inside(pulley: Pulley) -> float:
    """Length of a sheath [m], which the elements on its two sides share; 0 for other nodes."""
    return pulley.space.length if pulley.space and pulley.space.kind == "sheath" else 0.0


def _cut(cable: Cable, counts: list[int], inside: list[float]) -> Cable:
    if all(count == 1 for count in counts):
        return cable
    nodes: list[Node] = [cable.nodes[0]]
    spans = [cable.spans[0]]
    cuts = zip(cable.pulleys, cable.spans[1:], counts, inside, strict=True)
    for pulley, span, cells, length in cuts:
        wrap = tuple(
            replace(profile, value=profile.value / cells, slope=profile.slope / cells)
            for profile in pulley.wrap
        )
        cell: Pulley = replace(pulley, wrap=wrap, cells=cells)
        nodes += [cell] * cells
        # Half of a sheath's length belongs to the span on either side: what the outer cells do not
        # need of it goes to the spans between the cells.
        moved = (_constant(-0.5 * length * (1.0 - 1.0 / cells)),) if length else ()
        spans[-1] += moved
        spans += [(_constant(length / cells),)] * (cells - 1) + [span + moved]
    nodes.append(cable.nodes[-1])
    return replace(cable, nodes=tuple(nodes), spans=tuple(spans))


@dataclass(frozen=True)
class _Course:
    """Geometry of one cable over one joint's angle, with the other joints in the reference pose."""

    length: NDArray[np.float64]
    """Lengths of the elements [m], shape (points, elements)."""
    by_joint: NDArray[np.float64]
    """Derivatives of the lengths by the joint angle, shape (points, elements)."""
    wrap: NDArray[np.float64]
    """Wrap angles of the pulleys [rad], shape (points, pulleys)."""


def _tabulated(model: Model, index: int) -> Cable | None:
    """The cable by tables instead of positions; None if sums of tables cannot represent it."""
    robot = model.robot
    cable = robot.cables[index]
    first = sum(len(other.nodes) - 1 for other in robot.cables[:index])
    count = len(cable.nodes) - 1
    elements = slice(first, first + count)
    pulleys = slice(first - index, first - index + count - 1)
    reference = np.array([joint.reference_angle for joint in robot.joints])
    rest = shape_at(model, reference)
    length, wrap = rest.length[elements], rest.wrap[pulleys]
    radius = np.array([pulley.radius for pulley in cable.pulleys])

    def free(lengths: NDArray[np.float64], wraps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Lengths without the pulleys' arcs, along the last axis."""
        arcs = 0.5 * radius * wraps
        spans = lengths.copy()
        spans[..., 1:] -= arcs
        spans[..., :-1] -= arcs
        return spans

    spans = [[_constant(value)] for value in free(length, wrap)]
    wraps = [[_constant(value)] for value in wrap]
    for j, joint in enumerate(robot.joints):
        grid = np.linspace(joint.lower, joint.upper, TABLE_INTERVALS + 1)
        course = _along(model, reference, j, grid, elements, pulleys)
        wrap_slope = _slopes(grid, course.wrap)
        change = free(course.length - length, course.wrap - wrap)
        slope = free(course.by_joint, wrap_slope)
        for e in range(count):
            if np.ptp(course.length[:, e]) > 0.0 or np.ptp(change[:, e]) > 0.0:
                spans[e].append(Profile(joint.name, grid, change[:, e].copy(), slope[:, e].copy()))
        for p in range(count - 1):
            if np.ptp(course.wrap[:, p]) > 0.0:
                turned = course.wrap[:, p] - wrap[p]
                wraps[p].append(Profile(joint.name, grid, turned, wrap_slope[:, p].copy()))
    bare = [
        replace(node, place=None, space=None, wrap=tuple(wraps[k - 1]))
        if isinstance(node, Pulley)
        else _without_place(node)
        for k, node in enumerate(cable.nodes)
    ]
    tabulated = replace(cable, nodes=tuple(bare), spans=tuple(map(tuple, spans)))
    return tabulated if _agrees(model, tabulated, elements, pulleys) else None


def _along(
    model: Model, reference: Vector, j: int, grid: Vector, elements: slice, pulleys: slice
) -> _Course:
    poses = np.tile(reference, (grid.size, 1))
    poses[:, j] = grid
    shapes = [shape_at(model, pose) for pose in poses]
    return _Course(
        np.stack([shape.length[elements] for shape in shapes]),
        np.stack([shape.length_by_joint[elements, j] for shape in shapes]),
        np.stack([shape.wrap[pulleys] for shape in shapes]),
    )


def _slopes(grid: Vector, values: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.interpolate import CubicSpline  # slow to import, so only where used

    slopes: NDArray[np.float64] = CubicSpline(grid, values, axis=0)(grid, 1)
    return slopes


def _without_place(node: Node) -> Node:
    """The end node without its position; the tables include cable wound as its frame turns."""
    return replace(node, place=None, space=None) if isinstance(node, Winch) else Anchor()


def _agrees(model: Model, cable: Cable, elements: slice, pulleys: slice) -> bool:
    """Whether tables and positions agree in random poses within the joints' ranges."""
    robot = model.robot
    try:
        alone = prepare(replace(robot, cables=(cable,), frames=(), spatial_frames=()))
    except RobotFileError:  # the sum of tables describes no valid cable
        return False
    lower = np.array([joint.lower for joint in robot.joints])
    upper = np.array([joint.upper for joint in robot.joints])
    shares = np.random.default_rng(0).random((CHECKED_POSES, lower.size))
    for pose in lower + shares * (upper - lower):
        told, found = shape_at(model, pose), shape_at(alone, pose)
        if np.abs(told.length[elements] - found.length).max() > LENGTH_TOLERANCE:
            return False
        wraps = np.abs(told.wrap[pulleys] - found.wrap)
        if wraps.size and wraps.max() > WRAP_TOLERANCE:
            return False
    return True


def _constant(value: float) -> Profile:
    return Profile(None, _EMPTY, np.array([value]), _EMPTY)
