"""Many messages of one topic decoded at once.

Payloads of equal length are stacked into rows.  The layout of one row is parsed with every check
(`cdrj_ros.messages.cdr.read_layout`); all rows that agree with it in the bytes that decide the
layout are then read by slicing columns.  A row that disagrees is parsed on its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import zstandard

from cdrj_ros.bag.mcap_file import ZSTD_MAGIC, Batch, Int64s, Octets, column, pick
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.messages.cdr import TEXT, Field, Layout, MessageError, MessageType, read_layout

Float64s = npt.NDArray[np.float64]

LEAD: Final = 8
"""Bytes that lie before every payload, so that rows can be padded to words."""
LARGEST_MESSAGE: Final = 2**26
"""Bytes; no message of numbers and names comes near."""

_LAYOUTS_AT_ONCE: Final = 16
"""New layouts tried on all rows of a batch; beyond, every message is likely to be different."""
_LAYOUTS_KEPT: Final = 32
_SEC, _NANOSEC, _NAME = "header.stamp.sec", "header.stamp.nanosec", "name"


@dataclass(frozen=True)
class Block:
    """Messages of one layout."""

    names: tuple[str, ...]
    arrival: Int64s
    """Place in the order of the file(s), shape (m,)."""
    log_ns: Int64s
    stamp_ns: Int64s
    value: Float64s
    """Shape (m, len(names))."""


@dataclass(frozen=True)
class _Pattern:
    """A layout, and how to tell the payloads that have it from those that do not."""

    layout: Layout
    mask: npt.NDArray[np.uint64]
    """All ones over the bytes that decide the layout, shape (words,)."""
    expected: npt.NDArray[np.uint64]
    """Those bytes, zero elsewhere, shape (words,)."""
    usable: bool
    """There are as many values as names."""


class BulkDecoder:
    """Takes the messages of one topic and keeps, per name, one array of each message.

    Where `silent`, a message whose array is empty says nothing and is not malformed.
    """

    def __init__(self, message: MessageType, array: str, *, silent: bool = False) -> None:
        """Decode `array` of `message`, which must have it and an array of names."""
        self.blocks: list[Block] = []
        self.refused: list[Int64s] = []
        """Places (as `Block.arrival`) of the messages refused whole."""
        self._message = message
        self._array = array
        self._silent = silent
        self._patterns: dict[int, list[_Pattern]] = {}
        _require(message, array)

    def add(self, batch: Batch, chosen: Int64s, first: int) -> None:
        """Decode the messages of `batch` at the indices `chosen`; `first` lie before the batch."""
        for octets, start, length, index in plain_payloads(batch, chosen):
            self._add(octets, start, length, batch.log_ns[index], first + index)

    def _add(
        self, octets: Octets, start: Int64s, length: Int64s, log_ns: Int64s, arrival: Int64s
    ) -> None:
        for size in np.unique(length).tolist():
            same = np.flatnonzero(length == size)
            if not size:
                self.refused.append(arrival[same])
                continue
            pad = -size % 8
            rows = pick(octets, start[same] - pad, size + pad)
            self._add_rows(rows, pad, log_ns[same], arrival[same])

    def _add_rows(self, rows: Octets, pad: int, log_ns: Int64s, arrival: Int64s) -> None:
        """Payloads of one length, each in the last bytes of its row."""
        size = rows.shape[1] - pad
        words = rows.view(np.uint64)
        known = self._patterns.setdefault(size, [])
        todo = np.arange(len(rows))

        def take(pattern: _Pattern) -> None:
            nonlocal todo
            whole = len(todo) == len(rows)
            fits = _fits(words if whole else words[todo], pattern)
            if fits.all():
                found, todo = todo, todo[:0]
            else:
                found, todo = todo[fits], todo[~fits]
            if len(found):
                at = rows if len(found) == len(rows) else rows[found]
                self._keep(pattern, at, pad, log_ns[found], arrival[found])

        for pattern in known:
            if not len(todo):
                return
            take(pattern)
        tried = 0
        while len(todo):
            if tried < _LAYOUTS_AT_ONCE:
                head = todo[:1]
            else:
                head, todo = todo[:1], todo[1:]
            payload = rows[head[0], pad:].tobytes()
            try:
                layout = read_layout(payload, self._message.fields)
            except MessageError:
                self.refused.append(arrival[head])
                todo = todo[1:] if tried < _LAYOUTS_AT_ONCE else todo
                continue
            pattern = self._pattern(layout, rows[head[0]], pad)
            if tried < _LAYOUTS_AT_ONCE:
                tried += 1
                known.insert(0, pattern)
                del known[_LAYOUTS_KEPT:]
                take(pattern)
            else:
                self._keep(pattern, rows[head], pad, log_ns[head], arrival[head])

    def _pattern(self, layout: Layout, row: Octets, pad: int) -> _Pattern:
        mask = np.zeros(len(row), np.uint8)
        for a, b in layout.fixed:
            mask[pad + a : pad + b] = 255
        words = mask.view(np.uint64)
        span, names = layout.numbers[self._array], layout.texts[_NAME]
        return _Pattern(layout, words, row.view(np.uint64) & words, span.count == len(names))

    def _keep(
        self, pattern: _Pattern, rows: Octets, pad: int, log_ns: Int64s, arrival: Int64s
    ) -> None:
        layout = pattern.layout
        span = layout.numbers[self._array]
        if self._silent and not span.count:
            return
        if not pattern.usable:
            self.refused.append(arrival)
            return
        value = column(rows, pad + span.offset, span.dtype, span.count).astype(np.float64)
        sec, nanosec = layout.numbers.get(_SEC), layout.numbers.get(_NANOSEC)
        stamp_ns = log_ns
        if sec and nanosec:
            stamp_ns = column(rows, pad + sec.offset, sec.dtype)[:, 0].astype(np.int64)
            stamp_ns *= 1_000_000_000
            stamp_ns += column(rows, pad + nanosec.offset, nanosec.dtype)[:, 0]
        self.blocks.append(Block(layout.texts[_NAME], arrival, log_ns, stamp_ns, value))


def _fits(words: npt.NDArray[np.uint64], pattern: _Pattern) -> npt.NDArray[np.bool_]:
    """Which rows agree with the pattern's layout: `words` (m, w) → (m,)."""
    same: npt.NDArray[np.bool_] = ((words & pattern.mask) == pattern.expected).all(axis=1)
    return same


def _require(message: MessageType, array: str) -> None:
    """Refuse a definition that lacks what is to be read."""
    fields = {field.name: field for field in message.fields}
    for name, text in ((_NAME, True), (array, False)):
        field: Field | None = fields.get(name)
        if field is None or field.count is None or (field.code == TEXT) != text:
            raise BagError(
                f"{message.name} as this bag defines it has no array {name!r}, but "
                + ", ".join(fields)
            )


def plain_payloads(batch: Batch, chosen: Int64s) -> Iterator[tuple[Octets, Int64s, Int64s, Int64s]]:
    """(octets, start, length, index) of the messages at the indices `chosen`, none compressed.

    Messages that were compressed on their own (rosbag2's message mode) are known by zstd's first
    bytes, since plain CDR begins with a zero; they are decompressed into octets of their own.
    At least eight bytes lie before every payload.
    """
    octets, start, length = batch.octets, batch.start[chosen], batch.length[chosen]
    magic = np.frombuffer(ZSTD_MAGIC, np.uint8)
    packed = length >= len(magic)
    packed[packed] = (pick(octets, start[packed], len(magic)) == magic).all(axis=1)
    if not packed.any():
        yield octets, start, length, chosen
        return
    if not packed.all():
        yield octets, start[~packed], length[~packed], chosen[~packed]
    view = memoryview(octets)  # type: ignore[arg-type]
    parts = [
        unpack_message(view[a : a + n])
        for a, n in zip(start[packed].tolist(), length[packed].tolist(), strict=True)
    ]
    sizes = np.array([len(part) for part in parts], np.int64)
    joined = np.frombuffer(bytes(LEAD) + b"".join(parts), np.uint8)
    yield joined, np.cumsum(sizes) - sizes + LEAD, sizes, chosen[packed]


def unpack_message(data: bytes | memoryview) -> bytes:
    """A payload that was compressed on its own; empty where that cannot be undone."""
    try:
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            plain: bytes = reader.read(LARGEST_MESSAGE + 1)
    except zstandard.ZstdError:
        return b""
    return plain if len(plain) <= LARGEST_MESSAGE else b""


def merged(blocks: Sequence[Block]) -> dict[str, tuple[Int64s, Int64s, Float64s]]:
    """(stamp_ns, log_ns, value) by name, in order of log time, equal times in order of the file."""
    if not blocks:
        return {}
    log_ns = _joined([block.log_ns for block in blocks])
    stamp_ns = _joined([block.stamp_ns for block in blocks])
    arrival = _joined([block.arrival for block in blocks])
    if not stamp_ns.any():
        stamp_ns = log_ns
    order = _order(log_ns, arrival)
    names = blocks[0].names
    if len(set(names)) == len(names) and all(block.names == names for block in blocks):
        value = np.concatenate([block.value.T for block in blocks], axis=1)
        stamp_ns, log_ns = _frozen(stamp_ns, order), _frozen(log_ns, order)
        return {name: (stamp_ns, log_ns, _frozen(value[i], order)) for i, name in enumerate(names)}
    return _merged_by_name(blocks, stamp_ns, log_ns, arrival)


def _merged_by_name(
    blocks: Sequence[Block], stamp_ns: Int64s, log_ns: Int64s, arrival: Int64s
) -> dict[str, tuple[Int64s, Int64s, Float64s]]:
    """As `merged`, where messages differ in their names or the order of their names."""
    parts: dict[str, list[tuple[Int64s, Float64s]]] = {}
    first = 0
    for block in blocks:
        rows = np.arange(first, first + len(block.arrival))
        first += len(rows)
        for i, name in enumerate(block.names):
            parts.setdefault(name, []).append((rows, block.value[:, i]))
    found: dict[str, tuple[Int64s, Int64s, Float64s]] = {}
    for name, pieces in parts.items():
        rows = _joined([piece[0] for piece in pieces])
        value = np.concatenate([piece[1] for piece in pieces])
        order = _order(log_ns[rows], arrival[rows])
        found[name] = (
            _frozen(stamp_ns[rows], order),
            _frozen(log_ns[rows], order),
            _frozen(value, order),
        )
    return found


def _joined(parts: Sequence[Int64s]) -> Int64s:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _order(log_ns: Int64s, arrival: Int64s) -> Int64s | None:
    """The order of log time, equal times in order of arrival; None where it is so already."""
    if (np.diff(log_ns) >= 0).all() and (np.diff(arrival) > 0).all():
        return None
    return np.lexsort((arrival, log_ns))


def _frozen(values: npt.NDArray[Any], order: Int64s | None) -> npt.NDArray[Any]:
    values = np.ascontiguousarray(values if order is None else values[order])
    values.flags.writeable = False
    return values
