"""Progress of a replay: a bar with counters in a terminal, otherwise lines of text."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any, Final

from cdrj_ros.foundation.progress import LINE_S
from cdrj_ros.replay.answers import Run, Tally
from cdrj_ros.replay.controls import Controls, rate_in_words
from cdrj_ros.replay.playback import Playback

REFRESH_S: Final = 0.1

PACE_S: Final = 1.0
"""Wall time after which the remaining time is shown [s]."""


def counters(tally: Tally) -> str:
    """The counters as text: ``5400 sent, 5398 answered, 2 under way, 0 lost, 0 late``."""
    words = (
        f"{tally.sent} sent, {tally.received} answered, {tally.under_way} under way, "
        f"{tally.lost} lost, {tally.late} late"
    )
    return words + (f", {tally.strange} strange" if tally.strange else "")


class Display:
    """Shows progress on standard error and messages on standard output."""

    def __init__(self) -> None:
        self._progress: Any = None
        self._task: Any = None
        self._next_s = 0.0
        self._pace_from: tuple[Playback, float, float] | None = None

    def say(self, words: str) -> None:
        """Print a line above the bar."""
        if self._progress is not None:
            self._progress.console.print(words, markup=False, highlight=False)
        else:
            print(words, flush=True)

    @contextmanager
    def bar(self) -> Iterator[None]:
        """Show the progress bar while inside."""
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        console = Console(file=sys.stderr)
        self._next_s = perf_counter() + (0.0 if console.is_terminal else LINE_S)
        if not console.is_terminal:
            yield
            return
        with Progress(
            TextColumn("{task.description}"), BarColumn(bar_width=16),
            TextColumn("{task.fields[at]}"), TextColumn("{task.fields[counts]}"),
            console=console, transient=True, auto_refresh=False,
        ) as progress:  # fmt: skip
            self._progress = progress
            self._task = progress.add_task("waiting", total=1.0, at="", counts="")
            try:
                yield
            finally:
                self._progress = None

    def show(
        self, playback: Playback, controls: Controls, before: Tally, run: Run, now: float
    ) -> None:
        """Show the state, at most every ``REFRESH_S``, or ``LINE_S`` without a terminal."""
        if now < self._next_s:
            return
        duration, offset = controls.duration_s(), controls.offset_s()
        at = f"{offset:.1f}/{duration:.1f} s{self._left(playback, offset, duration, now)}"
        counts = counters(before + run.tally())
        state = "paused" if playback.paused else f"playing {_short(playback.rate)}"
        if self._progress is None:
            self._next_s = now + LINE_S
            print(f"{state}: {at}, {counts}", file=sys.stderr, flush=True)
            return
        self._next_s = now + REFRESH_S
        self._progress.update(
            self._task, description=state, total=max(duration, 1e-9),
            completed=offset, at=at, counts=counts,
        )  # fmt: skip
        self._progress.refresh()

    def _left(self, playback: Playback, offset: float, duration: float, now: float) -> str:
        """Remaining wall time, from the pace since the start, last pause or last backward seek."""
        before = self._pace_from
        if before is None or before[0] is not playback or playback.paused or offset < before[2]:
            self._pace_from = (playback, now, offset)
            return ""
        played = offset - before[2]
        if not played > 0.0 or now - before[1] < PACE_S:
            return ""
        return f", {(duration - offset) * (now - before[1]) / played:.0f} s left"


def _short(rate: float | None) -> str:
    return "fast" if rate is None else rate_in_words(rate).removesuffix(" real time")
