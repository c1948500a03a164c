"""Schedules recorded messages: time, rate, pause, step, burst, seek.  Does not depend on ROS.

The caller passes the wall time, in seconds of any monotonic clock, so that a test can play an hour
of a recording at once.  A recording is played in passes; within a pass every message is sent once
and in order unless the user seeks.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from math import inf
from operator import attrgetter
from pathlib import Path
from typing import Final

from cdrj_ros.bag.messages import RawMessage, read_messages
from cdrj_ros.bag.source import Source, open_source
from cdrj_ros.foundation.errors import UsageError

ORDERS: Final = ("received", "sent")
"""Order of messages by the time of recording, or by the stamp in the header."""

MIN_RATE: Final = 1e-3
MAX_RATE: Final = 1e6

Reel = Callable[[int], Iterator[RawMessage]]
"""Opens the recording at a time [ns]; yields the messages from then on by ``log_ns``."""


def checked_rate(rate: float) -> float:
    """Return the rate if it is valid.

    Raises:
        UsageError: the rate is not in [MIN_RATE, MAX_RATE].
    """
    if not MIN_RATE <= rate <= MAX_RATE:
        raise UsageError(
            f"rate must be in [{MIN_RATE:g}, {MAX_RATE:g}] times real time, got {rate:g}"
        )
    return rate


def check_span(begin_ns: int, end_ns: int) -> None:
    """Check that the end [ns] is not before the beginning [ns].

    Raises:
        UsageError: the end is before the beginning.
    """
    if end_ns < begin_ns:
        raise UsageError(
            f"nothing to play: the end lies {(begin_ns - end_ns) * 1e-9:.3f} s before the start"
        )


class Playback:
    """Returns the messages that are due, and executes the user's requests.

    Time runs from ``begin_ns`` to ``end_ns``, both included, at ``rate`` times real time, or jumps
    from message to message if the rate is None (as fast as possible).
    """

    def __init__(
        self,
        reel: Reel,
        begin_ns: int,
        end_ns: int,
        *,
        rate: float | None = None,
        paused: bool = False,
    ) -> None:
        """Prepare the playback; no message is due before ``start``."""
        check_span(begin_ns, end_ns)
        self.begin_ns, self.end_ns = begin_ns, end_ns
        self.rate = None if rate is None else checked_rate(rate)
        self.paused = paused
        self.sought = False
        """Whether a seek is pending; ``start`` or ``resume_after_seek`` clears it."""
        self.behind_s = 0.0
        """Maximum delay in wall time with which a message was taken [s]."""
        self._reel = reel
        self._burst = 0.0
        self._not_before_s = inf
        self._next: RawMessage | None = None
        self._messages: Iterator[RawMessage] = iter(())
        self._set_anchor(begin_ns, inf)
        self._open(begin_ns)

    # -- the flow ------------------------------------------------------------------------------

    def start(self, now_s: float, delay_s: float = 0.0) -> None:
        """Begin a pass ``delay_s`` from now, at ``begin_ns`` or the target of a pending seek."""
        if not self.sought:
            self._open(self.begin_ns)
        self.sought = False
        self._not_before_s = now_s + delay_s
        self._set_anchor(self._position_ns, now_s + delay_s)

    def resume_after_seek(self, now_s: float) -> None:
        """Continue at the target of the seek; the time spent since then is not played."""
        self.sought = False
        self._set_anchor(self._position_ns, now_s)

    def take(self, now_s: float, at_most: int) -> Sequence[RawMessage]:
        """The next due messages in order; none while a seek is pending."""
        if self._next is None or self.sought or now_s < self._not_before_s:
            return ()
        if self._burst:
            return self._take_fast(now_s, at_most)
        if self.paused:
            return ()
        if self.rate is None:
            return self._take_fast(now_s, at_most)
        time_ns = self._clock_ns(now_s)
        if self._next.log_ns > time_ns:
            return ()
        taken: list[RawMessage] = []
        while self._next is not None and self._next.log_ns <= time_ns and len(taken) < at_most:
            taken.append(self._next)
            self._next = next(self._messages, None)
        self._position_ns = taken[-1].log_ns
        self.behind_s = max(self.behind_s, (time_ns - taken[0].log_ns) * 1e-9 / self.rate)
        return taken

    def wait_s(self, now_s: float) -> float:
        """Time until the next message [s]; infinite if paused, ended or while a seek is pending."""
        if self._next is None or self.sought:
            return inf
        if now_s < self._not_before_s:
            return self._not_before_s - now_s
        if self._burst:
            return 0.0
        if self.paused:
            return inf
        if self.rate is None:
            return 0.0
        return max((self._next.log_ns - self._clock_ns(now_s)) * 1e-9 / self.rate, 0.0)

    @property
    def ended(self) -> bool:
        """Whether every message up to ``end_ns`` has been taken."""
        return self._next is None and not self.sought

    def position_ns(self, now_s: float) -> int:
        """Current time of the recording [ns]; never later than the next message to be sent."""
        if self.paused or self.rate is None or self.sought or now_s < self._not_before_s:
            return self._position_ns
        limit = self.end_ns if self._next is None else self._next.log_ns
        return max(min(self._clock_ns(now_s), limit), self._position_ns)

    # -- the controls --------------------------------------------------------------------------

    def pause(self, now_s: float) -> None:
        """Pause, and cancel the rest of a burst."""
        if not self.paused:
            self._position_ns = self.position_ns(now_s)
            self.paused = True
        self._burst = 0.0

    def resume(self, now_s: float) -> None:
        """Continue at the current position."""
        if self.paused:
            self.paused = False
            self._set_anchor(self._position_ns, now_s)

    def set_rate(self, rate: float | None, now_s: float) -> None:
        """Change the rate from the current position on; None for as fast as possible.

        Raises:
            UsageError: as ``checked_rate``.
        """
        new = None if rate is None else checked_rate(rate)
        self._position_ns = self.position_ns(now_s)
        self.rate = new
        self._set_anchor(self._position_ns, now_s)

    def burst(self, number: int) -> None:
        """Send the next messages at once, 0 for all remaining; then return to the previous mode.

        Messages of an earlier request that are not sent yet are sent as well: two requests may
        arrive before the next ``take``.

        Raises:
            UsageError: the number is negative.
        """
        if number < 0:
            raise UsageError(f"number of messages must not be negative, got {number}")
        self._burst += number or inf

    def seek(self, time_ns: int) -> int:
        """Go to a time, clamped to [begin_ns, end_ns]; returns the clamped time [ns].

        No message is due until ``resume_after_seek``, since the estimator must be reset first.
        """
        target = min(max(time_ns, self.begin_ns), self.end_ns)
        self._burst = 0.0
        self._open(target)
        self.sought = True
        return target

    # -- inside --------------------------------------------------------------------------------

    def _take_fast(self, now_s: float, at_most: int) -> Sequence[RawMessage]:
        """Take messages regardless of time: at the fast rate, or in a burst at any rate."""
        wanted = min(float(at_most), self._burst) if self._burst else at_most
        taken: list[RawMessage] = []
        if self._next is not None:
            taken = [self._next, *islice(self._messages, int(wanted) - 1)]
            self._next = next(self._messages, None)
            self._position_ns = taken[-1].log_ns
        if self._burst:
            self._burst -= len(taken)
            if self._next is None:
                self._burst = 0.0
            self._set_anchor(self._position_ns, now_s)
        return taken

    def _clock_ns(self, now_s: float) -> int:
        if self.rate is None or now_s <= self._anchor_s:
            return self._anchor_ns
        return self._anchor_ns + int((now_s - self._anchor_s) * self.rate * 1e9)

    def _set_anchor(self, time_ns: int, now_s: float) -> None:
        """Let time run from this point on."""
        self._anchor_ns, self._anchor_s = time_ns, now_s

    def _open(self, time_ns: int) -> None:
        self._messages = self._bounded(self._reel(time_ns))
        self._next = next(self._messages, None)
        self._position_ns = time_ns

    def _bounded(self, messages: Iterable[RawMessage]) -> Iterator[RawMessage]:
        """The messages up to ``end_ns``."""
        for message in messages:
            if message.log_ns > self.end_ns:
                return
            yield message


def log_order(source: Source, topics: Sequence[str]) -> Reel:
    """The recording ordered by log time, read during the playback.

    Raises:
        BagError: as ``read_messages``.
    """
    return lambda start_ns: read_messages(source, topics, start_ns=start_ns)


def stamp_order(
    source: Source, topics: Sequence[str], stamp_of: Callable[[RawMessage], int]
) -> tuple[Reel, int, int]:
    """The recording ordered by header stamp, with its first and last stamp [ns].

    The recording is held in memory.  ``stamp_of`` returns a message's header stamp [ns], or 0 if it
    has none; such messages keep their log time.  ``log_ns`` of the returned messages is the time by
    which they are ordered.

    Raises:
        BagError: as ``read_messages``.
    """
    messages = [
        message._replace(log_ns=stamp) if (stamp := stamp_of(message)) > 0 else message
        for message in read_messages(source, topics)
    ]
    messages.sort(key=attrgetter("log_ns"))
    times = [message.log_ns for message in messages]
    if not times:
        return (lambda _: iter(())), 0, 0

    def reel(start_ns: int) -> Iterator[RawMessage]:
        return islice(messages, bisect_left(times, start_ns), None)

    return reel, times[0], times[-1]


def merged_source(paths: Sequence[str]) -> Source:
    """Merge recordings of one event that were made in parallel or one after another.

    Raises:
        BagError: a recording cannot be opened.
    """
    sources = [open_source(path) for path in paths]
    return Source(
        Path(" + ".join(paths)),
        tuple(file for source in sources for file in source.files),
        tuple(note for source in sources for note in source.notes),
    )
