"""Recorded messages as undecoded bytes, and bounds on the sizes that a bag may claim.

A bag may come from an untrusted source, and a few kilobytes can claim, or unpack to, more memory
than a machine has.  Ordinary recordings stay far below the bounds, see `docs/reliability.md`.
"""

from __future__ import annotations

from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.files import InputError, open_regular

CHUNK_BYTES: Final = 1 << 26
"""Size of one unpacked chunk, and so of one message.  Writers make chunks of 1 to 4 MB; a joint
state of 1000 joints has 40 kB, a large image 30 MB."""
RECORD_BYTES: Final = CHUNK_BYTES + (1 << 16)
"""Size of a record of an MCAP file."""
UNPACKED_FREE: Final = 1 << 28
"""Bytes to which the chunks of any file may unpack."""
UNPACKED_RATIO: Final = 1000
"""Compression ratio allowed beyond `UNPACKED_FREE`.  Joint states of a robot at rest reach about
100; a file made to fill the memory reaches 30 000."""

DEFINITION_BYTES: Final = 1 << 20
"""Size of a record that declares a message type or a channel.  Those of ROS have some kilobytes."""
DEFINITION_FIELDS: Final = 10_000
"""Lines of a message definition, with nested messages expanded.  Each level may multiply them."""
DEFINITION_DEPTH: Final = 8
"""Levels of nested messages."""
ARRAY_VALUES: Final = CHUNK_BYTES
"""Length of an array of fixed size: no message can hold more."""

LARGEST_REFERENCE: Final = 1e15
"""Magnitude of a recorded reference [N or N·m].  Larger values are implausible; their square may
overflow."""


class BoundedReader(BufferedReader):
    """A file of which at most `RECORD_BYTES` are read between two calls of `renew`.

    A damaged record may claim to be, or to hold a list, of any length.
    """

    left = RECORD_BYTES

    @classmethod
    def of(cls, path: Path) -> BoundedReader:
        """Open a file, which must be a regular one.

        Raises:
            BagError: it cannot be read.
        """
        try:
            return cls(open_regular(path))
        except InputError as error:
            raise BagError(f"{path} cannot be read: {error}") from None

    def renew(self) -> int:
        """Allow the next record; returns the current offset in the file."""
        self.left = RECORD_BYTES
        return self.tell()

    def read(self, size: int | None = -1, /) -> bytes:
        """At most `size` bytes, and at most as many as are left.

        Raises:
            ValueError: `mcap` subtracts the size of a header from that of a smaller record.
        """
        if size is None or size < 0:
            raise ValueError("a record is shorter than its kind requires")
        data = super().read(min(size, self.left))
        self.left -= len(data)
        return data


BEFORE: Final = 8
"""Bytes that precede every payload, for rows that are padded to words."""

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
    """Offset of each payload; at least `BEFORE` bytes, of its record, precede it."""
    length: Int64s
    """Bytes of each payload."""

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


def require_cdr(path: Path, channel: Channel) -> None:
    """Raise BagError if the channel's messages are not CDR."""
    if channel.encoding != "cdr":
        raise BagError(
            f"{path}: topic {channel.topic} is encoded as {channel.encoding!r}, expected 'cdr'"
        )
