"""Error messages for geometry that is impossible in a pose."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.state import ScratchViews
from cdrj_ros.robot.description import Cable, Robot
from cdrj_ros.robot.units import unit_doubts

NAMED_ANGLES: Final = 12
"""Joints whose angles are listed in a message."""


def reason(robot: Robot, angle: Vector, views: ScratchViews) -> str:
    """Message of one line that names the impossible node or element and the joint angles.

    It begins with a doubtful unit, if there is one.

    Args:
        robot: the robot.
        angle: of the joints [rad] or [m].
        views: the scratch in this pose, with its geometry.
    """
    angles = [f"{joint.name} = {a:.4g}" for joint, a in zip(robot.joints, angle, strict=True)]
    more = ", ..." if len(angles) > NAMED_ANGLES else ""
    where = f" at {', '.join(angles[:NAMED_ANGLES])}{more}" if angles else ""
    found = next(_impossible(robot, where, views), f"the geometry is impossible{where}")
    doubt = next(unit_doubts(robot), None)
    begin = f"{doubt.where}: {doubt.text} With it " if doubt else ""
    return f"{begin}{found} ({robot.source})"


def _impossible(robot: Robot, where: str, views: ScratchViews) -> Iterator[str]:
    """Impossible nodes and elements, cable by cable."""
    node = element = pulley = 0
    for c, cable in enumerate(robot.cables):
        path, count = f"cables[{c}].nodes", len(cable.nodes)
        if cable.placed:
            yield from _at_nodes(cable, path, where, views.touches[node : node + count])
        for p, wrap in enumerate(views.wrap[pulley : pulley + count - 2]):
            if not wrap >= 0.0:
                yield (
                    f"{path}[{p + 1}] ({cable.name}/{p + 2}) is left by its cable{where}: the wrap "
                    f"angle is {wrap:.4g} rad and must not be negative"
                )
        for e, length in enumerate(views.element_length[element : element + count - 1]):
            if not length > 0.0:
                yield (
                    f"cables[{c}]: element {cable.name}/{e + 1} has the length {length:.4g} m"
                    f"{where}; it must be positive"
                )
        node, element, pulley = node + count, element + count - 1, pulley + count - 2


def _at_nodes(cable: Cable, path: str, where: str, touches: Any) -> Iterator[str]:
    """Nodes at which a cable given by positions is impossible."""
    last = len(cable.nodes) - 1
    for k, node in enumerate(cable.nodes):
        assert node.place is not None
        touch, kind = touches[k], node.place.kind
        if kind in ("pulley", "swivel"):
            for other, free in ((k - 1, touch.before_length), (k + 1, touch.after_length)):
                if 0 <= other <= last and not free > 0.0 and not (kind == "swivel" and other < k):
                    one, two = sorted((k, other))
                    yield (
                        f"{path}[{one}] and nodes[{two}] ({cable.name}) have no common tangent"
                        f"{where}: seen along the axis, one lies inside the circle of the other, "
                        "or the circles overlap where the cable should cross between them"
                    )
        elif kind in ("cylinder", "sphere") and not node.place.ignored_inside:
            seen = slice(0, 3 if kind == "sphere" else 2)
            for other, point in ((k - 1, touch.before), (k + 1, touch.after)):
                distance = float(np.linalg.norm(point[seen]))
                if not distance > node.radius:
                    yield (
                        f"{path}[{k}] ({cable.name}/{k + 1}) has a point of nodes[{other}] inside"
                        f"{where}: {distance:.4g} m from its centre, the radius is "
                        f"{node.radius:g} m"
                    )
