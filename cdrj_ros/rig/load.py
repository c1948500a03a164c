"""Load of a joint of the rig: inertia, gravity and damping as functions of its angle q.

    (a0 + a1 cos q) q'' - 1/2 a1 sin q q'^2 + c q' + w0 + w1 cos q + w2 cos 2q = torque

holds for the rolling joint (9'), for a pendulum and for a lifted weight; the torque is that of the
cables.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.joint import RollingLoad
from cdrj_ros.robot.description import Robot

Vector = NDArray[np.float64]

INERTIA, INERTIA_COS, WEIGHT, WEIGHT_COS, WEIGHT_COS_2, DAMPING, COEFFICIENTS = range(7)

LoadKind = Literal["rolling", "pendulum", "lift"]
KINDS: Final[tuple[LoadKind, ...]] = get_args(LoadKind)
"""Names of the loads: the source's rolling joint, a mass on a turning arm, a lifted mass."""


@dataclass(frozen=True)
class Pendulum:
    """A mass on the arm of a revolute joint; the arm is level at q = 0, gravity acts against +q."""

    load_mass: float = 0.3
    """[kg]."""
    arm: float = 0.15
    """[m]; assumed."""
    link_inertia: float = 1e-4
    """Inertia of the link [kg m^2]; assumed."""
    gravity: float = 9.81
    """[m/s^2]."""


@dataclass(frozen=True)
class Lift:
    """A mass that a prismatic joint lifts with +q."""

    load_mass: float = 0.3
    """[kg]."""
    link_mass: float = 0.05
    """Mass of the link that moves with the load [kg]; assumed."""
    gravity: float = 9.81
    """[m/s^2]."""


@dataclass(frozen=True)
class Load:
    """Coefficients of the equation above."""

    body: RollingLoad | Pendulum | Lift
    damping: float = 0.0
    """c [N m s/rad]."""

    def coefficients(self) -> Vector:
        """Shape (COEFFICIENTS,)."""
        body = self.body
        row = np.zeros(COEFFICIENTS)
        row[DAMPING] = self.damping
        if isinstance(body, RollingLoad):
            m_j, m_l = body.joint_mass, body.load_mass
            r, d, g = body.rolling_radius, body.load_distance, body.gravity
            row[INERTIA] = 6.0 * m_j * r**2 + (4.0 * d**2 + 4.0 * r**2) * m_l
            row[INERTIA_COS] = 8.0 * d * r * m_l
            row[WEIGHT_COS] = 2.0 * g * (m_j + m_l) * r
            row[WEIGHT_COS_2] = 2.0 * g * m_l * d
        elif isinstance(body, Pendulum):
            row[INERTIA] = body.load_mass * body.arm**2 + body.link_inertia
            row[WEIGHT_COS] = body.load_mass * body.arm * body.gravity
        else:
            mass = body.load_mass + body.link_mass
            row[INERTIA] = mass
            row[WEIGHT] = mass * body.gravity
        return row

    def torque(self, angle: Vector, speed: Vector, acceleration: Vector) -> Vector:
        """Torque that the cables must exert about the joint [N m]; all arrays of shape (n,)."""
        if isinstance(self.body, RollingLoad):
            torque = self.body.torque(angle, speed, acceleration)
        else:
            k = self.coefficients()
            torque = k[INERTIA] * acceleration + weight(k, angle)
        return torque + self.damping * speed if self.damping else torque


def weight(coefficients: Vector, angle: Vector) -> Vector:
    """Torque that holds the load at rest [N m]."""
    k = coefficients
    held: Vector = k[WEIGHT] + k[WEIGHT_COS] * np.cos(angle) + k[WEIGHT_COS_2] * np.cos(2.0 * angle)
    return held


def energy(coefficients: Vector, angle: Vector, speed: Vector) -> Vector:
    """Sum of kinetic and gravitational energy [J], zero at rest at q = 0; shape (n,)."""
    k = coefficients
    inertia = k[INERTIA] + k[INERTIA_COS] * np.cos(angle)
    raised = (
        k[WEIGHT] * angle
        + k[WEIGHT_COS] * np.sin(angle)
        + 0.5 * k[WEIGHT_COS_2] * np.sin(2.0 * angle)
    )
    total: Vector = 0.5 * inertia * speed**2 + raised
    return total


def make_load(kind: LoadKind, mass: float, damping: float = 0.0, gravity: float = 9.81) -> Load:
    """A load of ``KINDS`` with the assumed dimensions.

    Raises:
        UsageError: there is no such load.
    """
    if kind == "rolling":
        return Load(RollingLoad(load_mass=mass, gravity=gravity), damping)
    if kind == "pendulum":
        return Load(Pendulum(load_mass=mass, gravity=gravity), damping)
    if kind == "lift":
        return Load(Lift(load_mass=mass, gravity=gravity), damping)
    raise UsageError(f"the load must be one of {', '.join(KINDS)}, got {kind!r}")


def usual_load(robot: Robot, joint: int) -> LoadKind:
    """Default load for the joint's type of frame motion; rolling for a joint without frames."""
    name = robot.joints[joint].name
    if name in robot.prismatic_joints:
        return "lift"
    planar = {frame.motion for frame in robot.frames if frame.joint == name}
    in_space = {frame.motion for frame in robot.spatial_frames if frame.joint == name}
    return "pendulum" if planar | in_space == {"revolute"} else "rolling"
