"""The drives of the live rig: their limits, commands within them, and the angles that follow.

In position mode a motor moves to its angle at full speed and stays there; in velocity mode it turns
until the next command or the timeout; in effort mode its torque accelerates the rotor against the
cables (semi-implicit Euler).  In position and velocity mode, a motor that would need more than its
torque limit stalls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation.faults import drums_of

Program = Callable[[int], Vector]
"""Function from the step number to the angles of all motors [rad], shape (motors,)."""

Mode = Literal["position", "velocity", "effort"]
"""Commanded quantity: an angle [rad], a speed [rad/s] or a torque [N m]."""

MODES: Final[tuple[Mode, ...]] = get_args(Mode)

Cause = Literal["malformed", "wrong length", "not finite", "out of range"]
"""Cause of a refusal."""

CAUSES: Final[tuple[Cause, ...]] = get_args(Cause)

TRAVEL: Final = 1e3
"""Largest travel from the reference angle to either side [rad]."""

UNITS: Final = {"position": "rad from its reference angle", "velocity": "rad/s", "effort": "N m"}

HOLDING: Final = "position"

USUAL_SPEED: Final = 10.0
"""Default largest speed of a motor, unless its ``max_speed`` is lower [rad/s]."""

USUAL_TORQUE: Final = 10.0
"""Default largest torque of a motor whose cables have no maximum tension [N m]."""

USUAL_INERTIA: Final = 1e-4
"""Default inertia of a rotor with its drum [kg m^2]; assumed."""

RESOLVED: Final = 0.5
"""Largest angular frequency of a rotor on its cables' stiffness, as a fraction of the step rate."""


@dataclass(frozen=True, eq=False)
class DriveLimits:
    """Limits of all motors, in the robot's order; arrays of shape (motors,)."""

    motors: tuple[str, ...]
    reference: Vector
    """Angle from which travel is measured [rad]."""
    effort_sign: Vector
    """+1 where the robot's effort is the torque that the cables exert on the motor."""
    speed: Vector
    """Largest speed [rad/s]."""
    torque: Vector
    """Largest torque [N m]; a motor stalls if its position or speed requires more."""
    inertia: Vector
    """Inertia of rotor and drum, for effort commands [kg m^2]."""
    damping: float
    """Damping of every rotor, for effort commands [N m s/rad]."""
    timeout_s: float
    """Time without a command after which a motor in velocity or effort mode holds its angle [s]."""


class CommandError(UsageError):
    """A refused command; no part of it is executed."""

    def __init__(self, cause: Cause, message: str) -> None:
        self.cause: Cause = cause
        super().__init__(message)


@dataclass(frozen=True, eq=False)
class Command:
    """Targets of all motors, valid until the next command or the timeout."""

    mode: Mode
    values: Vector
    """The unit depends on the mode; shape (motors,)."""


def checked_command(limits: DriveLimits, mode: Mode, values: Sequence[float]) -> Command:
    """Create a command whose values are all within the drives' limits.

    Args:
        limits: of the drives.
        mode: the commanded quantity.
        values: one target per motor, in the robot's order.

    Raises:
        CommandError: what is wrong with it.
    """
    if len(values) != len(limits.motors):
        raise CommandError(
            "wrong length",
            f"{mode} needs {len(limits.motors)} values, for {', '.join(limits.motors)}; "
            f"got {len(values)}",
        )
    targets = np.array(values, dtype=np.float64)
    away = np.abs(targets - limits.reference if mode == "position" else targets)
    travel = np.full(targets.size, TRAVEL)
    most = {"position": travel, "velocity": limits.speed, "effort": limits.torque}[mode]
    for name, value, size, allowed in zip(limits.motors, targets, away, most, strict=True):
        if not np.isfinite(value):
            raise CommandError("not finite", f"the {mode} of {name} must be finite, got {value}")
        if size > allowed:
            raise CommandError(
                "out of range",
                f"the {mode} of {name} must be within {allowed:.4g} {UNITS[mode]}, got {value:g}",
            )
    return Command(mode, targets)


def drive_limits(
    robot: Robot,
    rate: float,
    *,
    max_speed: float | None = None,
    max_torque: float | None = None,
    rotor_inertia: float | None = None,
    rotor_damping: float = 1e-3,
    command_timeout: float = 0.5,
) -> DriveLimits:
    """Limits from values common to all motors, or from defaults that depend on the robot.

    Args:
        robot: robot with the motors and cables.
        rate: steps per second [Hz].
        max_speed: largest speed [rad/s]; None for 10, or the robot file's ``max_speed`` if lower.
        max_torque: largest torque [N m]; None for the torque that loads one cable of the motor with
            its maximum tension.
        rotor_inertia: inertia [kg m^2]; None for 1e-4, or the least that the step can resolve if
            larger.
        rotor_damping: damping of the rotors [N m s/rad].
        command_timeout: time without a command after which a motor holds [s].

    Raises:
        UsageError: an inertia too small for the step against the cables' stiffness.
    """
    speeds, torques, inertias = [], [], []
    for k, motor in enumerate(robot.motors):
        speeds.append(min(USUAL_SPEED if max_speed is None else max_speed, motor.max_speed))
        strongest = max(
            (abs(radius) * robot.cables[c].maximum_tension for c, _, m, radius in drums_of(robot)
             if m == k),
            default=np.inf,
        )  # fmt: skip
        usual = float(strongest) if np.isfinite(strongest) else USUAL_TORQUE
        torques.append(usual if max_torque is None else max_torque)
        least = _stiffness(robot, k) / (RESOLVED * rate) ** 2
        if rotor_inertia is not None and rotor_inertia < least:
            raise UsageError(
                f"rotor_inertia must be at least {least:.3g} kg m^2 for {motor.name}, got "
                f"{rotor_inertia:g}: steps at {rate:g} Hz do not resolve a lighter rotor on cables"
            )
        inertias.append(max(USUAL_INERTIA, least) if rotor_inertia is None else rotor_inertia)
    signs = np.array([float(motor.effort_sign) for motor in robot.motors])
    return DriveLimits(
        tuple(motor.name for motor in robot.motors), robot.reference_motors, signs,
        np.array(speeds), np.array(torques), np.array(inertias), rotor_damping, command_timeout,
    )  # fmt: skip


def _stiffness(robot: Robot, motor: int) -> float:
    """Stiffness of the cables' first elements against one motor, with all else held [N m/rad]."""
    pose = robot.reference_pose
    length = shape_at(prepare(robot, check_range=False), pose).length
    total = 0.0
    for cable, node, owner, radius in drums_of(robot):
        if owner == motor:
            element = length[robot.parts[cable]][0 if node == 0 else -1]
            total += radius**2 * robot.cables[cable].axial_stiffness / float(element)
    return total


class Drives:
    """All motors of a rig."""

    def __init__(self, limits: DriveLimits, program: Program | None = None) -> None:
        """Start at rest at the reference angles.

        Args:
            limits: limits of the drives.
            program: motion of the motors until the first command; if None, they hold.
        """
        self.limits = limits
        self._program = program
        self.reset()

    def reset(self) -> None:
        """Discard all commands and restart the program."""
        self.angle = self.limits.reference.copy()
        """Angles of all motors [rad], shape (motors,)."""
        self.speed = np.zeros(self.angle.size)
        """Speeds of all motors [rad/s], shape (motors,)."""
        self.mode: Mode = HOLDING
        self._target = self.angle.copy()
        self._heard_s = 0.0
        self.program = self._program
        self.timeouts = 0
        """Number of timeouts in velocity or effort mode."""

    def command(self, command: Command, now_s: float) -> None:
        """Apply a command; a torque accelerates a rotor from its current speed."""
        self.program = None
        self.mode, self._target, self._heard_s = command.mode, command.values, now_s

    def next(self, step: int, now_s: float, dt: float, effort: Vector) -> Vector:
        """Angles of all motors after a step [rad], shape (motors,).

        Args:
            step: number of the step.
            now_s: time at the end of the step [s].
            dt: duration of the step [s].
            effort: efforts of the cables on the motors, with the robot's signs [N m], shape
                (motors,).
        """
        if self.program is not None:
            self._target = self.program(step)
        if self.mode != HOLDING and now_s - self._heard_s > self.limits.timeout_s:
            self.timeouts += 1
            self.mode, self._target = HOLDING, self.angle
        torque = self.limits.effort_sign * effort
        if self.mode == "effort":
            self._accelerate(torque, dt)
        else:
            self._turn(torque, dt)
        return self.angle.copy()

    def stopped(self, angle: Vector) -> None:
        """Set the angles at which the cables stopped the motors [rad], shape (motors,)."""
        self.angle = angle.copy()
        self.speed[:] = 0.0

    def _turn(self, torque: Vector, dt: float) -> None:
        """Advance the motors towards their target angles, or at their target speeds."""
        before, most = self.angle, self.limits.speed * dt
        wanted = before + self._target * dt if self.mode == "velocity" else self._target
        wanted = np.clip(wanted, before - most, before + most)
        against = np.where(wanted > before, -torque, torque)
        self.angle = np.where(against > self.limits.torque, before, wanted)
        self.speed = (self.angle - before) / dt

    def _accelerate(self, torque: Vector, dt: float) -> None:
        """Advance the rotors under the torques of motors and cables."""
        limits = self.limits
        whole = self._target + torque
        speed = (limits.inertia * self.speed + dt * whole) / (limits.inertia + limits.damping * dt)
        self.speed = np.clip(speed, -limits.speed, limits.speed)
        self.angle = self.angle + self.speed * dt
