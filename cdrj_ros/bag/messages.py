"""The undecoded messages of a bag in order of time, and its topics."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cdrj_ros.bag.batch import Batch, Channel, Int64s
from cdrj_ros.bag.bulk import unpack_message
from cdrj_ros.bag.mcap_file import ZSTD_MAGIC
from cdrj_ros.bag.recording import require_cdr
from cdrj_ros.bag.source import BagFile, Source, open_source
from cdrj_ros.foundation.errors import BagError


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
    if file.complete and file.indexed and file.counts is not None:
        return {number: file.counts.get(number, 0) for number in file.channels}
    counts: dict[int, int] = {}
    for batch in file.batches():
        numbers, times = np.unique(batch.channel, return_counts=True)
        for number, n in zip(numbers.tolist(), times.tolist(), strict=True):
            counts[number] = counts.get(number, 0) + n
    return {number: counts.get(number, 0) for number in file.channels}


class _Waiting(NamedTuple):
    """Messages of one batch not yet yielded, in order of log time."""

    rank: int
    """Index of the batch in the bag; determines the order of messages with equal times."""
    batch: Batch
    channels: dict[int, Channel]
    place: Int64s
    """Indices in the batch."""
    log_ns: Int64s


def _in_order(source: Source, topics: set[str], low: int, high: int) -> Iterator[RawMessage]:
    """Merge the stretches; a message is yielded once no later stretch can hold an earlier one."""
    parts = [(stretch, file) for file in source.files for stretch in file.stretches]
    plan = [
        (rank, stretch, file)
        for rank, (stretch, file) in enumerate(parts)
        if stretch.first_ns < high and stretch.last_ns >= low
    ]
    plan.sort(key=lambda part: part[1].first_ns)
    readers = {
        id(file): file.batches([stretch for _, stretch, of in plan if of is file])
        for file in source.files
    }
    waiting: list[_Waiting] = []
    for i, (rank, _, file) in enumerate(plan):
        batch = next(readers[id(file)])
        channels = {n: c for n, c in file.channels.items() if c.topic in topics}
        chosen = np.isin(batch.channel, list(channels))
        chosen &= (batch.log_ns >= low) & (batch.log_ns <= high - 1)
        index = np.flatnonzero(chosen)
        index = index[np.argsort(batch.log_ns[index], kind="stable")]
        waiting.append(_Waiting(rank, batch, channels, index, batch.log_ns[index]))
        until = plan[i + 1][1].first_ns if i + 1 < len(plan) else 2**63
        waiting, ready = _split(waiting, until)
        yield from _given(ready)


def _split(waiting: list[_Waiting], until: int) -> tuple[list[_Waiting], list[_Waiting]]:
    """Split into messages from `until` on, which must wait, and earlier ones."""
    later: list[_Waiting] = []
    ready: list[_Waiting] = []
    for part in waiting:
        n = len(part.log_ns) if until >= 2**63 else int(np.searchsorted(part.log_ns, until))
        if n:
            ready.append(part._replace(place=part.place[:n], log_ns=part.log_ns[:n]))
        if n < len(part.log_ns):
            later.append(part._replace(place=part.place[n:], log_ns=part.log_ns[n:]))
    return later, ready


def _given(ready: list[_Waiting]) -> Iterator[RawMessage]:
    if not ready:
        return
    ready = sorted(ready, key=lambda part: part.rank)
    which = np.repeat(np.arange(len(ready)), [len(part.place) for part in ready])
    index = np.concatenate([part.place for part in ready])
    log_ns = np.concatenate([part.log_ns for part in ready])
    order = np.argsort(log_ns, kind="stable")
    columns = [
        (part.batch.raw, part.batch.start.tolist(), part.batch.length.tolist()) for part in ready
    ]
    numbers = [part.batch.channel.tolist() for part in ready]
    for w, i, t in zip(
        which[order].tolist(), index[order].tolist(), log_ns[order].tolist(), strict=True
    ):
        raw, start, length = columns[w]
        channel = ready[w].channels[numbers[w][i]]
        data = raw[start[i] : start[i] + length[i]]
        if data[:4] == ZSTD_MAGIC:
            data = unpack_message(data, ready[w].batch.unpacked)
        yield RawMessage(channel.topic, t, data, channel.msgtype)
