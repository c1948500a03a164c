"""Copies of bags with other stamps in the headers, as drivers and other clocks make them."""

import struct

from cdrj_ros.recordings.source import open_source, read_messages
from cdrj_ros.recordings.writer import BagWriter

SECOND = 10**9


def restamped(bag, out, change):
    """Write a copy of a bag; ``change`` shifts the stamps of topics [ns], None makes them zero."""
    source = open_source(bag)
    with BagWriter(out) as writer:
        for topic, channel in source.all_channels().items():
            messages = []
            for one in read_messages(source, (topic,)):
                data, shift = one.data, change.get(topic, 0)
                sec, nanosec = struct.unpack_from("<iI", data, 4)
                stamp = 0 if shift is None else sec * SECOND + nanosec + shift
                changed = data[:4] + struct.pack("<iI", *divmod(stamp, SECOND)) + data[12:]
                messages.append((one.log_ns, changed))
            writer.write_messages(topic, channel.msgtype, messages)
    return str(out)
