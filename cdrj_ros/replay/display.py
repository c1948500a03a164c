"""Progress of a replay: a bar with counters in a terminal, otherwise lines of text."""

from __future__ import annotations

from contextlib import AbstractContextManager
from time import perf_counter
from typing import Final

from cdrj_ros.foundation.progress import LabelledBar
from cdrj_ros.replay.answers import Run
from cdrj_ros.replay.controls import Controls, rate_in_words
from cdrj_ros.replay.heard import Tally
from cdrj_ros.replay.playback import Playback

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
        self._bar = LabelledBar()
        self._pace_from: tuple[Playback, float, float] | None = None

    def say(self, words: str) -> None:
        """Print a line above the bar."""
        self._bar.say(words)

    def bar(self) -> AbstractContextManager[None]:
        """Show the progress bar while inside."""
        return self._bar.drawn(perf_counter())

    def show(
        self, playback: Playback, controls: Controls, before: Tally, run: Run, now: float
    ) -> None:
        """Show the state if the bar is due at ``now``, a time of ``perf_counter`` [s]."""
        if not self._bar.is_due(now):
            return
        duration, offset = controls.duration_s(), controls.offset_s()
        at = f"{offset:.1f}/{duration:.1f} s{self._left(playback, offset, duration, now)}"
        state = "paused" if playback.paused else f"playing {_short(playback.rate)}"
        self._bar.show(now, state, offset, duration, f"{at}, {counters(before + run.tally())}")

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
