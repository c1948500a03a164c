"""The parsed geometry of a robot, and the shapes of its bodies: frozen values, SI units.

A robot that is described in the plane lies at z = 0, with all axes along z.  Shapes,
of the robot file or of its URDF, are drawn behind the cables.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import asin, atan2, cos, sin
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal, get_args
from xml.etree import ElementTree as Xml

import numpy as np

from cdrj_ros.foundation.arrays import Matrix
from cdrj_ros.foundation.errors import Refusal, ordered
from cdrj_ros.foundation.yaml import Document

Vector3 = tuple[float, float, float]
Matrix3 = tuple[float, ...]
"""Rotation matrix by rows, nine numbers."""

FrameMotion = Literal["fixed", "revolute", "prismatic", "rolling"]
"""Type of a frame's motion relative to its parent."""

ContactKind = Literal["point", "pulley", "swivel", "cylinder", "sphere", "sheath"]
"""Shape of what a cable touches; a point is an anchor or an eyelet."""


@dataclass(frozen=True)
class Guide:
    """What a kind of guide needs in a robot file."""

    axis: bool = False
    """Its axis is given."""
    turn: Literal["needed", "allowed", "meaningless"] = "meaningless"
    """Whether the sense about the axis is given."""
    bearing: bool = False
    """It turns in a bearing; otherwise the cable slides on it."""


GUIDES: Final[Mapping[ContactKind, Guide]] = MappingProxyType(
    {
        "point": Guide(),
        "pulley": Guide(axis=True, turn="needed", bearing=True),
        "swivel": Guide(axis=True, bearing=True),
        "cylinder": Guide(axis=True, turn="allowed"),
        "sphere": Guide(),
        "sheath": Guide(),
    }
)
"""All kinds; their geometry is in ``cdrj_ros/core/guide_*.cpp``."""

IDENTITY: Final[Matrix3] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Frame:
    """A frame that moves with a joint."""

    name: str
    parent: str | None
    motion: FrameMotion
    joint: str | None
    origin: Vector3 = (0.0, 0.0, 0.0)
    """Origin in the parent [m]."""
    rotation: Matrix3 = IDENTITY
    """Orientation in the parent at joint angle 0."""
    axis: Vector3 = (0.0, 0.0, 1.0)
    """Unit vector of the motion, in the frame."""
    rolling_radius: float = 0.0
    """Radius of both circles of a rolling joint [m]."""
    multiplier: float = 1.0
    """Motion of the frame per motion of its joint [-]."""
    offset: float = 0.0
    """Motion of the frame at joint angle 0 [rad] or [m]."""
    coupled: bool = False
    """Whether it belongs to a coupled joint, and moves with ``joint`` by a share."""


@dataclass(frozen=True)
class Place:
    """Position and shape of a node, for cables described by positions."""

    kind: ContactKind
    frame: str
    position: Vector3
    """Centre, point, or entry, in the frame [m]."""
    axis: Vector3 = (0.0, 0.0, 1.0)
    """Unit vector of the axis, in the frame."""
    turn: int = 0
    """Sense of rotation about the axis: +1 counter-clockwise, -1 clockwise, 0 where it follows from
    the cable's position."""
    sided: bool = False
    """Whether ``exit`` is a point on the side on which the cable passes a round body."""
    ignored_inside: bool = False
    """Whether a body is ignored in poses in which a neighbouring point lies inside it."""
    inside: bool = False
    """Whether the cable runs through the inside of a cylinder or a sphere, as through a ring."""
    turns: int = 0
    """Whole turns around a cylinder in addition to the wrap of less than a turn."""
    exit_frame: str = "base"
    """Frame of the far end of a sheath, or of the point on the side."""
    exit: Vector3 = (0.0, 0.0, 0.0)
    """Far end of a sheath, or the point on the side [m]."""
    length: float = 0.0
    """Length of a sheath [m]."""


def rpy_rotation(roll: float, pitch: float, yaw: float) -> Matrix3:
    """Rotation about the fixed x, then y, then z axis, as in URDF."""
    ci, si, cj, sj, ck, sk = (
        cos(roll), sin(roll), cos(pitch), sin(pitch), cos(yaw), sin(yaw),
    )  # fmt: skip
    return (
        ck * cj, ck * sj * si - sk * ci, ck * sj * ci + sk * si,
        sk * cj, sk * sj * si + ck * ci, sk * sj * ci - ck * si,
        -sj, cj * si, cj * ci,
    )  # fmt: skip


def quaternion_rotation(x: float, y: float, z: float, w: float) -> Matrix3:
    """Rotation matrix of a unit quaternion."""
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF and the link that it carries."""

    name: str
    motion: str
    parent: str
    child: str
    origin: list[float]
    rpy: list[float]
    axis: list[float]
    limits: tuple[float, float] | None
    mimic: tuple[str, float, float] | None
    """Joint, multiplier and offset."""
    max_speed: float = 0.0
    """0: not stated [rad/s] or [m/s]."""


VisualShape = Literal["box", "cylinder", "sphere", "mesh"]
SHAPES: Final[tuple[VisualShape, ...]] = get_args(VisualShape)

MESHES: Final = (".dae", ".obj", ".ply", ".stl")
"""Kinds of files that are read as meshes."""

MOST_VISUALS: Final = 1000
"""Largest number of visuals that are taken from a URDF."""


@dataclass(frozen=True)
class Visual:
    """One shape, carried by a frame."""

    frame: str
    shape: VisualShape
    size: Vector3
    """Of a box its edges, of a cylinder radius, radius and length along z, of a sphere its radius
    [m]; of a mesh its scale [-]."""
    origin: Vector3
    """Centre, or origin of the mesh, in the frame [m]."""
    rotation: Matrix3
    """Orientation in the frame."""
    mesh: str = ""
    """Path of the file of a mesh."""


def read_visuals(document: Document, frames: Collection[str], refuse: Refusal) -> Iterator[Visual]:
    """The visuals of a robot file.

    Args:
        document: satisfies the schema.
        frames: names of the frames.
        refuse: creates errors.

    Raises:
        RobotFileError: an unknown frame, or not exactly one shape.
    """
    for k, entry in enumerate(document.get("visuals", ())):
        frame = entry.get("frame", "base")
        if frame not in frames:
            raise refuse(f"visuals[{k}].frame", f"must be one of {ordered(frames)}, got {frame!r}")
        shapes = [shape for shape in SHAPES if shape in entry]
        if len(shapes) != 1:
            raise refuse(
                f"visuals[{k}]", f"needs one of {', '.join(SHAPES)}, got {ordered(shapes)}"
            )
        (shape,) = shapes
        x, y, z = map(float, entry.get("origin", (0.0, 0.0, 0.0)))
        path = str(Path(refuse.source).parent / entry["mesh"]) if shape == "mesh" else ""
        yield Visual(
            frame, shape, _size(shape, entry), (x, y, z),
            rpy_rotation(*entry.get("rpy", (0.0, 0.0, 0.0))), path,
        )  # fmt: skip


def _size(shape: VisualShape, entry: Document) -> Vector3:
    if shape == "cylinder":
        radius, length = map(float, entry["cylinder"])
        return radius, radius, length
    if shape == "sphere":
        radius = float(entry["sphere"])
        return radius, radius, radius
    x, y, z = map(float, entry["box"] if shape == "box" else entry.get("scale", (1.0, 1.0, 1.0)))
    return x, y, z


def urdf_visuals(
    root: Xml.Element,
    joints: Sequence[UrdfJoint],
    kept: Collection[str],
    moving: Collection[str],
    find: Callable[[str], Path | None],
) -> list[Document]:
    """Entries of ``visuals`` for the links of a URDF; what cannot be drawn is left out.

    Args:
        root: the element ``robot``.
        joints: all joints.
        kept: links that are frames of the robot file.
        moving: joints that move; the others stand at 0.
        find: gives the path of a mesh by its file name, or None.
    """
    carriers = {joint.child: joint for joint in joints}
    found: list[Document] = []
    for link in root.findall("link"):
        at, pose = link.get("name", ""), np.eye(4)
        while at not in kept and at in carriers:
            joint = carriers[at]
            if joint.motion != "fixed" and (joint.mimic or (joint.name,))[0] in moving:
                break
            pose, at = _transform(joint.origin, joint.rpy) @ pose, joint.parent
        if at not in kept and at in carriers:
            continue
        frame = at if at in kept else "base"
        for visual in link.findall("visual"):
            entry = _entry(visual, find)
            if entry is not None:
                whole = pose @ _transform(*_pose(visual))
                found.append(
                    {"frame": frame, **entry, "origin": whole[:3, 3].tolist(), "rpy": _rpy(whole)}
                )
    return found[:MOST_VISUALS]


def _entry(visual: Xml.Element, find: Callable[[str], Path | None]) -> Document | None:
    """The shape of a visual; None if it cannot be drawn."""
    geometry = visual.find("geometry")
    for shape in geometry if geometry is not None else ():
        sizes = {key: _numbers(text) for key, text in shape.attrib.items() if key != "filename"}
        match shape.tag:
            case "box" if len(sizes.get("size", ())) == 3:
                return {"box": sizes["size"]}
            case "cylinder" if sizes.get("radius") and sizes.get("length"):
                return {"cylinder": [*sizes["radius"], *sizes["length"]]}
            case "sphere" if sizes.get("radius"):
                return {"sphere": sizes["radius"][0]}
            case "mesh":
                path = find(shape.get("filename", ""))
                if path is not None and path.suffix.lower() in MESHES:
                    scale = sizes.get("scale", ())
                    return {"mesh": str(path)} | ({"scale": scale} if len(scale) == 3 else {})
    return None


def _pose(visual: Xml.Element) -> tuple[list[float], list[float]]:
    origin = visual.find("origin")
    given = [_numbers("" if origin is None else origin.get(key, "")) for key in ("xyz", "rpy")]
    xyz, rpy = (one if len(one) == 3 else [0.0, 0.0, 0.0] for one in given)
    return xyz, rpy


def _numbers(text: str) -> list[float]:
    """Finite numbers; none if the text has anything else."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return []
    return values if np.isfinite(values).all() else []


def _transform(origin: Sequence[float], rpy: Sequence[float]) -> Matrix:
    pose = np.eye(4)
    pose[:3, :3] = np.reshape(rpy_rotation(*rpy), (3, 3))
    pose[:3, 3] = origin
    return pose


def standing(joint: UrdfJoint, value: float) -> tuple[list[float], list[float]]:
    """Origin and rpy of the link of a joint that stands at a value [rad] or [m]."""
    pose, axis = _transform(joint.origin, joint.rpy), np.array(joint.axis)
    axis = axis / np.linalg.norm(axis)
    if joint.motion == "prismatic":
        pose[:3, 3] += pose[:3, :3] @ (value * axis)
    else:
        cross = np.cross(np.eye(3), axis)  # cross @ v is axis x v
        pose[:3, :3] @= np.eye(3) + sin(value) * cross + (1.0 - cos(value)) * cross @ cross
    return pose[:3, 3].tolist(), _rpy(pose)


def _rpy(pose: Matrix) -> list[float]:
    """Roll, pitch and yaw of a rotation; roll is 0 where only their sum is known."""
    r = pose[:3, :3]
    pitch = asin(min(max(-float(r[2, 0]), -1.0), 1.0))
    if abs(r[2, 0]) > 1.0 - 1e-12:
        return [0.0, pitch, atan2(-r[0, 1], r[1, 1])]
    return [atan2(r[2, 1], r[2, 2]), pitch, atan2(r[1, 0], r[0, 0])]
