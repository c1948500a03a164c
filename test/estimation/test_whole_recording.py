"""A recording that the gates do not accept whole: the same samples, in little memory."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from support.wound import robot_of

from cdrj_ros._core import LARGEST
from cdrj_ros.estimation import whole_recording
from cdrj_ros.estimation.conditioner import Conditioner
from cdrj_ros.estimation.samples import Sample, Samples
from cdrj_ros.estimation.whole_recording import condition
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


def recording() -> tuple[Series, Series]:
    """Four seconds, then two seconds an hour earlier, with a gap and refused readings."""
    stamps = START + MS * np.arange(6000)
    stamps[4000:] -= 3_600_000 * MS
    time = MS * np.arange(6000) * 1e-9
    winch, elbow = 2.0 * np.sin(3.0 * time), 0.5 * np.sin(4.0 * time)
    winch[[500, 5000]] = np.nan, np.inf
    elbow[1234] = 7.0
    heard = np.r_[0:2000, 2300:6000]  # 0.3 s without the joint, while it moves
    arrival = MS * np.arange(6000)
    return Series(stamps, arrival, winch), Series(stamps[heard], arrival[heard], elbow[heard])


def message_by_message(motor: Series, joint: Series) -> tuple[list[Sample], Conditioner]:
    conditioner = Conditioner(ROBOT)
    readings = [
        (arrival, which, stamp, value)
        for which, one in enumerate((motor, joint))
        for stamp, arrival, value in zip(one.stamp_ns, one.log_ns, one.value, strict=True)
    ]
    samples = []
    for _, which, stamp, value in sorted(readings, key=lambda reading: reading[:2]):
        feed = conditioner.feed_joints if which else conditioner.feed_motors
        samples += feed(int(stamp), ("elbow" if which else "winch",), (float(value),))
    return samples, conditioner


def in_order(segments: tuple[Samples, ...]) -> list[Sample]:
    return [one.at(k) for one in segments for k in range(one.stamp_ns.size)]


@pytest.mark.parametrize("piece", [1, 7, 65_536])
def test_a_recording_gives_the_samples_of_its_messages_bit_for_bit_in_pieces_of_any_size(
    monkeypatch: pytest.MonkeyPatch, piece: int
) -> None:
    motor, joint = recording()
    wanted, conditioner = message_by_message(motor, joint)
    monkeypatch.setattr(whole_recording, "PIECE", piece)
    done = condition(ROBOT, {"winch": motor}, {"elbow": joint})
    found = in_order(done.segments)

    assert done.refused == conditioner.refused
    assert (done.refused["not_finite"], done.refused["out_of_range"]) == (2, 1)
    assert (done.accepted, done.clock_jumps) == (conditioner.accepted, 1)
    assert len(done.segments) == 2
    assert [s.stamp_ns for s in found] == [s.stamp_ns for s in wanted]
    for one, other in zip(found, wanted, strict=True):
        assert one.motor_angle.tobytes() == other.motor_angle.tobytes()
        assert one.joint_angle.tobytes() == other.joint_angle.tobytes()
        unseen = other.unseen if other.unseen.size else np.zeros((2, 2))
        assert (one.unseen if one.unseen.size else np.zeros((2, 2))).tobytes() == unseen.tobytes()
    some = [bool(np.any(s.unseen)) for s in wanted]
    assert any(some)
    assert not all(some)
    assert [one.unseen.size > 0 for one in done.segments] == [True, False]


@pytest.mark.parametrize("refused", [0, 1])
def test_little_more_memory_is_used_than_readings_and_samples_take(
    monkeypatch: pytest.MonkeyPatch, refused: int
) -> None:
    monkeypatch.setattr(whole_recording, "PIECE", 512)
    n = 20_000
    stamps = START + MS * np.arange(n)
    elbow = 0.5 * np.sin(2e-3 * np.arange(n))
    winch = 8.0 * elbow
    winch[n // 2 : n // 2 + refused] = np.nan
    motor = Series(stamps, stamps + 100, winch)
    joint = Series(stamps[::2].copy(), stamps[::2] + 3 * MS, elbow[::2].copy())
    given = sum(array.nbytes for one in (motor, joint) for array in vars(one).values())
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


Channels = tuple[Series, Series]


def steady(stamps: NDArray[np.int64], values: Sequence[float] | None = None) -> Series:
    """A channel that moves slowly, or has the given readings, and arrives without delay."""
    value = 1e-4 * np.arange(stamps.size) if values is None else np.array(values)
    return Series(stamps, MS * np.arange(stamps.size), value)


def with_reading(value: float) -> Series:
    return steady(EVENLY, [0.0] * 20 + [value] + [0.0] * 19)


EVENLY = START + MS * np.arange(40)
FROM_ZERO = MS * np.arange(40)
REPEATED = np.insert(EVENLY, 20, EVENLY[20])
INTERRUPTED = START + MS * np.arange(0, 5000, 10)
INTERRUPTED[-2:] += 1500 * MS
UNCLEAN: dict[str, tuple[float, Channels, str]] = {
    "empty": (0.0, (steady(EVENLY), steady(EVENLY[:0])), ""),
    "unstamped": (1.0, (steady(FROM_ZERO), steady(FROM_ZERO + 1000 * MS)), "unstamped"),
    "before the clock's zero": (-0.01, (steady(FROM_ZERO + MS), steady(FROM_ZERO + MS)), "late"),
    "repeated": (0.0, (steady(REPEATED, [0.1] * 41), steady(EVENLY)), "repeated"),
    "gap": (0.0, (steady(INTERRUPTED, [0.1] * 500), steady(INTERRUPTED, [0.1] * 500)), ""),
    "below": (0.0, (steady(EVENLY), with_reading(-1.1)), "out_of_range"),
    "above": (0.0, (steady(EVENLY), with_reading(1.1)), "out_of_range"),
    "fast": (0.0, (with_reading(0.1), steady(EVENLY)), "implausible"),
}


@pytest.mark.parametrize("case", UNCLEAN)
def test_a_recording_with_one_fault_gives_the_samples_and_refusals_of_its_messages(
    monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    clock_offset, (motor, joint), refused = UNCLEAN[case]
    (winch,) = ROBOT.motors
    sensor = replace(winch.sensor, clock_offset_ns=round(clock_offset * 1e9))
    robot = replace(ROBOT, motors=(replace(winch, sensor=sensor, max_speed=5.0),))
    monkeypatch.setattr(f"{__name__}.ROBOT", robot)
    wanted, conditioner = message_by_message(motor, joint)
    done = condition(robot, {"winch": motor}, {"elbow": joint})
    assert (done.refused, done.accepted) == (conditioner.refused, conditioner.accepted)
    assert done.refused.get(refused, 1) > 0
    assert [s.stamp_ns for s in in_order(done.segments)] == [s.stamp_ns for s in wanted]
    for one, other in zip(in_order(done.segments), wanted, strict=True):
        assert one.motor_angle.tobytes() == other.motor_angle.tobytes()
        assert one.joint_angle.tobytes() == other.joint_angle.tobytes()


def test_the_greatest_leaps_of_the_least_period_have_an_angle() -> None:
    (winch,) = ROBOT.motors
    document = schema()["$defs"]["motor"]["properties"]
    sensor = replace(winch.sensor, period=document["period"]["minimum"], scale=-LARGEST_NUMBER)
    robot = replace(ROBOT, motors=(replace(winch, sensor=sensor),))
    motor = steady(EVENLY, [-LARGEST, LARGEST] * 20)
    done = condition(robot, {"winch": motor}, {"elbow": steady(EVENLY)})
    (samples,) = done.segments
    assert np.all(np.isfinite(samples.motor_angle))
    conditioner = Conditioner(robot)
    for stamp, value in zip(motor.stamp_ns, motor.value, strict=True):
        conditioner.feed_motors(int(stamp), ("winch",), (float(value),))
    assert conditioner.accepted == done.accepted - 40
