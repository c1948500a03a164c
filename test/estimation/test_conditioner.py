"""Whole recordings are conditioned as their messages are, bit for bit."""

import gc
import tracemalloc
from collections import Counter
from dataclasses import replace
from random import Random

import numpy as np
import pytest
from support.reading_streams import random_robot, random_stream, take
from support.wound import robot_of

from cdrj_ros._core import LARGEST
from cdrj_ros.estimation.conditioner import Conditioner, condition
from cdrj_ros.estimation.refusals import REFUSALS
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.robot.document import LARGEST as LARGEST_NUMBER
from cdrj_ros.robot.document import schema

ROBOT = robot_of(
    """
name: pair
motors: [{name: winch}]
joints: [{name: elbow, range: [-1, 1]}]
""",
    "winch",
)
START = 1_700_000_000_000_000_000
MS = 1_000_000
HELD_AT_MOST = 1.6
"""Peak of memory while conditioning, over that of the readings and samples."""


def in_order(segments):
    return [one.at(k) for one in segments for k in range(one.stamp_ns.size)]


def _arrays(series):
    return series.stamp_ns, series.log_ns, series.value


def nonzero(sample):
    """Everything in a sample; a row of a segment may have zeros where there is nothing."""
    return [one.tobytes() if np.any(one) else b"" for one in map(np.asarray, sample)]


def test_a_recording_gives_the_samples_of_its_readings_bit_for_bit():
    seen = Counter()
    for seed in range(40):
        random = Random(seed)
        robot = random_robot(random)
        conditioner, wanted = Conditioner(robot), []
        heard = {axis.name: [] for axis in robot.axes}
        for k, message in enumerate(random_stream(random, robot, 600)):
            positions = dict(zip(message.names, message.positions, strict=False))
            if seed % 10 == 0:
                positions.pop("m0", None)  # which is never heard
            for name in heard.keys() & positions.keys():
                heard[name].append((message.stamp_ns, k, positions[name]))
            names = [name for name in heard if name in positions]
            if names:
                values = [positions[name] for name in names]
                wanted += take(conditioner, "both", message.stamp_ns, names, values)
        channels = {
            name: Series(
                *(
                    np.array([row[i] for row in rows], kind)
                    for i, kind in enumerate((int, int, float))
                )
            )
            for name, rows in heard.items()
        }
        done = condition(
            robot,
            {axis.name: channels[axis.name] for axis in robot.motors},
            {axis.name: channels[axis.name] for axis in robot.joints},
        )
        assert list(map(nonzero, in_order(done.segments))) == list(map(nonzero, wanted))
        for name in ("refused", "accepted", "clock_jumps", "gaps", "steps"):
            assert getattr(done, name) == getattr(conditioner, name)
        for one in done.segments:
            assert np.all(np.diff(one.stamp_ns) > 0)
        seen += Counter(done.refused)
        seen["segments"] += len(done.segments) > 1
        for sample in wanted:
            for what in ("doubtful", "unseen", "offset", "after_gap"):
                seen[what] += bool(np.any(getattr(sample, what)))
    of_messages = {"malformed", "empty", "unknown_name"}
    assert set(seen) >= {*REFUSALS, "segments", "doubtful", "unseen", "offset"} - of_messages, seen


@pytest.mark.parametrize("refused", [0, 1])
def test_little_more_memory_is_used_than_readings_and_samples_take(refused):
    n = 20_000
    stamps = START + MS * np.arange(n)
    elbow = 0.5 * np.sin(2e-3 * np.arange(n))
    winch = 8.0 * elbow
    winch[n // 2 : n // 2 + refused] = np.nan
    motor = Series(stamps, stamps + 100, winch)
    joint = Series(stamps[::2].copy(), stamps[::2] + 3 * MS, elbow[::2].copy())
    given = sum(array.nbytes for one in (motor, joint) for array in _arrays(one))
    gc.collect()
    tracemalloc.start()
    try:
        done = condition(ROBOT, {"winch": motor}, {"elbow": joint})
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    (samples,) = done.segments
    assert done.refused["not_finite"] == refused
    assert samples.stamp_ns.size > n - 10
    kept = sum(array.nbytes for array in vars(samples).values())
    assert peak < HELD_AT_MOST * (given + kept)


def test_the_greatest_leaps_of_the_least_period_have_an_angle():
    (winch,) = ROBOT.motors
    document = schema()["$defs"]["axis"]["properties"]
    sensor = replace(winch.sensor, period=document["period"]["minimum"], scale=-LARGEST_NUMBER)
    robot = replace(ROBOT, motors=(replace(winch, sensor=sensor),))
    stamps = START + MS * np.arange(40)
    motor = Series(stamps, stamps, np.array([-LARGEST, LARGEST] * 20))
    joint = Series(stamps, stamps, np.zeros(40))
    done = condition(robot, {"winch": motor}, {"elbow": joint})
    (samples,) = done.segments
    assert np.all(np.isfinite(samples.motor_angle))
    conditioner = Conditioner(robot)
    for stamp, value in zip(motor.stamp_ns, motor.value, strict=True):
        take(conditioner, "motors", int(stamp), ("winch",), (float(value),))
    assert conditioner.accepted == done.accepted - 40
