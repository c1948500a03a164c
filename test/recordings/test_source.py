"""Messages in order of log time, lists of topics, and when a message is due."""

from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdrj_ros.foundation.errors import BagError, UsageError
from cdrj_ros.recordings.source import MAX_RATE, MIN_RATE, Playback, RawMessage, read_messages
from cdrj_ros.recordings.writer import BagWriter


@pytest.fixture
def three_topics(make, tmp_path):
    """A split bag: two files that overlap in time, each out of order, of three topics."""
    rng = np.random.default_rng(4)
    folder = tmp_path / "bag"
    folder.mkdir()
    everything = []
    for part, (low, high) in enumerate([(0, 600), (500, 1100)]):
        times = np.sort(rng.integers(low, high, 700)) + rng.integers(0, 30, 700)
        messages = [
            (f"/t{i % 3}", int(t), make.joint_state(int(t), [f"{part}"], [i]))
            for i, t in enumerate(times)
        ]
        make.write_mcap(folder / f"bag_{part}.mcap", messages, chunk_size=2000)
        everything += messages
    return folder, everything


def test_messages_come_in_order_across_topics_and_files(make, three_topics):
    folder, everything = three_topics
    wanted = [m for m in everything if m[0] != "/t1"]
    wanted.sort(key=lambda message: message[1])
    found = list(read_messages(folder, ["/t0", "/t2", "/not/there"]))
    assert [(m.topic, m.log_ns, m.data) for m in found] == wanted
    assert {m.msgtype for m in found} == {"sensor_msgs/msg/JointState"}
    assert all(type(m) is RawMessage and type(m.data) is bytes for m in found)


def test_a_span_of_time_is_half_open(three_topics):
    folder, everything = three_topics
    found = [m.log_ns for m in read_messages(folder, ["/t0"], start_ns=300, end_ns=550)]
    assert found == sorted(t for topic, t, _ in everything if topic == "/t0" and 300 <= t < 550)


def test_arguments_are_checked_before_the_first_message(make, tmp_path, three_topics):
    folder, _ = three_topics
    with pytest.raises(BagError, match=r"none of the topics /x, but /t0, /t1, /t2"):
        read_messages(folder, ["/x"])
    path = make.write_mcap(tmp_path / "a.mcap", make.swing(3), encoding="json")
    with pytest.raises(BagError, match="'json', expected 'cdr'"):
        read_messages(path, [make.TOPIC])


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 50)), max_size=60))
def test_what_a_writer_is_given_in_any_order_is_read_in_order_of_time(tmp_path_factory, events):
    path = tmp_path_factory.mktemp("bag") / "bag"
    with BagWriter(path) as bag:
        for topic in range(3):
            times = [t for which, t in events if which == topic]
            values = [i for i, (which, _) in enumerate(events) if which == topic]
            bag.write_joint_states(f"/{topic}", times, ["x"], np.reshape(values, (-1, 1)))
    found = [(m.topic, m.log_ns) for m in read_messages(path, ["/0", "/1", "/2"])]
    ordered = sorted(events, key=lambda event: (event[1], event[0]))
    assert found == [(f"/{topic}", t) for topic, t in ordered]


S = 1_000_000_000


def _playback(times_ns, rate=1.0):
    messages = [RawMessage("/t", t, k.to_bytes(4, "little"), "") for k, t in enumerate(times_ns)]
    return Playback(messages, times_ns[0], times_ns[-1], rate=rate)


def _playing(times_ns, rate=1.0):
    playback = _playback(times_ns, rate)
    playback.start(0.0)
    return playback


def _numbers(messages):
    return [int.from_bytes(message.data, "little") for message in messages]


def test_a_message_is_due_at_its_time_divided_by_the_rate():
    playback = _playing([0, 1 * S, 2 * S], rate=4.0)
    assert _numbers(playback.take(0.0, 10)) == [0]
    assert playback.wait_s(0.1) == pytest.approx(0.15)
    assert not playback.take(0.249, 10)
    assert _numbers(playback.take(0.25, 10)) == [1]


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), inf, MIN_RATE / 2, MAX_RATE * 2])
def test_an_invalid_rate_is_refused(rate):
    with pytest.raises(UsageError, match="rate must be in"):
        _playback([0], rate)


@given(
    st.lists(st.integers(0, 20 * S), min_size=1, max_size=60).map(sorted),
    st.lists(st.floats(0.0, 3.0), max_size=30),
    st.integers(1, 20),
    st.sampled_from([None, 0.1, 1.0, 50.0]),
)
def test_no_message_is_lost_repeated_out_of_order_or_early(times, waits, at_most, rate):
    playback, now = _playing(times, rate), 0.0
    sent = []
    position = playback.begin_ns
    steps = iter(waits)
    while not playback.ended:
        now += next(steps, playback.wait_s(now) + 1e-9)
        taken = playback.take(now, at_most)
        assert len(taken) <= at_most
        if rate is not None:
            assert all(m.log_ns - times[0] <= now * rate * 1e9 + 1 for m in taken)
        sent += _numbers(taken)
        assert playback.position_ns(now) >= position
        position = playback.position_ns(now)
        assert playback.ended or position <= times[len(sent)]
    assert sent == list(range(len(times)))


@pytest.mark.parametrize("rate", [1.0, None])
def test_nothing_is_due_before_the_start(rate):
    playback = _playback([0, S], rate)
    assert not playback.take(1e9, 10)
    assert playback.wait_s(1e9) == inf
