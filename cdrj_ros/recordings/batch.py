"""Recorded messages as undecoded bytes, bounds on the sizes that a bag claims, and bulk decoding.

A bag may come from an untrusted source, and a few kilobytes can claim, or unpack to, more memory
than a machine has.  Ordinary recordings stay far below the bounds, see `docs/reliability.md`.

To decode the messages of one topic, payloads of equal length are stacked into rows.  The layout of
the first row is parsed with all checks (`cdr.read_layout`); all rows whose layout-determining bytes
equal those of that row are then read by slicing columns.  The layout of the first remaining row is
parsed next.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.files import InputError, open_regular
from cdrj_ros.foundation.output import printable
from cdrj_ros.messages.cdr import TEXT, Field, Layout, MessageError, MessageType, read_layout

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
    """Offset of each payload; at least `BEFORE` bytes precede it."""
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


Float64s = npt.NDArray[np.float64]

ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"

CONVERSION: Final = "rosbags-convert --src {} --dst NEW --dst-storage mcap"
"""The command that makes an MCAP file of a bag stored as sqlite3."""

_LAYOUTS_AT_ONCE: Final = 16
"""Layouts compared with all rows; after these, each row is parsed individually."""
_SEC, _NANOSEC, _NAME = "header.stamp.sec", "header.stamp.nanosec", "name"
_FRAME = "header.frame_id"


@dataclass
class Table:
    """Decoded messages with the same names, in parts of any number of messages each."""

    arrival: list[Int64s] = field(default_factory=list)
    """Index of each message in the order of the files."""
    log_ns: list[Int64s] = field(default_factory=list)
    stamp_ns: list[Int64s] = field(default_factory=list)
    value: list[Float64s] = field(default_factory=list)
    """Shape (m, names) or (m, names, arrays) each."""
    by_arrival: bool = False
    """Whether a stamp is the log time, because the header's is zero."""


class BulkDecoder:
    """Decodes one array, or several side by side, by name, from the messages of one topic.

    With `may_be_empty`, a message whose first array is empty is skipped instead of being malformed.
    Further arrays may always be empty; their values are then NaN.
    """

    def __init__(self, message: MessageType, *arrays: str, may_be_empty: bool = False) -> None:
        """Decode `arrays` of `message`; the type must have these arrays and an array of names."""
        self.tables: dict[tuple[str, ...], Table] = {}
        """The decoded messages by their names."""
        self.refused: list[Int64s] = []
        """Indices (as `Table.arrival`) of the refused messages."""
        self.first_refusal = ""
        """Reason for the first refusal."""
        self.frame = ""
        """Frame of the first message that names one, where the type has a header."""
        self._message = message
        self._arrays = arrays
        self._may_be_empty = may_be_empty
        _require(message, arrays)

    def extent(self) -> tuple[int, int] | None:
        """Earliest and latest log time [ns]; None without messages."""
        times = [log_ns for table in self.tables.values() for log_ns in table.log_ns]
        return (
            (min(int(t.min()) for t in times), max(int(t.max()) for t in times)) if times else None
        )

    def add(self, batch: Batch, chosen: Int64s, first: int) -> None:
        """Decode messages `chosen` of `batch`; `first` messages precede the batch."""
        start, length, log_ns = batch.start[chosen], batch.length[chosen], batch.log_ns[chosen]
        for size in np.unique(length).tolist():
            same = np.flatnonzero(length == size)
            arrival = first + chosen[same]
            if not size:
                self._refuse(arrival, "an empty payload")
                continue
            pad = -size % 8
            rows = pick(batch.octets, start[same] - pad, size + pad)
            self._add_rows(rows, pad, log_ns[same], arrival)

    def _refuse(self, arrival: Int64s, reason: str) -> None:
        self.refused.append(arrival)
        self.first_refusal = self.first_refusal or reason

    def _add_rows(self, rows: Octets, pad: int, log_ns: Int64s, arrival: Int64s) -> None:
        """Decode payloads of one length, each right-aligned in its row."""
        todo, tried = np.arange(len(rows)), 0
        while len(todo):
            payload = rows[todo[0], pad:].tobytes()
            try:
                layout = read_layout(payload, self._message.fields)
            except MessageError as error:
                packed = payload.startswith(ZSTD_MAGIC)
                why = "it is compressed, and damaged or too large" if packed else str(error)
                self._refuse(arrival[todo[:1]], why)
                todo = todo[1:]
                continue
            same = np.arange(len(todo)) == 0
            if tried < _LAYOUTS_AT_ONCE:
                same = _alike(rows if len(todo) == len(rows) else rows[todo], layout, pad)
                tried += 1
            found, todo = todo[same], todo[~same]
            part = rows if len(found) == len(rows) else rows[found]
            self._keep(layout, part, pad, log_ns[found], arrival[found])

    def _keep(
        self, layout: Layout, rows: Octets, pad: int, log_ns: Int64s, arrival: Int64s
    ) -> None:
        """Add the values of payloads with this layout."""
        names = layout.texts[_NAME]
        counts = [layout.numbers[array].count for array in self._arrays]
        if self._may_be_empty and not counts[0]:
            return
        for k, (array, count) in enumerate(zip(self._arrays, counts, strict=True)):
            if count != len(names) and (count or not k):
                self._refuse(arrival, f"{len(names)} names but {count} values of {array}")
                return
        sec, nanosec = layout.numbers.get(_SEC), layout.numbers.get(_NANOSEC)
        stamp_ns = np.zeros_like(log_ns)
        if sec and nanosec:
            stamp_ns = column(rows, pad + sec.offset, sec.dtype)[:, 0].astype(np.int64)
            stamp_ns *= 1_000_000_000
            stamp_ns += column(rows, pad + nanosec.offset, nanosec.dtype)[:, 0]
        self.frame = self.frame or layout.texts.get(_FRAME, ("",))[0]
        columns = [self._column(layout, array, rows, pad) for array in self._arrays]
        table = self.tables.setdefault(names, Table())
        unstamped = stamp_ns == 0
        if unstamped.any():
            stamp_ns = np.where(unstamped, log_ns, stamp_ns)
        table.by_arrival = table.by_arrival or bool(unstamped.any())
        table.arrival.append(arrival)
        table.log_ns.append(log_ns)
        table.stamp_ns.append(stamp_ns)
        table.value.append(columns[0] if len(columns) == 1 else np.stack(columns, axis=2))

    def _column(self, layout: Layout, array: str, rows: Octets, pad: int) -> Float64s:
        """Values of one array, shape (m, names); NaN if it is empty."""
        span, names = layout.numbers[array], len(layout.texts[_NAME])
        if span.count != names:
            return np.full((len(rows), names), np.nan)
        return column(rows, pad + span.offset, span.dtype, span.count).astype(np.float64)


def series_by_name(decoders: Iterable[BulkDecoder]) -> dict[str, Series]:
    """Assemble the channels of one topic; this empties the decoders.

    Messages with equal log times keep the order of the file.  Arrays are contiguous and read-only;
    channels whose names occur in the same messages share their arrays of times.
    """
    tables: list[tuple[tuple[str, ...], Table]] = []
    for decoder in decoders:
        tables += decoder.tables.items()
        decoder.tables = {}
    places: dict[str, list[tuple[int, int]]] = {}
    for k, (names, _) in enumerate(tables):
        for i, name in enumerate(names):
            places.setdefault(name, []).append((k, i))
    times: dict[tuple[int, ...], tuple[Int64s, Int64s, Int64s | None]] = {}
    found: dict[str, Series] = {}
    for name, columns in places.items():
        key = tuple(k for k, _ in columns)
        if key not in times:
            times[key] = _times([tables[k][1] for k in key])
        stamp_ns, log_ns, order = times[key]
        value = np.concatenate([part[:, i] for k, i in columns for part in tables[k][1].value])
        by_arrival = any(tables[k][1].by_arrival for k in key)
        found[printable(name)] = Series(stamp_ns, log_ns, _frozen(value, order), by_arrival)
    return found


def _times(tables: Sequence[Table]) -> tuple[Int64s, Int64s, Int64s | None]:
    """Stamps and log times in order of log time, then of arrival; and the permutation, if any."""
    log_ns = np.concatenate([part for table in tables for part in table.log_ns])
    arrival = np.concatenate([part for table in tables for part in table.arrival])
    order = None
    if not ((log_ns[1:] >= log_ns[:-1]).all() and (arrival[1:] > arrival[:-1]).all()):
        order = np.lexsort((arrival, log_ns))
    del arrival
    log_ns = _frozen(log_ns, order)
    stamp_ns = np.concatenate([part for table in tables for part in table.stamp_ns])
    return _frozen(stamp_ns, order), log_ns, order


def _frozen(values: npt.NDArray[Any], order: Int64s | None) -> npt.NDArray[Any]:
    values = np.ascontiguousarray(values if order is None else values[order])
    values.flags.writeable = False
    return values


def _alike(rows: Octets, layout: Layout, pad: int) -> npt.NDArray[np.bool_]:
    """Whether each row has the same layout as the first: shape (m,)."""
    mask = np.zeros(rows.shape[1], np.uint8)
    for a, b in layout.fixed:
        mask[pad + a : pad + b] = 255
    words, bits = rows.view(np.uint64), mask.view(np.uint64)
    same: npt.NDArray[np.bool_] = ((words & bits) == (words[0] & bits)).all(axis=1)
    return same


def _require(message: MessageType, arrays: Sequence[str]) -> None:
    """Raise BagError unless the definition has the arrays and the names."""
    fields = {field.name: field for field in message.fields}
    for name, text in ((_NAME, True), *((array, False) for array in arrays)):
        field: Field | None = fields.get(name)
        if field is None or field.count is None or (field.code == TEXT) != text:
            raise BagError(
                f"{message.name} as this bag defines it has no array {name!r}, but "
                + ", ".join(fields)
            )
