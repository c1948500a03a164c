"""Limits of the drives of a live rig: speed, torque, travel, inertia."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation.faults import drums_of

USUAL_SPEED: Final = 10.0
"""Default largest speed of a motor, unless its ``max_speed`` is lower [rad/s]."""

USUAL_TORQUE: Final = 10.0
"""Default largest torque of a motor whose cables have no maximum tension [N m]."""

USUAL_INERTIA: Final = 1e-4
"""Default inertia of a rotor with its drum [kg m^2]; assumed."""

TRAVEL: Final = 1e3
"""Largest travel from the reference angle to either side [rad]."""

RESOLVED: Final = 0.5
"""Largest angular frequency of a rotor on its cables' stiffness, as a fraction of the step rate."""


@dataclass(frozen=True)
class DriveLimits:
    """Limits of all motors, in the robot's order."""

    motors: tuple[str, ...]
    reference: tuple[float, ...]
    """Angle from which travel is measured [rad]."""
    effort_sign: tuple[int, ...]
    """+1 where the robot's effort is the torque that the cables exert on the motor."""
    speed: tuple[float, ...]
    """Largest speed [rad/s]."""
    torque: tuple[float, ...]
    """Largest torque [N m]; a motor stalls if its position or speed requires more."""
    inertia: tuple[float, ...]
    """Inertia of rotor and drum, for effort commands [kg m^2]."""
    damping: float
    """Damping of every rotor, for effort commands [N m s/rad]."""
    timeout_s: float
    """Time without a command after which a motor in velocity or effort mode holds its angle [s]."""
    travel: float = TRAVEL
    """Largest travel from the reference angle to either side [rad]."""


def drive_limits(
    robot: Robot,
    rate: float,
    *,
    speed: float | None = None,
    torque: float | None = None,
    inertia: float | None = None,
    damping: float = 1e-3,
    timeout_s: float = 0.5,
) -> DriveLimits:
    """Limits from values common to all motors, or from defaults that depend on the robot.

    Args:
        robot: robot with the motors and cables.
        rate: steps per second [Hz].
        speed: largest speed [rad/s]; None for 10, or the robot file's ``max_speed`` if lower.
        torque: largest torque [N m]; None for the torque that loads one cable of the motor with its
            maximum tension.
        inertia: inertia [kg m^2]; None for 1e-4, or the least that the step can resolve if larger.
        damping: damping of the rotors [N m s/rad].
        timeout_s: command timeout [s].

    Raises:
        UsageError: an inertia too small for the step against the cables' stiffness.
    """
    speeds, torques, inertias = [], [], []
    for k, motor in enumerate(robot.motors):
        speeds.append(min(USUAL_SPEED if speed is None else speed, motor.max_speed))
        strongest = max(
            (abs(radius) * robot.cables[c].maximum_tension for c, _, m, radius in drums_of(robot)
             if m == k),
            default=np.inf,
        )  # fmt: skip
        usual = float(strongest) if np.isfinite(strongest) else USUAL_TORQUE
        torques.append(usual if torque is None else torque)
        least = _stiffness(robot, k) / (RESOLVED * rate) ** 2
        if inertia is not None and inertia < least:
            raise UsageError(
                f"rotor_inertia must be at least {least:.3g} kg m^2 for {motor.name}, got "
                f"{inertia:g}: steps at {rate:g} Hz do not resolve a lighter rotor on its cables"
            )
        inertias.append(max(USUAL_INERTIA, least) if inertia is None else inertia)
    return DriveLimits(
        tuple(motor.name for motor in robot.motors),
        tuple(motor.reference_angle for motor in robot.motors),
        tuple(motor.effort_sign for motor in robot.motors),
        tuple(speeds), tuple(torques), tuple(inertias), damping, timeout_s,
    )  # fmt: skip


def _stiffness(robot: Robot, motor: int) -> float:
    """Stiffness of the cables' first elements against one motor, with all else held [N m/rad]."""
    pose = np.array([joint.reference_angle for joint in robot.joints])
    length = shape_at(prepare(robot, check_range=False), pose).length
    first = np.cumsum([0, *(len(cable.nodes) - 1 for cable in robot.cables)])
    total = 0.0
    for cable, node, owner, radius in drums_of(robot):
        if owner == motor:
            element = first[cable] if node == 0 else first[cable + 1] - 1
            total += radius**2 * robot.cables[cable].axial_stiffness / float(length[element])
    return total
