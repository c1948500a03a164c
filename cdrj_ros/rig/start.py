"""Where the free joint is at the start, and a payload that suits the cables."""

from __future__ import annotations

from collections.abc import Callable
from math import floor, log10
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.rig.assembly import MotionError, Rig, make_rig
from cdrj_ros.rig.load import LoadKind, make_load, weight
from cdrj_ros.robot.description import Robot

Vector = NDArray[np.float64]

START_POINTS: Final = 2001
"""Number of poses among which the equilibrium at the start is sought."""

AT_AN_END: Final = 0.01
"""Share of the range within which a reference angle counts as at its end."""

LARGEST_PAYLOAD: Final = 0.3
"""Payload of the source's prototype [kg]."""

SAG: Final = 0.05
"""Share of its range that a joint may sag under the usual payload."""


def cable_torque(rig: Rig, drums: Vector, joints: Vector, joint: int) -> Callable[[float], float]:
    """Torque of cables without friction on a joint as a function of its angle.

    Args:
        rig: the rig.
        drums: angles of the fine robot's motors [rad].
        joints: angles of all joints [rad], shape (joints,).
        joint: index of the joint.

    Returns:
        A function from [rad] to [N m] along positive joint angle; NaN where cables have no path.
    """
    sign = rig.lumped.robot.joints[joint].effort_sign
    place = rig.fine.state_size + rig.fine.layout.joint_effort.start + joint
    out, empty = np.empty(rig.fine.out_size), np.zeros(rig.fine.state_size)

    def torque(angle: float) -> float:
        pose = joints.copy()
        pose[joint] = angle
        rig.fine.core.step(empty, drums, pose, 0.0, out)
        return float(out[place] * sign)

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
    falls, rises = excess(lower) < 0.0, excess(upper) >= 0.0
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
    drums = rig.drums(motors, rig.wiring.offset(np.zeros(1)))[0]
    torque = cable_torque(rig, drums, joints, joint)
    empty, full = (make_load(kind, mass, 0.0, gravity).coefficients() for mass in (0.0, 1.0))
    at = _stable(_excess(rig, drums, joints, joint, empty), axis.lower, axis.upper, joints[joint])
    sag = SAG * (axis.upper - axis.lower)
    angle = float(np.clip(joints[joint] if at is None else at, axis.lower + sag, axis.upper - sag))
    held = 0.5 * abs(torque(angle + sag) - torque(angle - sag))
    heavy = abs(float((weight(full, np.array([angle])) - weight(empty, np.array([angle])))[0]))
    if not 0.0 < held < LARGEST_PAYLOAD * heavy:
        return LARGEST_PAYLOAD
    digit = 10.0 ** floor(log10(held / heavy))
    return float(f"{floor(held / heavy / digit) * digit:.1g}")


def _excess(
    rig: Rig, drums: Vector, joints: Vector, joint: int, coefficients: Vector
) -> Callable[[float], float]:
    """Torque of the cables beyond what the load needs, as a function of the joint's angle."""
    torque = cable_torque(rig, drums, joints, joint)
    return lambda angle: torque(angle) - float(weight(coefficients, np.array([angle]))[0])


def _stable(
    excess: Callable[[float], float], lower: float, upper: float, wanted: float
) -> float | None:
    """The stable equilibrium nearest to an angle; None if there is none."""
    angles = np.linspace(lower, upper, START_POINTS)
    values = np.array([excess(float(angle)) for angle in angles])
    stable = np.flatnonzero((values[:-1] >= 0.0) & (values[1:] < 0.0))
    if stable.size == 0:
        return None
    near = stable[np.argmin(np.abs(angles[stable] - wanted))]
    from scipy.optimize import brentq  # slow to import, so only where used

    return float(brentq(excess, angles[near], angles[near + 1], xtol=1e-14))
