"""Serialisation of ROS messages in plain CDR (XCDR version 1, both byte orders) by layout.

A message of numbers and names has a *layout*: the offsets of its numbers, which are determined by
the bytes that hold lengths and names.  Two payloads with equal such bytes have their numbers at the
same offsets.  A layout is therefore parsed with all checks once (`read_layout`) and reused for
every matching payload: for single messages by `JointStateDecoder`, in bulk by `cdrj_ros.bag`.
`Template` does the reverse: it encodes a message once and then patches its numbers.

Numbers are aligned to their own size, counted from the end of the four encapsulation bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.model.channels import EFFORT, NODAL_FORCE, TENSION

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


@dataclass(frozen=True)
class _KnownJointState:
    """A layout prepared for comparison by `JointStateDecoder`."""

    representation: bytes
    head: bytes
    """From the frame's length to the first position."""
    head_stop: int
    tail: tuple[tuple[int, int, bytes], ...]
    """Start, stop and bytes of the lengths after the positions."""
    names: tuple[str, ...]
    stamp: struct.Struct
    dtype: np.dtype[Any]
    stop: int


class JointStateDecoder:
    """Callable that decodes the CDR payload of a JointState.

    It returns (stamp_ns, names, position [rad], shape (n,)).  Recent layouts are cached, so a
    message with a known layout takes about a microsecond.  `MessageError` is raised for a payload
    that is not a JointState or has unequal numbers of positions and names.  The position array is
    read-only, aligned and in native byte order.
    """

    KEPT: Final = 8
    """Layouts cached for each payload length; several senders may share a topic."""

    KEPT_BYTES: Final = 4_000_000
    """Total size of the payloads whose layouts are cached [bytes]."""

    def __init__(self) -> None:
        """Start with an empty cache."""
        self._known: dict[int, list[_KnownJointState]] = {}
        self._bytes = 0

    def __call__(self, payload: bytes) -> tuple[int, tuple[str, ...], npt.NDArray[np.float64]]:
        """Decode one payload."""
        for known in self._known.get(len(payload), ()):
            stop = known.head_stop
            if payload[12:stop] != known.head or payload[:2] != known.representation:
                continue
            for tail_start, tail_stop, tail in known.tail:
                if payload[tail_start:tail_stop] != tail:
                    break
            else:
                sec, nanosec = known.stamp.unpack_from(payload, 4)
                position = np.frombuffer(payload[stop : known.stop], known.dtype)
                if not known.dtype.isnative:
                    position = position.astype(np.float64)
                    position.flags.writeable = False
                return sec * 1_000_000_000 + nanosec, known.names, position
        self._learn(payload)
        return self(payload)

    def _learn(self, payload: bytes) -> None:
        """Cache the layout of a payload that matches no cached one, or raise MessageError."""
        layout = read_layout(payload, JOINT_STATE.fields)
        names, span = layout.texts["name"], layout.numbers["position"]
        if len(names) != span.count:
            raise MessageError(f"{len(names)} names but {span.count} positions")
        tail = [(max(a, span.offset), b) for a, b in layout.fixed if b > span.offset]
        known = _KnownJointState(
            representation=payload[:2],
            head=payload[12 : span.offset],
            head_stop=span.offset,
            tail=tuple((a, b, payload[a:b]) for a, b in tail),
            names=names,
            stamp=struct.Struct(layout.order + "iI"),
            dtype=np.dtype(span.dtype),
            stop=span.offset + 8 * span.count,
        )
        self._bytes += len(payload)
        if len(self._known) >= 64 or self._bytes > self.KEPT_BYTES:
            self._known.clear()
            self._bytes = len(payload)
        family = self._known.setdefault(len(payload), [])
        family.insert(0, known)
        del family[self.KEPT :]


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


def joint_state_efforts(payload: bytes) -> tuple[int, tuple[str, ...], npt.NDArray[np.float64]]:
    """Decode the efforts of a JointState: (stamp_ns, names, effort [N m], shape (n,)).

    n is 0 if the message has no efforts.  Unlike `JointStateDecoder`, this parses the layout each
    time.

    Raises:
        MessageError: not a JointState, or unequal numbers of efforts (if any) and names.
    """
    layout = read_layout(payload, JOINT_STATE.fields)
    names, span = layout.texts["name"], layout.numbers["effort"]
    if span.count not in (0, len(names)):
        raise MessageError(f"{len(names)} names but {span.count} efforts")
    sec, nanosec = struct.unpack_from(layout.order + "iI", payload, ENCAPSULATION)
    effort = np.frombuffer(payload, span.dtype, span.count, span.offset).astype(np.float64)
    return sec * 1_000_000_000 + nanosec, names, effort


class Template:
    """An encoded message with fixed names and array sizes, into which numbers are patched.

    Every sequence in `arrays` has one value per name; the others are empty.  Little-endian.
    """

    def __init__(
        self,
        message: MessageType,
        names: Sequence[str],
        arrays: Collection[str] | None = None,
        frame_id: str = "",
    ) -> None:
        """Encode the message; `arrays` of None means all of its sequences of numbers."""
        sequences = [f.name for f in message.fields if f.code != TEXT and f.count == 0]
        chosen = set(sequences if arrays is None else arrays)
        if unknown := chosen.difference(sequences):
            raise MessageError(f"{message.name} has no arrays {sorted(unknown)}, but {sequences}")
        self.message = message
        self.names = tuple(names)
        self.spans: Mapping[str, Span]
        """Locations of the arrays given to `encode`, in the order of the message."""
        self.payload, self.spans = _blank(message, self.names, chosen, frame_id)
        self._buffer = bytearray(self.payload)
        self._views = {
            name: np.frombuffer(self._buffer, span.dtype, span.count, span.offset)
            for name, span in self.spans.items()
        }
        self._stamp = struct.Struct("<iI")

    def encode(self, stamp_ns: int, **arrays: npt.ArrayLike) -> bytes:
        """Encode a message with this stamp and these arrays, each of shape (len(names),)."""
        views = self._views
        if len(arrays) != len(views):
            raise self._mismatch(arrays)
        try:
            self._stamp.pack_into(self._buffer, ENCAPSULATION, *divmod(stamp_ns, 1_000_000_000))
            for name, values in arrays.items():
                views[name][:] = values
        except (KeyError, ValueError):
            raise self._mismatch(arrays) from None
        except struct.error:
            raise MessageError(f"stamp {stamp_ns} ns does not fit a ROS header") from None
        return bytes(self._buffer)

    def encode_many(
        self,
        stamp_ns: npt.NDArray[np.int64],
        arrays: Mapping[str, npt.NDArray[Any]],
    ) -> npt.NDArray[np.uint8]:
        """Encode n messages as rows, shape (n, length).

        `stamp_ns` has shape (n,), each array shape (n, len(names)).
        """
        if set(arrays) != set(self._views):
            raise self._mismatch(arrays)
        n, width = len(stamp_ns), len(self.payload)
        rows = np.empty((n, width), np.uint8)
        if not n:
            return rows
        rows[:] = np.frombuffer(self.payload, np.uint8)
        sec, nanosec = np.divmod(stamp_ns, 1_000_000_000)
        if int(sec.min()) < -(2**31) or int(sec.max()) >= 2**31:
            raise MessageError("a stamp does not fit a ROS header (32-bit seconds)")
        at = ENCAPSULATION
        np.ndarray((n,), "<i4", rows, at, (width,))[:] = sec
        np.ndarray((n,), "<u4", rows, at + 4, (width,))[:] = nanosec
        for name, span in self.spans.items():
            strides = (width, np.dtype(span.dtype).itemsize)
            shape = (n, span.count)
            if np.shape(arrays[name]) != shape:
                raise self._mismatch(arrays)
            if span.count:
                np.ndarray(shape, span.dtype, rows, span.offset, strides)[:] = arrays[name]
        return rows

    def _mismatch(self, arrays: Mapping[str, npt.ArrayLike]) -> MessageError:
        given = {name: np.shape(values) for name, values in arrays.items()}
        return MessageError(
            f"{self.message.name} with {len(self.names)} names takes {list(self.spans)} "
            f"of as many values each, got {given}"
        )


def _blank(
    message: MessageType, names: tuple[str, ...], arrays: Collection[str], frame_id: str
) -> tuple[bytes, dict[str, Span]]:
    """A message of zeros, including encapsulation, and the locations of its arrays."""
    body = bytearray()
    spans: dict[str, Span] = {}

    def put(data: bytes, alignment: int) -> int:
        if data:
            body.extend(bytes(-len(body) % alignment))
        body.extend(data)
        return ENCAPSULATION + len(body) - len(data)

    def put_text(text: str) -> None:
        data = text.encode() + b"\0"
        put(struct.pack("<I", len(data)) + data, 4)

    for field in message.fields:
        if field.code == TEXT and field.count is None:
            put_text(frame_id if field.name == "header.frame_id" else "")
        elif field.code == TEXT:
            put(struct.pack("<I", len(names)), 4)
            for name in names:
                put_text(name)
        else:
            size = int(field.code[1:])
            count = 1 if field.count is None else field.count
            if field.count == 0:
                count = len(names) if field.name in arrays else 0
                put(struct.pack("<I", count), 4)
            offset = put(bytes(count * size), size)
            if field.name in arrays:
                spans[field.name] = Span(offset, count, "<" + field.code)
    return b"\0\1\0\0" + bytes(body), spans
