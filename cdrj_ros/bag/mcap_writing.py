"""Many messages into one MCAP file in order of time: chunks, indices, statistics, footer."""

from __future__ import annotations

import os
import struct
import zlib
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import IO, Final, Protocol

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import numpy.typing as npt
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from cdrj_ros.bag.mcap_file import MAGIC, MESSAGE_HEAD, Int64s, Octets

COMPRESSIONS: Final = ("zstd", "lz4", "")
_LIBRARY: Final = "cdrj_ros"
_METADATA: Final = "rosbag2"


class Block(Protocol):
    """Messages of one channel and one length, in order of log time."""

    @property
    def channel(self) -> int:
        """Number of the channel."""

    @property
    def log_ns(self) -> Int64s:
        """Shape (n,), never decreasing."""

    @property
    def arrival(self) -> Int64s:
        """Decides the order of equal log times, shape (n,)."""

    @property
    def length(self) -> int:
        """Bytes of each payload."""

    def rows(self, first: int, last: int) -> Octets:
        """Messages [first, last) as rows: MESSAGE_HEAD bytes left free, then the payload."""


@dataclass(frozen=True)
class _Chunk:
    """A chunk ready to be compressed."""

    data: bytes
    first_ns: int
    last_ns: int
    index: Mapping[int, npt.NDArray[np.uint64]]
    """By channel: (log time, offset in the chunk), shape (m, 2)."""


@dataclass(frozen=True)
class _Packed:
    chunk: _Chunk
    data: bytes
    crc: int


def write_file(
    stream: IO[bytes],
    schemas: Sequence[records.Schema],
    channels: Sequence[records.Channel],
    blocks: Sequence[Block],
    *,
    compression: str,
    chunk_bytes: int,
    serialized_metadata: str,
) -> None:
    """Write a whole MCAP file of the ROS 2 profile."""
    stream.write(MAGIC)
    stream.write(_encoded([records.Header(profile="ros2", library=_LIBRARY)]))
    head = _encoded([*schemas, *channels])
    chunk_indices = [
        _write_chunk(stream, packed, compression)
        for packed in _packed(_chunks(blocks, head, chunk_bytes), compression)
    ]
    metadata_start = stream.tell()
    metadata = records.Metadata(
        name=_METADATA, metadata={"serialized_metadata": serialized_metadata}
    )
    stream.write(_encoded([metadata]))
    metadata_index = records.MetadataIndex(
        offset=metadata_start, length=stream.tell() - metadata_start, name=_METADATA
    )
    stream.write(_encoded([records.DataEnd(data_section_crc=0)]))
    statistics = _statistics(schemas, channels, blocks, len(chunk_indices))
    groups: Sequence[tuple[int, Sequence[records.McapRecord]]] = (
        (Opcode.SCHEMA, schemas),
        (Opcode.CHANNEL, channels),
        (Opcode.STATISTICS, [statistics]),
        (Opcode.CHUNK_INDEX, chunk_indices),
        (Opcode.METADATA_INDEX, [metadata_index]),
    )
    _write_summary(stream, groups)


def _chunks(blocks: Sequence[Block], head: bytes, chunk_bytes: int) -> Iterator[_Chunk]:
    """Merge the blocks by log time; `head` (schemas and channels) begins the first chunk."""
    filled = [block for block in blocks if len(block.log_ns)]
    if not filled:
        yield _Chunk(head, 0, 0, {})
        return
    log_ns = np.concatenate([block.log_ns for block in filled])
    arrival = np.concatenate([block.arrival for block in filled])
    source = np.repeat(np.arange(len(filled)), [len(block.log_ns) for block in filled])
    order = np.lexsort((arrival, log_ns))
    log_ns, source = log_ns[order], source[order]
    sizes = np.array([MESSAGE_HEAD + block.length for block in filled], np.int64)[source]
    ends = np.cumsum(sizes)
    starts = ends - sizes
    borders = np.flatnonzero(np.diff(starts // chunk_bytes)) + 1
    given = [0] * len(filled)
    for a, b in zip([0, *borders.tolist()], [*borders.tolist(), len(starts)], strict=True):
        base = len(head) if a == 0 else 0
        data = np.empty(base + int(ends[b - 1] - starts[a]), np.uint8)
        data[:base] = np.frombuffer(head[:base], np.uint8)
        places = starts[a:b] - starts[a] + base
        index: dict[int, list[npt.NDArray[np.uint64]]] = {}
        for s in np.unique(source[a:b]).tolist():
            at = places[source[a:b] == s]
            first, given[s] = given[s], given[s] + len(at)
            block = filled[s]
            times = block.log_ns[first : given[s]]
            _lay(data, at, _with_heads(block, block.rows(first, given[s]), times))
            entries = np.stack([times, at], axis=1).astype(np.uint64)
            index.setdefault(block.channel, []).append(entries)
        yield _Chunk(
            data.tobytes(),
            int(log_ns[a]),
            int(log_ns[b - 1]),
            {channel: _by_offset(parts) for channel, parts in index.items()},
        )


def _by_offset(parts: list[npt.NDArray[np.uint64]]) -> npt.NDArray[np.uint64]:
    if len(parts) == 1:
        return parts[0]
    entries = np.concatenate(parts)
    return entries[np.argsort(entries[:, 1], kind="stable")]


def _with_heads(block: Block, rows: Octets, log_ns: Int64s) -> Octets:
    """Fill in the record heads: code, length, channel, sequence 0, log and publish time."""
    head = struct.pack("<BQHI", Opcode.MESSAGE, 22 + block.length, block.channel, 0)
    rows[:, : len(head)] = np.frombuffer(head, np.uint8)
    shape, strides = (len(rows), 2), (rows.shape[1], 8)
    np.ndarray(shape, "<i8", rows, len(head), strides)[:] = log_ns[:, np.newaxis]
    return rows


def _lay(data: Octets, places: Int64s, rows: Octets) -> None:
    """Copy each row to its place, one copy per row."""
    width = rows.shape[1]
    anywhere = np.lib.stride_tricks.as_strided(
        data[:width].view(f"V{width}"), (data.size - width + 1,), (1,), writeable=True
    )
    anywhere[places] = rows.view(f"V{width}")[:, 0]


def _packed(chunks: Iterator[_Chunk], compression: str) -> Iterator[_Packed]:
    """Compress in threads, a few chunks ahead."""
    workers = min(4, os.cpu_count() or 1)
    with ThreadPoolExecutor(workers) as pool:
        ahead: deque[Future[_Packed]] = deque()
        for chunk in chunks:
            ahead.append(pool.submit(_pack, chunk, compression))
            if len(ahead) > 2 * workers:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()


def _pack(chunk: _Chunk, compression: str) -> _Packed:
    data = chunk.data
    if compression == "zstd":
        data = zstandard.ZstdCompressor().compress(data)
    elif compression == "lz4":
        data = lz4.frame.compress(data)
    return _Packed(chunk, data, zlib.crc32(chunk.data))


def _write_chunk(stream: IO[bytes], packed: _Packed, compression: str) -> records.ChunkIndex:
    chunk, start = packed.chunk, stream.tell()
    record = records.Chunk(
        compression=compression,
        data=packed.data,
        message_start_time=chunk.first_ns,
        message_end_time=chunk.last_ns,
        uncompressed_crc=packed.crc,
        uncompressed_size=len(chunk.data),
    )
    stream.write(_encoded([record]))
    index_start = stream.tell()
    offsets: dict[int, int] = {}
    for channel, entries in chunk.index.items():
        offsets[channel] = stream.tell()
        content = entries.astype("<u8").tobytes()
        size = len(content)
        stream.write(struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + size, channel, size))
        stream.write(content)
    return records.ChunkIndex(
        message_start_time=chunk.first_ns,
        message_end_time=chunk.last_ns,
        chunk_start_offset=start,
        chunk_length=index_start - start,
        message_index_offsets=offsets,
        message_index_length=stream.tell() - index_start,
        compression=compression,
        compressed_size=len(packed.data),
        uncompressed_size=len(chunk.data),
    )


def _statistics(
    schemas: Sequence[records.Schema],
    channels: Sequence[records.Channel],
    blocks: Sequence[Block],
    chunk_count: int,
) -> records.Statistics:
    counts = {channel.id: 0 for channel in channels}
    for block in blocks:
        counts[block.channel] += len(block.log_ns)
    times = [block.log_ns for block in blocks if len(block.log_ns)]
    return records.Statistics(
        attachment_count=0,
        channel_count=len(channels),
        channel_message_counts=counts,
        chunk_count=chunk_count,
        message_count=sum(counts.values()),
        message_end_time=max((int(log_ns[-1]) for log_ns in times), default=0),
        message_start_time=min((int(log_ns[0]) for log_ns in times), default=0),
        metadata_count=1,
        schema_count=len(schemas),
    )


def _write_summary(
    stream: IO[bytes], groups: Sequence[tuple[int, Sequence[records.McapRecord]]]
) -> None:
    start = at = stream.tell()
    summary = bytearray()
    offsets: list[records.McapRecord] = []
    for code, group in groups:
        if group:
            data = _encoded(group)
            offsets.append(
                records.SummaryOffset(group_opcode=code, group_start=at, group_length=len(data))
            )
            summary += data
            at += len(data)
    summary += _encoded(offsets)
    footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, at)
    crc = zlib.crc32(footer_head, zlib.crc32(summary))
    stream.write(summary)
    stream.write(footer_head + struct.pack("<I", crc) + MAGIC)


def _encoded(group: Sequence[records.McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in group:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
