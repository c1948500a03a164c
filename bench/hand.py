"""Cost of a hand: the shipped finger many times, nothing shared, all joints in motion."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import yaml

from bench.figures import ROOT, alone, compared, in_turn, processor_seconds
from bench.update import stepping
from cdrj_ros.estimation.encoderless import EncoderlessEstimator
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.reader import parse_robot

FINGER = ROOT / "config" / "robots" / "finger.yaml"
ROUNDS = 7
"""Of medians of three, one in ten is off by a fifth on a busy machine."""
START_NS = 1_700_000_000 * 10**9
PLAIN_RATE = 500
"""Samples per second of plain steps, and of joints without encoder."""
COUNT = 2.0 * np.pi / 16384
"""Of the encoders [rad]."""
WINDING = (14.0 / 6.0, 9.0 / 6.0, -16.0 / 6.0)
"""Turn of the motors of a finger per turn of both its joints: arms over the drums' radius [-]."""


def fingers(count):
    """The shipped finger ``count`` times."""
    return prepare(parse_robot(hand_text(count)))


def hand_text(count):
    """Robot file of the shipped finger ``count`` times."""
    finger = yaml.safe_load(FINGER.read_text(encoding="utf-8"))
    used = [{"prefix": f"f{k}_"} for k in range(count)]
    keys = ("motors", "joints", "frames", "cables")
    part = {"name": "finger", **{key: finger[key] for key in keys}, "used": used}
    hand = {"name": "hand", "friction": finger["friction"], "parts": [part]}
    return yaml.safe_dump(hand, sort_keys=False)


def motion(model, rate, frequency=1.0):
    """Readings of all axes in whole periods, at least a second.

    Args:
        model: of ``fingers``.
        rate: readings per second.
        frequency: of all joints [Hz].
    """
    time = np.arange(round(rate * max(1.0, 1.0 / frequency))) / rate
    wave = np.sin(2.0 * np.pi * frequency * time)
    angle = np.round(np.radians(35.0 + 25.0 * wave) / COUNT) * COUNT
    count = len(model.robot.motors) // len(WINDING)
    stamp_ns = START_NS + np.round(time * 1e9).astype(np.int64)
    motor = np.tile(np.outer(angle, WINDING), (1, count))
    return Samples(stamp_ns, motor, np.tile(angle[:, None], (1, 2 * count)))


def fed(model, rate, frequency=1.0, *, torques=False):
    """Readings of one topic through the live estimator, with standard deviations.

    Args:
        model: the robot.
        rate: samples per second.
        frequency: as of ``motion``.
        torques: whether the motors report their torques, within 2 % and 1 mN m.
    """
    read = motion(model, rate, frequency)
    stamps = read.stamp_ns.tolist()
    names, motors = (*model.layout.motors, *model.layout.joints), model.layout.motors
    rows = np.concatenate([read.motor_angle, read.joint_angle], axis=1)
    whole = run(model, initial_state(model), read)[1]
    efforts, generator = whole.values[:, model.layout.motor_effort], np.random.default_rng(0)
    efforts = efforts * (1.0 + 0.02 * generator.normal(size=len(motors)))
    efforts += 0.001 * generator.normal(size=efforts.shape)
    live, begin = LiveEstimator(model), [0]

    def updated():
        for at, row, effort in zip(stamps, rows, efforts, strict=True):
            stamp = at + begin[0]
            if torques and live.wants_efforts(motors, stamp):
                live.feed_efforts(stamp, motors, effort)
            live.feed("both", stamp, names, row)
        begin[0] += len(stamps) * 10**9 // rate

    return updated


def without_encoders(model):
    """The estimate with no encoder at the outer joint of every finger."""
    hidden = [replace(one, measured=not one.name.endswith("pip")) for one in model.robot.joints]
    estimator = EncoderlessEstimator(prepare(replace(model.robot, joints=tuple(hidden))))
    read = motion(model, PLAIN_RATE)
    whole = run(model, initial_state(model), read)[1]
    efforts, begin = whole.values[:, model.layout.motor_effort], [0]

    def estimated():
        later = read.stamp_ns + begin[0]
        estimator.run(Samples(later, read.motor_angle, read.joint_angle[:, ::2]), efforts)
        begin[0] += 10**9

    return estimated


def measure():
    """Updates of one finger and of five beside a plain step [µs], torques, and starts [s]."""
    exact = prepare(parse_robot(f"{hand_text(5)}\nuncertainty: {{others: exact}}\n"))
    robots = {"one finger": fingers(1), "five fingers": fingers(5), "five known exactly": exact}
    rows = []
    for name, model in robots.items():
        stepped = stepping(model, motion(model, PLAIN_RATE))
        once, *found = in_turn(ROUNDS, stepped, fed(model, 500), fed(model, 100))
        steps = np.array(once) * 1e6 / PLAIN_RATE
        for rate, times, aim in zip((500, 100), found, ("≤ 4", "≤ 10"), strict=True):
            ours = np.array(times) * 1e6 / rate
            what = f"{name}, readings at {rate} Hz, with standard deviations"
            rows.append(compared(what, "µs", ours, "a step of the same robot", steps, aim))
        heard, deaf = in_turn(ROUNDS, fed(model, 500, torques=True), fed(model, 500))
        mine, others = (np.array(times) * 1e6 / 500 for times in (heard, deaf))
        what = f"{name}, torques of all motors, readings at 500 Hz"
        rows.append(compared(what, "µs", mine, "without torques", others, "≤ 4"))
    (hidden,) = in_turn(ROUNDS, without_encoders(fingers(5)))
    what = "five fingers, no encoder at the outer joints, one update"
    rows.append(alone(what, "ms", np.array(hidden) * 1e3 / PLAIN_RATE, "≤ 0.6"))
    five, twenty = fingers(5), fingers(20)
    made = [partial(LiveEstimator, model) for model in (twenty, five)]
    larger, smaller = in_turn(ROUNDS, *made)
    what = "an estimator of twenty fingers made"
    rows.append(compared(what, "s", larger, "of five", smaller, "≤ 4.5"))
    often = 50, 3.0  # reading rate and frequency at which the members' own steps weigh most
    one, many = (
        np.array(times) * 1e6 / often[0]
        for times in in_turn(ROUNDS, fed(fingers(1), *often), fed(twenty, *often))
    )
    what = "an update of twenty fingers, joints at 3 Hz read at 50 Hz"
    rows.append(compared(what, "µs", many, "twenty times that of one", 20.0 * one, "linear"))
    hand = LiveEstimator(load_model("hand"))
    ready = [processor_seconds(hand.expect_sensors) for _ in range(ROUNDS)]
    what = "the shipped hand prepared for the torques of 17 motors"
    return [*rows, alone(what, "s", ready, "≤ 1")]
