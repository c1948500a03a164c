"""What an inspection finds of a robot's cables and motors over the joint ranges."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import degrees

from cdrj_ros.foundation.arrays import Matrix
from cdrj_ros.foundation.output import fixed
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot


@dataclass(frozen=True)
class Extent:
    """Smallest and largest value over the poses, and the poses at which they occur."""

    low: float
    high: float
    low_at: tuple[float, ...]
    """Joint angles [rad], or [m] for prismatic joints."""
    high_at: tuple[float, ...]

    @property
    def width(self) -> float:
        """Largest less smallest value."""
        return self.high - self.low


@dataclass(frozen=True)
class ElementCheck:
    """One element of a cable over the joint ranges."""

    name: str
    length: Extent
    """Length of the element, including its share of the arcs [m]."""
    span: Extent
    """Length between the tangent points, including the arc wound on a drum or sector [m]."""
    moment_arm: tuple[Extent, ...]
    """-dL/dq of every joint [m]; [-] for prismatic joints."""


@dataclass(frozen=True)
class PulleyCheck:
    """One pulley of a cable over the joint ranges."""

    name: str
    wrap: Extent
    """Wrap angle [rad]."""
    transmission_at_rest: Extent
    """eta for v -> 0, the limit to be overcome before the cable slips [-]."""
    transmission_sliding: Extent
    """eta for v far above the Stribeck speed [-]."""
    passing: float
    """Length of cable that passes the pulley as the joints move through their ranges [m]."""
    needed: float
    """Length of cable after which it certainly slips: twice the break-away travel [m]."""


@dataclass(frozen=True)
class CableCheck:
    """One cable over the joint ranges."""

    name: str
    elements: tuple[ElementCheck, ...]
    pulleys: tuple[PulleyCheck, ...]
    length: Extent
    """Total length of all elements [m]."""
    moment_arm: tuple[Extent, ...]
    """-dL/dq of the total length for every joint [m]; [-] for prismatic joints."""
    transmission_at_rest: Extent
    """Product over the pulleys [-]."""
    transmission_sliding: Extent
    """Product over the pulleys [-]."""
    stiffness: float
    """dT / dL at the preload in the reference pose [N/m], EA / length of a linear cable."""
    followed: Extent
    """Frictionless tension while the motors follow [N]."""
    worst: Extent
    """Tension at the pulling end when every pulley has to slip [N]."""
    slack_after: tuple[float, ...]
    """Motion of every joint from the reference pose that removes all preload while the motors rest
    [rad] or [m]; infinite if the cable does not move the joint."""


@dataclass(frozen=True)
class MotorCheck:
    """One motor over the joint ranges."""

    name: str
    angle: Extent
    """Motor angle relative to the reference pose [rad]."""
    winding: tuple[float, ...]
    """Length of every cable that the motor winds in per radian [m]."""


@dataclass(frozen=True)
class Inspection:
    """A robot over its joint ranges."""

    model: Model
    poses: Matrix
    """Visited joint angles, shape (poses, joints)."""
    cables: tuple[CableCheck, ...]
    motors: tuple[MotorCheck, ...]
    unmoved: tuple[tuple[float, ...], ...]
    """Poses in which the joints can move without changing the length of any cable."""


@dataclass(frozen=True)
class Suspicion:
    """One suspicious property of a robot."""

    where: str
    """Name of the cable, pulley, element, motor or joint."""
    text: str
    """The finding with its numbers and what it implies."""
    grave: bool = True
    """False for a property that is normal in some mechanisms."""


def pose_text(robot: Robot, pose: Iterable[float]) -> str:
    """Format a pose: ``elbow = 40.0°, slide = 0.120 m``."""
    positions = robot.prismatic_joints
    return ", ".join(
        f"{joint.name} = {fixed(value, 3)} m"
        if joint.name in positions
        else f"{joint.name} = {fixed(degrees(value), 1)}°"
        for joint, value in zip(robot.joints, pose, strict=True)
    )
