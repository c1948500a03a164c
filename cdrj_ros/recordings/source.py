"""Opening of a recording: its files, its topics, and its undecoded messages in order of time."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import itemgetter
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.output import printable
from cdrj_ros.foundation.yaml import YamlError, load_yaml
from cdrj_ros.recordings.batch import METADATA_BYTES, Channel, open_regular, require_cdr
from cdrj_ros.recordings.db3_file import Db3File
from cdrj_ros.recordings.decoding import plain
from cdrj_ros.recordings.mcap_file import McapFile

METADATA: Final = "metadata.yaml"
_SUFFIXES: Final = (".mcap", ".mcap.zstd", ".db3")
_PART: Final = re.compile(r"(?P<name>.*)_(?P<number>\d+)\.(mcap(\.zstd)?|db3)")

BagFile = McapFile | Db3File


class RawMessage(NamedTuple):
    """One message as recorded."""

    topic: str
    log_ns: int
    """Log time [ns]."""
    data: bytes
    """CDR payload with encapsulation; empty if the message could not be decompressed."""
    msgtype: str


@dataclass(frozen=True)
class TopicInfo:
    """One topic of a bag."""

    name: str
    msgtype: str
    count: int
    """Number of readable messages."""


@dataclass(frozen=True)
class Source:
    """The files of one recording."""

    path: Path
    files: tuple[BagFile, ...]
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

    def channels(self) -> Mapping[str, Channel]:
        """Channels by topic, as declared so far; the first declaration of a topic counts."""
        found: dict[str, Channel] = {}
        for file in self.files:
            for channel in file.channels.values():
                found.setdefault(channel.topic, channel)
        return found


def open_source(path: Path | str) -> Source:
    """Open a rosbag2 folder, a folder of its files, or one .mcap, .mcap.zstd or .db3 file."""
    path = Path(path)
    if not _exists(path):
        raise BagError(f"{path} does not exist, expected a rosbag2 folder or an .mcap file")
    notes: list[str] = []
    if not path.is_dir():
        return Source(path, (_open(path),), ())
    paths = _listed(path, notes) or _found(path, notes)
    files = [file for part in paths if (file := _opened(part, notes)) is not None]
    if not files:
        raise BagError(f"{path} holds no readable file of a bag: {'; '.join(notes)}")
    return Source(path, tuple(files), tuple(notes))


def _open(path: Path) -> BagFile:
    if path.name.endswith(".db3.zstd"):
        raise BagError(f"{path} is a compressed sqlite3 bag: undo that first, `zstd -d {path}`")
    return Db3File(path) if path.suffix == ".db3" else McapFile(path)


def _opened(path: Path, notes: list[str]) -> BagFile | None:
    """Open one part of a recording; None, with a note, if it cannot be opened."""
    try:
        return _open(path)
    except BagError as error:
        notes.append(f"left out: {error}")
        return None


def _listed(folder: Path, notes: list[str]) -> list[Path]:
    """The existing files among those listed in metadata.yaml."""
    if not _exists(folder / METADATA):
        notes.append(f"no {METADATA}")
        return []
    try:
        with open_regular(folder / METADATA) as stream:
            content = stream.read(METADATA_BYTES + 1)
        if len(content) > METADATA_BYTES:
            raise BagError(f"it has more than {METADATA_BYTES} bytes")
        names = _file_names(content.decode())
    except (OSError, BagError, UnicodeDecodeError) as error:
        notes.append(f"{METADATA} cannot be read ({error})")
        return []
    if not names:
        notes.append(f"{METADATA} lists no files")
        return []
    paths: list[Path] = []
    for name in names:
        inside = folder / Path(name).name
        choices = [inside, inside.with_name(inside.name + ".zstd")]
        there = [choice for choice in choices if _exists(choice)]
        if there:
            paths.append(there[0])
        else:
            notes.append(f"{inside.name} is listed in {METADATA} but is not there")
    return paths


def _exists(path: Path) -> bool:
    """As `Path.exists`, but False for invalid names such as one with a zero byte."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


@lru_cache(maxsize=1000)
def _file_names(text: str) -> tuple[str, ...]:
    """File names listed in a metadata.yaml; empty if the text is not valid metadata.

    A command opens all its bags once to check their topics and again to read them.
    """
    try:
        content: Any = load_yaml(text, METADATA)
        information = content["rosbag2_bagfile_information"]
        return tuple(str(name) for name in information["relative_file_paths"])
    except (YamlError, KeyError, TypeError):
        return ()


def _found(folder: Path, notes: list[str]) -> list[Path]:
    """The parts of one recording in a folder without usable metadata."""
    recordings: dict[str, list[tuple[int, Path]]] = {}
    try:
        paths = sorted(folder.iterdir())
    except OSError as error:
        raise BagError(f"{folder} cannot be read: {error.strerror or error}") from None
    for path in paths:
        if not path.name.endswith(_SUFFIXES):
            continue
        part = _PART.fullmatch(path.name)
        name = part["name"] if part else path.name.partition(".mcap")[0].removesuffix(".db3")
        recordings.setdefault(name, []).append((int(part["number"]) if part else 0, path))
    if not recordings:
        raise BagError(f"{folder} holds no .mcap file, expected a rosbag2 folder")
    chosen = folder.name if folder.name in recordings else next(iter(recordings))
    others = sorted(set(recordings) - {chosen})
    if others and chosen != folder.name:
        raise BagError(
            f"{folder} has no {METADATA} and holds {len(recordings)} recordings "
            f"({', '.join(sorted(recordings))}): name one .mcap file"
        )
    if others:
        notes.append(f"other recordings in the folder were left out: {', '.join(others)}")
    return [path for _, path in sorted(recordings[chosen])]


def list_topics(path: Path | str) -> tuple[TopicInfo, ...]:
    """The topics of a bag, sorted by name; messages are read only if a file has no statistics."""
    source = open_source(path)
    found: dict[str, TopicInfo] = {}
    for file in source.files:
        for number, count in _counts(file).items():
            channel = file.channels.get(number)
            if channel is not None:
                info = found.get(channel.topic, TopicInfo(channel.topic, channel.msgtype, 0))
                found[channel.topic] = replace(info, count=info.count + count)
    return tuple(found[name] for name in sorted(found))


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
    for file in source.files:
        file.declare_all()
    there = source.channels()
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


def _counts(file: BagFile) -> dict[int, int]:
    """Number of messages by channel number, for every declared channel."""
    if file.counts is not None:
        return {number: file.counts.get(number, 0) for number in file.channels}
    counts: dict[int, int] = {}
    for batch in file.batches():
        numbers, times = np.unique(batch.channel, return_counts=True)
        for number, n in zip(numbers.tolist(), times.tolist(), strict=True):
            counts[number] = counts.get(number, 0) + n
    return {number: counts.get(number, 0) for number in file.channels}


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
            data = plain(batch.raw[start : start + length], batch.unpacked)
            channel = channels[number]
            message = RawMessage(channel.topic, log_ns, data, channel.msgtype)
            waiting.append((log_ns, rank, k, message))
        waiting.sort()
        last = i + 1 == len(wanted)
        ready = len(waiting) if last else bisect_left(waiting, (wanted[i + 1][0],))
        yield from (message for *_, message in waiting[:ready])
        del waiting[:ready]
