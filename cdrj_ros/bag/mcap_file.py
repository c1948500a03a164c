"""One MCAP file as it is: whole, without an index, or cut; compressed in chunks or not at all.

The file is walked record by record from its start, never by its index, so that every state of a
file is read by the same code and a cut file gives all that lies before the cut.  Records are only
framed here (code, length); what they hold goes into flat arrays, a `Batch` per stretch of the file.
"""

from __future__ import annotations

import mmap
import os
import struct
import tempfile
import zlib
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any, Final

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import numpy.typing as npt
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile

from cdrj_ros.bag.definitions import long_name
from cdrj_ros.foundation.errors import BagError

MAGIC: Final = b"\x89MCAP0\r\n"
ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
MESSAGE_HEAD: Final = 31
"""Bytes of a message record before its payload: code, length, channel, sequence and two times."""
LARGEST_CHUNK: Final = 2**30
"""No writer makes chunks this large; a chunk that claims more is damaged."""

_DENSEST: Final = {"lz4": 255, "zstd": 32768}
"""Bytes that one byte of each compression can stand for, at most."""

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 1, 2, 3, 4, 5, 6
_STATISTICS, _DATA_END = 11, 15
_FRAME = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_LOOSE_AT_ONCE = 50_000
_AT_A_TIME = 1 << 22
_MALFORMED = (EndOfFile, struct.error, ValueError, IndexError)

Int64s = npt.NDArray[np.int64]
Octets = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Channel:
    """One topic as a file declares it."""

    topic: str
    msgtype: str
    encoding: str
    """How messages are written: `cdr`."""
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
    """Log times of the earliest and the latest message, as the chunk claims them."""
    compression: str = ""
    size: int = 0
    """Bytes when decompressed."""
    crc: int = 0
    cut: bool = False
    """The file ends before the chunk does."""
    offsets: Int64s | None = None
    """Starts of the message records, where they lie outside chunks."""


@dataclass(frozen=True)
class Batch:
    """The messages of one stretch, in the order in which they lie there."""

    raw: bytes | mmap.mmap | memoryview
    """What `start` counts from."""
    channel: npt.NDArray[np.uint16]
    log_ns: Int64s
    start: Int64s
    """First byte of each payload; the record's head lies before it."""
    length: Int64s
    """Bytes of each payload."""
    declared: tuple[tuple[int, bytes], ...] = ()
    """Schema and channel records found among the messages: (code, content)."""
    note: str = ""
    """What was wrong with the stretch, in plain words."""

    @property
    def octets(self) -> Octets:
        """`raw` as numbers."""
        return np.frombuffer(self.raw, np.uint8)


class McapFile:
    """An MCAP file opened for reading.

    `channels` grows while batches are read, since channels may be declared inside chunks;
    `counts` is known from the start where the file has statistics.
    """

    def __init__(self, path: Path) -> None:
        """Frame the file's records; no message is read yet."""
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.counts: Mapping[int, int] | None = None
        self.stretches: tuple[Stretch, ...] = ()
        self.complete = False
        """The file ends with a footer, as a closed one does."""
        self.indexed = False
        self.notes: list[str] = []
        self.messages_read = 0
        self._schemas: dict[int, records.Schema] = {}
        self._cut_at = 0
        self._data = self._open()
        self._walk_file()

    def batches(self, stretches: Iterable[Stretch] | None = None) -> Iterator[Batch]:
        """Read the stretches in the given order (None: all of them), decompressing ahead."""
        wanted = self.stretches if stretches is None else tuple(stretches)
        workers = min(4, os.cpu_count() or 1)
        if len(wanted) < 4 or workers < 2:
            for stretch in wanted:
                yield self._accept(self._load(stretch))
            return
        with ThreadPoolExecutor(workers) as pool:
            ahead: deque[Future[Batch]] = deque()
            for stretch in wanted:
                ahead.append(pool.submit(self._load, stretch))
                if len(ahead) > 2 * workers:
                    yield self._accept(ahead.popleft().result())
            while ahead:
                yield self._accept(ahead.popleft().result())

    def declare_all(self) -> None:
        """Make `channels` complete, reading the whole file if its summary does not list them."""
        if not (self.complete and self.indexed):
            for _ in self.batches():
                pass

    def _open(self) -> mmap.mmap:
        try:
            with self.path.open("rb") as stream:
                head = stream.read(len(MAGIC))
                if not head:
                    raise BagError(f"{self.path} is empty, expected an MCAP file")
                if head.startswith(ZSTD_MAGIC):
                    stream.seek(0)
                    with tempfile.TemporaryFile() as plain:
                        self._unpack(stream, plain)
                        return self._map(plain)
                return self._map(stream)
        except OSError as error:
            raise BagError(f"{self.path} cannot be read: {error.strerror or error}") from None

    def _map(self, stream: IO[bytes]) -> mmap.mmap:
        stream.seek(0)
        head = stream.read(len(MAGIC))
        if head != MAGIC:
            raise BagError(
                f"{self.path} is not an MCAP file: it begins with {head!r}, expected {MAGIC!r}"
            )
        return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)

    def _unpack(self, packed: IO[bytes], plain: IO[bytes]) -> None:
        """Undo rosbag2's compression of whole files, as far as the file goes."""
        unpacker = zstandard.ZstdDecompressor().decompressobj()
        try:
            while block := packed.read(1 << 20):
                plain.write(unpacker.decompress(block))
                while unpacker.eof and (rest := unpacker.unused_data):
                    unpacker = zstandard.ZstdDecompressor().decompressobj()
                    plain.write(unpacker.decompress(rest))
        except zstandard.ZstdError as error:
            self.notes.append(f"{self.path.name}: damaged compression ({error})")
        plain.flush()
        if not plain.tell():
            raise BagError(f"{self.path} holds no data that can be decompressed")

    def _frames(self) -> Iterator[tuple[int, int, int]]:
        """Code, start and stop of every record's content; the last may reach beyond the file."""
        data, at = self._data, len(MAGIC)
        while at + _FRAME.size <= len(data):
            code, length = _FRAME.unpack_from(data, at)
            if code == 0:
                break
            after = at + _FRAME.size + length
            yield code, at + _FRAME.size, after
            if after > len(data) or code == _FOOTER:
                break
            at = after
        self._cut_at = at

    def _walk_file(self) -> None:
        """Frame every record of the file; chunks stay compressed."""
        end = len(self._data)
        stretches: list[Stretch] = []
        loose: list[int] = []
        data_ended = False
        for code, body, after in self._frames():
            cut = after > end
            if loose and (code != _MESSAGE or len(loose) == _LOOSE_AT_ONCE):
                stretches.append(self._run(loose))
                loose = []
            if code == _MESSAGE and not cut:
                loose.append(body - _FRAME.size)
            elif code == _CHUNK and not data_ended:
                stretches += self._chunk(body, min(after, end), cut=cut)
            elif not cut:
                self._note_record(code, body, after, data_ended)
            data_ended |= code == _DATA_END
        if loose:
            stretches.append(self._run(loose))
        self.stretches = tuple(stretches)

    def _note_record(self, code: int, body: int, after: int, data_ended: bool) -> None:
        """Take in a record that holds no messages."""
        data = self._data
        if code in (_SCHEMA, _CHANNEL):
            self._declare(code, data[body:after])
            self.indexed |= data_ended
        elif code == _STATISTICS:
            self.counts = _statistics(data[body:after])
        elif code == _FOOTER:
            self.complete = data[after : after + len(MAGIC)] == MAGIC

    def state(self) -> str:
        """What is unusual about the file's end, for a reader of notes; empty where it is whole."""
        if not self.complete:
            return (
                f"{self.path.name} is cut at byte {self._cut_at} (no footer): "
                f"read {self.messages_read} messages until there"
            )
        if not self.indexed:
            return f"{self.path.name} has no index; read from start to end"
        return ""

    def _run(self, offsets: list[int]) -> Stretch:
        found = np.array(offsets, np.int64)
        log_ns = _heads(np.frombuffer(self._data, np.uint8), found)[2]
        stop = offsets[-1] + _FRAME.size + _FRAME.unpack_from(self._data, offsets[-1])[1]
        if not log_ns.size:
            return Stretch(offsets[0], stop, 0, 0, offsets=found)
        first, last = int(log_ns.min()), int(log_ns.max())
        return Stretch(offsets[0], stop, first, last, offsets=found)

    def _chunk(self, body: int, stop: int, *, cut: bool) -> list[Stretch]:
        """The chunk record [body, stop); nothing where it is too short to have begun."""
        data = self._data
        if stop - body < _CHUNK_HEAD.size:
            return []
        first, last, size, crc, name_length = _CHUNK_HEAD.unpack_from(data, body)
        name = body + _CHUNK_HEAD.size
        start = name + name_length + 8
        if start > stop:
            if not cut:
                self.notes.append(
                    f"{self.path.name}: the chunk at byte {body} was left out, damaged"
                )
            return []
        compression = data[name : name + name_length].decode(errors="replace")
        (packed,) = struct.unpack_from("<Q", data, start - 8)
        if start + packed <= stop:
            stop, cut = start + packed, False
        elif not cut:
            self.notes.append(f"{self.path.name}: the chunk at byte {body} is shorter than it says")
            cut = True
        return [Stretch(start, stop, first, last, compression, size, crc, cut)]

    def _load(self, stretch: Stretch) -> Batch:
        """Decompress and frame one stretch; runs in any thread."""
        if stretch.offsets is not None:
            return _batch(self._data, stretch.offsets, (), "")
        packed = memoryview(self._data)[stretch.start : stretch.stop]
        raw, note = _unpack_chunk(packed, stretch)
        where = f"{self.path.name}: the chunk at byte {stretch.start}"
        if raw is None:
            return _batch(b"", np.zeros(0, np.int64), (), f"{where} {note}, left out")
        offsets, declared, rest = _walk_chunk(raw)
        if rest and not stretch.cut and not note:
            note = f"ends in {rest} bytes that are no whole record"
        return _batch(raw, offsets, declared, f"{where} {note}" if note else "")

    def _accept(self, batch: Batch) -> Batch:
        for code, content in batch.declared:
            self._declare(code, content)
        if batch.note and batch.note not in self.notes:
            self.notes.append(batch.note)
        self.messages_read += len(batch.start)
        return batch

    def _declare(self, code: int, content: bytes) -> None:
        stream = ReadDataStream(BytesIO(content))
        try:
            if code == _SCHEMA:
                schema = records.Schema.read(stream)
                _require_printable(schema.name)
                self._schemas[schema.id] = schema
                return
            found = records.Channel.read(stream)
            _require_printable(found.topic + found.message_encoding)
        except _MALFORMED:
            self.notes.append(f"{self.path.name}: a damaged schema or channel record was left out")
            return
        of = self._schemas.get(found.schema_id)
        self.channels[found.id] = Channel(
            topic=found.topic,
            msgtype=long_name(of.name) if of else "",
            encoding=found.message_encoding,
            definition_encoding=of.encoding if of else "",
            definition=of.data.decode(errors="replace") if of else "",
            metadata=tuple(found.metadata.items()),
        )


def _require_printable(name: str) -> None:
    """Names end up in messages of one line; a name with control characters is damage."""
    if not name.isprintable():
        raise ValueError(name)


def _unpack_chunk(packed: memoryview, stretch: Stretch) -> tuple[bytes | memoryview | None, str]:
    """A chunk's data, and what was wrong with it.  A cut chunk gives what decompresses."""
    raw: bytes | memoryview
    dense = LARGEST_CHUNK if stretch.cut else _DENSEST.get(stretch.compression, LARGEST_CHUNK)
    if stretch.size > min(dense * (len(packed) + _FRAME.size), LARGEST_CHUNK):
        return None, f"claims {stretch.size} bytes"
    try:
        if stretch.compression == "":
            raw = packed
        elif stretch.compression == "zstd":
            raw = _unzstd(packed, stretch.size, cut=stretch.cut)
        elif stretch.compression == "lz4":
            raw = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=stretch.size + 1)
        else:
            return None, f"has the unknown compression {stretch.compression!r}"
    except (zstandard.ZstdError, RuntimeError, MemoryError, ValueError) as error:
        return None, f"cannot be decompressed ({error})"
    if stretch.cut:
        return raw, ""
    if len(raw) != stretch.size:
        return raw, f"has {len(raw)} bytes, not the {stretch.size} it says"
    if stretch.crc and zlib.crc32(raw) != stretch.crc:
        return None, "fails its checksum"
    return raw, ""


def _unzstd(packed: memoryview, size: int, *, cut: bool) -> bytes:
    claimed = zstandard.frame_content_size(packed) if len(packed) >= 18 else -1
    if not cut and claimed == size:
        return zstandard.ZstdDecompressor().decompress(packed)
    if claimed > LARGEST_CHUNK:
        raise ValueError(f"claims {claimed} bytes")
    with zstandard.ZstdDecompressor().stream_reader(packed) as reader:
        parts: list[bytes] = []
        room = size + 1
        while room > 0 and (part := reader.read(min(room, _AT_A_TIME))):
            parts.append(part)
            room -= len(part)
    return b"".join(parts)


def _walk_chunk(
    raw: bytes | memoryview,
) -> tuple[Int64s, tuple[tuple[int, bytes], ...], int]:
    """Starts of the message records, other records' content, and the bytes left over at the end."""
    offsets: list[int] = []
    declared: list[tuple[int, bytes]] = []
    append, unpack = offsets.append, _FRAME.unpack_from
    at, end = 0, len(raw)
    last = end - _FRAME.size
    while at <= last:
        code, length = unpack(raw, at)
        after = at + 9 + length
        if after > end:
            break
        if code == _MESSAGE:
            append(at)
        elif code in (_SCHEMA, _CHANNEL):
            declared.append((code, bytes(raw[at + 9 : after])))
        elif code == 0:
            break
        at = after
    return np.array(offsets, np.int64), tuple(declared), end - at


def pick(octets: Octets, offsets: Int64s, width: int) -> Octets:
    """The `width` bytes from each offset on, shape (n, width); copied row by row, not by byte."""
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


def _heads(
    octets: Octets, offsets: Int64s
) -> tuple[npt.NDArray[np.uint16], Int64s, Int64s, Int64s]:
    """Channel, payload length, log time and start of every message record long enough to be one."""
    length = column(pick(octets, offsets, 9), 1, "<u8")[:, 0].astype(np.int64) - 22
    offsets, length = offsets[length >= 0], length[length >= 0]
    rows = pick(octets, offsets, MESSAGE_HEAD)
    channel = column(rows, 9, "<u2")[:, 0].astype(np.uint16)
    log_ns = column(rows, 15, "<i8")[:, 0].astype(np.int64)
    return channel, length, log_ns, offsets


def _batch(
    raw: bytes | mmap.mmap | memoryview,
    offsets: Int64s,
    declared: tuple[tuple[int, bytes], ...],
    note: str,
) -> Batch:
    if not len(offsets):
        none = np.zeros(0, np.int64)
        return Batch(raw, none.astype(np.uint16), none, none, none, declared, note)
    channel, length, log_ns, offsets = _heads(np.frombuffer(raw, np.uint8), offsets)
    return Batch(raw, channel, log_ns, offsets + MESSAGE_HEAD, length, declared, note)


def _statistics(content: bytes) -> Mapping[int, int] | None:
    try:
        found = records.Statistics.read(ReadDataStream(BytesIO(content)))
    except _MALFORMED:
        return None
    counts: dict[int, int] = found.channel_message_counts
    return counts
