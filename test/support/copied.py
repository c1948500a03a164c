"""Messages of one bag in another."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cdrj_ros.recordings import BagWriter, open_source, read_messages


def copy(bag: BagWriter, path: Path, topics: Sequence[str] | None = None) -> None:
    """Copy the messages of these topics of a bag; None: of all."""
    there = open_source(path).all_channels()
    for topic in there if topics is None else topics:
        messages = [(one.log_ns, one.data) for one in read_messages(path, [topic])]
        bag.write_messages(topic, there[topic].msgtype, messages)
