"""The drives of the rig: commands and limits, how they become angles, and how they follow joints.

In position mode a motor moves to its angle at full speed and stays there; in velocity mode it turns
until the next command or the timeout; in effort mode its torque accelerates the rotor against the
cables (semi-implicit Euler).  In position and velocity mode, a motor that would need more than its
torque limit stalls.

Where the motors follow the joints, as a position controller commands, the drums compensate the
cables' changes of length: r dphi = -dL.  With more cables than motors this holds in the
least-squares sense, and the remainder stretches the cables.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal, get_args

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.description import Cable, Joint, Robot, Winch, turns_of
from cdrj_ros.simulation import motion
from cdrj_ros.simulation.assembly import course
from cdrj_ros.simulation.load import AT_AN_END

Mode = Literal["position", "velocity", "effort"]
"""Commanded quantity: an angle [rad], a speed [rad/s] or a torque [N m]."""

MODES: Final[tuple[Mode, ...]] = get_args(Mode)

Cause = Literal["malformed", "wrong length", "not finite", "out of range"]
"""Cause of a refusal."""

CAUSES: Final[tuple[Cause, ...]] = get_args(Cause)

TRAVEL: Final = 1e3
"""Largest travel from the reference angle to either side [rad]."""

UNITS: Final = {"position": "rad from its reference angle", "velocity": "rad/s", "effort": "N m"}


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


class CommandError(UsageError):
    """A refused command; no part of it is executed."""

    def __init__(self, cause: Cause, message: str) -> None:
        self.cause: Cause = cause
        super().__init__(message)


@dataclass(frozen=True)
class Command:
    """A target for every motor, valid until the next command or the timeout."""

    mode: Mode
    values: tuple[float, ...]
    """In the robot's order; the unit depends on the mode."""


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
    for motor, value in enumerate(values):
        _require(limits, mode, motor, float(value))
    return Command(mode, tuple(float(value) for value in values))


def _require(limits: DriveLimits, mode: Mode, motor: int, value: float) -> None:
    """Refuse a value beyond the motor's limits."""
    name = limits.motors[motor]
    if not np.isfinite(value):
        raise CommandError("not finite", f"the {mode} of {name} must be finite, got {value}")
    most = {
        "position": TRAVEL,
        "velocity": limits.speed[motor],
        "effort": limits.torque[motor],
    }[mode]
    origin = limits.reference[motor] if mode == "position" else 0.0
    if abs(value - origin) > most:
        raise CommandError(
            "out of range",
            f"the {mode} of {name} must be within {most:.4g} {UNITS[mode]}, got {value:g}",
        )


Program = Callable[[int], Vector]
"""Function from the step number to the angles of all motors [rad], shape (motors,)."""

HOLDING: Final = "position"

USUAL_SPEED: Final = 10.0
"""Default largest speed of a motor, unless its ``max_speed`` is lower [rad/s]."""

USUAL_TORQUE: Final = 10.0
"""Default largest torque of a motor whose cables have no maximum tension [N m]."""

USUAL_INERTIA: Final = 1e-4
"""Default inertia of a rotor with its drum [kg m^2]; assumed."""

RESOLVED: Final = 0.5
"""Largest angular frequency of a rotor on its cables' stiffness, as a fraction of the step rate."""


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
    for motor in robot.motors:
        speeds.append(min(USUAL_SPEED if max_speed is None else max_speed, motor.max_speed))
        strongest = max(
            (arm * cable.maximum_tension for cable, _, arm in _drums(robot, motor.name)),
            default=np.inf,
        )
        usual = strongest if np.isfinite(strongest) else USUAL_TORQUE
        torques.append(usual if max_torque is None else max_torque)
        least = _stiffness(robot, motor.name) / (RESOLVED * rate) ** 2
        if rotor_inertia is not None and rotor_inertia < least:
            raise UsageError(
                f"rotor_inertia must be at least {least:.3g} kg m^2 for {motor.name}, got "
                f"{rotor_inertia:g}: steps at {rate:g} Hz do not resolve a lighter rotor on cables"
            )
        inertias.append(max(USUAL_INERTIA, least) if rotor_inertia is None else rotor_inertia)
    return DriveLimits(
        tuple(motor.name for motor in robot.motors),
        tuple(robot.reference_motors.tolist()),
        tuple(motor.effort_sign for motor in robot.motors),
        tuple(speeds), tuple(torques), tuple(inertias), rotor_damping, command_timeout,
    )  # fmt: skip


def _drums(robot: Robot, motor: str) -> Iterator[tuple[Cable, int, float]]:
    """Drums of a motor: the cable of each, its element, and what a radian takes up [m/rad]."""
    for cable, part in zip(robot.cables, robot.parts, strict=True):
        for element, node in ((part.start, cable.nodes[0]), (part.stop - 1, cable.nodes[-1])):
            if isinstance(node, Winch) and motor in turns_of(node):
                yield cable, element, node.effective_radius * abs(turns_of(node)[motor])


def _stiffness(robot: Robot, motor: str) -> float:
    """Stiffness of the cables' first elements against one motor, with all else held [N m/rad]."""
    length = shape_at(prepare(robot, check_range=False), robot.reference_pose).length
    return sum(
        arm**2 * cable.axial_stiffness / float(length[element])
        for cable, element, arm in _drums(robot, motor)
    )


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
        self.angle = np.array(self.limits.reference, dtype=np.float64)
        """Angles of all motors [rad], shape (motors,)."""
        self.speed = np.zeros(self.angle.size)
        """Speeds of all motors [rad/s], shape (motors,)."""
        self.mode: Mode = HOLDING
        self._target = self.angle.copy()
        self._heard_s = 0.0
        self.program = self._program
        self.timeouts = 0
        """Number of commands of velocities or efforts that were not renewed in time."""

    def command(self, command: Command, now_s: float) -> None:
        """Apply a command; a torque accelerates the rotor from its current speed."""
        self.program, self.mode, self._heard_s = None, command.mode, now_s
        self._target = np.array(command.values)

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
            self.mode, self._target = HOLDING, self.angle.copy()
        for motor in range(self.angle.size):
            torque = self.limits.effort_sign[motor] * float(effort[motor])
            if self.mode == "effort":
                self._accelerate(motor, torque, dt)
            else:
                self._turn(motor, torque, dt)
        return self.angle.copy()

    def stopped(self, angle: Vector) -> None:
        """Set the angles at which the cables stopped the motors [rad], shape (motors,)."""
        self.angle = angle.copy()
        self.speed[:] = 0.0

    def _turn(self, motor: int, torque: float, dt: float) -> None:
        """Advance a motor towards its target angle, or at its target speed."""
        most = self.limits.speed[motor] * dt
        before = float(self.angle[motor])
        wanted = float(self._target[motor])
        if self.mode == "velocity":
            wanted = before + wanted * dt
        way = wanted - before
        if abs(way) > most:
            wanted = before + (most if way > 0.0 else -most)
        against = -torque if way > 0.0 else torque
        if way != 0.0 and against > self.limits.torque[motor]:
            wanted = before
        self.angle[motor] = wanted
        self.speed[motor] = (wanted - before) / dt

    def _accelerate(self, motor: int, torque: float, dt: float) -> None:
        """Advance a rotor under the motor's and the cables' torque."""
        limits = self.limits
        inertia, damping = limits.inertia[motor], limits.damping
        whole = float(self._target[motor]) + torque
        speed = (inertia * float(self.speed[motor]) + dt * whole) / (inertia + damping * dt)
        speed = min(max(speed, -limits.speed[motor]), limits.speed[motor])
        self.speed[motor] = speed
        self.angle[motor] += speed * dt


MotionName = Literal["none"] | motion.MotionKind

MOTIONS: Final[tuple[MotionName, ...]] = ("none", *motion.MOTIONS)

BEGIN_S: Final = 1.0
"""Rest before the motion [s]."""

SHARE: Final = 0.6
"""Amplitude, as a share of the distance to the nearer end of the range."""

FREQUENCY_HZ: Final = 0.2
"""Frequency of the cycle, or the highest frequency of a random motion [Hz]."""

APPROACH_S: Final = 2.0
"""Duration of the move to the middle of the range if the reference is at its end [s]."""

AHEAD: Final = 50
"""Number of steps that are computed at once."""


@dataclass(frozen=True)
class Following:
    """Motor angles that follow the joints."""

    motor_angle: Table
    """[rad], shape (n, motors)."""
    untaken: Table
    """Uncompensated change of length [m], 0 for cables without a winch, shape (n, cables)."""


def follow_joints(model: Model, joint_angle: Table) -> Following:
    """Motor angles that compensate the cables' changes of length, from the reference pose on.

    Args:
        model: the prepared robot.
        joint_angle: shape (n, joints).

    Raises:
        UsageError: the geometry is impossible in one of the poses.
    """
    robot = model.robot
    reference = robot.reference_pose[None]
    lengths = course(model, np.concatenate([reference, joint_angle])).length
    total = np.add.reduceat(lengths, [part.start for part in robot.parts], axis=1)
    longer, radii = total[1:] - total[0], robot.effective_radii
    wound = np.any(radii != 0.0, axis=1)
    turned = -longer[:, wound] @ np.linalg.pinv(radii[wound]).T
    untaken = np.where(wound, longer + turned @ radii.T, 0.0)
    rest = robot.reference_motors
    return Following(rest + turned, untaken)


def pull_together(model: Model, joint: int) -> Vector:
    """Ratios of the motor speeds that load one joint, scaled to a largest of 1; shape (motors,).

    Raises:
        UsageError: no motor acts on the joint.
    """
    robot = model.robot
    if len(robot.motors) == 1:
        return np.ones(1)
    reference = robot.reference_pose
    span = robot.joints[joint].upper - robot.joints[joint].lower
    poses = np.tile(reference, (2, 1))
    step = 1e-3 * span
    poses[1, joint] += step if reference[joint] + step <= robot.joints[joint].upper else -step
    angles = follow_joints(model, poses).motor_angle
    way = angles[1] - angles[0]
    most = float(np.abs(way).max())
    if most < 1e-9:
        raise UsageError(f"no motor's cable acts on {robot.joints[joint].name}")
    return np.asarray(way / most)


def program_of(
    model: Model, joint: int, rate: float, kind: MotionName, seed: int = 0
) -> Program | None:
    """Motor angles by step of a rig, as in ``simulate --mode forward``.

    The free joint moves about the reference, or about the middle of its range if the reference is
    at an end of it.

    Args:
        model: the prepared robot.
        joint: index of the free joint.
        rate: steps per second [Hz].
        kind: of the motion; if it is none, the function returns None.
        seed: of a random motion.
    """
    if kind == "none":
        return None
    angle_at = _angle_of(model.robot.joints[joint], kind, seed)
    reference = model.robot.reference_pose

    @lru_cache(maxsize=1)
    def block(number: int) -> Table:
        poses = np.tile(reference, (AHEAD, 1))
        poses[:, joint] = angle_at(np.arange(number * AHEAD, (number + 1) * AHEAD) / rate)
        return follow_joints(model, poses).motor_angle

    return lambda step: block(step // AHEAD)[step % AHEAD].copy()


def _angle_of(axis: Joint, kind: motion.MotionKind, seed: int) -> Callable[[Vector], Vector]:
    """Angle of the joint as a function of time."""
    centre, begin = axis.reference_angle, BEGIN_S
    most = min(centre - axis.lower, axis.upper - centre)
    if most < AT_AN_END * (axis.upper - axis.lower):
        centre, begin = 0.5 * (axis.lower + axis.upper), BEGIN_S + APPROACH_S
        most = 0.5 * (axis.upper - axis.lower)
    move = motion.named_motion(kind, SHARE * most, FREQUENCY_HZ, seed)
    away = axis.reference_angle - centre

    def angle(time: Vector) -> Vector:
        left = away * (1.0 - motion.smooth_step((time - BEGIN_S) / APPROACH_S))
        return centre + left + move(time - begin)

    return angle
