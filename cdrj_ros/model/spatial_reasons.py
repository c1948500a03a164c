"""Error messages for cables in space whose path is impossible."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdrj_ros.model.state import ScratchViews
from cdrj_ros.robot.description import Cable


def spatial_reason(cable: Cable, index: int, first_node: int, views: ScratchViews) -> str:
    """Message that names the node at which a cable in space is impossible; empty if none is.

    Args:
        cable: a cable in space.
        index: its place in the robot file.
        first_node: place of its first node in the robot.
        views: views of the scratch in the pose.
    """
    touches: Any = views.touches
    path, last = f"cables[{index}].nodes", len(cable.nodes) - 1
    for k, node in enumerate(cable.nodes):
        assert node.space is not None
        touch, kind = touches[first_node + k], node.space.kind
        if kind in ("pulley", "swivel"):
            for other, free in ((k - 1, touch.before_length), (k + 1, touch.after_length)):
                if 0 <= other <= last and free == 0.0 and not (kind == "swivel" and other < k):
                    one, two = sorted((k, other))
                    return (
                        f"{path}[{one}] and nodes[{two}] ({cable.name}) have no common tangent"
                        ": seen along the axis, the cable would begin inside the circle"
                    )
        elif kind in ("cylinder", "sphere") and not node.space.ignored_inside:
            seen = slice(0, 3 if kind == "sphere" else 2)
            for other, point in ((k - 1, touch.before), (k + 1, touch.after)):
                distance = float(np.linalg.norm(point[seen]))
                if not distance > node.radius:
                    return (
                        f"{path}[{k}] ({cable.name}/{k + 1}) has a point of nodes[{other}] inside: "
                        f"{distance:.4g} m from its centre, the radius is {node.radius:g} m"
                    )
    return ""
