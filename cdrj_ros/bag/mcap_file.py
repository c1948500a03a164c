"""Reader of an MCAP file that may be complete, unindexed or truncated, compressed or not.

The file is read record by record from its start, never through its index, so that the same code
reads every kind of file and returns all messages before a truncation.  This module only frames the
records (code, length); their content goes into flat arrays, one `Batch` per stretch of the file.

This reader replaces that of the `mcap` package, which yields one message at a time and stops with
an error at a truncation.  Reading and decoding takes 0.07 of the time that `rosbags` takes
(docs/speed.md).  The record classes are those of `mcap`.
"""

from __future__ import annotations

import os
import struct
import tempfile
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future
from io import BytesIO
from pathlib import Path
from typing import IO, Final

import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile

from cdrj_ros.bag.batch import Batch, Channel, Stretch
from cdrj_ros.bag.bounds import CHUNK_BYTES, DEFINITION_BYTES, UNPACKED_FILE, Unpacked
from cdrj_ros.bag.definitions import long_name
from cdrj_ros.bag.file_bytes import FileBytes, open_regular
from cdrj_ros.bag.mcap_chunk import (
    AT_A_TIME,
    CHANNEL,
    FRAME,
    MESSAGE,
    MESSAGE_HEAD,
    SCHEMA,
    read_chunk,
)
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.threads import thread_pool

MAGIC: Final = b"\x89MCAP0\r\n"
ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"

_FOOTER, _CHUNK, _STATISTICS, _DATA_END = 2, 6, 11, 15
_CHUNK_HEAD = struct.Struct("<QQQII")
_MESSAGE_TIME = struct.Struct("<15xq")
_LONGEST_NAME = 32
"""Maximum length of the name of a chunk's compression [bytes]."""
_RUN_BYTES = 1 << 22
"""Size of a run of messages outside chunks that is read at once."""
_MALFORMED = (EndOfFile, struct.error, ValueError, IndexError)


class McapFile:
    """An MCAP file opened for reading.

    `channels` grows while batches are read, since channels may be declared inside chunks;
    `counts` is available from the start if the file has statistics.
    """

    def __init__(self, path: Path) -> None:
        """Frame the file's records without reading messages."""
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.counts: Mapping[int, int] | None = None
        self.stretches: tuple[Stretch, ...] = ()
        self.complete = False
        """Whether the file ends with a footer, i.e. was closed properly."""
        self.indexed = False
        self.notes: list[str] = []
        self.messages_read = 0
        self._schemas: dict[int, records.Schema] = {}
        self._cut_at = 0
        self._packed_size = 0
        self._data = self._open()
        self._walk_file()

    def batches(self, stretches: Iterable[Stretch] | None = None) -> Iterator[Batch]:
        """Read the stretches in the given order (None: all of them), decompressing ahead."""
        wanted = self.stretches if stretches is None else tuple(stretches)
        unpacked = Unpacked(self.path, self._packed_size)
        workers = min(4, os.cpu_count() or 1)
        if len(wanted) < 4 or workers < 2:
            for stretch in wanted:
                unpacked.add(stretch.size)
                yield self._accept(self._load(stretch, unpacked))
            return
        with thread_pool(workers) as pool:
            ahead: deque[tuple[int, Future[Batch]]] = deque()
            waiting = 0
            for stretch in wanted:
                while ahead and (len(ahead) > 2 * workers or waiting + stretch.size > CHUNK_BYTES):
                    size, batch = ahead.popleft()
                    waiting -= size
                    yield self._accept(batch.result())
                unpacked.add(stretch.size)
                waiting += stretch.size
                ahead.append((stretch.size, pool.submit(self._load, stretch, unpacked)))
            while ahead:
                yield self._accept(ahead.popleft()[1].result())

    def declare_all(self) -> None:
        """Complete `channels`, reading the whole file if its summary does not list them."""
        if not (self.complete and self.indexed):
            for _ in self.batches():
                pass

    def state(self) -> str:
        """A note on how the file ends; empty where it is complete and indexed."""
        if not self.complete:
            return (
                f"{self.path.name} is cut at byte {self._cut_at} (no footer): "
                f"read {self.messages_read} messages until there"
            )
        if not self.indexed:
            return f"{self.path.name} has no index; read from start to end"
        return ""

    def _open(self) -> FileBytes:
        try:
            with open_regular(self.path) as stream:
                self._packed_size = os.fstat(stream.fileno()).st_size
                head = stream.read(len(MAGIC))
                if not head:
                    raise BagError(f"{self.path} is empty, expected an MCAP file")
                if not head.startswith(ZSTD_MAGIC):
                    return self._checked(stream)
                with tempfile.TemporaryFile() as plain:
                    stream.seek(0)
                    self._unpack(stream, plain)
                    return self._checked(plain)
        except OSError as error:
            raise BagError(f"{self.path} cannot be read: {error.strerror or error}") from None

    def _checked(self, stream: IO[bytes]) -> FileBytes:
        stream.seek(0)
        head = stream.read(len(MAGIC))
        if head != MAGIC:
            raise BagError(
                f"{self.path} is not an MCAP file: it begins with {head!r}, expected {MAGIC!r}"
            )
        return FileBytes(stream)

    def _unpack(self, packed: IO[bytes], plain: IO[bytes]) -> None:
        """Decompress a file compressed as a whole (rosbag2's file mode), as far as possible."""
        unpacked = Unpacked(self.path, self._packed_size)
        decompressor = zstandard.ZstdDecompressor()
        with decompressor.stream_reader(packed, read_across_frames=True) as reader:
            try:
                while block := reader.read(AT_A_TIME):
                    unpacked.add(len(block))
                    if plain.tell() + len(block) > UNPACKED_FILE:
                        raise BagError(
                            f"{self.path} unpacks to more than {UNPACKED_FILE} bytes: unpack it "
                            f"first, `zstd -d {self.path}`"
                        )
                    plain.write(block)
            except zstandard.ZstdError as error:
                self.notes.append(f"{self.path.name}: damaged compression ({error})")
        plain.flush()
        if not plain.tell():
            raise BagError(f"{self.path} holds no data that can be decompressed")

    def _frames(self) -> Iterator[tuple[int, int, int]]:
        """Code, start and stop of every record's content; the last may reach beyond the file."""
        data, at = self._data, len(MAGIC)
        while len(frame := data.peek(at, FRAME.size)) == FRAME.size:
            code, length = FRAME.unpack(frame)
            if code == 0:
                break
            after = at + FRAME.size + length
            yield code, at + FRAME.size, after
            if after > data.size or code == _FOOTER:
                break
            at = after
        self._cut_at = at

    def _walk_file(self) -> None:
        """Frame every record of the file; chunks stay compressed."""
        end = self._data.size
        stretches: list[Stretch] = []
        run: Stretch | None = None
        data_ended = False
        for code, body, after in self._frames():
            cut = after > end
            loose = self._loose(body - FRAME.size, after) if code == MESSAGE and not cut else None
            if run and loose and loose.stop - run.start <= _RUN_BYTES:
                run = _joined(run, loose)
                continue
            if run:
                stretches.append(run)
            run = loose
            if code == _CHUNK and not data_ended:
                stretches += self._chunk(body, min(after, end), cut=cut)
            elif code != MESSAGE and not cut:
                self._note_record(code, body, after, data_ended)
            data_ended |= code == _DATA_END
        if run:
            stretches.append(run)
        self.stretches = tuple(stretches)

    def _loose(self, start: int, stop: int) -> Stretch | None:
        """A message record outside chunks; None if it is too short or too long."""
        head = self._data.peek(start, MESSAGE_HEAD)
        if stop - start < MESSAGE_HEAD or len(head) < MESSAGE_HEAD:
            return None
        if stop - start > CHUNK_BYTES:
            self.notes.append(
                f"{self.path.name}: the message at byte {start} has {stop - start} bytes, more "
                f"than {CHUNK_BYTES}, left out"
            )
            return None
        (log_ns,) = _MESSAGE_TIME.unpack_from(head)
        return Stretch(start, stop, log_ns, log_ns, size=stop - start)

    def _note_record(self, code: int, body: int, after: int, data_ended: bool) -> None:
        """Process a record that holds no messages."""
        if code in (SCHEMA, CHANNEL):
            content = self._data.read(body, min(after, body + DEFINITION_BYTES + 1))
            self._declare(code, content)
            self.indexed |= data_ended
        elif code == _STATISTICS and after - body <= DEFINITION_BYTES:
            self.counts = _statistics(self._data.read(body, after))
        elif code == _FOOTER:
            self.complete = self._data.read(after, after + len(MAGIC)) == MAGIC

    def _chunk(self, body: int, stop: int, *, cut: bool) -> list[Stretch]:
        """The stretch of the chunk record [body, stop); empty if the chunk has no usable header."""
        head = self._data.read(body, min(stop, body + _CHUNK_HEAD.size + _LONGEST_NAME + 8))
        if len(head) < _CHUNK_HEAD.size:
            return []
        first, last, size, crc, name_length = _CHUNK_HEAD.unpack_from(head)
        name = _CHUNK_HEAD.size
        content = name + name_length + 8
        if content > len(head):
            if not cut:
                self.notes.append(
                    f"{self.path.name}: the chunk at byte {body} was left out, damaged"
                )
            return []
        compression = head[name : name + name_length].decode(errors="replace")
        (packed,) = struct.unpack_from("<Q", head, content - 8)
        start = body + content
        if start + packed <= stop:
            stop, cut = start + packed, False
        elif not cut:
            self.notes.append(
                f"{self.path.name}: the chunk at byte {body} is shorter than its header states"
            )
            cut = True
        if size > CHUNK_BYTES or stop - start > CHUNK_BYTES:
            self.notes.append(
                f"{self.path.name}: the chunk at byte {start} claims {size} bytes, more than "
                f"{CHUNK_BYTES}, left out"
            )
            return []
        return [Stretch(start, stop, first, last, compression, size, crc, cut)]

    def _load(self, stretch: Stretch, unpacked: Unpacked) -> Batch:
        """Read, decompress and frame one stretch; runs in any thread."""
        packed = self._data.read(stretch.start, stretch.stop)
        where = f"{self.path.name}: the chunk at byte {stretch.start}"
        return read_chunk(packed, stretch, unpacked, where)

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
            if len(content) > DEFINITION_BYTES:
                raise ValueError(len(content))
            if code == SCHEMA:
                schema = records.Schema.read(stream)
                _require_printable(schema.name)
                self._schemas[schema.id] = schema
                return
            found = records.Channel.read(stream)
            _require_printable(found.topic + found.message_encoding)
        except _MALFORMED:
            note = f"{self.path.name}: a damaged schema or channel record was left out"
            if note not in self.notes:
                self.notes.append(note)
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


def _joined(run: Stretch, more: Stretch) -> Stretch:
    """Join two consecutive runs of messages outside chunks."""
    return Stretch(
        run.start,
        more.stop,
        min(run.first_ns, more.first_ns),
        max(run.last_ns, more.last_ns),
        size=more.stop - run.start,
    )


def _require_printable(name: str) -> None:
    """Refuse names with control characters: names appear in one-line messages."""
    if not name.isprintable():
        raise ValueError(name)


def _statistics(content: bytes) -> Mapping[int, int] | None:
    try:
        found = records.Statistics.read(ReadDataStream(BytesIO(content)))
    except _MALFORMED:
        return None
    counts: dict[int, int] = found.channel_message_counts
    return counts
