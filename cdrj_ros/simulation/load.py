"""Load of a joint of the rig, as functions of its angle q, and where it is at rest under it.

    (a0 + a1 cos q) q'' - 1/2 a1 sin q q'^2 + c q' + w0 + w1 cos q + w2 cos 2q = torque

holds for the rolling joint (9'), for a pendulum and for a lifted weight; the torque is that of the
cables.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from math import floor, log10
from typing import Final, Literal, get_args

import numpy as np

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation.assembly import MotionError, Rig, make_rig

START_POINTS: Final = 2001
"""Number of poses among which the equilibrium at the start is sought."""

AT_AN_END: Final = 0.01
"""Share of the range within which a reference angle counts as at its end."""

USUAL_PAYLOAD: Final = 0.3
"""Payload of the source's prototype [kg]."""

SAG: Final = 0.05
"""Share of its range that a joint may sag under the usual payload."""

UNSOLVED: Final = 1e-4
"""Largest imbalance of torque that is accepted in a step of a free joint [N m]."""

LoadKind = Literal["rolling", "pendulum", "lift"]
KINDS: Final[tuple[LoadKind, ...]] = get_args(LoadKind)
"""Names of the loads: the source's rolling joint, a mass on a turning arm, a lifted mass."""


@dataclass(frozen=True)
class Load:
    """The equation above; of a prismatic joint, q is in m and the torque in N."""

    inertia: float
    """a0 [kg m^2]."""
    inertia_cos: float = 0.0
    """a1 [kg m^2]."""
    weight: float = 0.0
    """w0 [N m]."""
    weight_cos: float = 0.0
    """w1 [N m]."""
    weight_cos_2: float = 0.0
    """w2 [N m]."""
    damping: float = 0.0
    """c [N m s/rad]."""

    def coefficients(self) -> Vector:
        """a0, a1, w0, w1, w2, c for the core, shape (6,)."""
        return np.array(astuple(self))

    def holding(self, angle: Vector) -> Vector:
        """Torque that holds the load at rest [N m]; shape (n,)."""
        turning = self.weight_cos * np.cos(angle) + self.weight_cos_2 * np.cos(2.0 * angle)
        return np.asarray(self.weight + turning)

    def torque(self, angle: Vector, speed: Vector, acceleration: Vector) -> Vector:
        """(4) as (9): torque that the cables must exert [N m]; all arrays of shape (n,)."""
        inertia = self.inertia + self.inertia_cos * np.cos(angle)
        carried = self.holding(angle) - 0.5 * self.inertia_cos * np.sin(angle) * speed**2
        return inertia * acceleration + carried + self.damping * speed


def make_load(
    kind: LoadKind, mass: float = USUAL_PAYLOAD, damping: float = 0.0, gravity: float = 9.81
) -> Load:
    """A load of ``KINDS``, with assumed dimensions.

    ``rolling``: (4)-(9), a mass 0.15 m beyond the centre of a link of 0.2 kg, on circles of
    0.04 m.  ``pendulum``: a mass on an arm of 0.15 m, level at q = 0.  ``lift``: a mass that a
    prismatic joint lifts with +q.  Gravity acts against +q.

    Raises:
        UsageError: there is no such load.
    """
    if kind == "rolling":
        link, radius, distance = 0.2, 0.04, 0.15
        return Load(
            6.0 * link * radius**2 + 4.0 * (distance**2 + radius**2) * mass,
            inertia_cos=8.0 * distance * radius * mass,
            weight_cos=2.0 * gravity * (link + mass) * radius,
            weight_cos_2=2.0 * gravity * mass * distance,
            damping=damping,
        )
    if kind == "pendulum":
        arm, link_inertia = 0.15, 1e-4
        turning = mass * arm**2 + link_inertia
        return Load(turning, weight_cos=mass * arm * gravity, damping=damping)
    if kind == "lift":
        lifted = mass + 0.05  # of the link
        return Load(lifted, weight=lifted * gravity, damping=damping)
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


def balanced_start(rig: Rig, drums: Vector, joints: Vector, joint: int, load: Load) -> float:
    """Angle nearest to the reference at which cables without friction hold the load [rad].

    Raises:
        MotionError: there is none.
    """
    axis = rig.lumped.robot.joints[joint]
    excess = _excess(rig, drums, joints, joint, load)
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
    load: Load,
    stops: tuple[float, float],
) -> float:
    """Angle at which the joint is at rest, held by the cables or by one of its end stops [rad]."""
    lower, upper = stops
    reference = rig.lumped.robot.joints[joint].reference_angle
    excess = _excess(rig, drums, joints, joint, load)
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
        return USUAL_PAYLOAD
    axis, rig = robot.joints[joint], make_rig(robot, 1)
    motors = robot.reference_motors[None]
    joints = robot.reference_pose
    drums = rig.drums(motors)[0]
    torque = cable_torque(rig, drums, joints, joint)
    empty, full = (make_load(kind, mass, 0.0, gravity) for mass in (0.0, 1.0))
    at = _stable(_excess(rig, drums, joints, joint, empty), axis.lower, axis.upper, joints[joint])
    sag = SAG * (axis.upper - axis.lower)
    angle = float(np.clip(joints[joint] if at is None else at, axis.lower + sag, axis.upper - sag))
    below, above = torque(np.array([angle - sag, angle + sag]))
    held = 0.5 * abs(float(above - below))
    heavy = abs(float((full.holding(np.array([angle])) - empty.holding(np.array([angle])))[0]))
    if not 0.0 < held < USUAL_PAYLOAD * heavy:
        return USUAL_PAYLOAD
    digit = 10.0 ** floor(log10(held / heavy))
    return float(f"{floor(held / heavy / digit) * digit:.1g}")


def _excess(
    rig: Rig, drums: Vector, joints: Vector, joint: int, load: Load
) -> Callable[[Vector], Vector]:
    """Torque of the cables beyond what the load needs, as a function of the joint's angle."""
    torque = cable_torque(rig, drums, joints, joint)
    return lambda angle: torque(angle) - load.holding(angle)


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

    ends = angles[near], angles[near + 1]
    return float(brentq(lambda angle: excess(np.array([angle]))[0], *ends, xtol=1e-14))
