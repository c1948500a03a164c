"""Commands to the motors of the live rig, checked on creation against the limits of the drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from cdrj_ros.foundation.errors import UsageError

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
