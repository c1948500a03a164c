"""Opening of a recording: its files, its topics, and its messages in order of time, at a pace."""

from __future__ import annotations

import os
import re
from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from math import inf
from operator import itemgetter
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.foundation.errors import BagError, UsageError
from cdrj_ros.foundation.output import printable
from cdrj_ros.recordings.batch import Channel, require_cdr
from cdrj_ros.recordings.mcap_file import McapFile

_FILE: Final = re.compile(r"(?P<name>.*?)(?:_(?P<number>\d+))?\.(?:mcap|db3)(?:\.zstd)?")
"""Name of a file of a bag; those of other kinds than MCAP are refused with what converts them."""


class RawMessage(NamedTuple):
    """One message as recorded."""

    topic: str
    log_ns: int
    """Log time [ns]."""
    data: bytes
    """CDR payload with encapsulation."""
    msgtype: str


@dataclass(frozen=True)
class Source:
    """The files of one recording."""

    path: Path
    files: tuple[McapFile, ...]
    notes: tuple[str, ...]
    """Irregularities of the folder."""

    def all_notes(self) -> tuple[str, ...]:
        """Notes of the folder and of every file, as far as the files have been read."""
        found = list(self.notes)
        for file in self.files:
            found += file.notes()
        return tuple(map(printable, found))

    def channels_known(self) -> bool:
        """Whether all channels are known without reading messages."""
        return all(file.channels_known for file in self.files)

    def all_channels(self) -> Mapping[str, Channel]:
        """Channels by topic, for which a file without an index is read."""
        for file in self.files:
            file.declare_all()
        return self.channels()

    def channels(self) -> Mapping[str, Channel]:
        """Channels by topic, as declared so far; the first declaration of a topic counts."""
        found: dict[str, Channel] = {}
        for file in self.files:
            for channel in file.channels.values():
                found.setdefault(channel.topic, channel)
        return found


def open_source(path: Path | str) -> Source:
    """Open the folder of a rosbag2 recording, or one MCAP file."""
    path = Path(path)
    if not os.path.exists(path):  # noqa: PTH110  Path.exists raises for names that are too long
        raise BagError(f"{path} does not exist, expected a rosbag2 folder or an .mcap file")
    if not path.is_dir():
        return Source(path, (McapFile(path),), ())
    notes: list[str] = []
    files = []
    for part in _parts(path, notes):
        try:
            files.append(McapFile(part))
        except BagError as error:
            notes.append(f"left out: {error}")
    if not files:
        raise BagError(f"{path} holds no readable file of a bag: {'; '.join(notes)}")
    return Source(path, tuple(files), tuple(notes))


def _parts(folder: Path, notes: list[str]) -> list[Path]:
    """The files of the recording in a folder, in the order of their numbers."""
    recordings: dict[str, list[tuple[int, Path]]] = {}
    try:
        paths = sorted(folder.iterdir())
    except OSError as error:
        raise BagError(f"{folder} cannot be read: {error.strerror or error}") from None
    for path in paths:
        if file := _FILE.fullmatch(path.name):
            recordings.setdefault(file["name"], []).append((int(file["number"] or 0), path))
    if not recordings:
        raise BagError(f"{folder} holds no .mcap file, expected a rosbag2 folder")
    chosen = folder.name if folder.name in recordings else next(iter(recordings))
    others = sorted(set(recordings) - {chosen})
    if others and chosen != folder.name:
        raise BagError(
            f"{folder} holds {len(recordings)} recordings ({', '.join(sorted(recordings))}): name "
            "one .mcap file"
        )
    if others:
        notes.append(f"other recordings in the folder were left out: {', '.join(others)}")
    parts = sorted(recordings[chosen])
    numbers = {number for number, _ in parts}
    if len(numbers) > 1 and (missing := max(numbers) + 1 - len(numbers)):
        notes.append(f"{missing} of the files {chosen}_0 to {chosen}_{max(numbers)} are missing")
    return [path for _, path in parts]


def read_messages(
    path: Path | str | Source,
    topic_names: Collection[str],
    *,
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> Iterator[RawMessage]:
    """The messages of these topics in order of log time, across topics and split files.

    Only messages with start_ns ≤ log_ns < end_ns are yielded.  Messages with equal times keep the
    order of the file.  Missing topics are ignored, but BagError is raised at once if all are
    missing.  Only parts of the bag that overlap in time are in memory together.
    """
    source = path if isinstance(path, Source) else open_source(path)
    there = source.all_channels()
    wanted = [there[name] for name in topic_names if name in there]
    if not wanted:
        raise BagError(
            f"{source.path} has none of the topics {', '.join(topic_names) or '(none named)'}, "
            f"but {', '.join(sorted(there)) or 'none'}"
        )
    for channel in wanted:
        require_cdr(source.path, channel)
    low = -(2**63) if start_ns is None else start_ns
    high = 2**63 if end_ns is None else end_ns
    return _in_order(source, {channel.topic for channel in wanted}, low, high)


def _in_order(source: Source, topics: set[str], low: int, high: int) -> Iterator[RawMessage]:
    """Merge the stretches; a message is yielded once no later stretch can hold an earlier one."""
    parts = [(stretch, file) for file in source.files for stretch in file.stretches]
    wanted = [
        (stretch.first_ns, rank, stretch, file)
        for rank, (stretch, file) in enumerate(parts)
        if stretch.first_ns < high and stretch.last_ns >= low
    ]
    wanted.sort(key=itemgetter(0))
    readers = {
        id(file): file.batches([stretch for *_, stretch, of in wanted if of is file])
        for file in source.files
    }
    waiting: list[tuple[int, int, int, RawMessage]] = []
    for i, (_, rank, _, file) in enumerate(wanted):
        batch = next(readers[id(file)])
        channels = {n: c for n, c in file.channels.items() if c.topic in topics}
        chosen = np.isin(batch.channel, list(channels))
        chosen &= (batch.log_ns >= low) & (batch.log_ns <= high - 1)
        index = np.flatnonzero(chosen)
        columns = (batch.log_ns, batch.channel, batch.start, batch.length)
        for k, log_ns, number, start, length in zip(
            index.tolist(), *(values[index].tolist() for values in columns), strict=True
        ):
            data, channel = batch.raw[start : start + length], channels[number]
            message = RawMessage(channel.topic, log_ns, data, channel.msgtype)
            waiting.append((log_ns, rank, k, message))
        waiting.sort()
        last = i + 1 == len(wanted)
        ready = len(waiting) if last else bisect_left(waiting, (wanted[i + 1][0],))
        yield from (message for *_, message in waiting[:ready])
        del waiting[:ready]


MIN_RATE: Final = 1e-3
MAX_RATE: Final = 1e6


def checked_rate(rate: float) -> float:
    """Return the rate if it is valid.

    Raises:
        UsageError: the rate is not in [MIN_RATE, MAX_RATE].
    """
    if not MIN_RATE <= rate <= MAX_RATE:
        raise UsageError(
            f"--rate must be in [{MIN_RATE:g}, {MAX_RATE:g}] times real time, got {rate:g}"
        )
    return rate


def rate_in_words(rate: float | None) -> str:
    """The rate as text, for example ``1 x real time``."""
    return "as fast as possible" if rate is None else f"{rate:g} x real time"


class Playback:
    """One pass over a recording: returns every message once, in order, when it is due.

    The caller passes the wall time, in seconds of any monotonic clock.  The time of the recording
    runs from ``begin_ns`` to ``end_ns`` at ``rate`` times real time, or jumps from message to
    message if the rate is None (as fast as possible).
    """

    def __init__(
        self,
        messages: Iterable[RawMessage],
        begin_ns: int,
        end_ns: int,
        *,
        rate: float | None = None,
    ) -> None:
        """Prepare the playback; no message is due before ``start``.

        Args:
            messages: in order of log time, within [begin_ns, end_ns].
            begin_ns, end_ns: first and last time of the recording that is played [ns].
            rate: multiple of real time; None: as fast as possible.

        Raises:
            UsageError: as ``checked_rate``.
        """
        self.begin_ns, self.end_ns = begin_ns, end_ns
        self.rate = None if rate is None else checked_rate(rate)
        self.behind_s = 0.0
        """Maximum delay in wall time with which a message was taken [s]."""
        self._messages = iter(messages)
        self._next = next(self._messages, None)
        self._taken_ns = begin_ns
        self._start_s = inf

    def start(self, now_s: float) -> None:
        """Let the time of the recording run from now on."""
        self._start_s = now_s

    @property
    def ended(self) -> bool:
        """Whether every message has been taken."""
        return self._next is None

    def take(self, now_s: float, at_most: int) -> Sequence[RawMessage]:
        """The next due messages in order."""
        if self._next is None or now_s < self._start_s:
            return ()
        taken: list[RawMessage] = []
        if self.rate is None:
            taken = [self._next, *islice(self._messages, at_most - 1)]
            self._next = next(self._messages, None)
        else:
            time_ns = self._time_ns(now_s, self.rate)
            late_ns = time_ns - self._next.log_ns
            self.behind_s = max(self.behind_s, late_ns * 1e-9 / self.rate)
            while self._next and self._next.log_ns <= time_ns and len(taken) < at_most:
                taken.append(self._next)
                self._next = next(self._messages, None)
        if taken:
            self._taken_ns = taken[-1].log_ns
        return taken

    def wait_s(self, now_s: float) -> float:
        """Time until the next message is due [s]; infinite before ``start`` and at the end."""
        if self._next is None or now_s < self._start_s:
            return inf
        if self.rate is None:
            return 0.0
        return max((self._next.log_ns - self._time_ns(now_s, self.rate)) * 1e-9 / self.rate, 0.0)

    def position_ns(self, now_s: float) -> int:
        """Current time of the recording [ns]; never later than the next message to be sent."""
        if self.rate is None or now_s < self._start_s:
            return self._taken_ns
        limit = self.end_ns if self._next is None else self._next.log_ns
        return max(min(self._time_ns(now_s, self.rate), limit), self._taken_ns)

    def _time_ns(self, now_s: float, rate: float) -> int:
        return self.begin_ns + int((now_s - self._start_s) * rate * 1e9)
