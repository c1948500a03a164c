"""Reader of a file of rosbag2's older sqlite3 storage, in batches like those of an MCAP file.

This reader replaces that of `rosbags` for two reasons.  `rosbags` fails at the first damaged page,
whereas this reader returns the messages before it.  `rosbags` also trusts the database: it reads a
view in place of a table, or a message of a gigabyte, without bound.  Reading and decoding takes
0.35 of the time that `rosbags` takes (docs/speed.md).
"""

from __future__ import annotations

import os
import sqlite3
import struct
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np

from cdrj_ros.bag.batch import Batch, Channel, Int64s, Stretch
from cdrj_ros.bag.bounds import (
    DATABASE_STEPS,
    DATABASE_STEPS_FREE,
    DEFINITION_BYTES,
    MESSAGE_BYTES,
    Unpacked,
)
from cdrj_ros.bag.bulk import LEAD
from cdrj_ros.bag.definitions import long_name
from cdrj_ros.bag.file_bytes import open_regular
from cdrj_ros.foundation.errors import BagError

MAGIC: Final = b"SQLite format 3\0"
_AT_ONCE: Final = 20_000
"""Maximum number of messages in one stretch."""
_BYTES_AT_ONCE: Final = 1 << 24
"""Maximum size of one stretch, unless a single message is larger [bytes]."""
_STEPS_AT_ONCE: Final = 1_000_000
_HEAD: Final = struct.Struct(">16xH10xI")
"""Page size and page count in the header of a database."""
_NEEDED: Final = ("topics", "messages")
_SOUND: Final = (
    "typeof(id) = 'integer' AND typeof(timestamp) = 'integer' AND typeof(topic_id) = 'integer' "
    "AND typeof(data) = 'blob'"
)
"""Required because a column of SQLite may hold values of any type."""


class Db3File:
    """A .db3 file opened for reading, with the same interface as ``McapFile``."""

    def __init__(self, path: Path) -> None:
        """Read the topics and the times of all messages; no message is read yet.

        Raises BagError if the file is not such a bag.
        """
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.notes: list[str] = []
        self.messages_read = 0
        self.complete = True
        self.indexed = True
        self._size = _require_whole(path)
        counts: dict[int, int] = {}
        try:
            with closing(self._connect()) as connection:
                self._read_channels(connection, self._tables(connection))
                self.stretches = tuple(self._read_stretches(connection, counts))
        except sqlite3.Error as error:
            raise BagError(f"{path} is not a bag stored as sqlite3 ({_line(error)})") from None
        self.counts: Mapping[int, int] | None = counts

    def batches(self, stretches: Iterable[Stretch] | None = None) -> Iterator[Batch]:
        """Read the stretches in the given order (None: all of them)."""
        wanted = self.stretches if stretches is None else tuple(stretches)
        if not wanted:
            return
        unpacked = Unpacked(self.path, self._size)
        with closing(self._connect()) as connection:
            for stretch in wanted:
                batch = self._load(connection, stretch, unpacked)
                self.messages_read += len(batch.start)
                yield batch

    def declare_all(self) -> None:
        """Do nothing: all channels are known from the start."""

    def state(self) -> str:
        """Empty: a truncated file is refused on opening, so there is nothing to report."""
        return ""

    def _connect(self) -> sqlite3.Connection:
        """Open read-only; a journal beside the file is applied if the folder permits it."""
        uri = self.path.resolve().as_uri()
        connection = self._bounded(f"{uri}?mode=ro")
        try:
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
        except sqlite3.Error:
            connection.close()
            connection = self._bounded(f"{uri}?mode=ro&immutable=1")
        return connection

    def _bounded(self, uri: str) -> sqlite3.Connection:
        """A connection that aborts after more work than an intact file of this size needs."""
        connection = sqlite3.connect(uri, uri=True, check_same_thread=False)
        connection.text_factory = lambda data: data.decode(errors="replace")
        left = (DATABASE_STEPS_FREE + DATABASE_STEPS * self._size) // _STEPS_AT_ONCE

        def count() -> bool:
            nonlocal left
            left -= 1
            return left < 0

        connection.set_progress_handler(count, _STEPS_AT_ONCE)
        connection.execute("PRAGMA trusted_schema = OFF")
        return connection

    def _tables(self, connection: sqlite3.Connection) -> set[str]:
        """The names of the real tables; views are excluded, since a view may never terminate."""
        kinds = dict(
            connection.execute(
                "SELECT name, type = 'table' AND sql LIKE 'CREATE TABLE%' FROM sqlite_master "
                "WHERE type IN ('table', 'view')"
            )
        )
        for name in _NEEDED:
            if name in kinds and not kinds[name]:
                raise BagError(
                    f"{self.path} is not a bag stored as sqlite3 ({name} is a view or a virtual "
                    "table)"
                )
        return {name for name, real in kinds.items() if real}

    def _read_channels(self, connection: sqlite3.Connection, tables: set[str]) -> None:
        definitions: dict[str, tuple[str, str]] = {}
        if "message_definitions" in tables:
            query = "SELECT topic_type, encoding, encoded_message_definition"
            for name, encoding, text in connection.execute(
                f"{query} FROM message_definitions WHERE length(encoded_message_definition) <= ?",
                (DEFINITION_BYTES,),
            ):
                definitions[long_name(str(name))] = (str(encoding), str(text))
        query = "SELECT id, name, type, serialization_format FROM topics"
        for number, name, msgtype, encoding in connection.execute(query):
            own = long_name(str(msgtype))
            printable = isinstance(number, int) and str(name).isprintable() and own.isprintable()
            if not (printable and 0 <= number < 2**16):
                self.notes.append(f"{self.path.name}: a damaged topic was left out")
                continue
            definition_encoding, definition = definitions.get(own, ("", ""))
            self.channels[number] = Channel(
                str(name), own, str(encoding), definition_encoding, definition
            )

    def _read_stretches(
        self, connection: sqlite3.Connection, counts: dict[int, int]
    ) -> Iterator[Stretch]:
        """Yield stretches up to the first damage, and add their messages by topic to `counts`."""
        cursor = connection.execute(
            "SELECT id, timestamp, topic_id, length(data) FROM messages NOT INDEXED "
            f"WHERE {_SOUND} ORDER BY id"
        )
        last = -(2**63)
        for rows in self._fetched(cursor):
            table = np.array(rows, np.int64).reshape(-1, 4)
            if len(table) and ((table[1:, 0] <= table[:-1, 0]).any() or table[0, 0] <= last):
                self._damaged("messages are out of order")
                return
            for number, count in zip(*np.unique(table[:, 2], return_counts=True), strict=True):
                counts[int(number)] = counts.get(int(number), 0) + int(count)
            for part in _parts(table):
                last = int(part[-1, 0])
                yield Stretch(int(part[0, 0]), last, int(part[:, 1].min()), int(part[:, 1].max()))

    def _fetched(self, cursor: sqlite3.Cursor) -> Iterator[list[Any]]:
        """Yield rows in groups; rows before an error are included."""
        damaged = False
        while not damaged:
            rows: list[Any] = []
            try:
                rows.extend(islice(cursor, _AT_ONCE))
            except sqlite3.Error as error:
                self._damaged(_line(error))
                damaged = True
            if not rows:
                return
            yield rows

    def _load(self, connection: sqlite3.Connection, stretch: Stretch, unpacked: Unpacked) -> Batch:
        """The messages of one stretch; one that is too large becomes empty and thus malformed."""
        cursor = connection.execute(
            "SELECT topic_id, timestamp, CASE WHEN length(data) <= ? THEN data ELSE x'' END "
            f"FROM messages WHERE id >= ? AND id <= ? AND {_SOUND} ORDER BY id",
            (MESSAGE_BYTES, stretch.start, stretch.stop),
        )
        rows = [row for part in self._fetched(cursor) for row in part if row[0] in self.channels]
        channel, log_ns, payloads = zip(*rows, strict=True) if rows else ((), (), ())
        length = np.array([len(data) for data in payloads], np.int64)
        return Batch(
            bytes(LEAD) + b"".join(payloads),
            np.array(channel, np.uint16),
            np.array(log_ns, np.int64),
            LEAD + np.cumsum(length) - length,
            length,
            unpacked,
        )

    def _damaged(self, reason: str) -> None:
        note = f"{self.path.name} is damaged ({reason}): read what comes before"
        if note not in self.notes:
            self.notes.append(note)


def _parts(table: Int64s) -> Iterator[Int64s]:
    """Rows (id, time, topic, length), split into parts of about `_BYTES_AT_ONCE` of messages."""
    ends = np.cumsum(np.clip(table[:, 3], 0, MESSAGE_BYTES))
    borders = np.flatnonzero(np.diff(ends // _BYTES_AT_ONCE)) + 1
    yield from (part for part in np.split(table, borders) if len(part))


def _require_whole(path: Path) -> int:
    """Size of the file [bytes]; raises BagError if it is not a database or is truncated."""
    try:
        with open_regular(path) as stream:
            head = stream.read(_HEAD.size)
            size = stream.seek(0, os.SEEK_END)
    except OSError as error:
        raise BagError(f"{path} cannot be read: {error.strerror or error}") from None
    if not head:
        raise BagError(f"{path} is empty, expected a bag stored as sqlite3")
    if not head.startswith(MAGIC):
        raise BagError(
            f"{path} is not a bag stored as sqlite3: it begins with {head[: len(MAGIC)]!r}, "
            f"expected {MAGIC!r}"
        )
    page, pages = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 1)
    claimed = (65536 if page == 1 else page) * pages
    if size < max(claimed, _HEAD.size):
        raise BagError(
            f"{path} is cut: {size} of {claimed} bytes are there; `sqlite3 {path} .recover` prints "
            "what is left as SQL"
        )
    return size


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
