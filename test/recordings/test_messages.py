"""Messages in order of log time, and lists of topics."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.recordings import BagWriter, RawMessage, read_messages


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
        make.mcap(folder / f"bag_{part}.mcap", messages, chunk_size=2000)
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
    path = make.mcap(tmp_path / "a.mcap", make.swing(3), encoding="json")
    with pytest.raises(BagError, match="'json', expected 'cdr'"):
        read_messages(path, [make.topic])


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
