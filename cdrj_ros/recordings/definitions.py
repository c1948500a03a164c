"""What a bag says of itself: definitions of messages, read and our own, and its metadata."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from importlib import resources
from typing import Any, Final, NamedTuple

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.yaml import yaml_text
from cdrj_ros.messages.cdr import MESSAGE_TYPES, TEXT, Field, MessageType
from cdrj_ros.recordings.batch import (
    ARRAY_VALUES,
    DEFINITION_BYTES,
    DEFINITION_DEPTH,
    DEFINITION_FIELDS,
    Channel,
)

OWN_PACKAGE: Final = "cdrj_msgs"

_CODES: Final = {
    "bool": "u1",
    "byte": "u1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
    "string": TEXT,
}
_COMMON: Final = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
}
_FIELD: Final = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?P<array>\[(?:<=)?\d*\])?"
    r"\s+(?P<name>[A-Za-z]\w*)\s*(?P<constant>=)?"
)
_SECTION: Final = re.compile(r"^=+\s*\nMSG:\s*(\S+)\s*\n", re.MULTILINE)


class Definition(NamedTuple):
    """A message definition as it is embedded in a bag."""

    text: str
    """The .msg text, with the definitions of nested messages appended."""
    hash: str
    """The type's RIHS01 hash."""


def long_name(msgtype: str) -> str:
    """`sensor_msgs/JointState` → `sensor_msgs/msg/JointState`."""
    package, _, name = msgtype.partition("/")
    return msgtype if "/" in name or not name else f"{package}/msg/{name}"


@lru_cache(maxsize=64)
def message_type(msgtype: str, encoding: str, text: str) -> MessageType:
    """The fields of a message as its bag defines them, or our own if the bag has no .msg text.

    Raises BagError for a definition that cannot be parsed, and for unsupported fields (sequences of
    messages, wide strings).
    """
    if encoding == "ros2msg" and text.strip():
        return parse_definition(msgtype, text)
    if msgtype in MESSAGE_TYPES:
        return MESSAGE_TYPES[msgtype]
    raise BagError(f"{msgtype} has no definition of encoding 'ros2msg' but {encoding or 'none'!r}")


def parse_definition(msgtype: str, text: str) -> MessageType:
    """Parse a .msg text with the definitions of nested messages appended."""
    if len(text) > DEFINITION_BYTES:
        raise BagError(f"the definition of {msgtype} has more than {DEFINITION_BYTES} characters")
    parts = _SECTION.split(text)
    sections = {_short(name): body for name, body in zip(parts[1::2], parts[2::2], strict=True)}
    package = msgtype.partition("/")[0]
    flat = _Flattening(msgtype, sections)
    flat.add(parts[0], package, "", 0)
    return MessageType(msgtype, tuple(flat.fields))


class _Flattening:
    """The fields of a definition with nested messages expanded."""

    def __init__(self, msgtype: str, sections: dict[str, str]) -> None:
        """`sections` holds the texts of the nested messages by short name."""
        self.fields: list[Field] = []
        self._msgtype = msgtype
        self._sections = sections
        self._lines = 0

    def add(self, text: str, package: str, prefix: str, depth: int) -> None:
        """Append the fields that `text` defines; short type names are looked up in `package`."""
        if depth > DEFINITION_DEPTH:
            raise self._error(f"is nested too deeply at {prefix!r}")
        for raw in text.splitlines():
            self._lines += 1
            if self._lines > DEFINITION_FIELDS:
                raise self._error(f"has more than {DEFINITION_FIELDS} lines, nested ones repeated")
            line = raw.partition("#")[0].strip()
            match = _FIELD.match(line)
            if match is None and line:
                raise self._error("has a line not understood", line)
            if match is not None and not match["constant"]:
                self._add_field(match, line, package, prefix, depth)

    def _add_field(
        self, match: re.Match[str], line: str, package: str, prefix: str, depth: int
    ) -> None:
        kind, array, name = match["type"], match["array"], prefix + match["name"]
        count = None if array is None else _count(array[1:-1])
        if count is not None and count > ARRAY_VALUES:
            raise self._error(f"has an array of more than {ARRAY_VALUES} values", line)
        if kind in _CODES:
            self.fields.append(Field(name, _CODES[kind], count))
            return
        nested = _resolve(kind, package)
        body = self._sections.get(nested, _COMMON.get(nested))
        if body is None or count is not None:
            raise self._error("has a field of an unsupported type", line)
        self.add(body, nested.partition("/")[0], name + ".", depth + 1)

    def _error(self, what: str, line: str = "") -> BagError:
        where = f": {line[:80]!r}" if line else ""
        return BagError(f"the definition of {self._msgtype} {what}{where}")


def _count(inside: str) -> int:
    """Length of an array from the text in its brackets; 0 for a sequence."""
    if not (inside.isascii() and inside.isdigit()):
        return 0
    return int(inside[:20])


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


def _resolve(kind: str, package: str) -> str:
    if kind == "Header":
        return "std_msgs/Header"
    return _short(kind) if "/" in kind else f"{package}/{kind}"


@lru_cache(maxsize=1)
def _definitions() -> dict[str, Definition]:
    """Texts and hashes of this project's messages, from Jazzy's definitions and our .msg files."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # slow

    store = get_typestore(Stores.ROS2_JAZZY)
    for entry in sorted(resources.files("cdrj_ros.recordings").joinpath("msg").iterdir(), key=str):
        if entry.name.endswith(".msg"):
            name = f"{OWN_PACKAGE}/msg/{entry.name[:-4]}"
            store.register(get_types_from_msg(entry.read_text(encoding="utf-8"), name))
    return {
        name: Definition(store.generate_msgdef(name, ros_version=2)[0], store.hash_rihs01(name))
        for name in MESSAGE_TYPES
        if name in store.fielddefs
    }


def own_definition(msgtype: str) -> Definition:
    """The definition that a bag written here embeds for `msgtype`."""
    found = _definitions().get(msgtype)
    if found is None:
        raise BagError(f"no definition of {msgtype}; there are {sorted(_definitions())}")
    return found


def channel_metadata(channel: Channel) -> dict[str, str]:
    """What an MCAP file states of a topic, as rosbag2 writes it."""
    return {
        "offered_qos_profiles": yaml_text([_qos()], block=True).strip(),
        "topic_type_hash": _type_hash(channel),
    }


def bag_metadata(
    file_name: str, start_ns: int, end_ns: int, channels: Iterable[Channel],
    counts: Mapping[str, int],
) -> str:  # fmt: skip
    """Metadata of a bag of one file as rosbag2 of ROS 2 Jazzy writes it (version 9), in YAML."""

    def extent() -> dict[str, Any]:
        return {
            "duration": {"nanoseconds": end_ns - start_ns},
            "starting_time": {"nanoseconds_since_epoch": start_ns},
            "message_count": sum(counts.values()),
        }

    return yaml_text(
        {
            "version": 9,
            "storage_identifier": "mcap",
            **extent(),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": channel.topic,
                        "type": channel.msgtype,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": [_qos()],
                        "type_description_hash": _type_hash(channel),
                    },
                    "message_count": counts[channel.topic],
                }
                for channel in channels
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file_name],
            "files": [{"path": file_name, **extent()}],
            "custom_data": None,
            "ros_distro": "jazzy",
        },
        block=True,
    )


def _type_hash(channel: Channel) -> str:
    """The type's hash: from the copied bag, or as computed for this project's types; else empty."""
    copied = dict(channel.metadata).get("topic_type_hash")
    if copied is not None:
        return copied
    try:
        own = own_definition(channel.msgtype)
    except BagError:
        return ""
    return own.hash if own.text == channel.definition else ""


def _qos() -> dict[str, Any]:
    """Reliable with depth 10; a new object for each call, so that YAML writes no anchors."""
    durations = ("deadline", "lifespan", "liveliness_lease_duration")
    return {
        "history": "keep_last",
        "depth": 10,
        "reliability": "reliable",
        "durability": "volatile",
        "liveliness": "automatic",
        "avoid_ros_namespace_conventions": False,
    } | {name: {"sec": 9223372036, "nsec": 854775807} for name in durations}
