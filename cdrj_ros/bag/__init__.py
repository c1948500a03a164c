"""Reading and writing of recordings; no other room opens one."""

from cdrj_ros.bag.recording import Recording, Topics, read_recording
from cdrj_ros.bag.source import (
    RawMessage,
    Source,
    TopicInfo,
    list_topics,
    open_source,
    read_messages,
)
from cdrj_ros.bag.writer import BagWriter
from cdrj_ros.foundation.series import Series

__all__ = [
    "BagWriter",
    "RawMessage",
    "Recording",
    "Series",
    "Source",
    "TopicInfo",
    "Topics",
    "list_topics",
    "open_source",
    "read_messages",
    "read_recording",
]
