"""The last message of a topic, and a rate."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from time import monotonic
from typing import Final

SILENCE_S: Final = 1.5
"""Time without a message after which the last one is out of date [s]."""

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
