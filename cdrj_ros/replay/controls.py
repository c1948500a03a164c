"""Requests to a replay, by key or by service; each is answered in words.  No ROS here."""

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
"""What the keys choose from."""


class Reply(NamedTuple):
    """The answer to a request."""

    done: bool
    words: str


IDLE: Final = Reply(False, "nothing is being played")


def rate_in_words(rate: float | None) -> str:
    """``1 x real time``."""
    return "as fast as possible" if rate is None else f"{rate:g} x real time"


class Controls:
    """Acts on the playback under way, if there is one."""

    def __init__(self, clock: Callable[[], float] = perf_counter) -> None:
        self.playback: Playback | None = None
        self.stopped = False
        """The user has asked to stop."""
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
        """Act on a key; None for one without a meaning."""
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
        """Continue."""
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
        """Whether it is paused, as ``done``."""
        if self.playback is None:
            return IDLE
        if self.playback.paused:
            return Reply(True, f"paused at {self._where()}")
        return Reply(False, f"playing at {self._where()}, {rate_in_words(self.playback.rate)}")

    def play_next(self) -> Reply:
        """Send one message."""
        if self.playback is None:
            return IDLE
        if not self.playback.paused:
            return Reply(False, "playing: pause first, then step")
        if self.playback.ended:
            return Reply(False, f"no message is left at {self._where()}")
        self.playback.burst(1)
        return Reply(True, f"next message after {self._where()}")

    def burst(self, number: int) -> Reply:
        """Send this number of messages at once; 0 for all that are left."""
        if self.playback is None:
            return IDLE
        if self.playback.ended:
            return Reply(False, f"no message is left at {self._where()}")
        self.playback.burst(number)
        what = f"the next {number} messages" if number else "all messages that are left"
        return Reply(True, f"sending {what} from {self._where()} at once")

    def seek(self, offset_s: float, *, relative: bool = False) -> Reply:
        """Go to a time [s] from the beginning, or from where it is."""
        playback = self.playback
        if playback is None:
            return IDLE
        if not abs(offset_s) < 1e9:
            return Reply(False, f"offset must be a number of seconds, got {offset_s:g}")
        base = playback.position_ns(self._clock()) if relative else playback.begin_ns
        wanted = base + round(offset_s * 1e9)
        reached = playback.seek(wanted)
        cut = "" if reached == wanted else " (there is no more on that side)"
        return Reply(True, f"gone to {self._where()}{cut}; the estimator starts anew there")

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
        """The next rate of ``RATES``; beyond the last, as fast as possible."""
        if self.playback is None:
            return IDLE
        rate = self.playback.rate
        above = [r for r in RATES if rate is not None and r > rate * 1.001]
        return self.set_rate(above[0] if above else 0.0)

    def slower(self) -> Reply:
        """The next lower rate of ``RATES``; real time after as fast as possible."""
        if self.playback is None:
            return IDLE
        rate = self.playback.rate
        if rate is None:
            return self.set_rate(1.0)
        below = [r for r in RATES if r < rate * 0.999]
        return self.set_rate(below[-1] if below else rate)

    def stop(self) -> Reply:
        """End, with the report of what was played."""
        self.stopped = True
        return Reply(True, f"stopping at {self._where()}" if self.playback else "stopping")

    def offset_s(self) -> float:
        """Where the playback is [s], from its beginning."""
        playback = self.playback
        if playback is None:
            return 0.0
        return (playback.position_ns(self._clock()) - playback.begin_ns) / 1e9

    def duration_s(self) -> float:
        """How much there is to play [s]."""
        return 0.0 if self.playback is None else _length_s(self.playback)

    def _where(self) -> str:
        return f"{self.offset_s():.3f} s of {self.duration_s():.3f} s"


def _length_s(playback: Playback) -> float:
    return (playback.end_ns - playback.begin_ns) / 1e9
