"""Properties of the gates and the time line that hold for every stream of messages."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.reading_streams import Message, take
from support.wound import robot_of

from cdrj_ros._core import MAX_GAP_NS
from cdrj_ros.estimation.conditioner import Conditioner, angles_of
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.robot.reader import parse_robot

ROBOT = robot_of("""
name: four
motors: [{name: a, max_speed: 50}, {name: b}]
joints: [{name: p, range: [-1, 1], max_speed: 20}, {name: q, range: [0, 2]}]
""")
COUNTED = robot_of(
    """
name: counted
motors: [{name: m}]
joints: [{name: q, range: [-3, 3], resolution: 0.0015707963267948967}]
""",
    "m",
)
MOTORS, JOINTS = ("a", "b"), ("p", "q")
NAMES = MOTORS + JOINTS
START = 1_700_000_000_000_000_000
SECOND = 1_000_000_000


class Listener:
    """A conditioner fed by messages, and all samples that it has returned."""

    def __init__(self, robot=ROBOT):
        self.conditioner = Conditioner(robot)
        self.segments = [[]]

    def feed(self, message):
        jumps = self.conditioner.clock_jumps
        samples = take(
            self.conditioner, message.topic, message.stamp_ns, message.names, message.positions
        )
        if self.conditioner.clock_jumps != jumps:
            self.segments.append([])
        self.segments[-1].extend(samples)
        return samples

    @property
    def samples(self):
        return [sample for segment in self.segments for sample in segment]


def listen(messages):
    listener = Listener()
    for message in messages:
        listener.feed(message)
    return listener


def bits(samples):
    return [
        (
            s.stamp_ns,
            s.motor_angle.tobytes(),
            s.joint_angle.tobytes() + (s.unseen.tobytes() if np.any(s.unseen) else b""),
        )
        for s in samples
    ]


def course(k, stamp):
    """Angle of channel k at a time: within its range, slower than its limit."""
    return float((0.5, 3.0, 0.9, 0.5)[k] * np.sin((stamp - START) * 1e-9 * (2.0 + k)) + (k == 3))


def stream(seed, topic, count, begin=START):
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


def interleaved(streams, seed):
    """Streams shuffled into one; each keeps its own order."""
    generator = np.random.default_rng(seed)
    turns = generator.permutation(np.repeat(np.arange(len(streams)), [len(s) for s in streams]))
    sources = [iter(one) for one in streams]
    return [next(sources[k]) for k in turns]


def by_stamp(streams):
    return sorted((m for one in streams for m in one), key=lambda message: message.stamp_ns)


def two_topics(seed, count=60, begin=START):
    return [stream(seed, "motors", count, begin), stream(seed, "joints", count, begin)]


SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(SEEDS)
def test_samples_increase_and_lie_between_their_neighbours(seed):
    streams = two_topics(seed)
    samples = listen(interleaved(streams, seed)).samples
    assert bits(samples) == bits(listen(by_stamp(streams)).samples), "their order does not matter"
    stamps = [sample.stamp_ns for sample in samples]
    assert stamps == sorted(set(stamps))
    readings = {name: {} for name in NAMES}
    for message in by_stamp(streams):
        for name, value in zip(message.names, message.positions, strict=True):
            readings[name][message.stamp_ns] = value
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


def test_the_ends_of_a_range_and_the_limit_of_speed_are_allowed():
    conditioner = Conditioner(ROBOT)
    take(conditioner, "joints", START, JOINTS, (-1.0, 2.0))
    take(conditioner, "joints", START + SECOND // 10, JOINTS, (1.0, 0.0))
    assert conditioner.accepted == 4
    assert not any(conditioner.refused.values())


def test_a_clock_that_jumps_back_on_two_topics_loses_no_reading():
    streams = two_topics(2, 200)
    once = by_stamp(streams)
    earlier = [Message(m.topic, m.stamp_ns - 60 * SECOND, m.names, m.positions) for m in once]
    listener = listen(once + earlier)
    assert listener.conditioner.clock_jumps == 1
    after, fresh = (  # what may happen between readings is known from before the jump
        [sample._replace(unseen=sample.unseen[:0]) for sample in samples]
        for samples in (listener.segments[1], listen(earlier).samples)
    )
    assert bits(after) == bits(fresh)
    assert listener.conditioner.accepted == 2 * sum(len(m.names) for m in once)


def test_a_gap_is_crossed_and_loses_no_reading():
    for wait in (MAX_GAP_NS + 1, 60 * SECOND):
        streams = two_topics(4, 80)
        cut = streams[0][40].stamp_ns
        late = [
            [
                Message(m.topic, m.stamp_ns + wait * (m.stamp_ns >= cut), m.names, m.positions)
                for m in one
            ]
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
        assert stamps == {m.stamp_ns for m in messages if first <= m.stamp_ns <= last}
        assert last > cut + wait


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


def test_a_reading_becomes_an_angle_by_scale_offset_and_clock_offset():
    robot, conditioner = _two_clocks(scale=-2.0, offset=0.5, clock_offset=0.001, period=1.0)
    whole = angles_of(robot, "m", _readings([0, 10, 20, 30], [0.1, 0.4, np.inf, -0.4]))
    assert whole.stamp_ns.tolist() == [1_000_000, 1_000_010, 1_000_020, 1_000_030]
    assert np.allclose(whole.value, [0.3, -0.3, np.nan, -0.7], equal_nan=True)
    take(conditioner, "motors", 10_000_000, ("m",), (0.1,))
    take(conditioner, "joints", 11_000_000, ("j",), (0.0,))
    (sample,) = take(conditioner, "joints", 12_000_000, ("j",), (0.0,)) or [None]
    assert sample is None  # the motor has no reading after 11 ms yet
    samples = take(conditioner, "motors", 12_000_000, ("m",), (0.2,))
    assert [s.stamp_ns for s in samples] == [12_000_000]
    assert samples[0].motor_angle[0] == pytest.approx(-2.0 * 0.2 + 0.5 + 0.1)  # half way back


def _lagging_joint():
    """A joint encoder at half the rate whose messages come 3 ms late; both move at 1 rad/s."""
    stamps = 1_000_000 * np.arange(1, 401)
    motor = _readings(stamps, stamps * 1e-9)
    slow = stamps[::2]
    return motor, Series(slow, slow + 3_000_000, slow * -1e-9)


def test_in_its_first_intervals_nothing_is_known_of_a_slow_channel():
    """From the fourth interval on the motion so far tells what may happen between readings."""
    heard, period = Listener(), SECOND // 2
    for k in range(300):
        stamp = START + k * SECOND // 100
        heard.feed(Message("motors", stamp, MOTORS, (0.5 * k / 100, 0.0)))
        if k % 50 == 10:
            heard.feed(Message("joints", stamp, JOINTS, (0.1 * np.sin(k / 30), 0.0)))
    (samples,) = heard.segments
    samples = [one for one in samples if not np.isnan(one.joint_angle).any()]
    first = START + SECOND // 10
    early = [sample for sample in samples if sample.stamp_ns <= first + 3 * period]
    assert [sample.stamp_ns - first for sample in early] == [0, period, 2 * period, 3 * period]
    assert [bool(np.isinf(one.unseen[1]).any()) for one in early if one.unseen.size] == [True] * 3
    later = [sample for sample in samples if sample.stamp_ns > first + 3 * period]
    assert len(later) == 100
    assert all(np.all(np.isfinite(sample.unseen)) for sample in later)
    assert max(sample.unseen[0].max() for sample in later if sample.unseen.size) > 1e-3


@pytest.mark.parametrize("hertz", [30, 50, 100])
def test_a_sharp_turn_between_two_readings_is_within_the_stated_deviation(hertz):
    """A joint goes to and fro at 1 rad/s and turns within 30 ms, at another time of every cycle."""
    milliseconds = np.arange(12_000)
    position = np.abs((milliseconds + 250) % 1010 - 505) - 252.5  # corners [ms]
    truth = 1e-3 * np.convolve(position, np.full(30, 1.0 / 30.0), mode="same")
    heard, ratio = Listener(), []
    for k in milliseconds.tolist()[100:-100]:
        stamp = START + k * SECOND // 1000
        found = heard.feed(Message("motors", stamp, MOTORS, (0.0, 0.0)))
        if k % (1000 // hertz) == 0:
            found += heard.feed(Message("joints", stamp, JOINTS, (truth[k], 1.0)))
        for sample in found if k > 4000 else []:
            error = abs(sample.joint_angle[0] - truth[(sample.stamp_ns - START) // 1_000_000])
            stated = sample.unseen[0][2] if sample.unseen.size else 0.0
            ratio.append(error / (stated + 2e-5))
    assert len(ratio) > 7000
    assert max(ratio) < 2.0


def test_a_joint_that_slows_down_and_rests_is_not_taken_for_a_stuck_encoder():
    """4000 counts per turn; the joint stops within 0.1 s, the motor goes on."""
    heard, count = Listener(COUNTED), 2.0 * np.pi / 4000.0
    time = 0.002 * np.arange(1000)
    slow = np.clip(time - 0.95, 0.0, 0.1)
    joint = np.minimum(time, 0.95) + slow - 5.0 * slow**2
    for k, stamp in enumerate((START + 2_000_000 * np.arange(1000)).tolist()):
        heard.feed(Message("motors", stamp, ("m",), (8.0 * time[k],)))
        heard.feed(Message("joints", stamp, ("q",), (count * np.round(joint[k] / count),)))
    doubtful = [one.stamp_ns - START for one in heard.samples if one.doubtful.any()]
    assert doubtful == [0], "a first reading, which nothing confirms"


def test_prediction_gives_at_once_the_samples_that_waiting_gives_late():
    motor, joint = _lagging_joint()
    for mode, lag in (("wait", 5_000_000), ("predict", 0)):
        _, conditioner = _two_clocks(mode)
        worst = 0
        samples = []
        for arrival, which, stamp, value in sorted(_events(motor, joint)):
            samples += take(conditioner, "both", int(stamp), ("mj"[which],), (float(value),))
            if which == 0 and arrival > 150_000_000:  # its motion is known
                worst = max(worst, int(arrival) - samples[-1].stamp_ns)
        assert worst == lag
        late = [s for s in samples if s.stamp_ns > 20_000_000]
        assert np.allclose([s.joint_angle[0] + s.stamp_ns * 1e-9 for s in late], 0.0, atol=1e-9)
        for predicted in (False, True):
            stamps = [s.stamp_ns for s in samples if s.predicted == predicted]
            assert np.all(np.diff(stamps) > 0)
        assert any(s.predicted for s in samples) == (mode == "predict")


def test_late_readings_of_a_slower_topic_do_not_undo_a_loop_of_the_recording():
    _, conditioner = _two_clocks()
    second = 1_000_000_000
    for k in range(1, 50):
        take(conditioner, "motors", 100 * second + k * 1_000_000, ("m",), (0.0,))
        take(conditioner, "joints", 100 * second + k * 1_000_000, ("j",), (0.0,))
    for k in range(1, 8):  # the motor's topic has gone back already
        take(conditioner, "motors", 10 * second + k * 1_000_000, ("m",), (0.0,))
    assert conditioner.clock_jumps == 1
    take(conditioner, "joints", 100 * second + 50 * 1_000_000, ("j",), (0.0,))
    samples = []
    for k in range(1, 30):
        samples += take(conditioner, "joints", 10 * second + k * 1_000_000, ("j",), (0.0,))
        samples += take(conditioner, "motors", 10 * second + (k + 7) * 1_000_000, ("m",), (0.0,))
    assert conditioner.clock_jumps == 1
    assert conditioner.refused["late"] == 1
    assert [s.stamp_ns for s in samples] == [10 * second + k * 1_000_000 for k in range(1, 30)]
