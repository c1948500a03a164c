"""One file of an older rosbag2 storage, sqlite3, read as batches like those of an MCAP file."""

from __future__ import annotations

import os
import sqlite3
import struct
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Final

import numpy as np

from cdrj_ros.bag.bulk import LEAD
from cdrj_ros.bag.definitions import long_name
from cdrj_ros.bag.mcap_file import Batch, Channel, Int64s, Stretch
from cdrj_ros.foundation.errors import BagError

MAGIC: Final = b"SQLite format 3\0"
_AT_ONCE: Final = 20_000
"""Messages of one stretch."""
_HEAD: Final = struct.Struct(">16xH10xI")
"""Size and number of the pages, where a database says them."""


class Db3File:
    """A .db3 file opened for reading, with the same face as ``McapFile``."""

    def __init__(self, path: Path) -> None:
        """Read the topics and the times of all messages; no message is read yet.

        Raises BagError for a file that is no such bag.
        """
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.notes: list[str] = []
        self.messages_read = 0
        self.complete = True
        self.indexed = True
        _require_whole(path)
        try:
            with closing(self._connect()) as connection:
                self._read_channels(connection)
                ids, times, topics = self._read_times(connection)
        except sqlite3.Error as error:
            raise BagError(f"{path} is not a bag stored as sqlite3 ({_line(error)})") from None
        self.counts: Mapping[int, int] | None = {
            int(number): int(count)
            for number, count in zip(*np.unique(topics, return_counts=True), strict=True)
        }
        edges = range(0, len(ids), _AT_ONCE)
        self.stretches = tuple(
            Stretch(
                int(ids[at]),
                int(ids[min(at + _AT_ONCE, len(ids)) - 1]) + 1,
                int(times[at : at + _AT_ONCE].min()),
                int(times[at : at + _AT_ONCE].max()),
            )
            for at in edges
        )

    def batches(self, stretches: Iterable[Stretch] | None = None) -> Iterator[Batch]:
        """Read the stretches in the given order (None: all of them)."""
        wanted = self.stretches if stretches is None else tuple(stretches)
        if not wanted:
            return
        with closing(self._connect()) as connection:
            for stretch in wanted:
                batch = self._load(connection, stretch)
                self.messages_read += len(batch.start)
                yield batch

    def declare_all(self) -> None:
        """All channels are known from the start."""

    def state(self) -> str:
        """Nothing is unusual about the file's end: one that is cut is refused."""
        return ""

    def _connect(self) -> sqlite3.Connection:
        """Read-only; a journal beside the file is taken in where the folder allows it."""
        uri = self.path.resolve().as_uri()
        connection = sqlite3.connect(f"{uri}?mode=ro", uri=True, check_same_thread=False)
        try:
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
        except sqlite3.Error:
            connection.close()
            connection = sqlite3.connect(
                f"{uri}?mode=ro&immutable=1", uri=True, check_same_thread=False
            )
        connection.text_factory = lambda data: data.decode(errors="replace")
        return connection

    def _read_channels(self, connection: sqlite3.Connection) -> None:
        tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master")}
        definitions: dict[str, tuple[str, str]] = {}
        if "message_definitions" in tables:
            query = "SELECT topic_type, encoding, encoded_message_definition"
            for name, encoding, text in connection.execute(f"{query} FROM message_definitions"):
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

    def _read_times(self, connection: sqlite3.Connection) -> tuple[Int64s, Int64s, Int64s]:
        """Number, time and topic of every message, as far as the file can be read."""
        rows: list[tuple[int, int, int]] = []
        cursor = connection.execute(
            "SELECT id, timestamp, topic_id FROM messages NOT INDEXED ORDER BY id"
        )
        try:
            for row in cursor:
                if all(isinstance(value, int) for value in row):
                    rows.append(row)  # noqa: PERF401 what comes before an error stays
        except sqlite3.Error as error:
            self._damaged(error)
        table = np.array(rows, np.int64).reshape(-1, 3)
        return table[:, 0], table[:, 1], table[:, 2]

    def _load(self, connection: sqlite3.Connection, stretch: Stretch) -> Batch:
        channel: list[int] = []
        log_ns: list[int] = []
        payloads: list[bytes] = []
        query = "SELECT topic_id, timestamp, data FROM messages WHERE id >= ? AND id < ?"
        try:
            for topic, time, data in connection.execute(
                f"{query} ORDER BY id", (stretch.start, stretch.stop)
            ):
                if topic in self.channels and isinstance(time, int) and isinstance(data, bytes):
                    channel.append(topic)
                    log_ns.append(time)
                    payloads.append(data)
        except sqlite3.Error as error:
            self._damaged(error)
        length = np.array([len(data) for data in payloads], np.int64)
        return Batch(
            bytes(LEAD) + b"".join(payloads),
            np.array(channel, np.uint16),
            np.array(log_ns, np.int64),
            LEAD + np.cumsum(length) - length,
            length,
        )

    def _damaged(self, error: sqlite3.Error) -> None:
        note = f"{self.path.name} is damaged ({_line(error)}): read what comes before"
        if note not in self.notes:
            self.notes.append(note)


def _require_whole(path: Path) -> None:
    """Refuse what is no database, and one that is cut: sqlite would not read either."""
    try:
        with path.open("rb") as stream:
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
            f"{path} is cut: {size} of {claimed} bytes are there; `sqlite3 {path} .recover` gives "
            "what is left as SQL"
        )


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
