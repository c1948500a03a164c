"""The last messages of topics, and those that ``watch`` shows as table entries."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from time import monotonic
from typing import Final

import numpy as np

from cdrj_ros.messages.cdr import MessageError, MessageType, read_layout
from cdrj_ros.model.packing import OK, STALE
from cdrj_ros.report.live_table import Line, Section

SILENCE_S: Final = 1.5
"""Time without a message after which the last one is marked stale and a note says why [s]."""

RATE_S: Final = 2.0
"""Time window over which the rate is measured [s]."""

LEAST_S: Final = 0.5
"""Shortest time over which a rate is reported [s]."""


@dataclass
class Rate:
    """The rate of a counter."""

    looks: deque[tuple[float, int]] = field(default_factory=deque)
    """Steady times [s] of recent calls, with the count at each."""

    def hz(self, count: int) -> float | None:
        """Rate since the oldest call within ``RATE_S`` [Hz]; None if that is too recent."""
        now = monotonic()
        while self.looks and now - self.looks[0][0] > RATE_S:
            self.looks.popleft()
        self.looks.append((now, count))
        begin, before = self.looks[0]
        return (count - before) / (now - begin) if now - begin > LEAST_S else None


@dataclass
class LastMessage:
    """The last message of a topic, undecoded."""

    payload: bytes | None = None
    heard_s: float = field(default_factory=monotonic)
    """Steady time of the last message, or of the construction before the first [s]."""
    count: int = 0
    """Number of messages."""

    def hear(self, payload: bytes) -> None:
        """Store a received message."""
        self.payload = payload
        self.heard_s = monotonic()
        self.count += 1

    def silent(self, after_s: float = SILENCE_S) -> bool:
        """Whether no message has been received for a time."""
        return monotonic() - self.heard_s > after_s


@dataclass(kw_only=True)
class Feed(LastMessage):
    """One topic of ``watch``: its last message and its message rate."""

    topic: str
    """Resolved name."""
    message: MessageType
    title: str
    """What an entry describes: ``element`` or ``pulley``."""
    value: str
    """Name of the field that is shown."""
    rate: Rate = field(default_factory=Rate)

    def rate_hz(self) -> float | None:
        """Message rate [Hz]; None if it is not known yet."""
        return self.rate.hz(self.count)

    def read(self, pattern: str = "*") -> tuple[int, Section]:
        """Stamp [ns] and the entries of these names; all are stale if the topic is silent.

        Raises:
            MessageError: the arrays differ in length, or the message cannot be decoded.
        """
        payload = self.payload or b""
        found = read_layout(payload, self.message.fields)
        arrays = {
            name: np.frombuffer(payload, span.dtype, span.count, span.offset)
            for name, span in found.numbers.items()
        }
        names, values = found.texts["name"], arrays[self.value]
        status, stddev = arrays["status"], arrays["stddev"]
        if not len(names) == len(values) == len(status) or len(stddev) not in (0, len(names)):
            raise MessageError(
                f"{len(names)} names, but {len(values)} values, {len(status)} "
                f"statuses and {len(stddev)} standard deviations"
            )
        also = STALE if self.silent() else OK
        lines = tuple(
            Line(
                name,
                float(values[k]),
                float(stddev[k]) if len(stddev) else None,
                int(status[k]) | also,
            )
            for k, name in enumerate(names)
            if fnmatchcase(name, pattern)
        )
        seconds, rest = (int(arrays[f"header.stamp.{part}"][0]) for part in ("sec", "nanosec"))
        return seconds * 1_000_000_000 + rest, Section(self.title, lines)
