"""Laws of the gates and the time line that hold for any messages in any order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.wound import robot_of

from cdrj_ros._core import CONFIRMATIONS, MAX_GAP_NS, RANGE_MARGIN, WAITING
from cdrj_ros.estimation.conditioner import MODES, Conditioner, Mode
from cdrj_ros.estimation.reading_limits import WHOLE, axes_of
from cdrj_ros.estimation.samples import Sample

PLAIN = """
name: plain
motors: [{name: a, max_speed: 50}, {name: b}]
joints: [{name: p, range: [-1, 1], max_speed: 20}, {name: q, range: [0, 2]}]
"""
SENSED = """
name: sensed
motors:
  - {name: a, max_speed: 50, period: 0.5, scale: -2, offset: 0.3, clock_offset: -0.25}
  - {name: b, period: 6.283185307179586, clock_offset: 0.001, noise: 0.2, tracking_bandwidth: 1}
joints:
  - {name: p, range: [-1, 1], max_speed: 20, scale: 0.5, offset: -0.1, resolution: 0.01,
     tracking_bandwidth: 12}
  - {name: q, range: [0, 2], period: 3, clock_offset: -0.002}
"""
ROBOTS = {text.split()[1]: robot_of(text) for text in (PLAIN, SENSED)}
NAMES = {"motors": ("a", "b"), "joints": ("p", "q"), "both": ("a", "b", "p", "q")}
CLOCKS = (10**9, 1_700_000_000 * 10**9)
MILLISECOND = 1_000_000


@dataclass(frozen=True)
class Message:
    """A message of one topic."""

    topic: str
    stamp: int
    names: tuple[str, ...]
    values: tuple[float, ...]


STAMPS = st.one_of(
    st.integers(0, 4_000).map(lambda k: CLOCKS[0] + k * MILLISECOND),  # 4 s around one clock,
    st.integers(0, 4_000).map(lambda k: CLOCKS[1] + k * MILLISECOND),  # and around another
    st.integers(0, 50).map(lambda k: CLOCKS[0] + k),
    st.sampled_from((0, 1, -1, 2**31 * 10**9 - 1, -(2**31) * 10**9, 250_000_000)),
)
VALUES = st.one_of(
    st.floats(-1.2, 2.2),
    st.sampled_from((0.0, -0.0, 5e-324, -1e-310, 1e12, 1e308, -1e308, np.nan, np.inf, -np.inf)),
    st.floats(allow_nan=True, allow_infinity=True),
)
NAME = st.sampled_from(("a", "b", "p", "q", "", "stranger", "a" * 10_000))


@st.composite
def messages(draw: st.DrawFn) -> Message:
    topic = draw(st.sampled_from(("motors", "joints", "both")))
    names = draw(st.one_of(st.just(NAMES[topic]), st.lists(NAME, max_size=5).map(tuple)))
    values = draw(st.lists(VALUES, min_size=len(names), max_size=len(names)))
    if draw(st.integers(0, 9)) == 0:
        values = values[:-1] if values else [0.0]
    return Message(topic, draw(STAMPS), names, tuple(values))


@st.composite
def runs(draw: st.DrawFn) -> list[Message]:
    """Consecutive messages of one topic, which confirm a new clock."""
    topic = draw(st.sampled_from(("motors", "joints", "both")))
    begin, step = draw(STAMPS), draw(st.sampled_from((1, MILLISECOND, 900 * MILLISECOND)))
    value = draw(VALUES)
    names = NAMES[topic]
    count = draw(st.integers(2, 8))
    return [Message(topic, begin + k * step, names, (value,) * len(names)) for k in range(count)]


STREAMS = st.lists(st.one_of(messages().map(lambda one: [one]), runs()), max_size=25).map(
    lambda parts: [message for part in parts for message in part]
)
MODE = st.sampled_from(MODES)
ROBOT = st.sampled_from(sorted(ROBOTS))
thorough = settings(max_examples=60, deadline=None, derandomize=True, database=None)


def feed(conditioner: Conditioner, message: Message) -> list[Sample]:
    method = getattr(conditioner, f"feed_{message.topic}")
    samples: list[Sample] = method(message.stamp, message.names, message.values)
    return samples


def settled(conditioner: Conditioner) -> int:
    """Readings that are counted anywhere, without messages refused whole."""
    by_reading = sum(n for cause, n in conditioner.refused.items() if cause not in WHOLE)
    return conditioner.accepted + conditioner.elsewhere + conditioner.held + by_reading


def refused_whole(message: Message) -> bool:
    return len(message.names) != len(message.values) or not message.names or message.stamp <= 0


@thorough
@given(ROBOT, MODE, STREAMS)
def test_samples_are_finite_within_limits_and_later_than_the_one_before(
    robot: str, mode: str, stream: list[Message]
) -> None:
    conditioner = Conditioner(ROBOTS[robot], mode)
    limits = axes_of(ROBOTS[robot])
    offsets = {limit.clock_offset_ns for limit in limits}
    possible: set[int] = set()
    last, ahead, jumps, given_out = -1, -1, 0, 0
    for message in stream:
        possible |= {message.stamp + offset for offset in offsets}
        samples = feed(conditioner, message)
        if conditioner.clock_jumps != jumps:
            jumps, last, ahead = conditioner.clock_jumps, -1, -1
        for sample in samples:
            assert sample.stamp_ns > max(last, 0)
            assert sample.stamp_ns in possible
            assert sample.silent == (sample.stamp_ns <= ahead)
            if sample.predicted:
                assert not sample.silent
                ahead = sample.stamp_ns
            else:
                last = sample.stamp_ns
                given_out += 1
            values = np.concatenate((sample.motor_angle, sample.joint_angle))
            assert np.all(np.isfinite(values))
            for value, limit in zip(values, limits, strict=True):
                assert limit.lower - 2 * RANGE_MARGIN <= value <= limit.upper + 2 * RANGE_MARGIN
    assert given_out <= conditioner.accepted


@thorough
@given(ROBOT, STREAMS)
def test_apart_from_predicted_samples_prediction_changes_nothing(
    robot: str, stream: list[Message]
) -> None:
    """At most one is predicted by a message, and it comes last."""
    waiting, predicting = Conditioner(ROBOTS[robot]), Conditioner(ROBOTS[robot], "predict")
    for message in stream:
        samples = feed(predicting, message)
        seen = [sample for sample in samples if not sample.predicted]
        assert _bits(seen) == _bits(feed(waiting, message))
        assert _bits(samples[: len(seen)]) == _bits(seen)
        assert len(samples) <= len(seen) + 1
    assert predicting.refused == waiting.refused


@thorough
@given(ROBOT, MODE, STREAMS, st.integers(0, 60))
def test_every_reading_is_accepted_refused_elsewhere_or_held_and_nothing_else(
    robot: str, mode: str, stream: list[Message], reset_at: int
) -> None:
    conditioner = Conditioner(ROBOTS[robot], mode)
    whole = readings = 0
    for k, message in enumerate(stream):
        if k == reset_at:
            conditioner.reset()
            assert conditioner.held == 0
        feed(conditioner, message)
        if refused_whole(message):
            whole += 1
        else:
            readings += len(message.names)
        assert settled(conditioner) == readings
        assert sum(conditioner.refused[cause] for cause in WHOLE) == whole


@thorough
@given(ROBOT, STREAMS)
def test_the_number_of_kept_readings_is_bounded(robot: str, stream: list[Message]) -> None:
    conditioner = Conditioner(ROBOTS[robot], "predict")
    for message in stream:
        feed(conditioner, message)
        assert all(len(held) < CONFIRMATIONS for held in conditioner.held_of.values())
        assert max(conditioner.waiting.values()) <= 2 * max(conditioner.accepted, 1)


@thorough
@given(ROBOT, STREAMS, STREAMS)
def test_a_refused_message_leaves_no_trace(
    robot: str, before: list[Message], after: list[Message]
) -> None:
    """If it leaves no held reading either, the same samples follow with and without it."""
    with_it, without = (Conditioner(ROBOTS[robot]) for _ in range(2))
    for message in before:
        assert _bits(feed(with_it, message)) == _bits(feed(without, message))
    for message in after:
        accepted, held, jumps = with_it.accepted, with_it.held, with_it.clock_jumps
        state = with_it.held_of
        samples = feed(with_it, message)
        unchanged = state == with_it.held_of
        if (accepted, held, jumps) == (with_it.accepted, with_it.held, with_it.clock_jumps) and (
            unchanged
        ):
            assert samples == []  # refused: the other conditioner does not get it
        else:
            assert _bits(samples) == _bits(feed(without, message))


def _bits(samples: Sequence[Sample]) -> list[tuple[int, bytes, bytes]]:
    return [
        (
            s.stamp_ns,
            s.motor_angle.tobytes(),
            s.joint_angle.tobytes() + (s.unseen.tobytes() if np.any(s.unseen) else b""),
        )
        for s in samples
    ]


@st.composite
def courses(draw: st.DrawFn) -> dict[str, list[Message]]:
    """Two topics as sensors send them: one clock, a rate each, some bad readings."""
    streams = {}
    for topic in ("motors", "joints"):
        gaps = draw(st.lists(st.integers(1, 5_000_000), min_size=1, max_size=40))
        stamps = (CLOCKS[1] + np.cumsum(gaps)).tolist()
        sent = []
        for stamp in stamps:
            drift = (stamp - CLOCKS[1]) * 1e-9
            values = (drift, 0.5) if topic == "motors" else (0.3, 1.0 - drift)
            if draw(st.integers(0, 7)) == 0:
                values = (draw(st.sampled_from((np.nan, np.inf, 1e308, -1e13))), values[1])
            sent.append(Message(topic, stamp, NAMES[topic], values))
        streams[topic] = sent
    return streams


@thorough
@given(ROBOT, courses(), st.randoms(use_true_random=False))
def test_the_order_in_which_topics_arrive_does_not_matter_while_waiting(
    robot: str, streams: dict[str, list[Message]], order: Random
) -> None:
    def listen(turns: Sequence[str]) -> tuple[list[tuple[int, bytes, bytes]], Conditioner]:
        conditioner = Conditioner(ROBOTS[robot])
        sources = {topic: iter(sent) for topic, sent in streams.items()}
        found = []
        for topic in turns:
            found += _bits(feed(conditioner, next(sources[topic])))
        return found, conditioner

    turns = [topic for topic, sent in streams.items() for _ in sent]
    one, first = listen(turns)
    order.shuffle(turns)
    other, second = listen(turns)
    assert one == other
    assert (first.refused, first.accepted) == (second.refused, second.accepted)
    stamps = [stamp for stamp, _, _ in one]
    assert len(stamps) == len(set(stamps))


@pytest.mark.parametrize("mode", MODES)
def test_a_channel_that_waits_in_vain_keeps_only_the_latest_readings(mode: Mode) -> None:
    conditioner = Conditioner(ROBOTS["plain"], mode)
    begin, lost = CLOCKS[1], 900
    first, last = WAITING + lost, 2 * WAITING
    recent = 1000

    def motors(k: int) -> list[Sample]:
        return conditioner.feed_motors(begin + k * MILLISECOND, ("a", "b"), (0.0, 0.001 * k))

    def joints(k: int) -> list[Sample]:
        return conditioner.feed_joints(begin + k * MILLISECOND, ("p", "q"), (0.0, 1.0))

    for k in range(first):
        assert motors(k) == []
    assert max(conditioner.waiting.values()) <= WAITING + recent
    assert conditioner.crowded == 2 * lost
    assert conditioner.accepted == 2 * first
    assert [sample.stamp_ns for sample in joints(first - 1)] == [begin + (first - 1) * MILLISECOND]

    for k in range(first, first + last):  # the joints fall silent again
        motors(k)
    assert max(conditioner.waiting.values()) <= WAITING + recent
    found = [
        sample
        for k in range(first + last - 10, first + last + 100)
        for sample in joints(k)
        if not sample.predicted
    ]
    stamps = [sample.stamp_ns for sample in found]
    assert stamps == sorted(set(stamps))
    assert stamps[0] > begin + (first - 1) * MILLISECOND
    assert begin + (first + last - 1) * MILLISECOND in stamps
    for sample in found:  # motor b was read at every stamp
        k = (sample.stamp_ns - begin) // MILLISECOND
        assert sample.motor_angle[1] == pytest.approx(0.001 * k, abs=1e-9)


def test_a_clock_that_begins_at_zero_may_be_offset() -> None:
    """A stamp that the offset moves below zero is late and does not disturb the channel."""
    conditioner = Conditioner(ROBOTS["sensed"])
    for k in range(1, 1001):
        stamp = k * MILLISECOND
        conditioner.feed_motors(stamp, ("a", "b"), (0.0, 0.0))
        conditioner.feed_joints(stamp, ("p", "q"), (0.0, 0.5))
    assert conditioner.refused["late"] == 250 + 2
    assert conditioner.lag_ns < 300 * MILLISECOND


def test_held_readings_must_be_plausible_too() -> None:
    """Five readings of another time confirm the clock, but not an impossible motion."""
    conditioner = Conditioner(ROBOTS["plain"])
    conditioner.feed_motors(CLOCKS[1], ("a",), (0.0,))
    for k in range(5):
        stamp = CLOCKS[1] + 2 * MAX_GAP_NS + k * MILLISECOND
        conditioner.feed_motors(stamp, ("a",), (1e6 if k == 2 else 0.01 * k,))
    assert conditioner.accepted == 5
    assert conditioner.refused["implausible"] == 1
    assert conditioner.gaps == 1
