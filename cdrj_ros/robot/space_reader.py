"""Frames and positions of nodes of a robot file, in the plane or in space."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import cos, hypot, sin, sqrt
from types import MappingProxyType
from typing import Final

from cdrj_ros.foundation.errors import Refusal, ordered
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.couplings import Coupling, coupled_frames
from cdrj_ros.robot.space import (
    GUIDES,
    IDENTITY,
    ContactKind,
    Frame,
    FrameMotion,
    Matrix3,
    Place,
    Vector3,
    quaternion_rotation,
    rpy_rotation,
)

KINDS: Final[MappingProxyType[str, ContactKind]] = MappingProxyType(
    {
        "winch": "pulley",
        "pulley": "pulley",
        "swivel": "swivel",
        "eyelet": "point",
        "cylinder": "cylinder",
        "sphere": "sphere",
        "sheath": "sheath",
    }
)
"""Shape by the type of a node; an anchor is a point or, with a radius, a pulley."""

ONLY_IN_SPACE: Final = frozenset({"swivel", "eyelet", "cylinder", "sphere", "sheath"})
"""Types of nodes that exist in space only."""

_TURNS: Final = MappingProxyType({"ccw": 1, "cw": -1})

_FRAME_KEYS: Final = ("rpy", "quaternion", "axis", "multiplier", "offset")
"""Keys of a frame in space."""

UNIT_TOLERANCE: Final = 1e-3
"""Largest deviation of a quaternion's norm from 1."""


def has_bearing(node_type: str) -> bool:
    """Whether a type of node turns in a bearing; on the others the cable slides."""
    return node_type in KINDS and GUIDES[KINDS[node_type]].bearing


def is_spatial(document: Document) -> bool:
    """Whether a robot is described in space: by a frame or by a node."""
    frames, cables = document.get("frames", []), document["cables"]
    return any(
        len(frame.get("origin", ())) == 3 or any(key in frame for key in _FRAME_KEYS)
        for frame in frames
    ) or any(
        node["type"] in ONLY_IN_SPACE or "axis" in node or len(node.get("position", ())) == 3
        for cable in cables
        for node in cable["nodes"]
    )


def read_frames(
    document: Document,
    planar: bool,
    coupling: Callable[[str, str | None], Coupling],
    refuse: Refusal,
) -> Iterator[Frame]:
    """The base and the frames of the file, parents first.

    Args:
        document: content of the robot file.
        planar: whether it describes the robot in the plane.
        coupling: gives the function of joint angles that is a joint's angle.
        refuse: makes the errors.

    Raises:
        RobotFileError: names the key, what was given and what is allowed.
    """
    known = {"base"}
    yield Frame("base", None, "fixed", None)
    for k, entry in enumerate(document.get("frames", [])):
        path = f"frames[{k}]"
        if entry["name"] == "base":
            raise refuse(f"{path}.name", "'base' is the frame that is always there")
        parent = entry.get("parent", "base")
        if parent not in known:
            raise refuse(
                f"{path}.parent",
                f"must name an earlier frame ({ordered(known)}), got {parent!r}",
            )
        given, joint = entry["motion"], entry.get("joint")
        motion: FrameMotion = "revolute" if given == "continuous" else given
        if motion == "fixed" and joint is not None:
            raise refuse(f"{path}.joint", "has no meaning for a fixed frame")
        if motion == "rolling" and len(coupling(f"{path}.joint", joint).shares) > 1:
            raise refuse(f"{path}.motion", f"must not be rolling: {joint} follows several joints")
        if (motion == "rolling") != ("radius" in entry):
            raise refuse(
                f"{path}.radius", "is required for a rolling frame, and allowed only there"
            )
        known.add(entry["name"])
        place = _in_plane if planar else _in_space
        origin, rotation, axis = place(path, entry, motion, refuse)
        frame = Frame(
            entry["name"],
            parent,
            motion,
            joint,
            origin,
            rotation,
            axis,
            float(entry.get("radius", 0.0)),
            float(entry.get("multiplier", 1.0)),
            float(entry.get("offset", 0.0)),
        )
        if motion == "fixed":
            yield frame
        else:
            yield from coupled_frames(frame, coupling(f"{path}.joint", joint))


def _in_plane(
    path: str, entry: Document, motion: FrameMotion, refuse: Refusal
) -> tuple[Vector3, Matrix3, Vector3]:
    """Origin, rotation and axis of a frame in the plane."""
    if "direction" in entry and motion != "prismatic":
        raise refuse(f"{path}.direction", "is allowed only for a prismatic frame")
    x, y = entry.get("direction", (1.0, 0.0))
    norm = hypot(x, y)
    if norm == 0.0:
        raise refuse(f"{path}.direction", "must not be zero")
    axis = (x / norm, y / norm, 0.0) if motion == "prismatic" else (0.0, 0.0, 1.0)
    angle = float(entry.get("angle", 0.0))
    c, s = cos(angle), sin(angle)
    turned = (c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
    return vector((*entry.get("origin", (0.0, 0.0)), 0.0)), turned, axis


def _in_space(
    path: str, entry: Document, motion: FrameMotion, refuse: Refusal
) -> tuple[Vector3, Matrix3, Vector3]:
    """Origin, rotation and axis of a frame in space."""
    _check_keys(path, entry, refuse)
    default = (1.0, 0.0, 0.0) if motion == "prismatic" else (0.0, 0.0, 1.0)
    return (
        vector(entry.get("origin", (0.0, 0.0, 0.0))),
        _rotation(path, entry, refuse),
        unit_vector(f"{path}.axis", entry.get("axis", default), refuse),
    )


def _check_keys(path: str, entry: Document, refuse: Refusal) -> None:
    """Refuse keys that belong to no frame in space, or to another motion."""
    motion = entry["motion"]
    if motion == "fixed":
        for key in ("axis", "multiplier", "offset"):
            if key in entry:
                raise refuse(f"{path}.{key}", "has no meaning for a fixed frame")
    if motion == "rolling" and "axis" in entry:
        raise refuse(
            f"{path}.axis",
            "has no meaning for a rolling frame: it rolls about its z axis and begins on its "
            "x axis; turn both by rpy",
        )
    for key, instead in (("angle", "rpy"), ("direction", "axis")):
        if key in entry:
            raise refuse(f"{path}.{key}", f"describes a frame in the plane; give {instead} here")
    if len(entry.get("origin", (0, 0, 0))) != 3:
        raise refuse(f"{path}.origin", f"must have three numbers, {IN_SPACE}")


IN_SPACE: Final = "for this robot is described in space (some frame or node is)"
"""Why planar positions are refused."""


def vector(numbers: Sequence[float]) -> Vector3:
    """Vector of three numbers of the file."""
    x, y, z = numbers
    return float(x), float(y), float(z)


def unit_vector(path: str, numbers: Sequence[float], refuse: Refusal) -> Vector3:
    """Unit vector in the direction of three numbers of the file.

    Raises:
        RobotFileError: their length is not between 1e-12 and 1e12.
    """
    x, y, z = vector(numbers)
    norm = sqrt(x * x + y * y + z * z)
    if not 1e-12 < norm < 1e12:
        raise refuse(path, f"must be a direction, not of the length {norm:g}")
    return x / norm, y / norm, z / norm


def _rotation(path: str, entry: Document, refuse: Refusal) -> Matrix3:
    if "quaternion" in entry:
        if "rpy" in entry:
            raise refuse(f"{path}.quaternion", "and rpy are two orientations; give one of them")
        x, y, z, w = map(float, entry["quaternion"])
        norm = sqrt(x * x + y * y + z * z + w * w)
        if abs(norm - 1.0) > UNIT_TOLERANCE:
            raise refuse(f"{path}.quaternion", f"must have the length 1, got {norm:g}")
        return quaternion_rotation(x / norm, y / norm, z / norm, w / norm)
    return rpy_rotation(*entry["rpy"]) if "rpy" in entry else IDENTITY


@dataclass(frozen=True)
class PlaceReader:
    """Reads the positions of one robot file's nodes."""

    frames: Sequence[str]
    """Names of the known frames."""
    planar: bool
    """Whether the robot is described in the plane."""
    refuse: Refusal

    def read(self, path: str, entry: Document) -> Place:
        """Shape and position of a node.

        Raises:
            RobotFileError: names the key, what was given and what is allowed.
        """
        return self._in_plane(path, entry) if self.planar else self._in_space(path, entry)

    def _in_plane(self, path: str, entry: Document) -> Place:
        frame = self._frame(f"{path}.frame", entry.get("frame", "base"))
        position = vector((*entry["position"], 0.0))
        if not entry.get("radius", 0.0) > 0.0:
            if "turn" in entry:
                raise self.refuse(f"{path}.turn", "has no meaning for a point")
            return Place("point", frame, position)
        if "turn" not in entry:
            raise self.refuse(
                f"{path}.turn", "is missing: ccw or cw, the sense in which the cable goes round"
            )
        return Place("pulley", frame, position, turn=_TURNS[entry["turn"]])

    def _in_space(self, path: str, entry: Document) -> Place:
        for key in ("position", "exit"):
            if key in entry and len(entry[key]) != 3:
                raise self.refuse(f"{path}.{key}", f"must have three numbers, {IN_SPACE}")
        kind: ContactKind = KINDS.get(entry["type"], "point")
        if entry["type"] == "anchor" and entry.get("radius", 0.0) > 0.0:
            kind = "pulley"
        if entry["type"] == "winch" and "axis" not in entry:
            kind = "point"
        self._check_axis(path, entry, kind)
        axis = unit_vector(f"{path}.axis", entry.get("axis", (0.0, 0.0, 1.0)), self.refuse)
        self._check_side(path, entry, axis if kind == "cylinder" else (0.0, 0.0, 0.0))
        frame = entry.get("frame", "base")
        far = (f"{path}.exit_frame", entry.get("exit_frame", "base"))
        if "side" in entry:
            far = (f"{path}.side_frame", entry.get("side_frame", frame))
        return Place(
            kind,
            self._frame(f"{path}.frame", frame),
            vector(entry["position"]),
            axis,
            _TURNS.get(entry.get("turn", ""), 0),
            "side" in entry,
            bool(entry.get("ignored_inside", False)),
            bool(entry.get("inside", False)),
            int(entry.get("turns", 0)),
            self._frame(*far),
            vector(entry["exit" if "exit" in entry else "side"])
            if "exit" in entry or "side" in entry
            else (0.0, 0.0, 0.0),
            float(entry.get("length", 0.0)),
        )

    def _check_axis(self, path: str, entry: Document, kind: ContactKind) -> None:
        """Check axis and turn.

        ``GUIDES`` says what a kind needs.
        """
        guide = GUIDES[kind]
        if guide.turn != "allowed" and (guide.turn == "needed") != ("turn" in entry):
            raise self.refuse(
                f"{path}.turn",
                "is missing: ccw or cw, the sense in which the cable goes round the axis"
                if guide.turn == "needed"
                else "has no meaning for a point",
            )
        if guide.axis != ("axis" in entry):
            raise self.refuse(
                f"{path}.axis",
                "has no meaning for a point"
                if "axis" in entry
                else "is missing: three numbers, the direction of the axis in its frame",
            )
        if "turn" in entry and "side" in entry:
            raise self.refuse(f"{path}.side", "and turn both say which way round; give one of them")
        if entry.get("turns", 0) and "turn" not in entry:
            raise self.refuse(f"{path}.turns", "needs turn: ccw or cw")
        for key in ("turn", "side", "turns"):
            if entry.get("inside") and key in entry:
                raise self.refuse(f"{path}.{key}", "has no meaning for a cable inside a ring")
        if "pitch" in entry and kind != "pulley":
            raise self.refuse(f"{path}.pitch", "needs the axis of the drum")

    def _frame(self, path: str, name: str) -> str:
        if name not in self.frames:
            raise self.refuse(path, f"must be one of {ordered(self.frames)}, got {name!r}")
        return name

    def _check_side(self, path: str, entry: Document, axis: Vector3) -> None:
        """Check that the point on the side lies outside a body of the same frame."""
        if "side" not in entry:
            if "side_frame" in entry:
                raise self.refuse(f"{path}.side_frame", "needs side")
            return
        if entry.get("side_frame", entry.get("frame", "base")) != entry.get("frame", "base"):
            return
        x, y, z = (a - b for a, b in zip(entry["side"], entry["position"], strict=True))
        along = x * axis[0] + y * axis[1] + z * axis[2]
        across = sqrt(max(x * x + y * y + z * z - along * along, 0.0))
        distance = sqrt(across * across + along * along)
        if not (distance > entry["radius"] and across > 0.0):
            raise self.refuse(
                f"{path}.side",
                f"must lie outside the radius {entry['radius']:g} m, got a point {distance:g} m "
                "from it; for a cable that runs through a ring, give inside: true instead",
            )
