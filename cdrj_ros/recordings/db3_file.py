"""Reader of a file of rosbag2's older sqlite3 storage, in batches like those of an MCAP file.

The package `rosbags` reads it.  It trusts the database, which may come from an untrusted source:
what may take any time or memory is refused before.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.output import printable
from cdrj_ros.recordings.batch import (
    DEFINITION_BYTES,
    LEAD,
    MESSAGE_BYTES,
    Batch,
    Channel,
    Stretch,
    Unpacked,
    open_regular,
)
from cdrj_ros.recordings.definitions import long_name

MAGIC: Final = b"SQLite format 3\0"
_AT_ONCE: Final = 20_000
"""Approximate number of messages in one stretch."""
_UNSOUND: Final = (
    "SELECT name FROM sqlite_master WHERE type NOT IN ('table', 'index') "
    "OR type = 'table' AND (sql NOT LIKE 'CREATE TABLE%' OR sql LIKE '%CHECK%' "
    "OR sql LIKE '% AS %' OR sql LIKE '% AS(%')"
)
"""Views, virtual tables and computed columns: they may be endless, and rosbag2 makes none."""


class Db3File:
    """A .db3 file opened for reading, with the same interface as ``McapFile``."""

    channels_known = True

    def __init__(self, path: Path) -> None:
        """Read the topics and the extent; no message is read yet.

        Raises BagError if the file is not such a bag, or is damaged.
        """
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.counts: Mapping[int, int] = {}
        self.messages_read = 0
        self._notes: list[str] = []
        _require_sound(path)
        with self._reading() as reader:
            self._read_channels(reader)
            first, beyond = int(reader.start_time), int(reader.end_time)
            parts = max(-(-reader.message_count // _AT_ONCE), 1)
            borders = [first + (beyond - first) * k // parts for k in range(parts + 1)]
        self.stretches = tuple(Stretch(0, 0, 0, a, b - 1) for a, b in pairwise(borders))

    def declare_all(self) -> None:
        """Do nothing: all channels are known from the start."""

    def batches(self, stretches: Iterable[Stretch] | None = None) -> Iterator[Batch]:
        """Read the stretches in the given order (None: all of them)."""
        unpacked = Unpacked(self.path, self.path.stat().st_size)
        with self._reading() as reader:
            connections = [one for one in reader.connections if one.id in self.channels]
            for stretch in self.stretches if stretches is None else stretches:
                rows = reader.messages(connections, stretch.first_ns, stretch.last_ns + 1)
                batch = _batch(rows, unpacked)
                self.messages_read += len(batch.start)
                yield batch

    def notes(self) -> list[str]:
        """Irregularities of the file, as sentences."""
        return self._notes

    @contextmanager
    def _reading(self) -> Iterator[Any]:
        """The reader of rosbags; whatever it raises at damage becomes a BagError."""
        from rosbags.rosbag2 import Reader  # slow

        try:
            with Reader(self.path) as reader:
                yield reader
        except (BagError, GeneratorExit):
            raise
        except Exception as error:  # noqa: BLE001  rosbags names no error of its own for damage
            words = printable(" ".join(str(error).split()))
            raise BagError(f"{self.path} is not a bag stored as sqlite3 ({words})") from None

    def _read_channels(self, reader: Any) -> None:
        counts = {}
        for one in reader.connections:
            name, msgtype = str(one.topic), long_name(str(one.msgtype))
            if not (0 <= one.id < 2**16 and name.isprintable() and msgtype.isprintable()):
                self._notes.append(f"{self.path.name}: a damaged topic was left out")
                continue
            text = str(one.msgdef.data)
            small = len(text) <= DEFINITION_BYTES
            self.channels[one.id] = Channel(
                topic=name,
                msgtype=msgtype if small else "",
                encoding=one.ext.serialization_format,
                definition_encoding={"MSG": "ros2msg", "IDL": "ros2idl"}.get(
                    one.msgdef.format.name, ""
                ),
                definition=text if small else "",
            )
            counts[one.id] = int(one.msgcount)
        self.counts = counts


def _batch(rows: Iterable[tuple[Any, Any, Any]], unpacked: Unpacked) -> Batch:
    """The messages as one batch; one that is too large becomes empty and thus malformed.

    A column of SQLite may hold values of any type.
    """
    kept = [
        (one.id, time_ns, data if isinstance(data, bytes) and len(data) <= MESSAGE_BYTES else b"")
        for one, time_ns, data in rows
        if isinstance(time_ns, int)
    ]
    channel, log_ns, payloads = zip(*kept, strict=True) if kept else ((), (), ())
    length = np.array([len(data) for data in payloads], np.int64)
    return Batch(
        bytes(LEAD) + b"".join(payloads),
        np.array(channel, np.uint16),
        np.array(log_ns, np.int64),
        LEAD + np.cumsum(length) - length,
        length,
        unpacked,
    )


def _require_sound(path: Path) -> None:
    """Refuse a file that is no database, is damaged, or holds more than tables and indexes."""
    with open_regular(path) as stream:
        head = stream.read(len(MAGIC))
    if not head:
        raise BagError(f"{path} is empty, expected a bag stored as sqlite3")
    if head != MAGIC:
        raise BagError(
            f"{path} is not a bag stored as sqlite3: it begins with {head!r}, expected {MAGIC!r}"
        )
    uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as connection:
            connection.execute("PRAGMA trusted_schema = OFF")
            unsound = connection.execute(_UNSOUND).fetchone()
            if unsound:
                raise BagError(
                    f"{path} is not a bag stored as sqlite3 "
                    f"({printable(unsound[0])} is a view or is computed)"
                )
            (words,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    except (sqlite3.Error, UnicodeDecodeError) as error:  # SQLite's words quote the file
        words = printable(str(error))
    if words != "ok":
        raise BagError(
            f"{path} is damaged ({' '.join(words.split())}); `sqlite3 {path} .recover` prints what "
            "is left as SQL"
        )
