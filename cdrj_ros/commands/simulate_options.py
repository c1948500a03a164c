"""Options of ``simulate``, and the numbers that they hold."""

from __future__ import annotations

import argparse
from typing import Final, Literal, get_args

import numpy as np

from cdrj_ros.commands.running import CommandParser
from cdrj_ros.commands.shared import add_robot_option
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.recordings import Topics

MotionKind = Literal["sine", "ramps", "dwell", "random"]
MOTIONS: Final[tuple[MotionKind, ...]] = get_args(MotionKind)

Mode = Literal["balance", "follow", "forward"]
MODES: Final[tuple[Mode, ...]] = get_args(Mode)

USUAL_AMPLITUDE_DEG: Final = 38.0
"""Default amplitude of a revolute joint, if its range allows it [deg]."""

DESCRIPTION: Final = "Write a bag of the simulated rig, whose model is finer than the estimator's."


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = CommandParser(prog="simulate", description=DESCRIPTION)
    made.add_argument("out", metavar="OUT", help="folder of the new bag")
    add_robot_option(made)
    made.add_argument(
        "--rig", default="", metavar="FILE",
        help="rig file (YAML) with sensors, drives, load and faults, or the name of an installed "
        "one (ideal)",
    )  # fmt: skip
    made.add_argument(
        "--duration", type=float, metavar="S", help="duration [s] (60; recorded: the bag's)"
    )
    made.add_argument("--seed", type=int, default=0, help="seed of all random numbers (0)")
    _add_motion_options(made)
    _add_physics_options(made)
    return made


def _add_motion_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("motion")
    group.add_argument(
        "--motion", choices=MOTIONS, default="sine", help="motion of the joint (sine)"
    )
    group.add_argument(
        "--joint", action="append", metavar="NAME",
        help="joint that moves; repeatable (the first); all others are held",
    )  # fmt: skip
    group.add_argument(
        "--amplitude", metavar="X",
        help="amplitude about the centre in rad or m, or in degrees as 20deg; with several joints "
        f"X,X,... ({USUAL_AMPLITUDE_DEG:g}deg, less where the joint's range, the motors or the "
        "preload require it)",
    )  # fmt: skip
    group.add_argument(
        "--centre", metavar="X",
        help="centre of the motion, as the amplitude (the reference pose, or the nearest one about "
        "which the default amplitude fits into the range)",
    )  # fmt: skip
    group.add_argument(
        "--frequency", default="0.1", metavar="HZ",
        help="frequency of the motion; for a random motion, the highest one; HZ,HZ,... (0.1)",
    )  # fmt: skip
    group.add_argument("--recorded", metavar="BAG", help="repeat the joint angles of a bag instead")
    group.add_argument(
        "--joint-topic", default=Topics().joints, metavar="TOPIC",
        help="topic of the joint angles in that bag (default %(default)s)",
    )  # fmt: skip
    group.add_argument(
        "--warm-up", type=float, default=0.0, metavar="S",
        help="duration of motion before the recording [s]; the friction state is then unknown (0: "
        "the recording starts at rest in the reference pose at the preload)",
    )  # fmt: skip


def _add_physics_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("physics")
    group.add_argument(
        "--mode", choices=MODES,
        help="balance: motors turn so that the cables carry the joint's load (for one joint); "
        "follow: motors follow the joints so that the cables keep their lengths (for several); "
        "forward: motors follow the motion and the joint moves by its dynamics",
    )  # fmt: skip
    group.add_argument(
        "--cells", type=int, default=8, help="contact cells per simulated pulley (8)"
    )
    group.add_argument(
        "--payload", type=float, metavar="KG", help="mass of the payload [kg] (the rig file's; 0.3)"
    )
    group.add_argument(
        "--allow-slack", action="store_true", help="permit motions in which a cable becomes slack"
    )


def check_ranges(arguments: argparse.Namespace) -> None:
    """Refuse numbers outside their ranges.

    Raises:
        UsageError: names the option and its range.
    """
    _require("warm_up", arguments.warm_up, 0.0, 1e6)
    if arguments.payload is not None:
        _require("payload", arguments.payload, 0.0, 1e6)
    if arguments.duration is not None:
        _require("duration", arguments.duration, 0.01, 1e6)
    _require("cells", arguments.cells, 1, 200)
    _require("seed", arguments.seed, 0, 2**63)


def _require(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise UsageError(
            f"--{name.replace('_', '-')} must be in [{low:g}, {high:g}], got {value:g}"
        )


def numbers(name: str, text: str, count: int, low: float, high: float) -> list[float]:
    """One number for all, or one for each.

    Raises:
        UsageError: the text is not a list of numbers, their count is wrong or one is out of range.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise UsageError(f"--{name} must be numbers separated by commas, got {text!r}") from error
    return _each(name, values, count, low, high)


def positions(name: str, text: str, prismatic: list[bool]) -> list[float]:
    """Positions of joints: numbers in rad or m, or angles in degrees such as ``20deg``.

    Args:
        name: of the option.
        text: one number for all joints, or one for each.
        prismatic: whether each of the joints is prismatic.

    Raises:
        UsageError: as ``numbers``, or a prismatic joint gets an angle.
    """
    parts = text.split(",")
    if any(part.endswith("deg") for part in parts) and any(prismatic):
        raise UsageError(f"--{name} of a prismatic joint is in m, got {text!r}")
    try:
        values = [
            float(np.radians(float(part[:-3]))) if part.endswith("deg") else float(part)
            for part in parts
        ]
    except ValueError as error:
        raise UsageError(
            f"--{name} must be numbers separated by commas, such as 0.3 or 20deg, got {text!r}"
        ) from error
    return _each(name, values, len(prismatic), -1e6, 1e6)


def _each(name: str, values: list[float], count: int, low: float, high: float) -> list[float]:
    if len(values) not in (1, count):
        wanted = "1 number" if count == 1 else f"1 or {count} numbers"
        raise UsageError(f"--{name} takes {wanted}, got {len(values)}")
    for value in values:
        _require(name, value, low, high)
    return values * count if len(values) == 1 else values
