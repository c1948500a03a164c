"""Time of commands on recordings: ``validate`` beside rosbags, ``identify``, ``commission``."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bench.figures import ROBOT, alone, compared, seconds, there_and_back
from bench.hand import fingers, hand_text
from bench.update import recorded_motion
from cdrj_ros.commands import validate
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.following import following_motors
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot

DURATION_S = 200
ROUNDS = 3
EIGHT = "rho,preload,EA,f_d"
"""Numbers to fit: four keys with a number for each of the prototype's two cables."""
TRUE = {"cables.upper.preload": 34.0, "cables.lower.preload": 28.0}
"""Where the recorded prototype differs from its file [N]."""
NOISE = (0.1, 0.002)
"""Of references [N], and of torques [N m]."""
FINGERS = 5
REST_S, MOTION_S = 3, 40
OFTEN = (1.3, 1.9)
"""Of both joints of a finger [rad/s]."""


def write_bag(path, model, motors, joints, every=0):
    """Write a robot's readings, joints' half as often, with torques.

    Args:
        path: of the bag.
        model: the robot.
        motors, joints: angles at all readings [rad].
        every: how many readings come with a reading of all load cells; 0 for none.
    """
    topics, layout, noise = Topics(), model.layout, np.random.default_rng(0)
    stamps = 1_700_000_000 * 10**9 + np.arange(len(motors)) * 1_000_000
    found = run(model, initial_state(model), Samples(stamps, motors, joints))[1].values

    def heard(part, size):
        return found[:, part] + noise.normal(0.0, size, found[:, part].shape)

    tensions, forces, *_ = topics.references
    with BagWriter(path) as bag:
        efforts = heard(layout.motor_effort, NOISE[1])
        bag.write_joint_states(topics.motors, stamps, layout.motors, motors, effort=efforts)
        bag.write_joint_states(topics.joints, stamps[::2], layout.joints, joints[::2])
        if every:
            pulls, magnitudes = (heard(one, NOISE[0]) for one in (layout.tension, layout.magnitude))
            bag.write_tensions(tensions, stamps[::every], layout.elements, pulls[::every])
            bag.write_nodal_forces(forces, stamps[::every], layout.pulleys, magnitudes[::every])


def write_prototype(path):
    """Write the sample recording's motion, to and fro for ``DURATION_S``."""
    robot = load_model(str(ROBOT)).robot
    model = prepare(build_robot(with_numbers(robot.document, TRUE), "recorded"))
    read = recorded_motion(model)
    motors, joints = (
        np.resize(there_and_back(angles), (DURATION_S * 1000, 1))
        for angles in (read.motor_angle, read.joint_angle)
    )
    write_bag(path, model, motors, joints, 10)


def deserialise(path):
    """Time [s] that rosbags needs to deserialise all messages, once it has read them."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        raw = list(reader.messages())

        def decode_all():
            for connection, _, payload in raw:
                reader.deserialize(payload, connection.msgtype)

        return seconds(decode_all)


def _quietly(arguments):
    with contextlib.redirect_stdout(io.StringIO()):
        validate.main(arguments)


def _run(command, arguments):
    """Time of a command from its start [s]."""
    program = f"from cdrj_ros.commands.entry import {command}; {command}()"
    given = [sys.executable, "-c", program, *arguments]
    return seconds(lambda: subprocess.run(given, check=True, stdout=subprocess.DEVNULL))


def commissioned(folder, count):
    """Time of ``commission`` of fingers with tare, spring scale and motion with torques [s]."""
    robot, model = folder / "hand.yaml", fingers(count)
    robot.write_text(hand_text(count), encoding="utf-8")
    reference = model.robot.reference_pose
    time = 1e-3 * np.arange(1000 * MOTION_S)
    moving = np.radians(35.0 + 25.0 * np.sin(np.outer(time, OFTEN * count)))
    for name, joints in (("rest", np.tile(reference, (1000 * REST_S, 1))), ("motion", moving)):
        write_bag(folder / name, model, following_motors(model, joints), joints)
    scale = ",".join(f"{cable.name}={cable.preload}" for cable in model.robot.cables)
    given = {"robot": robot, "out": folder / "new.yaml", "preload": scale}
    given |= {name: folder / name for name in ("rest", "motion")}
    return _run("commission", ["--yes", *(f"--{key}={value}" for key, value in given.items())])


def measure():
    """Seconds for a bag of ``DURATION_S``, and of the hand's commissioning."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "long")
        write_prototype(path)
        given = [str(path), "--robot", str(ROBOT)]
        _quietly(given)
        turns = [
            (seconds(lambda: _quietly(given)), _run("validate", given), deserialise(path))
            for _ in range(ROUNDS)
        ]
        fit = _run("identify", [*given, "--fit", EIGHT])
        commission = commissioned(Path(folder), FINGERS)
    whole, process, decoded = zip(*turns, strict=True)
    bag, beside = f"{DURATION_S} s bag", "rosbags: deserialising alone"
    return [
        compared(f"validate, {bag}, without its process", "s", whole, beside, decoded, "< 1"),
        compared("validate as a command", "s", process, beside, decoded, "≤ 0.3"),
        alone(f"identify, eight numbers, {bag}", "s", fit, "< 12"),
        alone("commission of five fingers, 40 s of motion", "s", commission, "≤ 90"),
    ]
