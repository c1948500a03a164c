"""Ordinary messages are taken by a kernel, with the same effect as if they were decoded."""

from __future__ import annotations

from collections import Counter
from math import remainder
from random import Random
from typing import Any

import numpy as np
import pytest
from support.foreign_bags import joint_state
from support.wound import robot_of

from cdrj_ros.conditioning import ordinary
from cdrj_ros.conditioning.conditioner import Conditioner
from cdrj_ros.conditioning.gate import LARGEST
from cdrj_ros.conditioning.ordinary import LONGEST
from cdrj_ros.conditioning.ordinary_kernel import NO_SAMPLE, NOT_ORDINARY
from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.messages.decoders import JointStateDecoder
from cdrj_ros.nodes.ordinary_topic import KEPT, LENGTHS, OrdinaryTopic
from cdrj_ros.robot.description import Robot

AXES = """
name: several
motors:
  - {name: a, max_speed: 50}
  - {name: b, max_speed: 50, resolution: 0.001, tracking_bandwidth: 20}
  - {name: c, clock_offset: 0.002, resolution: 0.01, tracking_bandwidth: 5, tracking: adaptive}
joints:
  - {name: p, range: [-0.5, 0.5], max_speed: 8}
  - {name: q, range: [-1, 0.52], resolution: 0.05, tracking_bandwidth: 3}
"""
PLAIN = robot_of(AXES)
GEARED = robot_of(
    AXES.replace("name: a,", "name: a, scale: -0.5, offset: 0.1, period: 6.3,")
    .replace("name: b,", "name: b, period: 0.015,")
    .replace("name: c,", "name: c, scale: 0.3,")
    .replace("name: p,", "name: p, offset: 0.02, period: 3.1,")
)
CORRECTED = robot_of(
    AXES.replace("name: p,", "name: p, correction: {angle: [-1, 1], value: [0.01, -0.01]},")
)
BEGIN_NS = 10**18
OFFSET_NS = 2_000_000
INTERVALS_MS = (*60 * (1,), 4, 4, 15, 60, 130, 400, 900)

Message = tuple[str, int, list[str], list[float]]


class Plain:
    """Decodes every message."""

    def __init__(self, mode: str = "wait", robot: Robot = PLAIN) -> None:
        self.conditioner = Conditioner(robot, mode)
        self.decode = JointStateDecoder()
        self.taken: Counter[str] = Counter()
        """Ordinary messages by kind."""

    def take(self, kind: str, payload: bytes) -> list[Sample]:
        stamp, names, positions = self.decode(payload)
        samples: list[Sample] = getattr(self.conditioner, f"feed_{kind}")(stamp, names, positions)
        return samples


class Quick(Plain):
    """Takes ordinary messages as the node does, and counts them."""

    def __init__(self, mode: str = "wait", robot: Robot = PLAIN) -> None:
        super().__init__(mode, robot)
        kinds = ("motors", "joints", "both")
        self.topics = {kind: OrdinaryTopic(self.conditioner, kind) for kind in kinds}

    def take(self, kind: str, payload: bytes) -> list[Sample]:
        topic = self.topics[kind]
        completed = topic.take(payload)
        if completed == NOT_ORDINARY:
            samples = super().take(kind, payload)
            assert self.decode.last is not None
            topic.learn(self.decode.last)
            if samples:
                self.conditioner.begin_ordinary()
            return samples
        self.taken[kind] += 1
        if completed == NO_SAMPLE:
            return []
        return [self.conditioner.ordinary.sample(completed)]


def stream(random: Random, robot: Robot, count: int) -> list[Message]:
    """Messages, most of them with the same stamps, of axes that sometimes leap or pause."""
    found: list[Message] = []
    periods = {axis.name: axis.sensor.period for axis in robot.axes}
    stamp, leap, speed = BEGIN_NS, 0.0, random.choice((0.1, 0.5, 2.0, 6.0))
    split, whole = random.random() < 0.3, random.random() < 0.3
    for k in range(count):
        stamp += (400 if k < 3 else random.choice(INTERVALS_MS)) * 1_000_000
        if random.random() < 0.01:
            leap = random.choice((0.0, 0.3))
        angle = 0.6 * np.sin(speed * (stamp - BEGIN_NS) * 1e-9)
        aside = random.choice((*30 * (0.0,), 0.012))  # too fast for p, too little for a leap
        joints = {"p": 0.85 * angle + aside, "q": min(0.9 * angle, 0.52)}
        motors = {"a": 10.0 * angle, "b": 3.0 * angle + leap}
        early = stamp - OFFSET_NS  # corrected by the robot file
        messages: list[tuple[str, int, dict[str, float]]] = [
            ("motors", early, {"c": angle}),
            ("joints", stamp, joints),
        ]
        if whole:
            messages[1] = ("both", stamp, joints | motors)
        elif split:
            messages += [("motors", stamp, {name: motors[name]}) for name in motors]
        else:
            messages.append(("motors", stamp, motors))
        if random.random() < 0.3:
            random.shuffle(messages)
        if k < 2 or random.random() < 0.03:
            messages.pop()
        for kind, at, angles in messages:
            readings = {name: remainder(angle, periods[name]) for name, angle in angles.items()}
            found.append(spoiled(random, (kind, at, readings)))
        if k > 5 and random.random() < 0.05:  # a message arrives twice or late
            place = random.randrange(-5, 0)
            found.append(found[place] if random.random() < 0.5 else found.pop(place))
    return found


def spoiled(random: Random, message: tuple[str, int, dict[str, float]]) -> Message:
    """A message, now and then with other names, with a wrong number or at another time."""
    kind, stamp, angles = message
    names, values = list(angles), list(angles.values())
    fault = random.random()
    if fault < 0.01:
        del names[1:], values[1:]
    elif fault < 0.02:
        names, values = [*names, names[0]], [*values, values[0]]
    elif fault < 0.03:
        values[-1] = random.choice((np.nan, np.inf, 7.0, 1e15))
    elif fault < 0.04:
        stamp += random.choice((-5_000_000, -1, 1, 3_000_000, 6_000_000_000))
    elif fault < 0.05:
        stamp = random.choice((0, -1_000_000_000, 2**31 * 1_000_000_000 - 1))
    elif fault < 0.3:  # other axes share the topic
        names, values = ["gripper", *names, "p"], [1.0, *values, 0.1]
    return kind, stamp, names, values


def content(sample: Sample) -> tuple[object, ...]:
    return tuple(one.tobytes() if isinstance(one, np.ndarray) else one for one in sample)


def counters(conditioner: Conditioner) -> tuple[object, ...]:
    names = ("accepted", "elsewhere", "clock_jumps", "gaps", "steps", "refused")
    line = conditioner.time_line
    return (*(getattr(conditioner, name) for name in names), line.lag_ns, line.crowded)


def remembered(conditioner: Conditioner) -> list[object]:
    """All that the channels and the time line remember."""
    kept: list[object] = []
    for channel in conditioner._channels:
        own = {**vars(channel), "memory": channel.memory.tolist(), "limits": None}
        before = own.pop("before")
        kept += [own, before and (before.last_stamp, before.turns, before.last_reading)]
    line = {**vars(conditioner.time_line), "_channels": None}
    doubts = line.pop("_doubts")
    return [*kept, line, [doubt for doubt in doubts if doubt.until_ns > line["_given_out"]]]


def disturb(random: Random, conditioners: list[Conditioner]) -> None:
    """Read or change the memory of both, as services and diagnostics do."""
    deed, bandwidth = random.random(), random.choice((None, 0.0, 30.0))
    if deed < 0.01:
        ours, theirs = (remembered(one) for one in conditioners)
        assert ours == theirs
    for one in conditioners:
        if 0.01 < deed < 0.012:
            one.reset(keep_turns=bandwidth is None)
        elif 0.012 < deed < 0.014:
            one.set_tracking(bandwidth)


@pytest.mark.parametrize("robot", [PLAIN, GEARED], ids=["plain", "geared"])
@pytest.mark.parametrize("seed", range(8))
def test_the_samples_and_counters_are_those_of_decoded_messages(
    seed: int, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ordinary, "WORTH", 0)
    random = Random(seed)
    quick, plain = Quick(robot=robot), Plain(robot=robot)
    conditioners = [quick.conditioner, plain.conditioner]
    for kind, stamp, names, values in stream(random, robot, 1200):
        payload = joint_state(stamp, names, values)
        ours, theirs = (one.take(kind, payload) for one in (quick, plain))
        assert [content(one) for one in ours] == [content(one) for one in theirs]
        assert counters(quick.conditioner) == counters(plain.conditioner)
        disturb(random, conditioners)
    assert remembered(quick.conditioner) == remembered(plain.conditioner)
    assert quick.taken.total() > 200


NAMES = ("a", "b", "p", "q")


def message(milliseconds: int) -> bytes:
    """All axes but one, some time after the beginning."""
    return joint_state(BEGIN_NS + milliseconds * 1_000_000, NAMES, [0.0] * 4)


def aside(milliseconds: int) -> bytes:
    """The remaining axis."""
    return joint_state(BEGIN_NS + milliseconds * 1_000_000 - OFFSET_NS, ["c"], [0.0])


def steady(quick: Plain, count: int, **options: bool) -> list[bool]:
    """Send messages of resting axes; whether each was taken as an ordinary one."""
    found = []
    for k in range(count):
        before = quick.taken.total()
        stamp = BEGIN_NS + k * 1_000_000
        names = ["a", "b", "c", "p", "q"]
        for kind, at, chosen in (("motors", stamp - OFFSET_NS, names[2:3]), ("both", stamp, names)):
            kept = [name for name in chosen if kind == "motors" or name != "c"]
            quick.take(kind, joint_state(at, kept, [0.0] * len(kept), **options))
        found.append(quick.taken.total() - before == 2)
    return found


def test_all_messages_after_the_first_sample_are_ordinary() -> None:
    quick = Quick()
    assert steady(quick, 500) == [False] + [True] * 499
    assert quick.conditioner.accepted == 2500
    for _ in range(3):
        quick.take("both", message(499))
    assert quick.conditioner.refused["repeated"] == 12
    (family,) = quick.topics["both"]._layouts.values()
    assert len(family.layouts) == 1


def test_no_message_is_ordinary_until_the_kernel_is_there() -> None:
    quick = Quick()
    quick.conditioner.ordinary.postpone()
    assert not any(steady(quick, 50))
    assert quick.conditioner.accepted == 250
    quick.conditioner.ordinary.prepare()
    assert all(steady(quick, 150)[100:])


def test_loading_is_tried_ever_less_often_where_it_is_not_worth_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One topic has twice the rate of the other: nothing is ordinary for long."""
    loads: list[int] = []
    quick = Quick()
    load = quick.conditioner.ordinary.load

    def counted(*arguments: Any) -> None:
        before = quick.conditioner.ordinary.loaded
        load(*arguments)
        loads.append(quick.conditioner.ordinary.loaded and not before)

    monkeypatch.setattr(quick.conditioner.ordinary, "load", counted)
    for k in range(3000):
        quick.take("both", message(k))
        if k % 2 == 0:
            quick.take("motors", aside(k))
    assert len(loads) > 1000
    assert 5 < sum(loads) < 20
    for k in range(3000, 3000 + 2 * LONGEST):
        quick.take("both", message(k))
        quick.take("motors", aside(k))
    taken = quick.taken.total()
    for k in range(6000, 6100):
        quick.take("both", message(k))
        quick.take("motors", aside(k))
    assert quick.taken.total() - taken >= 198
    quick.conditioner.memory()  # as the diagnostics do, every second
    quick.take("both", message(6100))
    quick.take("motors", aside(6100))
    assert quick.conditioner.ordinary.loaded


def test_messages_are_not_ordinary_where_samples_are_predicted() -> None:
    assert not any(steady(Quick("predict"), 50))


def test_messages_are_not_ordinary_where_readings_are_corrected() -> None:
    assert not any(steady(Quick(robot=CORRECTED), 50))


def test_messages_are_not_ordinary_before_the_first_sample() -> None:
    conditioner = Quick().conditioner
    conditioner.begin_ordinary()
    assert not conditioner.ordinary.loaded


def test_messages_of_the_other_byte_order_are_decoded() -> None:
    quick = Quick()
    assert not any(steady(quick, 50, little_endian=False))
    assert quick.conditioner.accepted == 250
    assert not quick.topics["both"]._layouts


def test_readings_beyond_the_largest_are_refused() -> None:
    quick, plain = Quick(), Plain()
    for k in range(60):
        reading = LARGEST if k < 50 else np.nextafter(LARGEST, np.inf)
        for one in (quick, plain):
            one.take("motors", aside(k))
            payload = joint_state(BEGIN_NS + k * 1_000_000, NAMES, [reading, 0.0, 0.0, 0.0])
            one.take("both", payload)
    assert counters(quick.conditioner) == counters(plain.conditioner)
    assert quick.conditioner.refused["implausible"] == 10
    assert quick.taken["both"] > 40


@pytest.mark.parametrize(
    "names",
    [[f"{k:02d}" for k in range(50)], ["x" * k for k in range(500)]],
    ids=["senders", "lengths"],
)
def test_many_layouts_on_a_topic_are_forgotten_again(names: list[str]) -> None:
    """Neither many senders nor messages of many lengths make a topic grow."""
    quick = Quick()
    for k, name in enumerate(names):
        quick.take("both", joint_state(BEGIN_NS + k, ["a", name], [0.0, 0.0]))
    families = quick.topics["both"]._layouts
    assert 0 < len(families) <= LENGTHS
    assert all(0 < len(family.layouts) <= KEPT for family in families.values())


def test_stamps_beyond_the_last_one_are_refused() -> None:
    """As a stamp before zero, whose seconds are beyond the end when read without sign."""
    quick, plain = Quick(), Plain()
    end = 2**31 * 1_000_000_000
    for k in range(-50, 5):
        stamp = end + k * 1_000_000
        for one in (quick, plain):
            for at, names in ((stamp - OFFSET_NS, ["c"]), (stamp, NAMES)):
                signed = at if at < end else at - 2 * end
                one.take("both", joint_state(signed, names, [0.0] * len(names)))
    assert counters(quick.conditioner) == counters(plain.conditioner)
    assert quick.conditioner.refused["unstamped"] == 8
    assert quick.conditioner.refused["future"] == 2
    assert quick.taken["both"] > 90


def at_rest(quick: Quick) -> OrdinaryTopic:
    """The topic of all axes but one, whose messages are ordinary."""
    steady(quick, 50)
    assert quick.conditioner.ordinary.loaded
    return quick.topics["both"]


def test_a_message_that_cannot_be_decoded_is_not_ordinary() -> None:
    topic = at_rest(Quick())
    good = message(50)
    for place, value in ((1, 7), (len(good) - 1, 1), (len(good) - 8, 2), (20, 9)):
        wrong = bytearray(good)
        wrong[place] ^= value
        assert topic.take(bytes(wrong)) == NOT_ORDINARY
    assert topic.take(good + bytes(8)) == NOT_ORDINARY
    assert topic.take(good) == NO_SAMPLE


def test_a_message_of_other_axes_is_counted_while_readings_wait() -> None:
    quick, plain = Quick(), Plain()
    at_rest(quick)
    steady(plain, 50)
    for one in (quick, plain):
        one.take("motors", aside(50))
        for stamp in (0, BEGIN_NS, BEGIN_NS + 50_000_000):
            for names in (["gripper"], []):
                one.take("both", joint_state(stamp, names, [0.0] * len(names)))
                one.take("both", joint_state(stamp, names, [0.0] * len(names)))
    assert counters(quick.conditioner) == counters(plain.conditioner)
    assert quick.conditioner.ordinary.loaded


GLITCH = joint_state(BEGIN_NS + 51_000_000, ["a"], [1.0])


@pytest.mark.parametrize("wrong", [GLITCH, message(8000)], ids=["glitch", "gap"])
def test_nothing_is_ordinary_until_it_is_known_whether_a_reading_was_right(wrong: bytes) -> None:
    """A reading that is refused, or held, precedes the last one of the sample before it."""
    quick = Quick()
    at_rest(quick)
    for payload in (message(50), wrong):
        quick.take("both", payload)
    (sample,) = quick.take("motors", aside(50))
    assert sample.stamp_ns == BEGIN_NS + 50_000_000
    assert not quick.conditioner.ordinary.loaded
