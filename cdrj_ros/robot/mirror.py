"""Reflection of a part of a robot file in space.

A position is reflected, an axis of rotation is reflected and reversed: then a frame turns, and a
cable goes round a pulley, by the same angle with the same ``turn`` as its original.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Final

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.yaml import Document

_CARRIERS: Final = {
    "position": "frame", "axis": "frame", "exit": "exit_frame", "side": "side_frame",
}  # fmt: skip
"""Vectors of a node, and the key of the frame in which each is given."""


def reflect(
    own: Mapping[str, list[Document]], axis: str, refuse: Callable[[str], RobotFileError]
) -> None:
    """Reflect entries of a robot file along an axis, in place; what lies in other frames stays.

    Args:
        own: the entries by kind: frames, cables and visuals.
        axis: ``x``, ``y`` or ``z``.
        refuse: makes the error of what cannot be reflected.

    Raises:
        RobotFileError: the entries are in the plane, or a frame rolls.
    """
    mirror = _Mirror([-1.0 if one == axis else 1.0 for one in "xyz"], refuse)
    frames = {frame["name"] for frame in own["frames"]}
    for frame in own["frames"]:
        mirror.frame(frame, placed="parent" not in frame or frame["parent"] in frames)
    for shape in own["visuals"]:
        if "frame" not in shape or shape["frame"] in frames:
            mirror.visual(shape)
    for node in nodes_of(own):
        mirror.node(node, frames)


def nodes_of(own: Mapping[str, list[Document]]) -> Iterator[Document]:
    """All nodes of the cables among some entries."""
    return (node for cable in own["cables"] for node in cable["nodes"])


class _Mirror:
    def __init__(self, signs: list[float], refuse: Callable[[str], RobotFileError]) -> None:
        self._signs = signs
        self._refuse = refuse

    def _vector(self, entry: Document, key: str, *, rotation: bool = False) -> None:
        """Reflect a vector, and reverse it if it is one of rotation; w of a quaternion stays."""
        if key not in entry:
            return
        first, rest = entry[key][:3], entry[key][3:]
        if len(first) < 3:
            raise self._refuse(f"is possible in space only, where {key} has three numbers")
        signs = [-s if rotation else s for s in self._signs]
        entry[key] = [s * v if v else v for s, v in zip(signs, first, strict=True)] + rest

    def frame(self, frame: Document, *, placed: bool) -> None:
        """Reflect a frame, with its pose if it is ``placed`` in what is reflected."""
        motion = frame["motion"]
        if motion == "rolling":
            raise self._refuse("is not possible with a rolling frame, which has no axis to reverse")
        if motion != "fixed":
            slides = motion == "prismatic"
            frame.setdefault("axis", [1.0, 0.0, 0.0] if slides else [0.0, 0.0, 1.0])
            self._vector(frame, "axis", rotation=not slides)
        if placed:
            self._vector(frame, "origin")
            self._vector(frame, "rpy", rotation=True)
            self._vector(frame, "quaternion", rotation=True)

    def visual(self, shape: Document) -> None:
        """Reflect a shape; a mesh by its scale."""
        if "mesh" in shape:
            shape.setdefault("scale", [1.0, 1.0, 1.0])
        self._vector(shape, "scale")
        self._vector(shape, "origin")
        self._vector(shape, "rpy", rotation=True)

    def node(self, node: Document, frames: Collection[str]) -> None:
        """Reflect those vectors of a node that lie in some frames, or in none that it names."""
        for key, carrier in _CARRIERS.items():
            frame = node.get(carrier, node.get("frame") if key == "side" else None)
            if frame is None or frame in frames:
                rotation = key == "axis" and node["type"] != "swivel"
                self._vector(node, key, rotation=rotation)
                if rotation and "pitch" in node:
                    node["pitch"] = -node["pitch"]
