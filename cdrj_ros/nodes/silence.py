"""Time since the last estimate, and the age of that estimate.  Does not depend on ROS."""

from __future__ import annotations

from math import inf
from typing import Final

SAME_CLOCK_S: Final = 60.0
"""Default of the parameter ``same_clock_within`` [s], see ``StampClock``."""

CLOCK_ERROR: Final = 2e-4
"""Relative difference of the rates of two clocks that is not taken for lateness."""


class Silence:
    """Time since the last estimate, by the node's clock and by a steady one.

    A simulated clock may stand still or be missing.  If it has not advanced for the timeout, the
    larger of both times is used.
    """

    def __init__(self, timeout_s: float, simulated: bool) -> None:
        """Start without an estimate."""
        self.timeout_s = timeout_s
        self._simulated = simulated
        self._node_ns: int | None = None
        self._steady_s = 0.0
        self._clock_ns = -1
        self._moved_s = -inf

    @property
    def heard(self) -> bool:
        """Whether there has been an estimate since ``forget``."""
        return self._node_ns is not None

    def forget(self) -> None:
        """Discard the time of the last estimate."""
        self._node_ns = None

    def note(self, node_ns: int, steady_s: float) -> None:
        """Record an estimate made at these times of both clocks."""
        self._node_ns, self._steady_s = node_ns, steady_s

    def seconds(self, node_ns: int, steady_s: float) -> float:
        """Time since the last estimate [s]; infinite before the first."""
        if node_ns != self._clock_ns:
            self._clock_ns, self._moved_s = node_ns, steady_s
        if self._node_ns is None:
            return inf
        steady = steady_s - self._steady_s
        if not self._simulated:  # the system clock may be set while the node runs
            return steady
        if self._node_ns == 0:  # the clock has started since
            self._node_ns = node_ns
        self._node_ns = min(self._node_ns, node_ns)  # the clock was set back
        simulated = (node_ns - self._node_ns) * 1e-9
        return max(simulated, steady) if self.clock_stands(steady_s) else simulated

    def clock_stands(self, steady_s: float) -> bool:
        """Whether a simulated clock has not advanced for the timeout, as ``seconds`` saw it."""
        return self._simulated and steady_s - self._moved_s > self.timeout_s


class StampClock:
    """How far the clock of the stamps lags the node's: not at all, or by an offset.

    Where the first readings lag by less than ``same_clock_s``, their stamps come from the node's
    clock, and any lag is lateness, now and later.  Otherwise they come from a recording or from
    another clock.  The smallest lag so far is then its offset, and what a reading lags beyond the
    offset is lateness: it has arisen since.
    """

    def __init__(self, same_clock_s: float = SAME_CLOCK_S) -> None:
        """Start without a reading; ``same_clock_s`` 0: never compare with the node's clock."""
        self._same_ns = round(same_clock_s * 1e9)
        self.forget()

    def forget(self) -> None:
        """Discard the offset; the next reading gives a new one."""
        self._offset_ns: int | None = None
        self._newest_ns = self._now_ns = 0

    def note(self, newest_ns: int, now_ns: int) -> int:
        """Take the stamp of the newest reading [ns] and the time of the node's clock [ns].

        Returns:
            How late that reading is [ns], see ``late_ns``.
        """
        if newest_ns < self._newest_ns:  # the clock was set back, or a recording repeats
            self.forget()
        lag = now_ns - newest_ns
        if self._offset_ns is None:
            self._offset_ns = lag
        elif self._offset_ns != 0:
            passed = max(now_ns - self._now_ns, 0)
            self._offset_ns = min(self._offset_ns + round(CLOCK_ERROR * passed), lag)
        if self._offset_ns < self._same_ns:
            self._offset_ns = 0
        self._newest_ns, self._now_ns = newest_ns, now_ns
        return self.late_ns(newest_ns, now_ns)

    def late_ns(self, stamp_ns: int, now_ns: int) -> int:
        """How late a stamp is at a time of the node's clock [ns]; may be negative."""
        if self._same_ns == 0:
            return self._newest_ns - stamp_ns
        return now_ns - stamp_ns - (self._offset_ns or 0)

    def age_s(self, stamp_ns: int, now_ns: int, lag_s: float, silence_s: float) -> float:
        """Age of the last estimate as seen by a controller [s].

        Args:
            stamp_ns: stamp of the last estimate [ns].
            now_ns: time of the node's clock [ns].
            lag_s: lag of the estimate behind the newest reading when it was computed [s].
            silence_s: time since the estimate was computed [s].
        """
        return max(lag_s + silence_s, self.late_ns(stamp_ns, now_ns) * 1e-9)
