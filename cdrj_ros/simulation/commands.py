"""Commands to the motors of the live rig, checked on creation against the limits of the drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import printable

Mode = Literal["position", "velocity", "effort"]
"""Commanded quantity: an angle [rad], a speed [rad/s] or a torque [N m]."""

MODES: Final[tuple[Mode, ...]] = get_args(Mode)

Cause = Literal["malformed", "wrong length", "unknown name", "not finite", "out of range"]
"""Cause of a refusal."""

CAUSES: Final[tuple[Cause, ...]] = get_args(Cause)

MOST_POINTS: Final = 100_000
"""Largest number of points of a trajectory."""

LONGEST_S: Final = 86_400.0
"""Longest duration of a trajectory [s]."""

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
    """Targets of some motors, valid until the next command or the timeout."""

    mode: Mode
    motors: tuple[int, ...]
    """Places in the robot's order."""
    values: tuple[float, ...]
    """One target per motor; the unit depends on the mode."""


@dataclass(frozen=True)
class Trajectory:
    """Angles of some motors over time: linear between points, cubic where speeds are given."""

    motors: tuple[int, ...]
    """Places in the robot's order."""
    time: Vector
    """Time from the start of the trajectory, increasing [s], shape (n,)."""
    angle: Table
    """Angles at the points [rad], shape (n, motors)."""
    speed: Table | None
    """Speeds at the points [rad/s], shape (n, motors); None if not given."""


def checked_command(
    limits: DriveLimits, mode: Mode, names: Sequence[str] | None, values: Sequence[float]
) -> Command:
    """Create a command whose values are all within the drives' limits.

    Args:
        limits: of the drives.
        mode: the commanded quantity.
        names: names of the motors; None for all motors, in the robot's order.
        values: one target per motor.

    Raises:
        CommandError: what is wrong with it.
    """
    motors = _places(limits, names, len(values), mode)
    for motor, value in zip(motors, values, strict=True):
        _require(limits, mode, motor, float(value))
    return Command(mode, motors, tuple(float(value) for value in values))


def command_of_states(
    limits: DriveLimits,
    names: Sequence[str],
    position: Sequence[float],
    velocity: Sequence[float],
    effort: Sequence[float],
) -> Command:
    """Create the command of a message with one field per mode, exactly one of which is filled in.

    Raises:
        CommandError: what is wrong with it.
    """
    given: dict[Mode, Sequence[float]] = {
        "position": position,
        "velocity": velocity,
        "effort": effort,
    }
    filled = [mode for mode in MODES if len(given[mode])]
    if len(filled) != 1:
        raise CommandError(
            "malformed",
            "exactly one of position, velocity and effort must be filled in, got "
            f"{len(filled)} of them",
        )
    return checked_command(limits, filled[0], names, given[filled[0]])


def checked_trajectory(
    limits: DriveLimits,
    names: Sequence[str],
    time_s: Sequence[float],
    positions: Sequence[Sequence[float]],
    velocities: Sequence[Sequence[float]],
) -> Trajectory:
    """Create a trajectory whose points are all within the drives' limits; no points mean stop.

    Args:
        limits: of the drives.
        names: names of the motors.
        time_s: times of the points from the trajectory's start [s].
        positions: positions of every point, one per motor [rad].
        velocities: velocities of every point [rad/s]; either all or none are empty.

    Raises:
        CommandError: what is wrong with it.
    """
    n = len(time_s)
    if n > MOST_POINTS:
        raise CommandError("wrong length", f"at most {MOST_POINTS} points are allowed, got {n}")
    motors = _places(limits, names, len(names), "trajectory")
    for row in positions:
        if len(row) != len(motors):
            raise CommandError(
                "wrong length", f"a point needs {len(motors)} positions, got {len(row)}"
            )
        for motor, value in zip(motors, row, strict=True):
            _require(limits, "position", motor, float(value))
    with_speed = any(len(row) for row in velocities)
    for row in velocities if with_speed else ():
        if len(row) != len(motors):
            raise CommandError(
                "wrong length", f"every point needs {len(motors)} velocities, got {len(row)}"
            )
        for motor, value in zip(motors, row, strict=True):
            _require(limits, "velocity", motor, float(value))
    times = np.array(time_s, dtype=np.float64)
    if n and not (times[0] >= 0.0 and np.all(np.diff(times) > 0.0) and times[-1] <= LONGEST_S):
        raise CommandError(
            "out of range",
            f"time_from_start must increase from at least 0 to at most {LONGEST_S:g} s",
        )
    shape = (n, len(motors))
    speed = np.array(velocities, dtype=np.float64).reshape(shape) if with_speed else None
    return Trajectory(motors, times, np.array(positions, dtype=np.float64).reshape(shape), speed)


def _places(
    limits: DriveLimits, names: Sequence[str] | None, count: int, what: str
) -> tuple[int, ...]:
    """Indices of the named motors."""
    if names is None:
        if count != len(limits.motors):
            raise CommandError(
                "wrong length",
                f"{what} needs {len(limits.motors)} values, for {', '.join(limits.motors)}; "
                f"got {count}",
            )
        return tuple(range(count))
    if len(names) != count or not names:
        raise CommandError(
            "wrong length", f"as many values as names are needed, got {len(names)} and {count}"
        )
    for name in names:
        if name not in limits.motors:
            raise CommandError(
                "unknown name",
                f"there is no motor {printable(name[:60])}, only {', '.join(limits.motors)}",
            )
    if len(set(names)) != len(names):
        raise CommandError("malformed", "a motor is named twice")
    return tuple(limits.motors.index(name) for name in names)


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
