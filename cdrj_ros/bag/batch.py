"""Recorded messages as undecoded bytes, with their offsets in flat arrays.

Both storage formats are read as one `Batch` for every `Stretch`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cdrj_ros.bag.bounds import Unpacked

Int64s = npt.NDArray[np.int64]
Octets = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Channel:
    """One topic as a file declares it."""

    topic: str
    msgtype: str
    encoding: str
    """Serialisation of the messages: `cdr`."""
    definition_encoding: str
    """`ros2msg`, `ros2idl` or empty."""
    definition: str
    metadata: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Stretch:
    """A part of the file that holds messages: one chunk, or a run of messages outside chunks."""

    start: int
    stop: int
    """Bytes of the file: the chunk's data, or the run."""
    first_ns: int
    last_ns: int
    """Log times of the earliest and the latest message, as stated by the chunk."""
    compression: str = ""
    size: int = 0
    """Decompressed size [bytes]."""
    crc: int = 0
    cut: bool = False
    """The file ends before the chunk does."""


@dataclass(frozen=True)
class Batch:
    """The undecoded messages of one stretch, in the order of the file."""

    raw: bytes
    """The bytes to which `start` refers."""
    channel: npt.NDArray[np.uint16]
    log_ns: Int64s
    start: Int64s
    """Offset of each payload; the record's header precedes it."""
    length: Int64s
    """Bytes of each payload."""
    unpacked: Unpacked
    """Counts the bytes of individually compressed messages when they are unpacked."""
    declared: tuple[tuple[int, bytes], ...] = ()
    """Schema and channel records found among the messages: (code, content)."""
    note: str = ""
    """Description of a fault in the stretch; empty if there is none."""

    @property
    def octets(self) -> Octets:
        """`raw` as an array of bytes."""
        return np.frombuffer(self.raw, np.uint8)


def pick(octets: Octets, offsets: Int64s, width: int) -> Octets:
    """The `width` bytes from each offset on, shape (n, width), copied by whole rows."""
    if not len(offsets):
        return np.empty((0, width), np.uint8)
    anywhere = np.lib.stride_tricks.as_strided(
        octets[:width].view(f"V{width}"), (octets.size - width + 1,), (1,), writeable=False
    )
    rows: Octets = anywhere[offsets].view(np.uint8).reshape(len(offsets), width)
    return rows


def column(rows: Octets, offset: int, dtype: str, count: int = 1) -> npt.NDArray[Any]:
    """`count` numbers from byte `offset` of every row on, as a view of shape (n, count)."""
    if not len(rows):
        return np.empty((0, count), dtype)
    itemsize = np.dtype(dtype).itemsize
    shape, strides = (len(rows), count), (rows.shape[1], itemsize)
    view: npt.NDArray[Any] = np.ndarray(shape, dtype, rows, offset, strides)
    return view
