"""Reading and writing of recordings; nothing else opens one."""

from cdrj_ros.bag.messages import RawMessage, TopicInfo, list_topics, read_messages
from cdrj_ros.bag.recording import Recording, Topics, read_recording
from cdrj_ros.bag.series import Series
from cdrj_ros.bag.source import size_of
from cdrj_ros.bag.writer import BagWriter

__all__ = [
    "BagWriter",
    "RawMessage",
    "Recording",
    "Series",
    "TopicInfo",
    "Topics",
    "list_topics",
    "read_messages",
    "read_recording",
    "size_of",
]
