"""Schedules recorded messages in real time, at a multiple of it, or as fast as possible."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice
from math import inf
from typing import Final

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.recordings import RawMessage

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
