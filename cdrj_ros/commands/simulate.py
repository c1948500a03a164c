"""``simulate``: a bag of the simulated rig, with truth finer than the estimator's model."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.bag import BagWriter, Topics, read_recording
from cdrj_ros.commands.shared import DONE, add_robot_option, run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.progress import progress_bar
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.rig import motion
from cdrj_ros.rig.faults import KINDS as FAULTS
from cdrj_ros.rig.faults import Fault
from cdrj_ros.rig.follow import follow_joints
from cdrj_ros.rig.forward import swing
from cdrj_ros.rig.load import KINDS as LOADS
from cdrj_ros.rig.load import Load, make_load, usual_load
from cdrj_ros.rig.sensors import (
    JOINT_ENCODER,
    MOTOR_ENCODER,
    Encoder,
    LoadCells,
    read_cells,
    read_encoder,
    schedule,
)
from cdrj_ros.rig.truth import Progress, SlackError, Truth, follow, simulate
from cdrj_ros.robot.description import Joint, Motor, Robot

EPOCH_NS: Final = 1_700_000_000_000_000_000
"""Stamp of a simulated recording's start [ns]."""

DWELL_S: Final = 1.0
"""Rest before the motion begins [s]."""

TRUTH_RATE: Final = 1000.0
"""Steps of the simulation per second [Hz]."""

MOTIONS: Final = ("sine", "ramps", "dwell", "random", "recorded")
MODES: Final = ("balance", "follow", "forward")

PRELOAD_FACTORS: Final = (1.25, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Of the preloads, tried in turn where a cable went slack."""

Vector = NDArray[np.float64]
Axes = Sequence[Motor | Joint]


@dataclass(frozen=True)
class _Plan:
    """What is to be simulated."""

    time: Vector
    """[s], with the warm-up, shape (n,)."""
    joints: NDArray[np.float64]
    """Prescribed angles [rad], shape (n, joints)."""
    moved: int
    """The joint that is balanced or free."""
    load: Load
    mode: str
    faults: tuple[Fault, ...]
    allow_slack: bool
    motor_speed: float


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    _check(arguments)
    model = load_model(arguments.robot, arguments.preload)
    encoders = _encoders(arguments)
    plan = _plan(model.robot, arguments)
    with progress_bar("simulating", plan.time.size) as report:
        try:
            truth = _truth(model.robot, plan, arguments.cells, report)
        except SlackError as error:
            raise UsageError(_slack_advice(model, plan, arguments.warm_up, error)) from error
    _write(arguments.out, model, truth, arguments.warm_up, arguments.seed, *encoders)
    for note in (*truth.notes, *_slack_notes(model, truth, arguments.warm_up)):
        print(f"note: {note}")
    print(f"bag: {arguments.out}")
    return DONE


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="simulate", description=__doc__.split(": ", 1)[1])
    parser.add_argument("out", metavar="OUT", help="folder of the new bag")
    add_robot_option(parser)
    parser.add_argument("--duration", type=float, metavar="S", help="[s] (60; recorded: its own)")
    parser.add_argument("--seed", type=int, default=0, help="of everything random (0)")
    _add_motion_options(parser.add_argument_group("motion"))
    _add_rig_options(parser.add_argument_group("rig"))
    _add_sensor_options(
        parser.add_argument_group(
            "sensors", "one number for all encoders, or two: MOTORS,JOINTS; defaults are ideal"
        )
    )
    return parser


def _add_motion_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--motion", choices=MOTIONS, default="sine", help="of the joint (sine)")
    group.add_argument(
        "--joint", action="append", metavar="NAME",
        help="the joint that moves; repeatable (the first); the others are held",
    )  # fmt: skip
    group.add_argument(
        "--amplitude-deg", default="38", metavar="DEG",
        help="to either side of the centre [deg]; with several joints DEG,DEG,... (38)",
    )  # fmt: skip
    group.add_argument(
        "--amplitude", metavar="X", help="the same in rad, or m for a prismatic joint"
    )
    group.add_argument(
        "--centre", metavar="X",
        help="pose about which to move, in rad or m; X,X,... (the reference pose)",
    )  # fmt: skip
    group.add_argument(
        "--frequency", default="0.1", metavar="HZ",
        help="of the motion's cycle, of random motion the highest; HZ,HZ,... (0.1)",
    )  # fmt: skip
    group.add_argument("--recorded", metavar="BAG", help="bag whose joint angles are moved again")
    group.add_argument(
        "--joint-topic", default=Topics().joints, metavar="TOPIC",
        help="of the joint angles in that bag (default %(default)s)",
    )  # fmt: skip
    group.add_argument(
        "--warm-up", type=float, default=0.0, metavar="S",
        help="motion before the recording starts: the friction state is then unknown [s] (0: the "
        "recording starts at rest in the reference pose, just preloaded)",
    )  # fmt: skip


def _add_rig_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--mode", choices=MODES,
        help="balance: motors turn so that the cables carry the joint's load (for one joint); "
        "follow: motors keep the cables' lengths to the joints (for several); forward: motors "
        "follow the motion and the joint moves as cables and load let it",
    )  # fmt: skip
    group.add_argument(
        "--cells", type=int, default=8, help="contact cells a pulley in the truth (8)"
    )
    group.add_argument(
        "--load-mass", "--payload", type=float, default=0.3, metavar="KG", help="payload [kg] (0.3)"
    )
    group.add_argument(
        "--load", choices=LOADS, help="how the joint carries it (by the joint's frame, or rolling)"
    )
    group.add_argument(
        "--gravity", type=float, default=9.81, metavar="A",
        help="against positive joint angle [m/s^2]; negative: along it (9.81)",
    )  # fmt: skip
    group.add_argument(
        "--damping", type=float, default=0.0, metavar="C", help="of the joint [N m s/rad] (0)"
    )
    group.add_argument(
        "--motor-speed", type=float, default=5.0, metavar="W",
        help="fastest that a motor turns to balance the joint [rad/s] (5)",
    )  # fmt: skip
    group.add_argument(
        "--fault", action="append", default=[], metavar="NAME[/CABLE]@T[:AMOUNT]",
        help="slack or snap: the anchor gives way by AMOUNT mm, slowly or at once; slip: the drum "
        "slips by AMOUNT deg; at T s of the recording; repeatable (CABLE: the first; AMOUNT: by "
        "the preload)",
    )  # fmt: skip
    group.add_argument("--allow-slack", action="store_true", help="record slack cables as well")


def _add_sensor_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--motor-counts", type=int, default=MOTOR_ENCODER.counts, metavar="N",
                       help="a turn (%(default)s)")  # fmt: skip
    group.add_argument("--joint-counts", type=int, default=JOINT_ENCODER.counts, metavar="N",
                       help="a turn (%(default)s)")  # fmt: skip
    group.add_argument("--rate", metavar="HZ", help="readings per second (1000,500)")
    group.add_argument("--noise", default="0", metavar="RAD", help="standard deviation [rad]")
    group.add_argument("--bias", default="0", metavar="RAD", help="reads too much by [rad]")
    group.add_argument("--jitter", default="0", metavar="S",
                       help="standard deviation of the stamps [s]")  # fmt: skip
    group.add_argument("--dropout", default="0", metavar="SHARE",
                       help="share of readings lost, in [0, 1)")  # fmt: skip
    group.add_argument("--burst", default="0", metavar="S",
                       help="mean duration of a loss [s] (0: one reading at a time)")  # fmt: skip
    group.add_argument("--cell-noise", type=float, default=LoadCells.force_noise, metavar="N",
                       help="of the recorded tensions and forces [N] (%(default)s)")  # fmt: skip
    group.add_argument("--cell-bias", type=float, default=0.0, metavar="N",
                       help="of the recorded tensions and forces [N] (0)")  # fmt: skip


def _check(arguments: argparse.Namespace) -> None:
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
    if arguments.duration is not None:
        _require("duration", arguments.duration, 0.01, 1e6)
    _require("cells", arguments.cells, 1, 200)
    _require("seed", arguments.seed, 0, 2**63)
    for name in ("motor_counts", "joint_counts"):
        _require(name, getattr(arguments, name), 1, 2**40)
    if (arguments.motion == "recorded") != (arguments.recorded is not None):
        raise UsageError("--motion recorded and --recorded BAG belong together")


def _require(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise UsageError(
            f"--{name.replace('_', '-')} must be in [{low:g}, {high:g}], got {value:g}"
        )


def _numbers(name: str, text: str, count: int, low: float, high: float) -> list[float]:
    """One number for all, or one for each."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise UsageError(f"--{name} must be numbers and commas, got {text!r}") from error
    if len(values) not in (1, count):
        raise UsageError(f"--{name} takes 1 or {count} numbers, got {len(values)}")
    for value in values:
        _require(name, value, low, high)
    return values * count if len(values) == 1 else values


def _encoders(arguments: argparse.Namespace) -> tuple[Encoder, Encoder, LoadCells]:
    """Motor and joint encoders and load cells that the options describe."""
    encoders = []
    named = {
        name: _numbers(name, getattr(arguments, name), 2, low, high)
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
        rates = _numbers("rate", arguments.rate, 2, 0.1, 1e5)
    for k, counts in enumerate((arguments.motor_counts, arguments.joint_counts)):
        encoders.append(
            replace(
                usual[k], counts=counts, rate=rates[k], noise=named["noise"][k],
                bias=named["bias"][k], jitter_s=named["jitter"][k],
                dropout=named["dropout"][k], burst_s=named["burst"][k],
            )
        )  # fmt: skip
    cells = LoadCells(force_noise=arguments.cell_noise, force_bias=arguments.cell_bias)
    return encoders[0], encoders[1], cells


def _faults(arguments: argparse.Namespace) -> tuple[Fault, ...]:
    """``NAME[/CABLE]@T[:AMOUNT]``; T counts from the recording's start."""
    faults = []
    for text in arguments.fault:
        match = re.fullmatch(r"(\w+)(?:/(\w+))?@([^:@/]+)(?::([^:@/]+))?", text)
        kind = match[1] if match else None
        try:
            if match is None or kind not in FAULTS:
                raise ValueError
            begin = float(match[3])
            amount = None if match[4] is None else float(match[4])
        except ValueError:
            raise UsageError(
                f"--fault must be NAME[/CABLE]@T[:AMOUNT] with NAME one of {', '.join(FAULTS)}, T "
                f"in s, AMOUNT in mm ({FAULTS[2]}: deg), got {text!r}"
            ) from None
        most = 3600.0 if kind == "slip" else 1000.0
        if amount is not None and not 0.0 < amount <= most:
            raise UsageError(f"--fault {text}: the amount must be in (0, {most:g}], got {amount:g}")
        if not 0.0 <= begin < 1e6:
            raise UsageError(f"--fault {text}: the time must be in [0, 1e6) s, got {begin:g}")
        if amount is not None:
            amount = float(np.radians(amount)) if kind == "slip" else amount * 1e-3
        faults.append(Fault(kind, begin + arguments.warm_up, amount, match[2]))
    return tuple(faults)


def _plan(robot: Robot, arguments: argparse.Namespace) -> _Plan:
    """Every choice checked against the robot."""
    names = [joint.name for joint in robot.joints]
    if not names:
        raise UsageError(f"simulate moves joints, and {robot.name} has none")
    chosen = arguments.joint or names[:1]
    for name in chosen:
        if name not in names:
            raise UsageError(f"--joint must be one of {', '.join(names)}, got {name!r}")
    if len(set(chosen)) != len(chosen):
        raise UsageError("--joint names a joint twice")
    mode = arguments.mode or ("balance" if len(names) == 1 else "follow")
    if mode != "follow" and len(chosen) > 1:
        raise UsageError(f"--mode {mode} moves one joint; several can --mode follow")
    moved = names.index(chosen[0])
    motions, duration = _motions(robot, [names.index(name) for name in chosen], arguments)
    time = np.arange(round((arguments.warm_up + duration) * TRUTH_RATE) + 1) / TRUTH_RATE
    joints = np.tile([joint.reference_angle for joint in robot.joints], (time.size, 1))
    for index, course in motions.items():
        angle = course(time).angle
        joint = robot.joints[index]
        if angle.min() < joint.lower or angle.max() > joint.upper:
            raise UsageError(
                f"the motion of {joint.name} goes from {angle.min():.4g} to {angle.max():.4g}, "
                f"out of its range [{joint.lower:.4g}, {joint.upper:.4g}]"
            )
        joints[:, index] = angle
    kind = arguments.load or usual_load(robot, moved)
    load = make_load(kind, arguments.load_mass, arguments.damping, arguments.gravity)
    return _Plan(
        time, joints, moved, load, mode, _faults(arguments), arguments.allow_slack,
        arguments.motor_speed,
    )  # fmt: skip


def _motions(
    robot: Robot, chosen: list[int], arguments: argparse.Namespace
) -> tuple[dict[int, motion.Motion], float]:
    """The motion of every moving joint, and how long to simulate beside the warm-up [s]."""
    duration = 60.0 if arguments.duration is None else arguments.duration
    if arguments.motion == "recorded":
        return _recorded(robot, chosen, arguments)
    centres = [robot.joints[index].reference_angle for index in chosen]
    if arguments.centre is not None:
        centres = _numbers("centre", arguments.centre, len(chosen), -1e6, 1e6)
    amplitudes = _amplitudes(robot, chosen, centres, arguments)
    frequencies = _numbers("frequency", arguments.frequency, len(chosen), 1e-4, 50.0)
    motions = {}
    for k, index in enumerate(chosen):
        centre = centres[k]
        shape = (amplitudes[k], frequencies[k])
        if arguments.motion == "random":
            seed = arguments.seed + 1000 * k
            motions[index] = motion.random(*shape, seed, DWELL_S, centre)
        else:
            make = {"sine": motion.sine, "ramps": motion.ramps, "dwell": motion.dwell}
            motions[index] = make[arguments.motion](*shape, DWELL_S, centre)
    return motions, duration


def _amplitudes(
    robot: Robot, chosen: list[int], centres: list[float], arguments: argparse.Namespace
) -> list[float]:
    """[rad] or [m], within the joints' ranges."""
    if arguments.amplitude is not None:
        option, text = "amplitude", arguments.amplitude
    else:
        option, text = "amplitude-deg", arguments.amplitude_deg
    given = _numbers(option, text, len(chosen), -1e6, 1e6)
    amplitudes = []
    for value, index, centre in zip(given, chosen, centres, strict=True):
        joint = robot.joints[index]
        if option == "amplitude-deg" and usual_load(robot, index) == "lift":
            raise UsageError(
                f"{joint.name} is prismatic: --amplitude in m, not --amplitude-deg; its range is "
                f"[{joint.lower:g}, {joint.upper:g}] m"
            )
        amplitude = value if option == "amplitude" else float(np.radians(value))
        most = min(centre - joint.lower, joint.upper - centre)
        if abs(amplitude) > most:
            allowed = most if option == "amplitude" else np.degrees(most)
            raise UsageError(
                f"--{option} {value:g} leaves the range of {joint.name}: at most "
                f"{max(allowed, 0.0):g} to either side of {centre:g}, which --centre moves within "
                f"[{joint.lower:g}, {joint.upper:g}]"
            )
        amplitudes.append(amplitude)
    return amplitudes


def _recorded(
    robot: Robot, chosen: list[int], arguments: argparse.Namespace
) -> tuple[dict[int, motion.Motion], float]:
    names = [robot.joints[index].name for index in chosen]
    topics = Topics(arguments.joint_topic, arguments.joint_topic, ())
    series = read_recording(arguments.recorded, topics, joint_names=names).joints
    motions = {}
    lengths = []
    start = min(int(one.stamp_ns[0]) for one in series.values() if one.stamp_ns.size)
    for index, name in zip(chosen, names, strict=True):
        sensor = robot.joints[index].sensor
        stamps, first = np.unique(series[name].stamp_ns, return_index=True)
        readings = series[name].value[first]
        stamps, readings = stamps[np.isfinite(readings)], readings[np.isfinite(readings)]
        if np.isfinite(sensor.period):
            readings = np.unwrap(readings, period=sensor.period)
        time = np.asarray((stamps - start) * 1e-9, dtype=np.float64)
        motions[index] = motion.recorded(time, sensor.scale * readings + sensor.offset, DWELL_S)
        lengths.append(DWELL_S + motion.recorded_duration(time))
    longest = min(lengths) - arguments.warm_up
    if arguments.duration is not None and arguments.duration > longest:
        raise UsageError(
            f"--duration {arguments.duration:g} is longer than the recorded motion allows: "
            f"{max(longest, 0.0):.4g} s"
        )
    if not longest >= 0.01:
        raise UsageError(f"--warm-up leaves nothing of the recorded motion in {arguments.recorded}")
    return motions, longest if arguments.duration is None else arguments.duration


def _truth(robot: Robot, plan: _Plan, cells: int, report: Progress | None) -> Truth:
    """The plan carried out."""
    if plan.mode == "follow":
        return follow(
            robot, plan.time, plan.joints, cells, report,
            faults=plan.faults, allow_slack=plan.allow_slack,
        )  # fmt: skip
    if plan.mode == "forward":
        motors = follow_joints(prepare(robot), plan.joints).motor_angle
        return swing(
            robot, plan.time, motors, plan.load, cells, report,
            joint=plan.moved, joint_angle=plan.joints, faults=plan.faults,
            allow_slack=plan.allow_slack,
        )  # fmt: skip
    # what the simulation's own steps make of the motion, corners and all
    torque = plan.load.torque(*motion.differences(plan.time, plan.joints[:, plan.moved]))
    return simulate(
        robot, plan.time, plan.joints, torque, plan.motor_speed, cells, report,
        joint=plan.moved, faults=plan.faults, allow_slack=plan.allow_slack,
    )  # fmt: skip


def _slack_advice(model: Model, plan: _Plan, warm_up: float, error: SlackError) -> str:
    """Where a cable went slack, and what preload would keep it taut: tried, not guessed."""
    where = f"t = {error.time - warm_up:.4g} s{', ' + error.pose if error.pose else ''}"
    text = f"the motion asks for a slack cable: element {error.element} has no tension at {where}"
    robot = model.robot
    if not any(cable.preload > 0.0 for cable in robot.cables):
        return f"{text}; there is no preload to raise: give --preload, or --allow-slack"
    for factor in PRELOAD_FACTORS:
        tighter = replace(
            robot,
            cables=tuple(replace(cable, preload=factor * cable.preload) for cable in robot.cables),
        )
        try:
            _truth(tighter, plan, 1, None)
        except UsageError:
            continue
        preloads = ",".join(f"{cable.preload:.4g}" for cable in tighter.cables)
        return f"{text}; with --preload {preloads} it stays taut, with --allow-slack it is recorded"
    return (
        f"{text}; {PRELOAD_FACTORS[-1]:g} times the preload would not help; a smaller motion, "
        "another load, or --allow-slack"
    )


def _slack_notes(model: Model, truth: Truth, warm_up: float) -> list[str]:
    """When each cable was slack in the recording."""
    notes = []
    element = 0
    shown = truth.time >= warm_up
    for cable in model.robot.cables:
        count = len(cable.nodes) - 1
        slack = truth.slack[:, element : element + count].any(axis=1) & shown
        element += count
        if slack.any():
            first = truth.time[np.argmax(slack)] - warm_up
            notes.append(
                f"{cable.name} is slack for {slack.sum() / TRUTH_RATE:.4g} s, first at "
                f"t = {first:.4g} s"
            )
    return notes


def _write(
    path: str,
    model: Model,
    truth: Truth,
    begin: float,
    seed: int,
    motor_encoder: Encoder,
    joint_encoder: Encoder,
    cells: LoadCells,
) -> None:
    generator = np.random.default_rng(seed)
    end = float(truth.time[-1])
    layout, robot = model.layout, model.robot
    topics = Topics()

    def stamps(times: Vector, offset_ns: int = 0) -> NDArray[np.int64]:
        stamp: NDArray[np.int64] = EPOCH_NS + np.round((times - begin) * 1e9).astype(np.int64)
        return stamp - offset_ns

    with BagWriter(path) as bag:
        inputs: tuple[tuple[str, Encoder, Axes, NDArray[np.float64]], ...] = (
            (topics.motors, motor_encoder, robot.motors, truth.motor_angle),
            (topics.joints, joint_encoder, robot.joints, truth.joint_angle),
        )
        for k, (topic, encoder, axes, angles) in enumerate(inputs):
            own = np.random.default_rng([seed, 1 + k])
            plan = schedule(encoder, begin, end, own)
            readings = {
                axis.name: read_encoder(
                    encoder, plan.times, truth.time, angles[:, a], own, axis.sensor
                )
                for a, axis in enumerate(axes)
            }
            # a message has one stamp: axes whose clocks differ have messages of their own
            for offset in dict.fromkeys(axis.sensor.clock_offset_ns for axis in axes):
                names = [axis.name for axis in axes if axis.sensor.clock_offset_ns == offset]
                position = np.stack([readings[name] for name in names], axis=1)
                bag.write_joint_states(topic, stamps(plan.stamps, offset), names, position=position)
        plan = schedule(cells, begin, end, np.random.default_rng([seed, 3]))

        def read(
            values: NDArray[np.float64], noise: float, step: float, bias: float
        ) -> NDArray[np.float64]:
            return read_cells(values, truth.time, plan.times, noise, step, generator, bias)

        tensions, forces, efforts = topics.references
        force = (cells.force_noise, cells.force_step, cells.force_bias)
        torque = (cells.torque_noise, cells.torque_step, cells.torque_bias)
        at = stamps(plan.stamps)
        bag.write_tensions(tensions, at, layout.elements, read(truth.tension, *force))
        if layout.pulleys:
            bag.write_nodal_forces(forces, at, layout.pulleys, read(truth.nodal_force, *force))
        both = np.concatenate([truth.motor_effort, truth.joint_effort], axis=1)
        bag.write_joint_states(
            efforts, at, layout.motors + layout.joints, effort=read(both, *torque)
        )


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("simulate", _body, argv)
