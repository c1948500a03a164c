"""Options of ``simulate``, and the sensors, faults and numbers that they describe."""

from __future__ import annotations

import argparse
import re
from dataclasses import replace
from typing import Final, Literal, NamedTuple, get_args

import numpy as np

from cdrj_ros.commands.running import CommandParser
from cdrj_ros.commands.shared import add_robot_option
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.recordings import Topics
from cdrj_ros.simulation.faults import KINDS as FAULTS
from cdrj_ros.simulation.faults import Fault, FaultKind
from cdrj_ros.simulation.load import KINDS as LOADS
from cdrj_ros.simulation.sensors import JOINT_ENCODER, MOTOR_ENCODER, Encoder, LoadCells

MotionKind = Literal["sine", "ramps", "dwell", "random", "recorded"]
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
        "--duration", type=float, metavar="S", help="duration [s] (60; recorded: the bag's)"
    )
    made.add_argument("--seed", type=int, default=0, help="seed of all random numbers (0)")
    _add_motion_options(made)
    _add_rig_options(made)
    _add_sensor_options(made)
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
        "--amplitude-deg", metavar="DEG",
        help="amplitude about the centre [deg]; with several joints DEG,DEG,... "
        f"({USUAL_AMPLITUDE_DEG:g}, less where the joint's range, the motors or the preload "
        "require it)",
    )  # fmt: skip
    group.add_argument(
        "--amplitude", metavar="X", help="amplitude in rad, or m for a prismatic joint"
    )
    group.add_argument(
        "--centre", metavar="X",
        help="centre of the motion in rad or m; X,X,... (the reference pose, or the nearest "
        "one about which the default amplitude fits into the range)",
    )  # fmt: skip
    group.add_argument(
        "--frequency", default="0.1", metavar="HZ",
        help="frequency of the motion; for a random motion, the highest one; HZ,HZ,... (0.1)",
    )  # fmt: skip
    group.add_argument("--recorded", metavar="BAG", help="bag whose joint angles are repeated")
    group.add_argument(
        "--joint-topic", default=Topics().joints, metavar="TOPIC",
        help="topic of the joint angles in that bag (default %(default)s)",
    )  # fmt: skip
    group.add_argument(
        "--warm-up", type=float, default=0.0, metavar="S",
        help="duration of motion before the recording [s]; the friction state is then unknown (0: "
        "the recording starts at rest in the reference pose at the preload)",
    )  # fmt: skip


def _add_rig_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("rig")
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
        "--load-mass",
        "--payload",
        type=float,
        default=0.3,
        metavar="KG",
        help="mass of the payload [kg] (0.3)",
    )
    group.add_argument(
        "--load",
        choices=LOADS,
        help="kind of load (depends on the joint's frame; rolling for a joint without frames)",
    )
    group.add_argument(
        "--gravity", type=float, default=9.81, metavar="A",
        help="gravity against positive joint angle [m/s^2]; negative: along it (9.81)",
    )  # fmt: skip
    group.add_argument(
        "--damping",
        type=float,
        default=0.0,
        metavar="C",
        help="damping of the joint [N m s/rad] (0)",
    )
    group.add_argument(
        "--motor-speed", type=float, default=5.0, metavar="W",
        help="largest speed of a motor that balances the joint [rad/s] (5)",
    )  # fmt: skip
    group.add_argument(
        "--fault", action="append", default=[], metavar="NAME[/CABLE]@T[:AMOUNT]",
        help="slack or snap: the anchor gives way by AMOUNT mm, slowly or at once; slip: the drum "
        "slips by AMOUNT deg; at T s of the recording; repeatable (default CABLE: the first; "
        "default AMOUNT: depends on the preload)",
    )  # fmt: skip
    group.add_argument(
        "--allow-slack", action="store_true", help="permit motions in which a cable becomes slack"
    )


def _add_sensor_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "sensors",
        "one number for all encoders, or two: MOTORS,JOINTS; by default, encoder readings are "
        "quantised and have no other errors",
    )
    group.add_argument("--motor-counts", type=int, default=MOTOR_ENCODER.counts, metavar="N",
                       help="counts per turn of motor encoders (%(default)s)")  # fmt: skip
    group.add_argument("--joint-counts", type=int, default=JOINT_ENCODER.counts, metavar="N",
                       help="counts per turn of joint encoders (%(default)s)")  # fmt: skip
    group.add_argument("--rate", metavar="HZ", help="readings per second (1000,500)")
    group.add_argument(
        "--noise", default="0", metavar="RAD", help="standard deviation of readings [rad]"
    )
    group.add_argument(
        "--bias", default="0", metavar="RAD", help="constant error of readings [rad]"
    )
    group.add_argument("--jitter", default="0", metavar="S",
                       help="standard deviation of the stamps [s]")  # fmt: skip
    group.add_argument("--dropout", default="0", metavar="SHARE",
                       help="share of readings lost, in [0, 1)")  # fmt: skip
    group.add_argument("--burst", default="0", metavar="S",
                       help="mean duration of a loss [s] (0: one reading at a time)")  # fmt: skip
    group.add_argument("--cell-noise", type=float, default=LoadCells.force_noise, metavar="N",
                       help="noise of recorded tensions and forces [N] (%(default)s)")  # fmt: skip
    group.add_argument("--cell-bias", type=float, default=0.0, metavar="N",
                       help="bias of recorded tensions and forces [N] (0)")  # fmt: skip
    group.add_argument(
        "--effort-noise", type=float, metavar="NM",
        help="write efforts beside the motors' angles, as drives report them, with this noise "
        "[N m] (none are written)",
    )  # fmt: skip


def check_ranges(arguments: argparse.Namespace) -> None:
    """Refuse numbers outside their ranges.

    Raises:
        UsageError: names the option and its range.
    """
    for name, low, high in (
        ("warm_up", 0.0, 1e6),
        ("load_mass", 0.0, 1e6),
        ("gravity", -1e3, 1e3),
        ("damping", 0.0, 1e6),
        ("motor_speed", 1e-3, 1e6),
        ("cell_noise", 0.0, 1e6),
        ("cell_bias", -1e6, 1e6),
    ):
        _require(name, getattr(arguments, name), low, high)
    if arguments.effort_noise is not None:
        _require("effort_noise", arguments.effort_noise, 0.0, 1e6)
    if arguments.duration is not None:
        _require("duration", arguments.duration, 0.01, 1e6)
    _require("cells", arguments.cells, 1, 200)
    _require("seed", arguments.seed, 0, 2**63)
    for name in ("motor_counts", "joint_counts"):
        _require(name, getattr(arguments, name), 1, 2**40)
    if (arguments.motion == "recorded") != (arguments.recorded is not None):
        raise UsageError("--motion recorded and --recorded BAG require each other")


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
    if len(values) not in (1, count):
        wanted = "1 number" if count == 1 else f"1 or {count} numbers"
        raise UsageError(f"--{name} takes {wanted}, got {len(values)}")
    for value in values:
        _require(name, value, low, high)
    return values * count if len(values) == 1 else values


class Sensors(NamedTuple):
    """What is read of the rig."""

    motors: Encoder
    joints: Encoder
    cells: LoadCells
    effort_noise: float | None
    """Standard deviation of the efforts beside the motors' angles [N m]; None: none are read."""


def sensors(arguments: argparse.Namespace) -> Sensors:
    """Encoders, load cells and efforts that the options describe."""
    made = []
    named = {
        name: numbers(name, getattr(arguments, name), 2, low, high)
        for name, low, high in (
            ("noise", 0.0, 10.0),
            ("bias", -10.0, 10.0),
            ("jitter", 0.0, 10.0),
            ("dropout", 0.0, 0.99),
            ("burst", 0.0, 1e3),
        )
    }
    usual = (MOTOR_ENCODER, JOINT_ENCODER)
    rates = [encoder.rate for encoder in usual]
    if arguments.rate is not None:
        rates = numbers("rate", arguments.rate, 2, 0.1, 1e5)
    for k, counts in enumerate((arguments.motor_counts, arguments.joint_counts)):
        made.append(
            replace(
                usual[k], counts=counts, rate=rates[k], noise=named["noise"][k],
                bias=named["bias"][k], jitter_s=named["jitter"][k],
                dropout=named["dropout"][k], burst_s=named["burst"][k],
            )
        )  # fmt: skip
    cells = LoadCells(force_noise=arguments.cell_noise, force_bias=arguments.cell_bias)
    return Sensors(made[0], made[1], cells, arguments.effort_noise)


def faults(arguments: argparse.Namespace) -> tuple[Fault, ...]:
    """The faults of ``--fault NAME[/CABLE]@T[:AMOUNT]``; T counts from the recording's start.

    Raises:
        UsageError: no such fault, or a time or amount out of range.
    """
    return tuple(_fault(text, arguments.warm_up) for text in arguments.fault)


def _fault(text: str, warm_up: float) -> Fault:
    match = re.fullmatch(r"(\w+)(?:/(\w+))?@([^:@/]+)(?::([^:@/]+))?", text)
    kind: FaultKind | None = next((k for k in FAULTS if match and k == match[1]), None)
    try:
        if match is None or kind is None:
            raise ValueError
        begin = float(match[3])
        amount = None if match[4] is None else float(match[4])
    except ValueError:
        raise UsageError(
            f"--fault must be NAME[/CABLE]@T[:AMOUNT] with NAME one of {', '.join(FAULTS)}, T "
            f"in s, AMOUNT in mm (slip: deg), got {text!r}"
        ) from None
    most = 3600.0 if kind == "slip" else 1000.0
    if amount is not None and not 0.0 < amount <= most:
        raise UsageError(f"--fault {text}: the amount must be in (0, {most:g}], got {amount:g}")
    if not 0.0 <= begin < 1e6:
        raise UsageError(f"--fault {text}: the time must be in [0, 1e6) s, got {begin:g}")
    if amount is not None:
        amount = float(np.radians(amount)) if kind == "slip" else amount * 1e-3
    return Fault(kind, begin + warm_up, amount, match[2])
