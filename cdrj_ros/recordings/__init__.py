"""Reading, writing and playback of recordings; no other room opens one."""

from cdrj_ros.foundation.arrays import Series
from cdrj_ros.recordings.recording import Recording, Topics, read_recording
from cdrj_ros.recordings.source import (
    RawMessage,
    Source,
    open_source,
    read_messages,
)
from cdrj_ros.recordings.writer import BagWriter

__all__ = [
    "BagWriter",
    "RawMessage",
    "Recording",
    "Series",
    "Source",
    "Topics",
    "open_source",
    "read_messages",
    "read_recording",
]
