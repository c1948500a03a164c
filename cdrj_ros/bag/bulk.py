"""Bulk decoding of the messages of one topic.

Payloads of equal length are stacked into rows.  The layout of one row is parsed with all checks
(`cdrj_ros.messages.cdr.read_layout`); all rows whose layout-determining bytes equal those of that
row are then read by slicing columns.  The layout of the first remaining row is parsed next.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import zstandard

from cdrj_ros.bag.batch import Batch, Int64s, Octets, column, pick
from cdrj_ros.bag.bounds import MESSAGE_BYTES, Unpacked
from cdrj_ros.bag.mcap_file import ZSTD_MAGIC
from cdrj_ros.bag.series import Decoded, Float64s
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.messages.cdr import TEXT, Field, Layout, MessageError, MessageType, read_layout

LEAD: Final = 8
"""Bytes in front of every payload, so that rows can be padded to words."""

_LAYOUTS_AT_ONCE: Final = 16
"""New layouts compared with all rows; after these, each row is parsed individually."""
_LAYOUTS_KEPT: Final = 32
"""Layouts cached for each payload length."""
_LAYOUT_BYTES_KEPT: Final = 1 << 24
"""Total size of the payloads whose layouts are cached; beyond it the cache is cleared."""
_UNPACKED_AT_ONCE: Final = 1 << 24
"""Bytes of individually compressed messages that are unpacked before decoding starts."""
_SEC, _NANOSEC, _NAME = "header.stamp.sec", "header.stamp.nanosec", "name"
_FRAME = "header.frame_id"


@dataclass(frozen=True)
class _Pattern:
    """A layout and the mask that identifies the payloads that have it."""

    layout: Layout
    mask: npt.NDArray[np.uint64]
    """All ones over the bytes that determine the layout, shape (words,)."""
    expected: npt.NDArray[np.uint64]
    """Those bytes, zero elsewhere, shape (words,)."""
    wrong: str
    """Why the numbers of values and names do not match; empty if they do."""


class BulkDecoder:
    """Decodes one array, or several side by side, by name, from the messages of one topic.

    With `may_be_empty`, a message whose first array is empty is skipped instead of being malformed.
    Further arrays may always be empty; their values are then NaN.
    """

    def __init__(self, message: MessageType, *arrays: str, may_be_empty: bool = False) -> None:
        """Decode `arrays` of `message`; the type must have these arrays and an array of names."""
        self.decoded = Decoded()
        self.refused: list[Int64s] = []
        """Indices (as `Table.arrival`) of the refused messages."""
        self.first_refusal = ""
        """Reason for the first refusal."""
        self.frame = ""
        """Frame of the first message that names one, where the type has a header."""
        self._message = message
        self._arrays = arrays
        self._may_be_empty = may_be_empty
        self._patterns: dict[int, list[_Pattern]] = {}
        self._pattern_bytes = 0
        _require(message, arrays)

    def add(self, batch: Batch, chosen: Int64s, first: int) -> None:
        """Decode messages `chosen` of `batch`; `first` messages precede the batch."""
        for octets, start, length, index in plain_payloads(batch, chosen):
            log_ns, arrival = batch.log_ns[index], first + index
            for size in np.unique(length).tolist():
                same = np.flatnonzero(length == size)
                if not size:
                    self._refuse(arrival[same], "an empty payload, or one that does not unpack")
                    continue
                pad = -size % 8
                rows = pick(octets, start[same] - pad, size + pad)
                self._add_rows(rows, pad, log_ns[same], arrival[same])

    def _refuse(self, arrival: Int64s, reason: str) -> None:
        self.refused.append(arrival)
        self.first_refusal = self.first_refusal or reason

    def _add_rows(self, rows: Octets, pad: int, log_ns: Int64s, arrival: Int64s) -> None:
        """Decode payloads of one length, each right-aligned in its row."""
        if self._pattern_bytes > _LAYOUT_BYTES_KEPT:
            self._patterns.clear()
            self._pattern_bytes = 0
        known = self._patterns.setdefault(rows.shape[1] - pad, [])
        todo = np.arange(len(rows))
        for pattern in known:
            todo = self._take(pattern, rows, pad, log_ns, arrival, todo)
        tried = 0
        while len(todo):
            head = todo[:1]
            try:
                layout = read_layout(rows[head[0], pad:].tobytes(), self._message.fields)
            except MessageError as error:
                self._refuse(arrival[head], str(error))
                todo = todo[1:]
                continue
            pattern = self._pattern(layout, rows[head[0]], pad)
            if tried >= _LAYOUTS_AT_ONCE:
                self._keep(pattern, rows[head], pad, log_ns[head], arrival[head])
                todo = todo[1:]
                continue
            tried += 1
            known.insert(0, pattern)
            del known[_LAYOUTS_KEPT:]
            self._pattern_bytes += rows.shape[1]
            todo = self._take(pattern, rows, pad, log_ns, arrival, todo)

    def _take(
        self,
        pattern: _Pattern,
        rows: Octets,
        pad: int,
        log_ns: Int64s,
        arrival: Int64s,
        todo: Int64s,
    ) -> Int64s:
        """Decode the rows among `todo` that have the pattern's layout; return the others."""
        words = rows.view(np.uint64)
        fits = _fits(words if len(todo) == len(rows) else words[todo], pattern)
        found, others = (todo, todo[:0]) if fits.all() else (todo[fits], todo[~fits])
        if len(found):
            at = rows if len(found) == len(rows) else rows[found]
            self._keep(pattern, at, pad, log_ns[found], arrival[found])
        return others

    def _pattern(self, layout: Layout, row: Octets, pad: int) -> _Pattern:
        mask = np.zeros(len(row), np.uint8)
        for a, b in layout.fixed:
            mask[pad + a : pad + b] = 255
        words = mask.view(np.uint64)
        return _Pattern(layout, words, row.view(np.uint64) & words, self._wrong(layout))

    def _wrong(self, layout: Layout) -> str:
        names = len(layout.texts[_NAME])
        for k, array in enumerate(self._arrays):
            count = layout.numbers[array].count
            if count != names and (count or not k):
                return f"{names} names but {count} values of {array}"
        return ""

    def _keep(
        self, pattern: _Pattern, rows: Octets, pad: int, log_ns: Int64s, arrival: Int64s
    ) -> None:
        layout = pattern.layout
        if self._may_be_empty and not layout.numbers[self._arrays[0]].count:
            return
        if pattern.wrong:
            self._refuse(arrival, pattern.wrong)
            return
        sec, nanosec = layout.numbers.get(_SEC), layout.numbers.get(_NANOSEC)
        stamp_ns = log_ns
        if sec and nanosec:
            stamp_ns = column(rows, pad + sec.offset, sec.dtype)[:, 0].astype(np.int64)
            stamp_ns *= 1_000_000_000
            stamp_ns += column(rows, pad + nanosec.offset, nanosec.dtype)[:, 0]
        self.frame = self.frame or layout.texts.get(_FRAME, ("",))[0]
        columns = [self._column(layout, array, rows, pad) for array in self._arrays]
        value = columns[0] if len(columns) == 1 else np.stack(columns, axis=2)
        self.decoded.add(layout.texts[_NAME], arrival, log_ns, stamp_ns, value)

    def _column(self, layout: Layout, array: str, rows: Octets, pad: int) -> Float64s:
        """Values of one array, shape (m, names); NaN if it is empty."""
        span, names = layout.numbers[array], len(layout.texts[_NAME])
        if span.count != names:
            return np.full((len(rows), names), np.nan)
        return column(rows, pad + span.offset, span.dtype, span.count).astype(np.float64)


def _fits(words: npt.NDArray[np.uint64], pattern: _Pattern) -> npt.NDArray[np.bool_]:
    """Whether each row has the pattern's layout: `words` (m, w) → (m,)."""
    same: npt.NDArray[np.bool_] = ((words & pattern.mask) == pattern.expected).all(axis=1)
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


def plain_payloads(batch: Batch, chosen: Int64s) -> Iterator[tuple[Octets, Int64s, Int64s, Int64s]]:
    """(octets, start, length, index) of the messages at the indices `chosen`, decompressed.

    Individually compressed messages (rosbag2's message mode) are recognised by zstd's magic bytes,
    since plain CDR begins with a zero; they are decompressed in groups into new octets.  At least
    eight bytes precede every payload.
    """
    octets, start, length = batch.octets, batch.start[chosen], batch.length[chosen]
    magic = np.frombuffer(ZSTD_MAGIC, np.uint8)
    packed = length >= len(magic)
    packed[packed] = (pick(octets, start[packed], len(magic)) == magic).all(axis=1)
    if not packed.all():
        yield octets, start[~packed], length[~packed], chosen[~packed]
    parts: list[bytes] = []
    waiting = 0
    index = chosen[packed]
    for k, (a, n) in enumerate(zip(start[packed].tolist(), length[packed].tolist(), strict=True)):
        parts.append(unpack_message(batch.raw[a : a + n], batch.unpacked))
        waiting += len(parts[-1])
        if waiting >= _UNPACKED_AT_ONCE or k + 1 == len(index):
            sizes = np.array([len(part) for part in parts], np.int64)
            joined = np.frombuffer(bytes(LEAD) + b"".join(parts), np.uint8)
            of_these = index[k + 1 - len(parts) : k + 1]
            parts, waiting = [], 0
            yield joined, np.cumsum(sizes) - sizes + LEAD, sizes, of_these


def unpack_message(data: bytes, unpacked: Unpacked) -> bytes:
    """Decompress one payload; empty if that fails or the result is too large.

    Raises:
        BagError: the file unpacks to more than `unpacked` allows.
    """
    try:
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            plain: bytes = reader.read(MESSAGE_BYTES + 1)
    except zstandard.ZstdError:
        return b""
    unpacked.add(len(plain))
    return plain if len(plain) <= MESSAGE_BYTES else b""
