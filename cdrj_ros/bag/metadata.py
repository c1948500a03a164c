"""Text of rosbag2's metadata.yaml (version 9, as written by ROS 2 Jazzy)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from io import StringIO
from textwrap import indent
from typing import Any, Final

from ruamel.yaml import YAML

_VERSION: Final = 9
_DISTRO: Final = "jazzy"


def _text(content: object) -> str:
    stream = StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.width = 4096
    yaml.dump(content, stream)
    return stream.getvalue()


def _qos() -> dict[str, Any]:
    """Reliable with depth 10; a new object for each call, so that YAML writes no anchors."""

    def forever() -> dict[str, int]:
        return {"sec": 9223372036, "nsec": 854775807}

    return {
        "history": "keep_last",
        "depth": 10,
        "reliability": "reliable",
        "durability": "volatile",
        "deadline": forever(),
        "lifespan": forever(),
        "liveliness": "automatic",
        "liveliness_lease_duration": forever(),
        "avoid_ros_namespace_conventions": False,
    }


@cache
def offered_qos() -> str:
    """QoS profiles that a channel's metadata states for the publishers of written topics."""
    return _text([_qos()]).strip()


@dataclass(frozen=True)
class WrittenTopic:
    """A topic as metadata.yaml lists it."""

    name: str
    msgtype: str
    type_hash: str
    """RIHS01 hash; empty if unknown."""
    count: int


def information(file_name: str, start_ns: int, end_ns: int, topics: Sequence[WrittenTopic]) -> str:
    """Metadata of a bag of one file, in YAML; the same text is stored inside the MCAP file."""
    count = sum(topic.count for topic in topics)

    def extent() -> dict[str, Any]:
        return {
            "duration": {"nanoseconds": end_ns - start_ns},
            "starting_time": {"nanoseconds_since_epoch": start_ns},
            "message_count": count,
        }

    return _text(
        {
            "version": _VERSION,
            "storage_identifier": "mcap",
            **extent(),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic.name,
                        "type": topic.msgtype,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": [_qos()],
                        "type_description_hash": topic.type_hash,
                    },
                    "message_count": topic.count,
                }
                for topic in topics
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file_name],
            "files": [{"path": file_name, **extent()}],
            "custom_data": None,
            "ros_distro": _DISTRO,
        }
    )


def metadata_file(information_text: str) -> str:
    """The content of metadata.yaml."""
    return "rosbag2_bagfile_information:\n" + indent(information_text, "  ")
