"""Decoding of a chunk, or a run of message records, of an MCAP file into a `Batch`."""

from __future__ import annotations

import struct
import zlib
from array import array
from dataclasses import replace
from typing import Final

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard

from cdrj_ros.bag.batch import Batch, Int64s, Stretch, column, pick
from cdrj_ros.bag.bounds import DEFINITION_BYTES, Unpacked

FRAME: Final = struct.Struct("<BQ")
"""Header of every record: its code and the length of its content [bytes]."""
SCHEMA, CHANNEL, MESSAGE = 3, 4, 5
MESSAGE_HEAD: Final = 31
"""Bytes of a message record before its payload: code, length, channel, sequence and two times."""
AT_A_TIME: Final = 1 << 20
"""Number of bytes decompressed at a time."""


def read_chunk(packed: bytes, stretch: Stretch, unpacked: Unpacked, where: str) -> Batch:
    """The messages of a stretch; `where` begins the note on a fault."""
    shortened = len(packed) < stretch.stop - stretch.start
    if shortened:
        stretch = replace(stretch, cut=True)
    raw, note = _unpack_chunk(packed, stretch)
    offsets, declared, rest = _walk_chunk(raw or b"")
    if raw is None:
        note += ", left out"
    elif shortened:
        note = "was cut while it was read"
    elif rest and not stretch.cut and not note:
        note = f"ends in {rest} bytes that form no complete record"
    return _batch(raw or b"", offsets, unpacked, declared, f"{where} {note}" if note else "")


def _unpack_chunk(packed: bytes, stretch: Stretch) -> tuple[bytes | None, str]:
    """A chunk's data, as far as it decompresses if truncated, and a note on its fault."""
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
        return raw, f"has {len(raw)} bytes instead of {stretch.size}"
    if stretch.crc and zlib.crc32(raw) != stretch.crc:
        return None, "fails its checksum"
    return raw, ""


def _unzstd(packed: bytes, size: int, *, cut: bool) -> bytes:
    """Decompress at most `size` + 1 bytes, whatever size the data claims."""
    claimed = zstandard.frame_content_size(packed) if len(packed) >= 18 else -1
    if not cut and claimed == size:
        return zstandard.ZstdDecompressor().decompress(packed)
    with zstandard.ZstdDecompressor().stream_reader(packed) as reader:
        parts: list[bytes] = []
        room = size + 1
        while room > 0 and (part := reader.read(min(room, AT_A_TIME))):
            parts.append(part)
            room -= len(part)
    return b"".join(parts)


def _walk_chunk(raw: bytes) -> tuple[Int64s, tuple[tuple[int, bytes], ...], int]:
    """Offsets of the message records, schema and channel records, and the number of bytes left."""
    offsets = array("q")
    declared: list[tuple[int, bytes]] = []
    append, unpack = offsets.append, FRAME.unpack_from
    at, end = 0, len(raw)
    last = end - FRAME.size
    while at <= last:
        code, length = unpack(raw, at)
        after = at + 9 + length
        if after > end:
            break
        if code == MESSAGE and after - at >= MESSAGE_HEAD:
            append(at)
        elif code in (SCHEMA, CHANNEL):
            declared.append((code, raw[at + 9 : min(after, at + 10 + DEFINITION_BYTES)]))
        elif code == 0:
            break
        at = after
    return np.frombuffer(offsets, np.int64), tuple(declared), end - at


def _batch(
    raw: bytes,
    offsets: Int64s,
    unpacked: Unpacked,
    declared: tuple[tuple[int, bytes], ...],
    note: str,
) -> Batch:
    """The message records that begin at `offsets`."""
    rows = pick(np.frombuffer(raw, np.uint8), offsets, MESSAGE_HEAD)
    length = column(rows, 1, "<u8")[:, 0].astype(np.int64) - (MESSAGE_HEAD - FRAME.size)
    channel = column(rows, 9, "<u2")[:, 0].astype(np.uint16)
    log_ns = column(rows, 15, "<i8")[:, 0].astype(np.int64)
    return Batch(raw, channel, log_ns, offsets + MESSAGE_HEAD, length, unpacked, declared, note)
