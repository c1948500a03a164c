"""Commands to the motors of the live rig, checked on creation against the limits of the drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import printable

Mode = Literal["position", "velocity", "effort"]
"""Commanded quantity: an angle [rad], a speed [rad/s] or a torque [N m]."""

MODES: Final[tuple[Mode, ...]] = get_args(Mode)

Cause = Literal["malformed", "wrong length", "unknown name", "not finite", "out of range"]
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
    travel: float = TRAVEL
    """Largest travel from the reference angle to either side [rad]."""


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
        "position": limits.travel,
        "velocity": limits.speed[motor],
        "effort": limits.torque[motor],
    }[mode]
    origin = limits.reference[motor] if mode == "position" else 0.0
    if abs(value - origin) > most:
        raise CommandError(
            "out of range",
            f"the {mode} of {name} must be within {most:.4g} {UNITS[mode]}, got {value:g}",
        )
