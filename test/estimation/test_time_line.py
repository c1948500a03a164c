"""Properties of the gates and the time line that hold for every stream of messages."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.wound import robot_of

from cdrj_ros._core import CONFIRMATIONS, MAX_GAP_NS
from cdrj_ros.estimation.conditioner import Conditioner
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.estimation.whole_recording import Conditioned, condition
from cdrj_ros.foundation.series import Series
from cdrj_ros.robot.reader import parse_robot

ROBOT = robot_of("""
name: four
motors: [{name: a, max_speed: 50}, {name: b}]
joints: [{name: p, range: [-1, 1], max_speed: 20}, {name: q, range: [0, 2]}]
""")
MOTORS, JOINTS = ("a", "b"), ("p", "q")
NAMES = MOTORS + JOINTS
START = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
STREAMS = int(os.environ.get("CDRJ_STREAMS", "50"))
"""Number of streams of messages of any kind; 1000 in ``make soak``."""


@dataclass(frozen=True)
class Message:
    """A message of one topic."""

    topic: str
    """``motors``, ``joints`` or ``both``."""
    stamp: int
    names: tuple[str, ...]
    values: tuple[float, ...]


class Listener:
    """A conditioner fed by messages, and all samples that it has returned."""

    def __init__(self) -> None:
        self.conditioner = Conditioner(ROBOT)
        self.segments: list[list[Sample]] = [[]]

    def feed(self, message: Message) -> list[Sample]:
        jumps = self.conditioner.clock_jumps
        feed = getattr(self.conditioner, f"feed_{message.topic}")
        samples: list[Sample] = feed(message.stamp, message.names, message.values)
        if self.conditioner.clock_jumps != jumps:
            self.segments.append([])
        self.segments[-1].extend(samples)
        return samples

    @property
    def samples(self) -> list[Sample]:
        return [sample for segment in self.segments for sample in segment]

    def held(self) -> int:
        return self.conditioner.held


def listen(messages: Sequence[Message]) -> Listener:
    listener = Listener()
    for message in messages:
        listener.feed(message)
    return listener


def bits(samples: Sequence[Sample]) -> list[tuple[int, bytes, bytes]]:
    return [
        (
            s.stamp_ns,
            s.motor_angle.tobytes(),
            s.joint_angle.tobytes() + (s.unseen.tobytes() if np.any(s.unseen) else b""),
        )
        for s in samples
    ]


def offline(messages: Sequence[Message]) -> Conditioned:
    """The messages as a recording, conditioned as a whole; they arrive in their order."""
    rows: dict[str, list[tuple[int, int, float]]] = {name: [] for name in NAMES}
    for arrival, message in enumerate(messages):
        for name, value in zip(message.names, message.values, strict=True):
            rows.setdefault(name, []).append((message.stamp, arrival, value))

    def readings(name: str) -> Series:
        stamps, arrivals, values = zip(*rows[name], strict=True) if rows[name] else ((), (), ())
        return Series(
            np.array(stamps, dtype=np.int64),
            np.array(arrivals, dtype=np.int64),
            np.array(values, float),
        )

    return condition(
        ROBOT,
        {name: readings(name) for name in rows if name not in JOINTS},
        {name: readings(name) for name in JOINTS},
    )


def course(k: int, stamp: int) -> float:
    """Angle of channel k at a time: within its range, slower than its limit."""
    return float((0.5, 3.0, 0.9, 0.5)[k] * np.sin((stamp - START) * 1e-9 * (2.0 + k)) + (k == 3))


def stream(seed: int, topic: str, count: int, begin: int = START) -> list[Message]:
    """Messages of one topic at its own uneven rate; some carry one name only, in any order."""
    generator = np.random.default_rng((seed, len(topic), len(topic) % 3))
    names = {"motors": MOTORS, "joints": JOINTS, "both": NAMES}[topic]
    period = int(generator.integers(300_000, 3_000_000))
    stamps = begin + np.cumsum(generator.integers(period // 3, 2 * period, count))
    messages = []
    for stamp in stamps.tolist():
        chosen = [names[k] for k in generator.permutation(len(names))]
        chosen = chosen[: generator.integers(1, len(names) + 1)]
        values = tuple(course(NAMES.index(name), stamp) for name in chosen)
        messages.append(Message(topic, stamp, tuple(chosen), values))
    return messages


def interleaved(streams: Sequence[Sequence[Message]], seed: int) -> list[Message]:
    """Streams shuffled into one; each keeps its own order."""
    generator = np.random.default_rng(seed)
    turns = generator.permutation(np.repeat(np.arange(len(streams)), [len(s) for s in streams]))
    sources = [iter(one) for one in streams]
    return [next(sources[k]) for k in turns]


def by_stamp(streams: Sequence[Sequence[Message]]) -> list[Message]:
    return sorted((m for one in streams for m in one), key=lambda message: message.stamp)


def two_topics(seed: int, count: int = 60, begin: int = START) -> list[list[Message]]:
    return [stream(seed, "motors", count, begin), stream(seed, "joints", count, begin)]


SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(SEEDS, SEEDS)
def test_offline_and_online_agree_to_the_bit_whatever_the_interleaving(
    seed: int, order: int
) -> None:
    streams = two_topics(seed)
    listener = listen(interleaved(streams, order))
    assert bits(listener.samples) == bits(listen(by_stamp(streams)).samples)
    done = offline(by_stamp(streams))
    assert done.accepted == listener.conditioner.accepted
    assert done.accepted == sum(len(m.names) for one in streams for m in one)
    assert not any(done.refused.values())
    whole = [s.at(k) for s in done.segments for k in range(s.stamp_ns.size)]
    assert bits(whole) == bits(listener.samples)


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(SEEDS)
def test_samples_increase_and_lie_between_their_neighbours(seed: int) -> None:
    streams = two_topics(seed)
    samples = listen(interleaved(streams, seed)).samples
    stamps = [sample.stamp_ns for sample in samples]
    assert stamps == sorted(set(stamps))
    readings: dict[str, dict[int, float]] = {name: {} for name in NAMES}
    for message in by_stamp(streams):
        for name, value in zip(message.names, message.values, strict=True):
            readings[name][message.stamp] = value
    first = max(min(channel) for channel in readings.values())
    last = min(max(channel) for channel in readings.values())
    union = {stamp for channel in readings.values() for stamp in channel}
    assert stamps == sorted(stamp for stamp in union if first <= stamp <= last)
    for sample in samples:
        values = (*sample.motor_angle, *sample.joint_angle)
        for value, channel in zip(values, readings.values(), strict=True):
            before = channel[max(stamp for stamp in channel if stamp <= sample.stamp_ns)]
            after = channel[min(stamp for stamp in channel if stamp >= sample.stamp_ns)]
            assert min(before, after) - 1e-15 <= value <= max(before, after) + 1e-15
            if sample.stamp_ns in channel:
                assert value == channel[sample.stamp_ns]


def hostile(kind: str, message: Message, last: int) -> tuple[Message, str, int]:
    """A message that must leave no trace, the cause for which it is counted, and how often.

    ``last`` is the newest stamp accepted on every channel of the message.
    """
    topic, names = message.topic, message.names
    count = len(names)
    fine = message.values
    other = {"motors": "joints", "joints": "motors"}.get(topic, "both")
    table: dict[str, tuple[Message, str, int]] = {
        "nan": (Message(topic, last + 1, names, (np.nan,) * count), "not_finite", count),
        "infinite": (Message(topic, last + 1, names, (np.inf,) * count), "not_finite", count),
        "below": (Message(topic, last + 1, names, (-np.inf,) * count), "not_finite", count),
        "repeated": (Message(topic, last, names, fine), "repeated", count),
        "late": (Message(topic, last - 1, names, fine), "late", count),
        "ancient": (Message(topic, 1, names, fine), "late", count),
        "an hour late": (Message(topic, last - 3600 * SECOND, names, fine), "late", count),
        "far future": (Message(topic, last + 3600 * SECOND, names, fine), "future", count),
        "end of time": (Message(topic, 2**62, names, fine), "future", count),
        "unstamped": (Message(topic, 0, names, fine), "unstamped", 1),
        "before the epoch": (Message(topic, -5, names, fine), "unstamped", 1),
        "empty": (Message(topic, last + 1, (), ()), "empty", 1),
        "too few values": (Message(topic, last + 1, names, fine[1:]), "malformed", 1),
        "too many values": (Message(topic, last + 1, names, (*fine, 0.0)), "malformed", 1),
        "values without names": (Message(topic, last + 1, (), (0.0,)), "malformed", 1),
        "strangers": (Message(topic, last + 1, ("x", "y", ""), (0.0,) * 3), "unknown_name", 3),
        "wrong topic": (Message(other, last + 1, names, fine), "", 0),
    }  # fmt: skip
    return table[kind]


KINDS = (
    "nan", "infinite", "below", "repeated", "late", "ancient", "an hour late",
    "far future", "end of time", "unstamped", "before the epoch", "empty", "too few values",
    "too many values", "values without names", "strangers", "wrong topic",
)  # fmt: skip


def disturbed(seed: int, kinds: Sequence[str], most: int) -> None:
    """Hostile messages between good ones: the samples are those of the good ones alone."""
    generator = np.random.default_rng(seed)
    names = {"motors": MOTORS, "joints": JOINTS}
    good = []
    for message in interleaved(two_topics(seed, 40), seed):
        # whole messages, so that one stamp is the newest on all channels of a topic
        whole = names[message.topic]
        values = tuple(course(NAMES.index(name), message.stamp) for name in whole)
        good.append(Message(message.topic, message.stamp, whole, values))
    wanted = listen(good)
    listener = Listener()
    expected = dict.fromkeys(listener.conditioner.refused, 0)
    newest: dict[str, int] = {}
    for message in good:
        if message.topic in newest:
            for _ in range(generator.integers(0, most + 1)):
                kind = kinds[generator.integers(len(kinds))]
                bad, cause, count = hostile(kind, message, newest[message.topic])
                assert listener.feed(bad) == []
                if cause:
                    expected[cause] += count
        listener.feed(message)
        newest[message.topic] = message.stamp
    assert bits(listener.samples) == bits(wanted.samples)
    assert listener.conditioner.refused == expected
    assert listener.conditioner.accepted == wanted.conditioner.accepted
    assert (listener.conditioner.clock_jumps, listener.conditioner.gaps) == (0, 0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_hostile_message_leaves_no_trace_and_is_counted(kind: str) -> None:
    for seed in range(5):
        disturbed(seed, [kind], 1)


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(SEEDS)
def test_hostile_messages_of_all_kinds_leave_no_trace_and_are_counted(seed: int) -> None:
    disturbed(seed, KINDS, CONFIRMATIONS - 1)


def test_readings_out_of_range_or_too_fast_leave_no_trace_and_are_counted() -> None:
    good = by_stamp(two_topics(3, 40))
    wanted = listen(good)
    listener = Listener()
    sent = {"out_of_range": 0, "implausible": 0}
    for k, message in enumerate(good):
        listener.feed(message)
        if "p" in message.names:
            for value in (1.0 + 1e-6, -1e300):
                assert listener.feed(Message("joints", message.stamp + 1, ("p",), (value,))) == []
                sent["out_of_range"] += 1
        if "a" in message.names:
            far = course(0, message.stamp) + (1e-3 if k % 2 else -1e9)
            assert listener.feed(Message("motors", message.stamp + 1, ("a",), (far,))) == []
            sent["implausible"] += 1
    assert bits(listener.samples) == bits(wanted.samples)
    refused = listener.conditioner.refused
    assert {cause: refused[cause] for cause in sent} == sent
    assert sum(refused.values()) == sum(sent.values())


def test_the_ends_of_a_range_and_the_limit_of_speed_are_allowed() -> None:
    conditioner = Conditioner(ROBOT)
    conditioner.feed_joints(START, JOINTS, (-1.0, 2.0))
    conditioner.feed_joints(START + SECOND // 10, JOINTS, (1.0, 0.0))
    assert conditioner.accepted == 4
    assert not any(conditioner.refused.values())


def looped(seed: int) -> tuple[list[Message], list[Message]]:
    """A recording of one topic with all channels, and the same a minute earlier."""
    once = [
        Message("both", m.stamp, NAMES, tuple(course(k, m.stamp) for k in range(4)))
        for m in stream(seed, "both", 100)
    ]
    earlier = [Message(m.topic, m.stamp - 60 * SECOND, m.names, m.values) for m in once]
    return once, earlier


def test_a_clock_that_jumps_back_is_followed_after_enough_confirmations() -> None:
    once, earlier = looped(1)
    listener = listen(once)
    before = len(listener.samples)
    for k, message in enumerate(earlier):
        samples = listener.feed(message)
        assert listener.conditioner.clock_jumps == (1 if k >= CONFIRMATIONS - 1 else 0)
        assert (samples == []) == (k < CONFIRMATIONS - 1)
    assert len(listener.segments) == 2
    assert len(listener.segments[0]) == before
    assert listener.samples[-1].stamp_ns == earlier[-1].stamp


def test_a_clock_that_jumps_back_loses_no_reading() -> None:
    once, earlier = looped(1)
    listener = listen(once + earlier)
    assert bits(listener.segments[1]) == bits(listen(earlier).samples)
    assert listener.conditioner.accepted == 4 * (len(once) + len(earlier))
    assert not any(listener.conditioner.refused.values())


def test_a_clock_that_jumps_back_on_two_topics_loses_no_reading() -> None:
    streams = two_topics(2, 200)
    once = by_stamp(streams)
    earlier = [Message(m.topic, m.stamp - 60 * SECOND, m.names, m.values) for m in once]
    listener = listen(once + earlier)
    assert listener.conditioner.clock_jumps == 1
    assert bits(listener.segments[1]) == bits(listen(earlier).samples)
    assert listener.conditioner.accepted == 2 * sum(len(m.names) for m in once)


def test_a_gap_is_crossed_and_loses_no_reading() -> None:
    for wait in (MAX_GAP_NS + 1, 60 * SECOND):
        streams = two_topics(4, 80)
        cut = streams[0][40].stamp
        late = [
            [Message(m.topic, m.stamp + wait * (m.stamp >= cut), m.names, m.values) for m in one]
            for one in streams
        ]
        messages = by_stamp(late)
        listener = listen(messages)
        assert listener.conditioner.clock_jumps == 0
        assert listener.conditioner.gaps == 4, "one per channel"
        assert listener.conditioner.accepted == sum(len(m.names) for m in messages)
        assert not any(listener.conditioner.refused.values())
        stamps = {sample.stamp_ns for sample in listener.samples}
        first, last = min(stamps), max(stamps)
        assert stamps == {m.stamp for m in messages if first <= m.stamp <= last}
        assert last > cut + wait


@settings(max_examples=STREAMS, deadline=None, derandomize=True, database=None)
@given(st.data())
def test_every_reading_is_accepted_refused_or_held_and_offline_agrees(data: st.DataObject) -> None:
    # stamps wander, repeat, jump far ahead and back; values may be anything
    stamp = START
    messages = []
    for _ in range(data.draw(st.integers(1, 40))):
        stamp += data.draw(
            st.sampled_from(
                [1, 1000, 10**6, 10**6, 10**6, 10**6, 0, -1, -(10**6), 3 * SECOND, -3 * SECOND]
            )
        )
        topic = data.draw(st.sampled_from(["motors", "joints"]))
        names = data.draw(st.sampled_from([("a", "b"), ("a",), ("b",)] if topic == "motors" else
                                          [("p", "q"), ("p",), ("q",)]))  # fmt: skip
        values = [data.draw(st.sampled_from([0.0, 0.5, 1e-3, np.nan, 1e9, 1.5])) for _ in names]
        messages.append(Message(topic, stamp, names, tuple(values)))
    listener = listen(messages)
    conditioner = listener.conditioner
    sent = sum(len(message.names) for message in messages)
    for segment in listener.segments:
        stamps = [sample.stamp_ns for sample in segment]
        assert stamps == sorted(set(stamps))
        for sample in segment:
            assert np.all(np.isfinite(sample.motor_angle))
            assert np.all(np.abs(sample.joint_angle - [0.0, 1.0]) <= 1.0 + 1e-9)
    done = offline(messages)
    whole = [
        bits([segment.at(k) for k in range(segment.stamp_ns.size)]) for segment in done.segments
    ]
    assert [one for one in whole if one] == [bits(one) for one in listener.segments if one]
    assert dict(done.refused) == conditioner.refused
    assert (done.accepted, done.clock_jumps, done.gaps) == (
        conditioner.accepted, conditioner.clock_jumps, conditioner.gaps,
    )  # fmt: skip
    assert conditioner.accepted + sum(conditioner.refused.values()) + listener.held() == sent


def _two_clocks(mode="wait", **sensor):
    text = f"""
name: pair
motors: [{{name: m{"".join(f", {key}: {value}" for key, value in sensor.items())}}}]
joints: [{{name: j, range: [-10, 10]}}]
cables:
  - name: c
    axial_stiffness: 1000
    preload: 10
    nodes: [{{type: winch, motor: m, radius: 0.01, winding: 1}}, {{type: anchor}}]
    spans: [{{joint: j, offset: 1.0, slope: 0.01}}]
"""
    robot = parse_robot(text)
    return robot, Conditioner(robot, mode)


def _readings(stamps, values):
    stamps = np.asarray(stamps, dtype=np.int64)
    return Series(stamps, stamps.copy(), np.asarray(values, dtype=float))


def _events(motor, joint):
    """(arrival, 0 for the motor or 1 for the joint, stamp, value) of all readings."""
    return [
        (arrival, which, stamp, value)
        for which, r in enumerate((motor, joint))
        for stamp, arrival, value in zip(r.stamp_ns, r.log_ns, r.value, strict=True)
    ]


def _in_order(conditioner, robot, motor, joint):
    """Feed both channels in order of arrival; all samples."""
    events = _events(motor, joint)
    samples = []
    for _, which, stamp, value in sorted(events):
        feed = conditioner.feed_joints if which else conditioner.feed_motors
        samples += feed(int(stamp), ("j" if which else "m",), (float(value),))
    return samples


def test_a_reading_becomes_an_angle_by_scale_offset_and_clock_offset():
    _, conditioner = _two_clocks(scale=-2.0, offset=0.5, clock_offset=0.001)
    conditioner.feed_motors(10_000_000, ("m",), (0.1,))
    conditioner.feed_joints(11_000_000, ("j",), (0.0,))
    (sample,) = conditioner.feed_joints(12_000_000, ("j",), (0.0,)) or [None]
    assert sample is None  # the motor has no reading after 11 ms yet
    samples = conditioner.feed_motors(12_000_000, ("m",), (0.2,))
    assert [s.stamp_ns for s in samples] == [12_000_000]
    assert samples[0].motor_angle[0] == pytest.approx(-2.0 * 0.2 + 0.5 + 0.1)  # half way back


def test_an_encoder_that_wraps_is_unwrapped_alike_online_and_in_bulk():
    period = 2.0 * np.pi
    robot, conditioner = _two_clocks(period=period, scale=0.5)
    stamps = 1_000_000 * np.arange(1, 3001)
    truth = 9.0 * np.sin(stamps * 2e-9)  # several turns to and fro
    motor = _readings(stamps, np.mod(truth, period))
    joint = _readings(stamps, np.zeros(stamps.size))
    bulk = condition(robot, {"m": motor}, {"j": joint}).segments[0]
    online = _in_order(conditioner, robot, motor, joint)
    assert np.array_equal(bulk.motor_angle[:, 0], [s.motor_angle[0] for s in online])
    assert np.allclose(np.diff(bulk.motor_angle[:, 0]), 0.5 * np.diff(truth), atol=1e-12)


def _lagging_joint():
    """A joint encoder at half the rate whose messages come 3 ms late; both move at 1 rad/s."""
    stamps = 1_000_000 * np.arange(1, 401)
    motor = _readings(stamps, stamps * 1e-9)
    slow = stamps[::2]
    return motor, Series(slow, slow + 3_000_000, slow * -1e-9)


def test_the_first_intervals_of_a_slow_channel_give_no_samples_and_are_unknown():
    """From the fourth interval on the motion so far tells what may happen between readings."""
    heard, period = Listener(), SECOND // 2
    for k in range(300):
        stamp = START + k * SECOND // 100
        heard.feed(Message("motors", stamp, MOTORS, (0.5 * k / 100, 0.0)))
        if k % 50 == 10:
            heard.feed(Message("joints", stamp, JOINTS, (0.1 * np.sin(k / 30), 0.0)))
    (samples,) = heard.segments
    first = START + SECOND // 10
    early = [sample for sample in samples if sample.stamp_ns <= first + 3 * period]
    assert [sample.stamp_ns - first for sample in early] == [0, period, 2 * period, 3 * period]
    assert [bool(np.isinf(one.unseen[1]).any()) for one in early if one.unseen.size] == [True] * 3
    later = [sample for sample in samples if sample.stamp_ns > first + 3 * period]
    assert len(later) == 100
    assert all(np.all(np.isfinite(sample.unseen)) for sample in later)
    assert max(sample.unseen[0].max() for sample in later if sample.unseen.size) > 1e-3


@pytest.mark.parametrize("late", [(0, 0, 0), (310, 0, 0), (0, 90, 40), (0, 40, 330)])
def test_readings_within_an_unknown_interval_come_in_any_order(late: tuple[int, ...]) -> None:
    """An interval is seen to be unknown when it ends, with the others' readings there or not.

    The joints' messages and those of either motor are ``late`` by so many milliseconds.
    """
    stamps = START + SECOND * np.arange(1, 12) // 2
    begin, end, ms = int(stamps[0]) - SECOND // 5, int(stamps[-1]), SECOND // 1000
    messages = [
        Message("joints", stamp, JOINTS, (0.1 * np.sin(stamp * 1e-9), 0.0))
        for stamp in stamps.tolist()
    ]
    for name, every_ms in (("a", 20), ("b", 31)):
        messages += [
            Message("motors", stamp, (name,), (stamp * 1e-9 % 1.0,))
            for stamp in range(begin, end, every_ms * ms)
        ]
    delay = {"p": late[0] * ms, "a": late[1] * ms, "b": late[2] * ms}
    heard = Listener()
    for message in sorted(messages, key=lambda one: one.stamp + delay[one.names[0]]):
        heard.feed(message)
    (samples,) = heard.segments
    given = [sample.stamp_ns for sample in samples]
    assert given == sorted(set(given))
    assert [stamp for stamp in given if stamp <= stamps[3]] == stamps[:4].tolist()
    assert len([stamp for stamp in given if stamps[3] < stamp <= stamps[-2]]) > 100


def test_prediction_gives_at_once_the_samples_that_waiting_gives_late():
    motor, joint = _lagging_joint()
    for mode, lag in (("wait", 5_000_000), ("predict", 0)):
        _, conditioner = _two_clocks(mode)
        worst = 0
        samples = []
        for arrival, which, stamp, value in sorted(_events(motor, joint)):
            feed = conditioner.feed_joints if which else conditioner.feed_motors
            samples += feed(int(stamp), ("j" if which else "m",), (float(value),))
            if which == 0 and arrival > 150_000_000:  # its motion is known
                worst = max(worst, int(arrival) - samples[-1].stamp_ns)
        assert worst == lag
        late = [s for s in samples if s.stamp_ns > 20_000_000]
        assert np.allclose([s.joint_angle[0] + s.stamp_ns * 1e-9 for s in late], 0.0, atol=1e-9)
        for predicted in (False, True):
            stamps = [s.stamp_ns for s in samples if s.predicted == predicted]
            assert np.all(np.diff(stamps) > 0)
        assert any(s.predicted for s in samples) == (mode == "predict")


def test_prediction_ends_at_its_horizon_and_continues_without_a_lost_reading():
    robot, conditioner = _two_clocks("predict")
    stamps = 1_000_000 * np.arange(1, 301)
    motor = _readings(stamps, stamps * 1e-9)
    silent = (stamps > 150_000_000) & (stamps < 250_000_000)
    joint = _readings(stamps[~silent], np.zeros(int(np.sum(~silent))))
    samples = _in_order(conditioner, robot, motor, joint)
    ahead = [s.stamp_ns for s in samples if s.predicted and silent[s.stamp_ns // 1_000_000 - 1]]
    assert ahead == list(range(151_000_000, 171_000_000, 1_000_000))
    seen = [s for s in samples if not s.predicted]
    stamped = [s.stamp_ns for s in seen]
    assert np.array_equal(stamped, stamps)  # the joint's silence is filled in once it is over
    assert np.allclose([s.motor_angle[0] for s in seen], stamps * 1e-9)


def test_prediction_keeps_no_more_readings_the_longer_it_runs():
    _, conditioner = _two_clocks("predict")
    for k in range(1, 5000):
        conditioner.feed_motors(1_000_000 * k, ("m",), (0.0,))
        if k > 3:
            conditioner.feed_joints(1_000_000 * (k - 3), ("j",), (0.0,))
    assert max(conditioner.waiting.values()) < 60


def test_apart_from_predicted_samples_prediction_gives_those_of_the_recording():
    motor, joint = _lagging_joint()
    robot, conditioner = _two_clocks("predict")
    online = _in_order(conditioner, robot, motor, joint)
    seen = [s for s in online if not s.predicted]
    assert len(seen) < len(online)
    bulk = condition(robot, {"m": motor}, {"j": joint}).segments[0]
    assert np.array_equal(bulk.stamp_ns, [s.stamp_ns for s in seen])
    assert np.array_equal(bulk.joint_angle[:, 0], [s.joint_angle[0] for s in seen])


def test_late_readings_of_a_slower_topic_do_not_undo_a_loop_of_the_recording():
    _, conditioner = _two_clocks()
    second = 1_000_000_000
    for k in range(1, 50):
        conditioner.feed_motors(100 * second + k * 1_000_000, ("m",), (0.0,))
        conditioner.feed_joints(100 * second + k * 1_000_000, ("j",), (0.0,))
    for k in range(1, 8):  # the motor's topic has gone back already
        conditioner.feed_motors(10 * second + k * 1_000_000, ("m",), (0.0,))
    assert conditioner.clock_jumps == 1
    conditioner.feed_joints(100 * second + 50 * 1_000_000, ("j",), (0.0,))
    samples = []
    for k in range(1, 30):
        samples += conditioner.feed_joints(10 * second + k * 1_000_000, ("j",), (0.0,))
        samples += conditioner.feed_motors(10 * second + (k + 7) * 1_000_000, ("m",), (0.0,))
    assert conditioner.clock_jumps == 1
    assert conditioner.refused["late"] == 1
    assert [s.stamp_ns for s in samples] == [10 * second + k * 1_000_000 for k in range(1, 30)]
