"""Requests to a replay, by key or service, and their text replies.  Does not depend on ROS."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Final, NamedTuple

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.replay.playback import Playback

KEYS: Final = (
    "space pause/resume · → or n next message · ↑ ↓ or + - rate · f as fast as possible · "
    "← or [ back 10 s · ] on 10 s · q quit"
)

JUMP_S: Final = 10.0

RATES: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
"""Rates that the keys select."""


class Reply(NamedTuple):
    """Reply to a request."""

    done: bool
    words: str


IDLE: Final = Reply(False, "nothing is being played")


def rate_in_words(rate: float | None) -> str:
    """The rate as text, for example ``1 x real time``."""
    return "as fast as possible" if rate is None else f"{rate:g} x real time"


class Controls:
    """Executes requests on the current playback, if there is one."""

    def __init__(self, clock: Callable[[], float] = perf_counter) -> None:
        self.playback: Playback | None = None
        self.stopped = False
        """Whether the user has requested to stop."""
        self._clock = clock
        self._keys: dict[str, Callable[[], Reply]] = {
            " ": self.toggle_paused,
            "n": self.play_next,
            "right": self.play_next,
            "+": self.faster,
            "=": self.faster,
            "up": self.faster,
            "-": self.slower,
            "down": self.slower,
            "f": lambda: self.set_rate(0.0),
            "left": lambda: self.seek(-JUMP_S, relative=True),
            "[": lambda: self.seek(-JUMP_S, relative=True),
            "]": lambda: self.seek(JUMP_S, relative=True),
            "q": self.stop,
        }

    def press(self, key: str) -> Reply | None:
        """Execute the request of a key; None if the key has no function."""
        act = self._keys.get(key)
        return act() if act else None

    def pause(self) -> Reply:
        """Pause the playback."""
        if self.playback is None:
            return IDLE
        already = self.playback.paused
        self.playback.pause(self._clock())
        return Reply(True, f"{'already paused' if already else 'paused'} at {self._where()}")

    def resume(self) -> Reply:
        """Resume the playback."""
        if self.playback is None:
            return IDLE
        already = not self.playback.paused
        self.playback.resume(self._clock())
        words = "already playing" if already else "playing on"
        return Reply(True, f"{words} from {self._where()}, {rate_in_words(self.playback.rate)}")

    def toggle_paused(self) -> Reply:
        """Pause or resume."""
        paused = self.playback is not None and self.playback.paused
        return self.resume() if paused else self.pause()

    def is_paused(self) -> Reply:
        """Report in ``done`` whether the playback is paused."""
        if self.playback is None:
            return IDLE
        if self.playback.paused:
            return Reply(True, f"paused at {self._where()}")
        return Reply(False, f"playing at {self._where()}, {rate_in_words(self.playback.rate)}")

    def play_next(self) -> Reply:
        """Send the next message while paused."""
        if self.playback is None:
            return IDLE
        if not self.playback.paused:
            return Reply(False, "playing: pause first, then step")
        if self.playback.ended:
            return Reply(False, f"no message is left at {self._where()}")
        self.playback.burst(1)
        return Reply(True, f"next message after {self._where()}")

    def burst(self, number: int) -> Reply:
        """Send this number of messages at once; 0 for all remaining ones."""
        if self.playback is None:
            return IDLE
        if self.playback.ended:
            return Reply(False, f"no message is left at {self._where()}")
        self.playback.burst(number)
        what = f"the next {number} messages" if number else "all messages that are left"
        return Reply(True, f"sending {what} from {self._where()} at once")

    def seek(self, offset_s: float, *, relative: bool = False) -> Reply:
        """Go to a time [s] relative to the beginning or to the current position."""
        playback = self.playback
        if playback is None:
            return IDLE
        if not abs(offset_s) < 1e9:
            return Reply(False, f"offset must be a number of seconds, got {offset_s:g}")
        base = playback.position_ns(self._clock()) if relative else playback.begin_ns
        wanted = base + round(offset_s * 1e9)
        reached = playback.seek(wanted)
        cut = "" if reached == wanted else " (there is no more on that side)"
        return Reply(True, f"moved to {self._where()}{cut}; the estimator is reset there")

    def set_rate(self, rate: float) -> Reply:
        """Change the rate; 0 for as fast as possible."""
        if self.playback is None:
            return IDLE
        try:
            self.playback.set_rate(rate or None, self._clock())
        except UsageError as error:
            return Reply(False, str(error))
        return Reply(True, f"{rate_in_words(self.playback.rate)} from {self._where()}")

    def faster(self) -> Reply:
        """Select the next higher rate of ``RATES``; as fast as possible after the last."""
        if self.playback is None:
            return IDLE
        rate = self.playback.rate
        above = [r for r in RATES if rate is not None and r > rate * 1.001]
        return self.set_rate(above[0] if above else 0.0)

    def slower(self) -> Reply:
        """Select the next lower rate of ``RATES``; real time after as fast as possible."""
        if self.playback is None:
            return IDLE
        rate = self.playback.rate
        if rate is None:
            return self.set_rate(1.0)
        below = [r for r in RATES if r < rate * 0.999]
        return self.set_rate(below[-1] if below else rate)

    def stop(self) -> Reply:
        """Request the end of the replay; the report follows."""
        self.stopped = True
        return Reply(True, f"stopping at {self._where()}" if self.playback else "stopping")

    def offset_s(self) -> float:
        """Position of the playback relative to its beginning [s]."""
        playback = self.playback
        if playback is None:
            return 0.0
        return (playback.position_ns(self._clock()) - playback.begin_ns) / 1e9

    def duration_s(self) -> float:
        """Duration of the playback [s]."""
        return 0.0 if self.playback is None else _length_s(self.playback)

    def _where(self) -> str:
        return f"{self.offset_s():.3f} s of {self.duration_s():.3f} s"


def _length_s(playback: Playback) -> float:
    return (playback.end_ns - playback.begin_ns) / 1e9
