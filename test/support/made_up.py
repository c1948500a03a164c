"""Recordings of a robot computed by the estimator itself."""

import numpy as np

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.model.packing import channel_columns
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.simulation.assembly import divide_contacts

EPOCH_NS = 1_700_000_000_000_000_000
RATE = 200.0


def recording(
    document,
    seconds=20.0,
    amplitude=0.6,
    late_s=0.0,
    noise=0.02,
    seed=1,
    name="made_up",
    frequency=0.1,
    *,
    cells=1,
):
    """References computed by the estimator itself, with noise: with one contact cell per pulley
    there is no model error."""
    robot = build_robot(document, "made up")
    model = prepare(divide_contacts(robot, cells) if cells > 1 else robot)
    time = np.arange(round(seconds * RATE)) / RATE
    joint = amplitude * np.sin(2.0 * np.pi * frequency * time)
    motor = 8.0 * np.sin(joint) + 0.08 * np.sin(1.7 * time)
    stamps = EPOCH_NS + np.round(time * 1e9).astype(np.int64)
    samples = Samples(stamps, motor[:, None].copy(), joint[:, None].copy())
    _, estimates = run(model, initial_state(model), samples)
    generator = np.random.default_rng(seed)
    references = {}
    for channel, column in channel_columns(model.layout).items():
        scale = noise * (0.02 if channel.startswith("effort") else 1.0)
        values = estimates.values[:, column] + generator.normal(0.0, scale, stamps.size)
        references[channel] = Series(stamps, stamps, values)
    reported = stamps - round(late_s * 1e9)
    (sensor,) = (axis.sensor for axis in model.robot.joints)
    return Recorded(
        name,
        {"winch": Series(stamps, stamps, motor)},
        {"elbow": Series(reported, stamps, (joint - sensor.offset) / sensor.scale)},
        references,
    )
