"""Recorded messages as undecoded bytes, with their offsets in flat arrays.

Both storage formats are read as one `Batch` for every `Stretch`.
"""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.recordings.bounds import Unpacked

Int64s = npt.NDArray[np.int64]
Octets = npt.NDArray[np.uint8]

LEAD: Final = 8
"""Bytes in front of every payload, so that rows can be padded to words."""


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

    offset: int
    length: int
    """Place of the records in the file [bytes]."""
    size: int
    """Their size when decompressed [bytes]."""
    first_ns: int
    last_ns: int
    """Log times of the earliest and the latest message, as stated by the chunk."""
    chunked: bool = True


@dataclass(frozen=True)
class Batch:
    """The undecoded messages of one stretch, in the order of the file."""

    raw: bytes
    """The bytes to which `start` refers."""
    channel: npt.NDArray[np.uint16]
    log_ns: Int64s
    start: Int64s
    """Offset of each payload; at least `LEAD` bytes precede it."""
    length: Int64s
    """Bytes of each payload."""
    unpacked: Unpacked
    """Counts the bytes of individually compressed messages when they are unpacked."""

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


def open_regular(path: Path) -> IO[bytes]:
    """Open a regular file for reading; a pipe or a device might never end.

    Raises:
        BagError: it cannot be read or is not a regular file.
    """
    try:
        stream = open(path, "rb", opener=_without_waiting)  # noqa: SIM115
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise BagError(f"{path} cannot be read: {reason or error}") from None
    if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
        return stream
    stream.close()
    raise BagError(f"{path} is not a regular file")


def _without_waiting(path: str, flags: int) -> int:
    """Open without blocking: opening a named pipe would otherwise wait for a writer."""
    return os.open(path, flags | os.O_NONBLOCK)


def require_cdr(path: Path, channel: Channel) -> None:
    """Raise BagError if the channel's messages are not CDR."""
    if channel.encoding != "cdr":
        raise BagError(
            f"{path}: topic {channel.topic} is encoded as {channel.encoding!r}, expected 'cdr'"
        )
