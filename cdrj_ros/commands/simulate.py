"""``simulate``: a bag of the simulated rig, with truth finer than the estimator's model."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Final

import numpy as np

from cdrj_ros.bag import BagWriter, Topics
from cdrj_ros.commands.shared import (
    DONE,
    add_robot_option,
    load_model,
    progress_bar,
    run_command,
)
from cdrj_ros.model.errors import UsageError
from cdrj_ros.model.joint import RollingLoad
from cdrj_ros.model.plan import Model
from cdrj_ros.rig.sensors import (
    JOINT_ENCODER,
    MOTOR_ENCODER,
    LoadCells,
    read_cells,
    read_encoder,
    reading_times,
)
from cdrj_ros.rig.truth import Truth, simulate

EPOCH_NS: Final = 1_700_000_000_000_000_000
"""Stamp of a simulated recording's start [ns]."""

DWELL_S: Final = 1.0
"""Rest before the motion begins [s]."""

TRUTH_RATE: Final = 1000.0
"""Steps of the simulation per second [Hz]."""


def _body(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="simulate", description=__doc__.split(": ", 1)[1])
    parser.add_argument("out", metavar="OUT", help="folder of the new bag")
    add_robot_option(parser)
    parser.add_argument("--duration", type=float, default=60.0, metavar="S", help="[s] (60)")
    parser.add_argument(
        "--amplitude-deg", type=float, default=38.0, help="of the sine of the joint [deg] (38)"
    )
    parser.add_argument("--frequency", type=float, default=0.1, help="of the sine [Hz] (0.1)")
    parser.add_argument(
        "--warm-up", type=float, default=0.0, metavar="S",
        help="motion before the recording starts: the friction state is then unknown [s] (0: the "
        "recording starts at rest in the reference pose, just preloaded)",
    )  # fmt: skip
    parser.add_argument(
        "--cells", type=int, default=8, help="contact cells a pulley in the truth (8)"
    )
    parser.add_argument("--load-mass", type=float, default=0.3, help="payload [kg] (0.3)")
    parser.add_argument("--seed", type=int, default=0, help="of the sensors' noise (0)")
    arguments = parser.parse_args(argv)
    for name in ("duration", "frequency", "warm_up", "load_mass"):
        if not 0.0 <= getattr(arguments, name) < 1e6:
            raise UsageError(f"--{name.replace('_', '-')} must be in [0, 1e6)")
    if not arguments.duration >= 0.01:
        raise UsageError(f"--duration must be at least 0.01 s, got {arguments.duration}")
    if not 1 <= arguments.cells <= 200:
        raise UsageError(f"--cells must be in [1, 200], got {arguments.cells}")
    model = load_model(arguments.robot, arguments.preload)
    truth = _truth(model, arguments)
    _write(arguments.out, model, truth, arguments.warm_up, arguments.seed)
    print(f"bag: {arguments.out}")
    return DONE


def _truth(model: Model, arguments: argparse.Namespace) -> Truth:
    robot = model.robot
    if len(robot.joints) != 1:
        raise UsageError(f"simulate needs a robot with one joint, {robot.name} has more")
    amplitude = np.radians(arguments.amplitude_deg)
    joint = robot.joints[0]
    if not joint.lower <= -abs(amplitude) <= abs(amplitude) <= joint.upper:
        raise UsageError(
            f"--amplitude-deg {arguments.amplitude_deg:g} leaves the range "
            f"[{np.degrees(joint.lower):g}, {np.degrees(joint.upper):g}] of {joint.name}"
        )
    time = np.arange(round((arguments.warm_up + arguments.duration) * TRUTH_RATE) + 1) / TRUTH_RATE
    moving = np.maximum(time - DWELL_S, 0.0)
    share = np.minimum(moving * arguments.frequency, 1.0)
    ramp = share * share * (3.0 - 2.0 * share)  # grows over the first period
    angle = amplitude * ramp * np.sin(2.0 * np.pi * arguments.frequency * moving)
    speed = np.gradient(angle, time)
    acceleration = np.gradient(speed, time)
    torque = RollingLoad(load_mass=arguments.load_mass).torque(angle, speed, acceleration)
    with progress_bar("simulating", time.size) as report:
        return simulate(robot, time, angle, torque, cells=arguments.cells, progress=report)


def _write(path: str, model: Model, truth: Truth, begin: float, seed: int) -> None:
    generator = np.random.default_rng(seed)
    cells = LoadCells()
    end = float(truth.time[-1])
    layout = model.layout
    topics = Topics()

    def stamps(times: np.ndarray) -> np.ndarray:
        return EPOCH_NS + np.round((times - begin) * 1e9).astype(np.int64)

    with BagWriter(path) as bag:
        for topic, encoder, name, angle in (
            (topics.motors, MOTOR_ENCODER, layout.motors[0], truth.motor_angle[:, 0]),
            (topics.joints, JOINT_ENCODER, layout.joints[0], truth.joint_angle[:, 0]),
        ):
            times = reading_times(begin, end, encoder.rate, encoder.phase_s)
            readings = read_encoder(encoder, times, truth.time, angle)
            bag.write_joint_states(topic, stamps(times), (name,), position=readings[:, None])
        times = reading_times(begin, end, cells.rate)

        def read(values: np.ndarray, noise: float, step: float) -> np.ndarray:
            return read_cells(values, truth.time, times, noise, step, generator)

        tensions, forces, efforts = topics.references
        bag.write_tensions(
            tensions, stamps(times), layout.elements,
            read(truth.tension, cells.force_noise, cells.force_step),
        )  # fmt: skip
        bag.write_nodal_forces(
            forces, stamps(times), layout.pulleys,
            read(truth.nodal_force, cells.force_noise, cells.force_step),
        )  # fmt: skip
        both = np.concatenate([truth.motor_effort, truth.joint_effort], axis=1)
        bag.write_joint_states(
            efforts, stamps(times), layout.motors + layout.joints,
            effort=read(both, cells.torque_noise, cells.torque_step),
        )  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("simulate", _body, argv)
