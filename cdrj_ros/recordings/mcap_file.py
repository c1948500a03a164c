"""Reader of an MCAP file that may be complete, unindexed, damaged or truncated.

The package `mcap` finds the chunks, by the index of a complete file, otherwise by reading it record
by record up to the damage.  Only the messages within a chunk are not read one by one: their places
go into flat arrays, one `Batch` per chunk, from which `BulkDecoder` decodes them.
"""

from __future__ import annotations

import os
import struct
import zlib
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Final

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.reader import SeekingReader
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.recordings.batch import (
    BEFORE,
    CHUNK_BYTES,
    CONVERSION,
    DEFINITION_BYTES,
    RECORD_BYTES,
    UNPACKED_FREE,
    UNPACKED_RATIO,
    ZSTD_MAGIC,
    Batch,
    BoundedReader,
    Channel,
    Int64s,
    Stretch,
    column,
    pick,
)
from cdrj_ros.recordings.definitions import long_name

MAGIC: Final = b"\x89MCAP0\r\n"
SQLITE3_MAGIC: Final = b"SQLite format 3"

_FRAME: Final = struct.Struct("<BQ")
"""Header of every record: its code and the length of its content [bytes]."""
_SCHEMA, _CHANNEL, _MESSAGE = 3, 4, 5
_MESSAGE_HEAD: Final = 31
"""Bytes of a message record before its payload: code, length, channel, sequence and two times."""
_CHUNK_HEAD: Final = 49
"""Bytes of a chunk record before its data, without the name of the compression."""
_RUN_BYTES: Final = 1 << 22
"""Size of a run of messages outside chunks that is read at once."""
_DAMAGES: Final = (
    McapError, EndOfFile, struct.error, ValueError, LookupError, OSError, OverflowError,
)  # fmt: skip
"""What `mcap` raises at damage."""


class McapFile:
    """An MCAP file opened for reading.

    `channels` grows while batches are read, since channels may be declared inside chunks, unless
    the file has an index.
    """

    def __init__(self, path: Path) -> None:
        """Find the file's chunks without reading messages."""
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.channels_known = False
        """Whether `channels` is complete without reading messages."""
        self.stretches: tuple[Stretch, ...] = ()
        self.messages_read = 0
        self._schemas: dict[int, records.Schema] = {}
        self._notes: dict[str, int] = {}
        self._damaged_at = -1
        with BoundedReader.of(path) as stream:
            _require_mcap(path, stream.read(16))
            summary = _summary(stream)
            found = self._walked(stream) if summary is None else self._take(summary)
            packed = os.fstat(stream.fileno()).st_size
        self.stretches = tuple(self._fitting(found))
        most = max(UNPACKED_FREE, UNPACKED_RATIO * packed)
        if sum(stretch.size for stretch in self.stretches) > most:
            raise BagError(
                f"{path} unpacks to more than {most} bytes, "
                f"more than {UNPACKED_RATIO} times its size: refused as damaged or malicious"
            )

    def declare_all(self) -> None:
        """Complete `channels`, reading the whole file if it has no index."""
        if not self.channels_known:
            for _ in self.batches():
                pass

    def batches(self, stretches: Iterable[Stretch] | None = None) -> Iterator[Batch]:
        """Read the stretches in the given order (None: all of them).

        Raises:
            BagError: the file cannot be read any more.
        """
        with BoundedReader.of(self.path) as stream:
            for stretch in self.stretches if stretches is None else stretches:
                raw = self._raw(stream, stretch)
                offsets, declared, rest = _records(raw)
                if rest:
                    self._note(f"ends in {rest} bytes that form no complete record", stretch)
                for code, content in declared:
                    self._declare(code, content)
                self.messages_read += len(offsets)
                yield _batch(raw, offsets)

    def notes(self) -> list[str]:
        """Irregularities found so far, as sentences."""
        found = [
            f"{self.path.name}: {words}" + (f", and {count - 1} more like it" if count > 1 else "")
            for words, count in self._notes.items()
        ]
        if self._damaged_at >= 0:
            found.append(
                f"{self.path.name} is cut or damaged at byte {self._damaged_at}: "
                f"read {self.messages_read} messages until there"
            )
        elif not self.channels_known and any(stretch.chunked for stretch in self.stretches):
            found.append(f"{self.path.name} has no index; read from start to end")
        return found

    def _note(self, words: str, stretch: Stretch | None = None) -> None:
        """Count a fault; of faults of one kind, only the first is worded."""
        if stretch is None:
            self._notes[words] = 1
            return
        for noted in self._notes:
            if noted.endswith(words):
                self._notes[noted] += 1
                return
        self._notes[f"the chunk at byte {stretch.offset} {words}"] = 1

    def _take(self, summary: Summary) -> Iterable[Stretch]:
        """Adopt the index of a complete file; returns its chunks."""
        self._schemas = summary.schemas
        for channel in summary.channels.values():
            self._add_channel(channel)
        self.channels_known = True
        found = {
            index.chunk_start_offset: Stretch(
                index.chunk_start_offset, index.chunk_length, index.uncompressed_size,
                index.message_start_time, index.message_end_time,
            )
            for index in summary.chunk_indexes
        }  # fmt: skip
        return (found[offset] for offset in sorted(found))

    def _walked(self, stream: BoundedReader) -> list[Stretch]:
        """The stretches of a file without an index, up to its end or to the first damage."""
        found: list[Stretch] = []
        stream.seek(0)
        at = stream.renew()
        reader = StreamReader(stream, emit_chunks=True, record_size_limit=RECORD_BYTES)
        try:
            for record in reader.records:
                at = stream.renew()
                if isinstance(record, records.Schema):
                    self._add_schema(record)
                elif isinstance(record, records.Channel):
                    self._add_channel(record)
                elif isinstance(record, records.Chunk):
                    found.append(_chunk(record, at))
                elif isinstance(record, records.Message):
                    _append(found, record, at)
        except _DAMAGES:
            self._damaged_at = at
        return found

    def _fitting(self, found: Iterable[Stretch]) -> Iterator[Stretch]:
        """The stretches that are not too large."""
        for stretch in found:
            if stretch.size > CHUNK_BYTES or stretch.length > RECORD_BYTES:
                self._note(
                    f"claims {stretch.size} bytes, more than {CHUNK_BYTES}, left out", stretch
                )
            else:
                yield stretch

    def _raw(self, stream: BoundedReader, stretch: Stretch) -> bytes:
        """The records of a stretch; none, with a note, if its chunk is damaged."""
        try:
            stream.seek(stretch.offset)
            stream.renew()
            content = stream.read(stretch.length)
            if not stretch.chunked:
                return content
            chunk = records.Chunk.read(ReadDataStream(BytesIO(content[_FRAME.size :])))
            return _unpacked(chunk, stretch.size)
        except (*_DAMAGES, zstandard.ZstdError, RuntimeError, MemoryError) as error:
            self._note(f"was left out, damaged ({str(error) or 'cut'})", stretch)
            return b""

    def _declare(self, code: int, content: bytes) -> None:
        """Add a schema or channel that is declared in a chunk."""
        stream = ReadDataStream(BytesIO(content))
        try:
            if code == _SCHEMA:
                self._add_schema(records.Schema.read(stream))
            else:
                self._add_channel(records.Channel.read(stream))
        except _DAMAGES:
            self._note("a damaged schema or channel record was left out")

    def _add_schema(self, schema: records.Schema) -> None:
        self._schemas[schema.id] = schema

    def _add_channel(self, found: records.Channel) -> None:
        schema = self._schemas.get(found.schema_id)
        data = schema.data if schema else b""
        name = schema.name if schema else ""
        if not (found.topic + found.message_encoding + name).isprintable():
            self._note("a damaged schema or channel record was left out")
            return
        if len(data) > DEFINITION_BYTES:
            name, data = "", b""
        self.channels[found.id] = Channel(
            topic=found.topic,
            msgtype=long_name(name),
            encoding=found.message_encoding,
            definition_encoding=schema.encoding if schema else "",
            definition=data.decode(errors="replace"),
            metadata=tuple(found.metadata.items()),
        )


def _require_mcap(path: Path, head: bytes) -> None:
    """Refuse a file by its first bytes, with the command that makes an MCAP file of another bag."""
    if not head:
        raise BagError(f"{path} is empty, expected an MCAP file")
    if head.startswith(SQLITE3_MAGIC):
        command = CONVERSION.format(path)
        raise BagError(f"{path} is a bag stored as sqlite3; `{command}` makes an MCAP file of it")
    if head.startswith(ZSTD_MAGIC):
        raise BagError(f"{path} is compressed as a whole; `zstd -d {path}` unpacks it")
    if not head.startswith(MAGIC):
        head = head[: len(MAGIC)]
        raise BagError(f"{path} is not an MCAP file: it begins with {head!r}, expected {MAGIC!r}")


def _summary(stream: BoundedReader) -> Summary | None:
    """A file's index; None if it has none that covers the whole file."""
    stream.seek(0)
    stream.renew()
    try:
        summary = SeekingReader(stream, record_size_limit=RECORD_BYTES).get_summary()
    except _DAMAGES:
        return None
    if summary is None or summary.statistics is None or not summary.chunk_indexes:
        return None
    complete = summary.statistics.chunk_count == len(summary.chunk_indexes)
    return summary if complete else None


def _chunk(chunk: records.Chunk, stop: int) -> Stretch:
    """The stretch of a chunk record that ends at byte `stop`."""
    length = _CHUNK_HEAD + len(chunk.compression.encode()) + len(chunk.data)
    return Stretch(
        stop - length, length, chunk.uncompressed_size,
        chunk.message_start_time, chunk.message_end_time,
    )  # fmt: skip


def _append(found: list[Stretch], message: records.Message, stop: int) -> None:
    """Append a message outside chunks, which ends at byte `stop`, to the run before it."""
    length = _MESSAGE_HEAD + len(message.data)
    time_ns, start = message.log_time, stop - length
    run = found[-1] if found else None
    if run and not run.chunked and run.offset + run.length == start and run.size < _RUN_BYTES:
        found[-1] = replace(
            run, length=run.length + length, size=run.size + length,
            first_ns=min(run.first_ns, time_ns), last_ns=max(run.last_ns, time_ns),
        )  # fmt: skip
    else:
        found.append(Stretch(start, length, length, time_ns, time_ns, chunked=False))


def _unpacked(chunk: records.Chunk, size: int) -> bytes:
    """A chunk's data, decompressed to `size` bytes whatever size it claims.

    Raises:
        ValueError: it has another size or checksum, or an unknown compression.
        ZstdError, RuntimeError: it cannot be decompressed.
    """
    if chunk.compression == "":
        raw = chunk.data
    elif chunk.compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
            raw = reader.read(size + 1)
    elif chunk.compression == "lz4":
        raw = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    else:
        raise ValueError(f"unknown compression {chunk.compression!r}")
    if len(raw) != size:
        raise ValueError(f"{len(raw)} bytes instead of {size}")
    if chunk.uncompressed_crc and zlib.crc32(raw) != chunk.uncompressed_crc:
        raise ValueError("wrong checksum")
    return raw


def _records(raw: bytes) -> tuple[Int64s, tuple[tuple[int, bytes], ...], int]:
    """Offsets of the message records, schema and channel records, and the number of bytes left."""
    offsets = array("q")
    declared: list[tuple[int, bytes]] = []
    append, unpack = offsets.append, _FRAME.unpack_from
    at, end = 0, len(raw)
    last = end - _FRAME.size
    while at <= last:
        code, length = unpack(raw, at)
        after = at + 9 + length
        if after > end:
            break
        if code == _MESSAGE and after - at >= _MESSAGE_HEAD:
            append(at)
        elif code in (_SCHEMA, _CHANNEL):
            declared.append((code, raw[at + 9 : after]))
        elif code == 0:
            break
        at = after
    return np.frombuffer(offsets, np.int64), tuple(declared), end - at


def _batch(raw: bytes, offsets: Int64s) -> Batch:
    """The message records that begin at `offsets`."""
    rows = pick(np.frombuffer(raw, np.uint8), offsets, _MESSAGE_HEAD)
    length = column(rows, 1, "<u8")[:, 0].astype(np.int64) - (_MESSAGE_HEAD - _FRAME.size)
    channel = column(rows, 9, "<u2")[:, 0].astype(np.uint16)
    log_ns = column(rows, 15, "<i8")[:, 0].astype(np.int64)
    return _plain(Batch(raw, channel, log_ns, offsets + _MESSAGE_HEAD, length))


def _plain(batch: Batch) -> Batch:
    """The batch with messages that rosbag2 compressed one by one unpacked.

    Nothing but their first bytes says that they are: their metadata may be lost.  They stay as they
    are, and are refused, where they are damaged or unpack to more than one chunk in all.
    """
    long = np.flatnonzero(batch.length >= len(ZSTD_MAGIC))
    heads = pick(batch.octets, batch.start[long], len(ZSTD_MAGIC))
    packed = long[(heads == np.frombuffer(ZSTD_MAGIC, np.uint8)).all(axis=1)]
    if not len(packed):
        return batch
    payloads = [
        batch.raw[start : start + length]
        for start, length in zip(batch.start.tolist(), batch.length.tolist(), strict=True)
    ]
    left, unpacker = CHUNK_BYTES, zstandard.ZstdDecompressor()
    for k in packed.tolist():
        try:
            with unpacker.stream_reader(payloads[k]) as reader:
                plain = reader.read(left + 1)
            stated = zstandard.frame_content_size(payloads[k])  # negative if it is not
        except zstandard.ZstdError:
            continue
        if len(plain) <= left and stated in (len(plain), -1):
            payloads[k], left = plain, left - len(plain)
    length = np.array([len(payload) for payload in payloads], np.int64)
    start = BEFORE + np.cumsum(length) - length
    return Batch(bytes(BEFORE) + b"".join(payloads), batch.channel, batch.log_ns, start, length)
