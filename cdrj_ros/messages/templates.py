"""Encoding of messages whose names and array sizes stay the same."""

from __future__ import annotations

import struct
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cdrj_ros.messages.cdr import ENCAPSULATION, TEXT, MessageError, MessageType, Span


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
        self.views: Mapping[str, npt.NDArray[Any]] = {
            name: np.frombuffer(self._buffer, span.dtype, span.count, span.offset)
            for name, span in self.spans.items()
        }
        """The arrays of the next message that is encoded, each of shape (len(names),)."""
        self._stamp = struct.Struct("<iI")

    def encode(self, stamp_ns: int, **arrays: npt.ArrayLike) -> bytes:
        """Encode a message with this stamp and these arrays, each of shape (len(names),)."""
        views = self.views
        if len(arrays) != len(views):
            raise self._mismatch(arrays)
        try:
            for name, values in arrays.items():
                views[name][:] = values
        except (KeyError, ValueError):
            raise self._mismatch(arrays) from None
        return self.stamped(stamp_ns)

    def stamped(self, stamp_ns: int) -> bytes:
        """Encode a message with this stamp and what ``views`` hold."""
        try:
            self._stamp.pack_into(self._buffer, ENCAPSULATION, *divmod(stamp_ns, 1_000_000_000))
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
        if set(arrays) != set(self.views):
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
