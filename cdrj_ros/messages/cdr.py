"""Serialisation of ROS messages in plain CDR (XCDR version 1, both byte orders) by layout.

A message of numbers and names has a *layout*: the offsets of its numbers, which are determined by
the bytes that hold lengths and names.  Two payloads with equal such bytes have their numbers at the
same offsets.  A layout is therefore parsed with all checks once (`read_layout`), and `batch`
reuses it for every matching payload.
`Template` does the reverse: it encodes a message once and then patches its numbers.

Numbers are aligned to their own size, counted from the end of the four encapsulation bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from cdrj_ros._core import END_OF_TIME_NS
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.model.packing import EFFORT, NODAL_FORCE, TENSION

ENCAPSULATION: Final = 4
"""Bytes before the first field: representation (2) and options (2)."""

BYTE_ORDER: Final[Mapping[bytes, str]] = {b"\x00\x00": ">", b"\x00\x01": "<"}
"""NumPy's byte order character by CDR representation."""

XCDR2: Final = frozenset(bytes((0, number)) for number in range(6, 12))
"""Representations of CDR version 2: plain, delimited and as parameter lists, in both orders."""

TEXT: Final = "text"
"""The `Field.code` of a string."""


class MessageError(BagError):
    """A payload that does not decode as a message of its type."""


@dataclass(frozen=True)
class Field:
    """One field of a message whose nested messages are flattened."""

    name: str
    """Dotted path, such as `header.stamp.sec`."""
    code: str
    """NumPy type code without byte order (`f8`, `u1`, …), or `TEXT`."""
    count: int | None = None
    """None: one value; 0: a sequence of any length; n: an array of n values."""


@dataclass(frozen=True)
class MessageType:
    """A message's name and its fields in the order of serialisation."""

    name: str
    fields: tuple[Field, ...]


def _stamped(name: str, floats: Sequence[str], octets: Sequence[str] = ()) -> MessageType:
    header = (Field("header.stamp.sec", "i4"), Field("header.stamp.nanosec", "u4"))
    return MessageType(
        name,
        (
            *header,
            Field("header.frame_id", TEXT),
            Field("name", TEXT, 0),
            *(Field(field, "f8", 0) for field in floats),
            *(Field(field, "u1", 0) for field in octets),
        ),
    )


JOINT_STATE: Final = _stamped("sensor_msgs/msg/JointState", ("position", "velocity", "effort"))
CABLE_TENSIONS: Final = _stamped("cdrj_msgs/msg/CableTensions", ("tension", "stddev"), ("status",))
NODAL_FORCES: Final = _stamped(
    "cdrj_msgs/msg/NodalForces",
    ("force_x", "force_y", "force_z", "magnitude", "stddev", "friction", "slip_speed"),
    ("status",),
)
MESSAGE_TYPES: Final[Mapping[str, MessageType]] = {
    message.name: message for message in (JOINT_STATE, CABLE_TENSIONS, NODAL_FORCES)
}
"""The messages of this project, by name; a test compares them with the .msg files."""
REFERENCE_ARRAYS: Final[Mapping[str, tuple[str, str]]] = {
    CABLE_TENSIONS.name: (TENSION, "tension"),
    NODAL_FORCES.name: (NODAL_FORCE, "magnitude"),
    JOINT_STATE.name: (EFFORT, "effort"),
}
"""By message type: the prefix of its channels' names and the array that holds their values."""

FORCE_VECTOR: Final = "force_vector"
"""``force_vector/cable/node``, the force of a cable on a pulley as a vector [N]."""
FORCE_COMPONENTS: Final = ("force_x", "force_y", "force_z")
"""Arrays of NodalForces that hold the components of a ``FORCE_VECTOR``."""


@dataclass(frozen=True)
class Span:
    """Location of the numbers of one field in a payload."""

    offset: int
    """Bytes from the start of the payload, encapsulation included."""
    count: int
    dtype: str
    """NumPy type with byte order, such as `<f8`."""


@dataclass(frozen=True)
class Layout:
    """Locations of all fields in payloads of one length with equal `fixed` bytes."""

    length: int
    """Bytes of the payload, encapsulation included."""
    order: str
    """`<` or `>`."""
    numbers: Mapping[str, Span]
    texts: Mapping[str, tuple[str, ...]]
    """Strings by field; a single string is a tuple of one."""
    fixed: tuple[tuple[int, int], ...]
    """Ranges [start, stop) of the bytes that determine the layout: representation, lengths, names.
    They exclude numbers, padding, and the text of single strings such as the frame."""


class _Walk:
    """A cursor over one payload; every step is checked against the payload's length."""

    def __init__(self, payload: bytes) -> None:
        order = BYTE_ORDER.get(payload[:2])
        if payload[:2] in XCDR2:
            raise MessageError(
                f"payload is XCDR2 (encapsulation {payload[:2].hex()}), expected XCDR1 (0000 or "
                "0001), the default of ROS 2: set the publisher's data representation to XCDR1 "
                "and record again"
            )
        if len(payload) < ENCAPSULATION or order is None:
            raise MessageError(
                f"payload of {len(payload)} bytes begins with {payload[:4].hex() or 'nothing'}, "
                "expected plain CDR (0000 or 0001 and two option bytes)"
            )
        self.payload = payload
        self.order = order
        self.at = ENCAPSULATION
        self.fixed: list[tuple[int, int]] = [(0, 2)]
        self._uint32 = struct.Struct(order + "I")

    def take(self, size: int, alignment: int, what: str) -> int:
        """Offset of the next `size` bytes; the cursor moves past them."""
        start = self.at + -(self.at - ENCAPSULATION) % alignment if size else self.at
        if start + size > len(self.payload):
            raise MessageError(
                f"{what} needs {size} bytes at byte {start} of a payload of {len(self.payload)}"
            )
        self.at = start + size
        return start

    def length(self, what: str) -> int:
        start = self.take(4, 4, f"length of {what}")
        self._fix(start, start + 4)
        value: int = self._uint32.unpack_from(self.payload, start)[0]
        return value

    def text(self, what: str, *, fix: bool) -> str:
        size = self.length(what)
        start = self.take(size, 1, what)
        if fix:
            self._fix(start, self.at)
        if size and self.payload[self.at - 1]:
            raise MessageError(f"{what} does not end with a zero byte")
        try:
            return self.payload[start : max(start, self.at - 1)].decode()
        except UnicodeDecodeError as error:
            raise MessageError(f"{what} is not UTF-8: {error.reason}") from None

    def _fix(self, start: int, stop: int) -> None:
        if self.fixed[-1][1] == start:
            start = self.fixed.pop()[0]
        self.fixed.append((start, stop))


def read_layout(payload: bytes, fields: Sequence[Field]) -> Layout:
    """Locate each of `fields` in `payload`.

    Claimed lengths are checked before anything is allocated.  Bytes after the last field are
    allowed, since some senders pad to four bytes.
    """
    walk = _Walk(payload)
    numbers: dict[str, Span] = {}
    texts: dict[str, tuple[str, ...]] = {}
    for field in fields:
        count = 1 if field.count is None else field.count or walk.length(field.name)
        if field.code == TEXT:
            if count * 4 > len(payload) - walk.at:
                raise MessageError(f"{field.name} claims {count} strings, too many for the payload")
            listed = field.count is not None
            texts[field.name] = tuple(walk.text(field.name, fix=listed) for _ in range(count))
        else:
            size = int(field.code[1:])
            start = walk.take(count * size, size, field.name)
            numbers[field.name] = Span(start, count, walk.order + field.code)
    return Layout(len(payload), walk.order, numbers, texts, tuple(walk.fixed))


def stamped(payload: bytes, stamp_ns: int) -> bytes:
    """A message whose header has this stamp [ns], if its own is zero; otherwise as it is."""
    time = slice(ENCAPSULATION, ENCAPSULATION + 8)
    if payload[time] != bytes(8) or not 0 < stamp_ns < END_OF_TIME_NS:
        return payload
    order = "<" if payload[1] == 1 else ">"
    stamp = struct.pack(f"{order}iI", *divmod(stamp_ns, 1_000_000_000))
    return payload[: time.start] + stamp + payload[time.stop :]


def cable_tensions(
    payload: bytes,
) -> tuple[int, tuple[str, ...], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Decode a CableTensions: (stamp_ns, names, tension [N], stddev [N]), arrays of any length.

    Raises:
        MessageError: not a CableTensions.
    """
    layout = read_layout(payload, CABLE_TENSIONS.fields)
    sec, nanosec = struct.unpack_from(layout.order + "iI", payload, ENCAPSULATION)
    tension, stddev = (
        np.frombuffer(payload, span.dtype, span.count, span.offset).astype(np.float64)
        for span in (layout.numbers["tension"], layout.numbers["stddev"])
    )
    return sec * 1_000_000_000 + nanosec, layout.texts["name"], tension, stddev
