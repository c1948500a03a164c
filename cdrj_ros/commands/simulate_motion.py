"""The motion that ``simulate`` prescribes, from its options, checked against the robot."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import radians
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Joint, Motor, Robot
from cdrj_ros.robot.names import known_name
from cdrj_ros.simulation import motion
from cdrj_ros.simulation.drives import follow_joints
from cdrj_ros.simulation.load import USUAL_PAYLOAD, usual_load
from cdrj_ros.simulation.rig_file import RigDescription
from cdrj_ros.simulation.truth import SPEEDING_UP

MODES: Final = ("balance", "follow", "forward")

USUAL_AMPLITUDE_DEG: Final = 38.0
"""Default amplitude of a revolute joint, if its range allows it [deg]."""

DWELL_S: Final = 1.0
"""Rest before the motion begins [s]."""

TRUTH_RATE: Final = 1000.0
"""Steps of the simulation per second [Hz]."""

USUAL_SPEED: Final = 5.0
"""Default largest speed of a motor that balances a joint [rad/s]."""

FOR_THE_MOTION: Final = 0.8
"""Share of an axis's limits that the motion may take; the rest is for the stretch of the cables."""

USUAL_SHARE: Final = 0.25
"""Default amplitude of a prismatic joint, as a share of its range."""

LARGEST_SHARE: Final = 0.4
"""Largest default amplitude, as a share of the joint's range."""

CLEARANCE: Final = 1.1
"""The joint's range reaches at least this many default amplitudes to either side of the centre."""


@dataclass(frozen=True)
class Swing:
    """Amplitude and centre of one joint's motion."""

    joint: int
    """Index of the joint."""
    amplitude: float
    """[rad], or [m] for a prismatic joint."""
    centre: float
    """[rad], or [m] for a prismatic joint."""


@dataclass(frozen=True)
class Plan:
    """What is to be simulated."""

    time: Vector
    """[s], shape (n,)."""
    joints: Table
    """Prescribed angles [rad], shape (n, joints)."""
    rule: dict[str, Any]
    """How the rig is carried along: further arguments of ``simulate``."""
    slower: str
    """A note if the motion is slower than asked for; otherwise empty."""
    swings: tuple[Swing, ...]
    """Amplitudes and centres."""


def adaptable(arguments: argparse.Namespace) -> bool:
    """Whether the command chose the amplitude."""
    return arguments.amplitude is None


def make_plan(
    model: Model, arguments: argparse.Namespace, rig: RigDescription, share: float = 1.0
) -> Plan:
    """Check every choice against the robot.

    Args:
        model: robot whose joints move.
        arguments: arguments of the command line.
        rig: the content of the rig file.
        share: factor of the default amplitude; it does not apply to given amplitudes.

    Raises:
        UsageError: an option does not suit the robot.
    """
    robot = model.robot
    names = [joint.name for joint in robot.joints]
    if not names:
        raise UsageError(f"simulate moves joints, and {robot.name} has none")
    given = arguments.joint or names[:1]
    chosen = [known_name(name, names, dict(robot.document)) for name in given]
    for name in chosen:
        if name not in names:
            raise UsageError(f"--joint must be one of {', '.join(names)}, got {name!r}")
    if len(set(chosen)) != len(chosen):
        raise UsageError("--joint names a joint twice")
    mode = arguments.mode or ("balance" if len(names) == 1 else "follow")
    if mode != "follow" and len(chosen) > 1:
        raise UsageError(f"--mode {mode} moves only one joint; --mode follow moves several")
    moved = names.index(chosen[0])
    indices = [names.index(name) for name in chosen]
    swings = _swings(robot, indices, arguments, share)
    motions = _motions(swings, arguments)
    duration = 60.0 if arguments.duration is None else arguments.duration
    time = np.arange(round(duration * TRUTH_RATE) + 1) / TRUTH_RATE
    joints = _prescribed(robot, time - DWELL_S, swings, motions)
    speed = rig.drives.get("max_speed", USUAL_SPEED)
    acceleration = rig.drives.get("max_acceleration", SPEEDING_UP * speed)
    limits = (speed, acceleration) if mode == "balance" else (np.inf, np.inf)
    slower, because = _slower(model, time, joints, *limits)
    if slower > 1.0:
        joints = _prescribed(robot, (time - DWELL_S) / slower, swings, motions)
    load = rig.load.made(usual_load(robot, moved), USUAL_PAYLOAD, damping=0.0)
    rule = {
        "cells": arguments.cells, "joint": moved, "faults": rig.faults,
        "allow_slack": arguments.allow_slack,
    }  # fmt: skip
    if mode == "forward":
        rule["load"] = load
    elif mode == "balance":
        # speed of the motion as sampled by the simulation, corners included
        torque = load.torque(*motion.differences(time, joints[:, moved]))
        rule |= {"joint_torque": torque, "motor_speed": speed, "motor_acceleration": acceleration}
    return Plan(time, joints, rule, because, swings)


def _slower(
    model: Model, time: Vector, joints: Table, most_speed: float, most_acceleration: float
) -> tuple[float, str]:
    """How many times slower the joints must move for all axes to stay within their limits.

    Args:
        model: the robot; its axes may have a ``max_speed``.
        time: [s], shape (n,).
        joints: angles of all joints [rad], shape (n, joints).
        most_speed: of the motors [rad/s].
        most_acceleration: of the motors [rad/s^2].

    Returns:
        The factor, and a note that says so and names the axis; 1 and nothing if all do.
    """
    robot, motors = model.robot, len(model.robot.motors)
    axes: tuple[Motor | Joint, ...] = (*robot.motors, *robot.joints)
    angle = np.hstack([follow_joints(model, joints).motor_angle, joints])
    speed = np.gradient(angle, time, axis=0)
    hardest = np.abs(np.gradient(speed[:, :motors], time, axis=0)).max(axis=0)
    most = np.array([axis.max_speed for axis in axes])
    most[:motors] = np.minimum(most[:motors], most_speed)
    factor = np.abs(speed).max(axis=0) / (FOR_THE_MOTION * most)
    enough = np.sqrt(hardest / (FOR_THE_MOTION * most_acceleration))
    factor[:motors] = np.maximum(factor[:motors], enough)
    worst = int(np.argmax(factor))
    if factor[worst] <= 1.0:
        return 1.0, ""
    return float(factor[worst]), (
        f"the motion is {factor[worst]:.3g} times slower than asked for, so that "
        f"{axes[worst].name} keeps to its largest speed and acceleration"
    )


def _prescribed(
    robot: Robot, time: Vector, swings: Sequence[Swing], motions: Sequence[motion.Motion]
) -> Table:
    """Angles of all joints, those without a swing in the reference pose; shape (n, joints)."""
    joints = np.tile(robot.reference_pose, (time.size, 1))
    for swing, move in zip(swings, motions, strict=True):
        angle, joint = swing.centre + move(time), robot.joints[swing.joint]
        if angle.min() < joint.lower or angle.max() > joint.upper:
            raise UsageError(
                f"the motion of {joint.name} goes from {angle.min():.4g} to {angle.max():.4g}, "
                f"out of its range [{joint.lower:.4g}, {joint.upper:.4g}]"
            )
        joints[:, swing.joint] = angle
    return joints


def _motions(swings: Sequence[Swing], arguments: argparse.Namespace) -> list[motion.Motion]:
    """The motion of every moving joint about its centre."""
    frequencies = numbers("frequency", arguments.frequency, len(swings), 1e-4, 50.0)
    return [
        motion.named_motion(arguments.motion, swing.amplitude, frequency, arguments.seed + 1000 * k)
        for k, (swing, frequency) in enumerate(zip(swings, frequencies, strict=True))
    ]


def _swings(
    robot: Robot, chosen: Sequence[int], arguments: argparse.Namespace, share: float
) -> tuple[Swing, ...]:
    """Amplitude and centre of every moving joint, within its range."""
    prismatic = [robot.joints[index].name in robot.prismatic_joints for index in chosen]
    centres: list[float | None] = [None] * len(chosen)
    if arguments.centre is not None:
        centres = [*positions("centre", arguments.centre, prismatic)]
    if arguments.amplitude is None:
        return tuple(
            _usual_swing(robot, index, centre, share)
            for index, centre in zip(chosen, centres, strict=True)
        )
    given = positions("amplitude", arguments.amplitude, prismatic)
    return tuple(
        _given_swing(robot, index, value, centre)
        for index, value, centre in zip(chosen, given, centres, strict=True)
    )


def _usual_swing(robot: Robot, index: int, centre: float | None, share: float) -> Swing:
    """The default: about the reference pose, or the nearest pose with enough room on both sides."""
    joint = robot.joints[index]
    width = joint.upper - joint.lower
    amplitude = float(np.radians(USUAL_AMPLITUDE_DEG))
    if joint.name in robot.prismatic_joints:
        amplitude = USUAL_SHARE * width
    if centre is None:
        centre = joint.reference_angle
        if _room(joint, centre) < amplitude:
            amplitude = min(amplitude, LARGEST_SHARE * width)
            clear = CLEARANCE * amplitude
            centre = float(np.clip(centre, joint.lower + clear, joint.upper - clear))
    elif _room(joint, centre) <= 0.0:
        raise UsageError(
            f"--centre {centre:g} leaves no room to move {joint.name} within its range "
            f"[{joint.lower:g}, {joint.upper:g}]"
        )
    else:
        amplitude = min(amplitude, _room(joint, centre))
    return Swing(index, share * amplitude, centre)


def _given_swing(robot: Robot, index: int, amplitude: float, centre: float | None) -> Swing:
    """The amplitude given by ``--amplitude``."""
    joint = robot.joints[index]
    centre = joint.reference_angle if centre is None else centre
    most = _room(joint, centre)
    if abs(amplitude) > most:
        raise UsageError(
            f"--amplitude {amplitude:g} leaves the range of {joint.name}: at most "
            f"{max(most, 0.0):g} to either side of {centre + 0.0:g}; --centre moves the centre "
            f"within [{joint.lower:g}, {joint.upper:g}]"
        )
    return Swing(index, amplitude, centre)


def _room(joint: Joint, centre: float) -> float:
    """Largest amplitude about a centre; negative outside the range."""
    return min(centre - joint.lower, joint.upper - centre)


def swing_text(robot: Robot, swing: Swing) -> str:
    """``elbow by 38 deg about 0 deg``."""
    name = robot.joints[swing.joint].name
    if name in robot.prismatic_joints:
        return f"{name} by {swing.amplitude:.4g} m about {swing.centre + 0.0:.4g} m"
    amplitude, centre = np.degrees(swing.amplitude), np.degrees(swing.centre) + 0.0
    return f"{name} by {amplitude:.4g} deg about {centre:.4g} deg"


def check_ranges(arguments: argparse.Namespace) -> None:
    """Refuse numbers outside their ranges.

    Raises:
        UsageError: names the option and its range.
    """
    if arguments.duration is not None:
        _require("duration", arguments.duration, 0.01, 1e6)
    _require("cells", arguments.cells, 1, 200)
    _require("seed", arguments.seed, 0, 2**63)


def _require(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise UsageError(f"--{name} must be in [{low:g}, {high:g}], got {value:g}")


def numbers(
    name: str,
    text: str,
    count: int,
    low: float,
    high: float,
    number: Callable[[str], float] = float,
    such_as: str = "",
) -> list[float]:
    """One number for all, or one for each.

    Raises:
        UsageError: the text is not a list of numbers, their count is wrong or one is out of range.
    """
    try:
        values = [number(part) for part in text.split(",")]
    except ValueError as error:
        raise UsageError(
            f"--{name} must be numbers separated by commas{such_as}, got {text!r}"
        ) from error
    if len(values) not in (1, count):
        wanted = "1 number" if count == 1 else f"1 or {count} numbers"
        raise UsageError(f"--{name} takes {wanted}, got {len(values)}")
    for value in values:
        _require(name, value, low, high)
    return values * count if len(values) == 1 else values


def positions(name: str, text: str, prismatic: list[bool]) -> list[float]:
    """Positions of joints: numbers in rad or m, or angles in degrees such as ``20deg``.

    Args:
        name: of the option.
        text: one number for all joints, or one for each.
        prismatic: whether each of the joints is prismatic.

    Raises:
        UsageError: as ``numbers``, or a prismatic joint gets an angle.
    """
    if any(part.endswith("deg") for part in text.split(",")) and any(prismatic):
        raise UsageError(f"--{name} of a prismatic joint is in m, got {text!r}")
    such_as = ", such as 0.3 or 20deg"
    return numbers(name, text, len(prismatic), -1e6, 1e6, _position, such_as)


def _position(text: str) -> float:
    return radians(float(text[:-3])) if text.endswith("deg") else float(text)
