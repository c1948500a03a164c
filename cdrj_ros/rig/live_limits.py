"""Limits of the drives of a live rig: speed, torque, travel, inertia."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.rig.faults import drums_of
from cdrj_ros.robot.description import Robot

USUAL_SPEED: Final = 10.0
"""Of a motor, unless its ``max_speed`` is lower [rad/s]."""

USUAL_TORQUE: Final = 10.0
"""Of a motor whose cables have no greatest tension [N m]."""

USUAL_INERTIA: Final = 1e-4
"""Of a rotor with its drum [kg m^2]; assumed."""

TRAVEL: Final = 1e3
"""From the reference angle to either side [rad]."""

RESOLVED: Final = 0.5
"""Largest angular frequency of a rotor against its cables, as a share of a step's rate."""


@dataclass(frozen=True)
class DriveLimits:
    """Of all motors, in the robot's order."""

    motors: tuple[str, ...]
    reference: tuple[float, ...]
    """Angle from which travel counts [rad]."""
    effort_sign: tuple[int, ...]
    """+1 where the robot's efforts are what the cables exert on the motor."""
    speed: tuple[float, ...]
    """A motor never turns faster [rad/s]."""
    torque: tuple[float, ...]
    """A motor never exerts more [N m]; if position or speed require more, it stalls."""
    inertia: tuple[float, ...]
    """Of rotor and drum, for commands of torque [kg m^2]."""
    damping: float
    """Of every rotor, for commands of torque [N m s/rad]."""
    timeout_s: float
    """Without a new command for this time, a motor under speed or torque holds its angle [s]."""
    travel: float = TRAVEL
    """[rad]."""


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
    """The same limits for all motors, or defaults that suit the robot.

    Args:
        robot: its motors and cables.
        rate: steps per second [Hz].
        speed: [rad/s]; None: 10, or the robot file's ``max_speed`` where that is less.
        torque: [N m]; None: what loads one cable of the motor with its greatest tension.
        inertia: [kg m^2]; None: 1e-4, or what the step can resolve where that is more.
        damping: of the rotors [N m s/rad].
        timeout_s: [s].

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
    """Of the cables against one motor [N m/rad]: of their first elements, all else held."""
    pose = np.array([joint.reference_angle for joint in robot.joints])
    length = shape_at(prepare(robot, check_range=False), pose).length
    first = np.cumsum([0, *(len(cable.nodes) - 1 for cable in robot.cables)])
    total = 0.0
    for cable, node, owner, radius in drums_of(robot):
        if owner == motor:
            element = first[cable] if node == 0 else first[cable + 1] - 1
            total += radius**2 * robot.cables[cable].axial_stiffness / float(length[element])
    return total
