"""Bags from third-party writers, so that our reader is not tested only against our writer."""

import sys

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.source import read_messages
from support.places import ROOT

STORE = get_typestore(Stores.ROS2_JAZZY)
for _name in ("CableTensions", "NodalForces"):
    _text = (ROOT / "msg_defs/cdrj_msgs/msg" / f"{_name}.msg").read_text(encoding="utf-8")
    STORE.register(get_types_from_msg(_text, f"cdrj_msgs/msg/{_name}"))
TOPIC = "/joint_states"
JOINT_STATE = "sensor_msgs/msg/JointState"
START_NS = 1_700_000_000_000_000_000
ONE_TOPIC = Topics(TOPIC, TOPIC, (TOPIC,))
COUNT = 600
"""Messages of a bag that is read whole."""


def header(stamp_ns, frame_id=""):
    sec, nanosec = divmod(stamp_ns, 10**9)
    time = STORE.types["builtin_interfaces/msg/Time"](sec, nanosec)
    return STORE.types["std_msgs/msg/Header"](time, frame_id)


def joint_state(
    stamp_ns, names, position=(), velocity=(), effort=(), *, frame_id="", little_endian=True
):
    arrays = (np.array(list(values), float) for values in (position, velocity, effort))
    message = STORE.types[JOINT_STATE](header(stamp_ns, frame_id), list(names), *arrays)
    return bytes(STORE.serialize_cdr(message, JOINT_STATE, little_endian=little_endian))


def write_mcap(
    path,
    messages,
    *,
    msgtype=JOINT_STATE,
    encoding="cdr",
    compression=CompressionType.NONE,
    chunked=True,
    chunk_size=4096,
    indexed=True,
):
    """Write messages (topic, log_ns, payload) to an MCAP file with the writer of mcap."""
    definition = STORE.generate_msgdef(msgtype, ros_version=2)[0]
    with path.open("wb") as stream:
        writer = Writer(
            stream,
            chunk_size=chunk_size,
            compression=compression,
            use_chunking=chunked,
            use_statistics=indexed,
            use_summary_offsets=indexed,
            repeat_channels=indexed,
            repeat_schemas=indexed,
            index_types=IndexType.ALL if indexed else IndexType.NONE,
        )
        writer.start(profile="ros2")
        schema = writer.register_schema(msgtype, "ros2msg", definition.encode())
        channels = {}
        for topic, log_ns, payload in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, encoding, schema)
            writer.add_message(channels[topic], log_ns, payload, log_ns)
        writer.finish()
    return path


def write_topics(path, topics):
    """Write topics of several types to MCAP: {topic: (type, definition, [(log_ns, payload)])}.

    An empty definition stands for the standard ROS definition.
    """
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        for topic, (msgtype, definition, messages) in topics.items():
            text = definition or STORE.generate_msgdef(msgtype, ros_version=2)[0]
            schema = writer.register_schema(msgtype, "ros2msg", text.encode())
            channel = writer.register_channel(topic, "cdr", schema)
            for log_ns, payload in messages:
                writer.add_message(channel, log_ns, payload, log_ns)
        writer.finish()
    return path


def swing(count, *, little_endian=True):
    """Messages of `motor` (0, 1, 2, …) and `joint` (0, −1, −2, …), a millisecond apart."""
    return [
        (
            TOPIC,
            START_NS + i * 1_000_000,
            joint_state(
                START_NS + i * 1_000_000,
                ["motor", "joint"],
                [i, -i],
                effort=[2 * i, -2 * i],
                little_endian=little_endian,
            ),
        )
        for i in range(count)
    ]


def attempt(read):
    """What `read` returns, and the text of the refusal; any other exception passes."""
    try:
        return read(), ""
    except BagError as error:
        return None, str(error)


def check_whole(path):
    """Check that every way of reading returns all messages of `swing`; returns the notes."""
    read = read_recording(path, ONE_TOPIC)
    np.testing.assert_array_equal(read.motors["motor"].value, np.arange(COUNT))
    np.testing.assert_array_equal(read.joints["joint"].value, -np.arange(COUNT))
    np.testing.assert_array_equal(read.references["effort/motor"].value, 2 * np.arange(COUNT))
    assert read.malformed == {TOPIC: 0}
    times = [message.log_ns for message in read_messages(path, [TOPIC])]
    assert times == sorted(times)
    assert len(times) == COUNT
    return read.notes


@pytest.fixture(scope="session")
def make():
    """This module."""
    return sys.modules[__name__]
