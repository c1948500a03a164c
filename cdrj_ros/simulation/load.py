"""Load of a joint of the rig, as functions of its angle q, and where it is at rest under it.

    (a0 + a1 cos q) q'' - 1/2 a1 sin q q'^2 + c q' + w0 + w1 cos q + w2 cos 2q = torque

holds for the rolling joint (9'), for a pendulum and for a lifted weight; the torque is that of the
cables.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import floor, log10
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.joint import RollingLoad
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation.assembly import MotionError, Rig, make_rig

Vector = NDArray[np.float64]

INERTIA, INERTIA_COS, WEIGHT, WEIGHT_COS, WEIGHT_COS_2, DAMPING, COEFFICIENTS = range(7)

START_POINTS: Final = 2001
"""Number of poses among which the equilibrium at the start is sought."""

AT_AN_END: Final = 0.01
"""Share of the range within which a reference angle counts as at its end."""

LARGEST_PAYLOAD: Final = 0.3
"""Payload of the source's prototype [kg]."""

SAG: Final = 0.05
"""Share of its range that a joint may sag under the usual payload."""

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
    motions = {frame.motion for frame in robot.frames if frame.joint == name}
    return "pendulum" if motions == {"revolute"} else "rolling"


def cable_torque(rig: Rig, drums: Vector, joints: Vector, joint: int) -> Callable[[Vector], Vector]:
    """Torque of cables without friction on a joint as a function of its angle.

    Args:
        rig: the rig.
        drums: angles of the fine robot's motors [rad].
        joints: angles of all joints [rad], shape (joints,).
        joint: index of the joint.

    Returns:
        A function from [rad] to [N m] along positive joint angle, both of shape (n,); NaN where
        cables have no path.
    """
    sign = float(rig.lumped.robot.joints[joint].effort_sign)
    stepper = _core.Stepper(rig.fine.core, joint)

    def torque(angle: Vector) -> Vector:
        poses = np.tile(joints, (angle.size, 1))
        poses[:, joint] = angle
        return stepper.efforts(np.tile(drums, (angle.size, 1)), poses) * sign

    return torque


def balanced_start(
    rig: Rig, drums: Vector, joints: Vector, joint: int, coefficients: Vector
) -> float:
    """Angle nearest to the reference at which cables without friction hold the load [rad].

    Raises:
        MotionError: there is none.
    """
    axis = rig.lumped.robot.joints[joint]
    excess = _excess(rig, drums, joints, joint, coefficients)
    angle = _stable(excess, axis.lower, axis.upper, axis.reference_angle)
    if angle is not None:
        return angle
    room = min(axis.reference_angle - axis.lower, axis.upper - axis.reference_angle)
    hint = (
        f", or no pose balances the preloads of {axis.name}, whose reference_angle "
        f"{axis.reference_angle:g} is at an end of its range; set it inside"
    )
    raise MotionError(
        f"the cables cannot hold the load in any pose of {axis.name} at the start: the preload "
        "is too small, or the load acts in the wrong direction"
        + (hint if room < AT_AN_END * (axis.upper - axis.lower) else "")
    )


def resting_start(
    rig: Rig,
    drums: Vector,
    joints: Vector,
    joint: int,
    coefficients: Vector,
    stops: tuple[float, float],
) -> float:
    """Angle at which the joint is at rest, held by the cables or by one of its end stops [rad]."""
    lower, upper = stops
    reference = rig.lumped.robot.joints[joint].reference_angle
    excess = _excess(rig, drums, joints, joint, coefficients)
    angle = _stable(excess, lower, upper, reference)
    if angle is not None:
        return angle
    at_lower, at_upper = excess(np.array([lower, upper]))
    falls, rises = at_lower < 0.0, at_upper >= 0.0
    if falls and rises:
        return lower if reference - lower < upper - reference else upper
    return upper if rises else lower


def usual_payload(robot: Robot, joint: int, kind: LoadKind, gravity: float) -> float:
    """The source's payload, or less if the joint would sag by more than ``SAG`` of its range [kg].

    It is rounded down to one digit.
    """
    if robot.joints[joint].lower == robot.joints[joint].upper:
        return LARGEST_PAYLOAD
    axis, rig = robot.joints[joint], make_rig(robot, 1)
    motors = np.array([[motor.reference_angle for motor in robot.motors]])
    joints = np.array([other.reference_angle for other in robot.joints])
    drums = rig.drums(motors)[0]
    torque = cable_torque(rig, drums, joints, joint)
    empty, full = (make_load(kind, mass, 0.0, gravity).coefficients() for mass in (0.0, 1.0))
    at = _stable(_excess(rig, drums, joints, joint, empty), axis.lower, axis.upper, joints[joint])
    sag = SAG * (axis.upper - axis.lower)
    angle = float(np.clip(joints[joint] if at is None else at, axis.lower + sag, axis.upper - sag))
    below, above = torque(np.array([angle - sag, angle + sag]))
    held = 0.5 * abs(float(above - below))
    heavy = abs(float((weight(full, np.array([angle])) - weight(empty, np.array([angle])))[0]))
    if not 0.0 < held < LARGEST_PAYLOAD * heavy:
        return LARGEST_PAYLOAD
    digit = 10.0 ** floor(log10(held / heavy))
    return float(f"{floor(held / heavy / digit) * digit:.1g}")


def _excess(
    rig: Rig, drums: Vector, joints: Vector, joint: int, coefficients: Vector
) -> Callable[[Vector], Vector]:
    """Torque of the cables beyond what the load needs, as a function of the joint's angle."""
    torque = cable_torque(rig, drums, joints, joint)
    return lambda angle: torque(angle) - weight(coefficients, angle)


def _stable(
    excess: Callable[[Vector], Vector], lower: float, upper: float, wanted: float
) -> float | None:
    """The stable equilibrium nearest to an angle; None if there is none."""
    angles = np.linspace(lower, upper, START_POINTS)
    values = excess(angles)
    stable = np.flatnonzero((values[:-1] >= 0.0) & (values[1:] < 0.0))
    if stable.size == 0:
        return None
    near = stable[np.argmin(np.abs(angles[stable] - wanted))]
    from scipy.optimize import brentq  # slow to import, so only where used

    def excess_at(angle: float) -> float:
        return float(excess(np.array([angle]))[0])

    return float(brentq(excess_at, angles[near], angles[near + 1], xtol=1e-14))
