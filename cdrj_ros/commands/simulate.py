"""``simulate``: write a bag of the simulated rig, whose model is finer than the estimator's."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.commands.shared import add_robot_option
from cdrj_ros.commands.simulate_motion import (
    MODES,
    TRUTH_RATE,
    USUAL_AMPLITUDE_DEG,
    Plan,
    adaptable,
    check_ranges,
    make_plan,
    swing_text,
)
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import ProgressBar, say
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.recordings.writer import require_new
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation import motion
from cdrj_ros.simulation.assembly import MotionError, SlackError, Truth
from cdrj_ros.simulation.recorder import Recorder
from cdrj_ros.simulation.rig_file import RigDescription, load_rig
from cdrj_ros.simulation.truth import simulate

SMALLER_SHARES: Final = (0.5, 0.25, 0.125)
"""Shares of the default amplitude, tried in turn if the rig cannot perform the default motion."""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = CommandParser(
        prog="simulate",
        description="Write a bag of the simulated rig, whose model is finer than the estimator's.",
    )
    made.add_argument("out", metavar="OUT", help="folder of the new bag")
    add_robot_option(made)
    made.add_argument(
        "--rig", default="", metavar="FILE",
        help="rig file (YAML) with sensors, drives, load and faults, or the name of an installed "
        "one (ideal)",
    )  # fmt: skip
    made.add_argument("--duration", type=float, metavar="S", help="duration [s] (60)")
    made.add_argument("--seed", type=int, default=0, help="seed of all random numbers (0)")
    _add_motion_options(made)
    _add_physics_options(made)
    return made


def _add_motion_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("motion")
    group.add_argument(
        "--motion", choices=motion.MOTIONS, default="sine", help="motion of the joint (sine)"
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
        "--allow-slack", action="store_true", help="permit motions in which a cable becomes slack"
    )


def _body(argv: Sequence[str]) -> int:
    arguments = parser().parse_args(argv)
    check_ranges(arguments)
    _check_output(Path(arguments.out))
    model = load_model(arguments.robot, arguments.preload)
    rig = load_rig(arguments.rig)
    record = Recorder(model, rig.sensors, arguments.seed)
    plan, truth, reason = _simulated(model, rig, arguments)
    record.write(arguments.out, truth)
    notes = [
        *truth.notes,
        *_slack_notes(model, truth),
        *_motion_notes(model.robot, arguments, plan, reason),
    ]
    for note in notes:
        say(f"note: {note}")
    say(f"bag: {arguments.out}")
    return DONE


def _motion_notes(
    robot: Robot, arguments: argparse.Namespace, plan: Plan, reason: str
) -> tuple[str, ...]:
    """Notes on a motion that differs from what was asked for, or from the usual one."""
    notes = (plan.slower,) if plan.slower else ()
    motions = ", ".join(swing_text(robot, one) for one in plan.swings)
    if reason:
        return (*notes, f"the default motion is reduced to {motions}: {reason}")
    moved = any(one.centre != robot.joints[one.joint].reference_angle for one in plan.swings)
    usual = adaptable(arguments) and moved
    return (*notes, f"the default motion is {motions}") if usual else notes


def _check_output(path: Path) -> None:
    """Refuse an output bag that cannot be written, before the simulation starts.

    Raises:
        BagError: the path exists.
        UsageError: no folder can be made there.
    """
    require_new(path)
    above = next(folder for folder in path.absolute().parents if folder.exists())
    if not above.is_dir() or not os.access(above, os.W_OK):
        raise UsageError(f"{path} cannot be written: {above} is not a folder, or is not writable")


def _simulated(
    model: Model, rig: RigDescription, arguments: argparse.Namespace
) -> tuple[Plan, Truth, str]:
    """Carry out the plan; the default amplitude is reduced until the rig can perform the motion.

    Returns:
        The plan, the truth, and why the default amplitude was reduced; empty if it was not.

    Raises:
        UsageError: the rig cannot perform the motion.
    """
    plan = make_plan(model, arguments, rig)
    try:
        return plan, _run(model, plan), ""
    except MotionError as error:
        refused = error
    for share in SMALLER_SHARES if adaptable(arguments) else ():
        smaller = make_plan(model, arguments, rig, share)
        try:
            return smaller, _run(model, smaller), str(refused)
        except MotionError:
            continue
    if isinstance(refused, SlackError):
        raise UsageError(
            f"{refused}: more --preload or less --amplitude keeps the cables taut, "
            "--allow-slack permits slack"
        ) from refused
    raise refused


def _run(model: Model, plan: Plan) -> Truth:
    """Carry out the plan."""
    with ProgressBar("simulating", plan.time.size) as report:
        return simulate(model.robot, plan.time, plan.joints, progress=report, **plan.rule)


def _slack_notes(model: Model, truth: Truth) -> list[str]:
    """When each cable was slack in the recording."""
    notes = []
    for cable, part in zip(model.robot.cables, model.robot.parts, strict=True):
        slack = truth.slack[:, part].any(axis=1)
        if slack.any():
            notes.append(
                f"{cable.name} is slack for {slack.sum() / TRUTH_RATE:.4g} s, first at "
                f"t = {truth.time[np.argmax(slack)]:.4g} s"
            )
    return notes


main = partial(run_command, "simulate", _body)
"""Entry point; returns the exit code."""
