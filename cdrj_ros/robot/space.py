"""The parsed geometry of a robot: frozen values, SI units.

A robot that is described in the plane lies at z = 0, with all axes along z.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, sin
from types import MappingProxyType
from typing import Final, Literal

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
