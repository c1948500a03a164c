"""The topics that ``watch`` listens to: their last messages as entries of a table."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from time import monotonic
from typing import Final

import numpy as np

from cdrj_ros.messages.cdr import MessageError, MessageType, read_layout
from cdrj_ros.model.status import OK, STALE
from cdrj_ros.report.live_table import Line, Section

SILENCE_S: Final = 1.5
"""Time without a message after which the last one is stale and the reason is looked for [s]."""

RATE_S: Final = 2.0
"""Time over which the rate is counted [s]."""

LEAST_S: Final = 0.5
"""Time after which a rate can be told [s]."""


@dataclass(frozen=True)
class Choice:
    """Which entries are shown, and how long their bars may get."""

    pattern: str = "*"
    limits: Mapping[str, float] = field(default_factory=dict)
    """By cable [N]."""
    any_limit: float = float("inf")
    """Of cables without one of their own [N]."""

    def wants(self, name: str) -> bool:
        """Whether an entry is shown."""
        return fnmatchcase(name, self.pattern)

    def limit(self, name: str) -> float:
        """Limit of an element [N]."""
        return self.limits.get(name.rpartition("/")[0], self.any_limit)


@dataclass
class Feed:
    """One topic: what came last, and how often something comes."""

    topic: str
    """Resolved name."""
    message: MessageType
    title: str
    """What its entries are."""
    value: str
    """Field that is shown."""
    limited: bool
    """Whether limits of tension apply to the value."""
    payload: bytes | None = None
    heard_s: float = field(default_factory=monotonic)
    """Steady time of the last message, or of the start [s]."""
    count: int = 0
    looks: deque[tuple[float, int]] = field(default_factory=deque)
    """Steady times [s] of recent looks and the messages counted until then."""

    def hear(self, payload: bytes) -> None:
        """Take a message."""
        self.payload = payload
        self.heard_s = monotonic()
        self.count += 1

    def rate_hz(self) -> float | None:
        """Messages a second since the oldest look in ``RATE_S``; counts as a look."""
        now = monotonic()
        while self.looks and now - self.looks[0][0] > RATE_S:
            self.looks.popleft()
        self.looks.append((now, self.count))
        begin, before = self.looks[0]
        return (self.count - before) / (now - begin) if now - begin > LEAST_S else None

    def silent(self) -> bool:
        """Whether nothing has come for ``SILENCE_S``."""
        return monotonic() - self.heard_s > SILENCE_S

    def read(self, choice: Choice) -> tuple[int, Section]:
        """Stamp [ns] and entries of the last message; in silence they are all stale.

        Raises:
            MessageError: arrays of different lengths, or not the message at all.
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
                choice.limit(name) if self.limited else float("inf"),
            )
            for k, name in enumerate(names)
            if choice.wants(name)
        )
        seconds, rest = (int(arrays[f"header.stamp.{part}"][0]) for part in ("sec", "nanosec"))
        return seconds * 1_000_000_000 + rest, Section(self.title, lines)
