"""What is wrong with a robot's geometry: doubtful units, and what is impossible in a pose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import degrees, hypot, pi, radians
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.packing import Views
from cdrj_ros.robot.description import Cable, Joint, Robot
from cdrj_ros.robot.groups import joints_of

LARGEST_ANGLE: Final = 2.0 * pi
"""Joint angle beyond which degrees were probably given as radians [rad]."""

SMALLEST_RANGE: Final = radians(pi)
"""Angle within which a whole range was probably given in radians under a key in degrees [rad]."""

LARGEST_RADIUS: Final = 5.0
"""Radius of a drum, pulley or body beyond which millimetres were probably given as metres [m]."""

SMALLEST_RADIUS: Final = 1e-4
"""Radius below which metres were probably given under a key in millimetres [m]."""

FARTHEST: Final = 50.0
"""Coordinate beyond which millimetres were probably given as metres [m]."""

LONGER: Final = 50.0
"""Distance of a node from the origin of its frame, over the largest one between frames, beyond
which one of them was probably given in millimetres."""


@dataclass(frozen=True)
class Suspicion:
    """One suspicious property of a robot."""

    where: str
    """Name of the cable, node, element, motor, joint or frame."""
    text: str
    """The finding with its numbers and what it implies."""
    grave: bool = True
    """False for a property that is normal in some mechanisms."""


def unit_doubts(robot: Robot) -> Iterator[Suspicion]:
    """Numbers in doubtful units, in the order of the file."""
    for joint in robot.joints:
        if joint.name not in robot.prismatic_joints:
            yield from _range(joint)
    for frame in robot.frames:
        yield from _coordinates(f"frame {frame.name}", "origin", frame.origin)
    largest = max((hypot(*frame.origin) for frame in robot.frames), default=0.0)
    for cable in robot.cables:
        yield from _nodes(cable, largest)


def _range(joint: Joint) -> Iterator[Suspicion]:
    farthest = max(abs(joint.lower), abs(joint.upper))
    if farthest > LARGEST_ANGLE:
        yield Suspicion(
            joint.name,
            f"range [{joint.lower:g}, {joint.upper:g}] is in rad, {farthest / (2.0 * pi):.1f} "
            "turns: is it range_deg?",
        )
    elif farthest <= SMALLEST_RANGE:
        yield Suspicion(
            joint.name,
            f"range [{degrees(joint.lower):g}, {degrees(joint.upper):g}] is in degrees: is it "
            "range, in rad?",
        )


def _coordinates(where: str, key: str, values: tuple[float, ...]) -> Iterator[Suspicion]:
    farthest = max(values, key=abs)
    if abs(farthest) > FARTHEST:
        yield Suspicion(where, f"{key} is {farthest:g} m away: is it {key}_mm? A URDF is in m.")


def _nodes(cable: Cable, largest: float) -> Iterator[Suspicion]:
    """Doubtful numbers of nodes; ``largest``: the largest distance between frames [m]."""
    for k, node in enumerate(cable.nodes):
        where = f"{cable.name}/{k + 1}"
        if node.radius > LARGEST_RADIUS:
            yield Suspicion(where, f"radius is {node.radius:g} m: is it radius_mm?")
        elif 0.0 < node.radius < SMALLEST_RADIUS:
            yield Suspicion(where, f"radius is {1e3 * node.radius:g} mm: is it radius, in m?")
        if node.place is None:
            continue
        yield from _coordinates(where, "position", node.place.position)
        away = hypot(*node.place.position)
        if node.place.frame != "base" and FARTHEST >= away > LONGER * largest > 0.0:
            yield Suspicion(
                where,
                f"position is {away:.3g} m from the origin of its frame, and frames are at most "
                f"{largest:.3g} m apart: is it position_mm?",
            )


RIM: Final = 1e-6
"""Depth below the rim at which a point counts as on it, over the radius; as in the core."""


COINCIDENT: Final = 1e-9
"""Share of a cable's length between two nodes below which they count as one point, where it has no
direction; as in the core, up to the size of the robot."""


def reason(robot: Robot, angle: Vector, views: Views) -> str:
    """Message of one line that names the impossible node or element and the joint angles.

    It begins with a doubtful unit, if there is one.

    Args:
        robot: the robot.
        angle: of the joints [rad] or [m].
        views: the scratch in this pose, with its geometry.
    """
    found = next(_impossible(robot, angle, views), "the geometry is impossible")
    doubt = next(unit_doubts(robot), None)
    begin = f"{doubt.where}: {doubt.text} With it " if doubt else ""
    return f"{begin}{found} ({robot.source})"


def _impossible(robot: Robot, angle: Vector, views: Views) -> Iterator[str]:
    """Impossible nodes and elements, cable by cable, with the joints that the cable depends on."""
    node = element = pulley = 0
    for c, cable in enumerate(robot.cables):
        own = joints_of(robot, cable)
        pose = zip(robot.joints, angle, strict=True)
        angles = ", ".join(f"{joint.name} = {a:.4g}" for joint, a in pose if joint.name in own)
        where = f" at {angles}" if angles else ""
        path, count = f"cables[{c}].nodes", len(cable.nodes)
        if cable.placed:
            yield from _at_nodes(cable, path, where, views.touches[node : node + count])
        lengths = views.element_length[element : element + count - 1]
        least = COINCIDENT * float(lengths.sum()) if cable.placed else 0.0
        for e, length in enumerate(lengths):
            if not length > least:
                why = ": its ends coincide" if cable.placed else "; it must be positive"
                yield (
                    f"cables[{c}]: element {cable.name}/{e + 1} has the length {length:.4g} m"
                    f"{where}{why}"
                )
        for p, wrap in enumerate(views.wrap[pulley : pulley + count - 2]):
            if not wrap >= 0.0:
                yield (
                    f"{path}[{p + 1}] ({cable.name}/{p + 2}) is left by its cable{where}: the wrap "
                    f"angle is {wrap:.4g} rad and must not be negative"
                )
        node, element, pulley = node + count, element + count - 1, pulley + count - 2


def _at_nodes(cable: Cable, path: str, where: str, touches: Any) -> Iterator[str]:
    """Nodes at which a cable given by positions is impossible."""
    last = len(cable.nodes) - 1
    for k, node in enumerate(cable.nodes):
        assert node.place is not None
        touch, kind = touches[k], node.place.kind
        seen = slice(0, 3 if kind == "sphere" else 2)
        points = [(k - 1, touch.before[seen]), (k + 1, touch.after[seen])]
        if kind == "pulley":
            for other, point in points:
                if 0 <= other <= last and _distance(point) < (1.0 - RIM) * node.radius:
                    one, two = sorted((k, other))
                    yield _no_tangent(f"{path}[{one}] and nodes[{two}] ({cable.name})", where)
        elif kind == "swivel" and not touch.after_length > 0.0:
            yield _no_tangent(f"{path}[{k}] and nodes[{k + 1}] ({cable.name})", where)
        elif kind in ("cylinder", "sphere"):
            begin = f"{path}[{k}] ({cable.name}/{k + 1})"
            least = (1.0 - 2.0 * RIM if node.place.ignored_inside else 0.0) * node.radius
            for other, point in points:
                if least <= (distance := _distance(point)) < (1.0 - RIM) * node.radius:
                    yield (
                        f"{begin} has a point of nodes[{other}] inside{where}: {distance:.7g} m "
                        f"from its centre, the radius is {node.radius:g} m"
                    )
            side = touch.side[seen] if node.place.sided else None
            if not node.place.inside and _undecided(points[0][1], points[1][1], side):
                towards = "its side point" if node.place.sided else "nodes on both sides of it"
                yield (
                    f"{begin}: rounding decides on which side the cable passes{where}, for "
                    f"{towards} and its centre lie on one line; "
                    "give a side that no point of the cable lies opposite to"
                )


def _distance(point: Vector) -> float:
    return float(np.linalg.norm(point))


def _no_tangent(nodes: str, where: str) -> str:
    return (
        f"{nodes} have no common tangent{where}: seen along the axis, one lies inside the circle "
        "of the other, or the circles overlap where the cable should cross between them"
    )


def _undecided(before: Vector, after: Vector, side: Vector | None) -> bool:
    """Whether points lie opposite to each other to rounding, as in ``core/tangents.cpp``."""
    pairs = [(before, after)] if side is None else [(before, side), (after, side)]
    for one, other in pairs:
        product = float(one @ other)
        if product < 0.0 and product <= (RIM**2 - 1.0) * _distance(one) * _distance(other):
            return True
    return False
