"""Time since the last estimate, and the age of that estimate.  Does not depend on ROS."""

from __future__ import annotations

from math import inf
from typing import Final

SAME_CLOCK_S: Final = 60.0
"""Default of the parameter ``same_clock_within`` [s]: stamps that lag the node's clock by less are
assumed to come from it.  Older stamps come from a recording or another clock, and only their
differences are used."""


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
        self._node_ns = min(self._node_ns, node_ns)  # the clock was set back
        simulated = (node_ns - self._node_ns) * 1e-9
        if steady_s - self._moved_s > self.timeout_s:
            return max(simulated, steady)
        return simulated


def stale_before_ns(
    newest_ns: int, now_ns: int, timeout_s: float, same_clock_s: float = SAME_CLOCK_S
) -> int:
    """Estimates with a stamp before this are older than the timeout [ns].

    Args:
        newest_ns: stamp of the newest reading [ns].
        now_ns: time of the node's clock [ns].
        timeout_s: the timeout [s].
        same_clock_s: lag up to which stamps are assumed to come from the node's clock [s].
    """
    same = (now_ns - newest_ns) * 1e-9 < same_clock_s
    return (max(newest_ns, now_ns) if same else newest_ns) - round(timeout_s * 1e9)


def age_s(
    stamp_ns: int, now_ns: int, lag_s: float, silence_s: float, same_clock_s: float = SAME_CLOCK_S
) -> float:
    """Age of the last estimate as seen by a controller [s].

    Args:
        stamp_ns: stamp of the last estimate [ns].
        now_ns: time of the node's clock [ns].
        lag_s: lag of the estimate behind the newest reading when it was computed [s].
        silence_s: time since the estimate was computed [s].
        same_clock_s: lag up to which stamps are assumed to come from the node's clock [s].
    """
    by_readings = lag_s + silence_s
    by_clock = (now_ns - stamp_ns) * 1e-9
    return max(by_readings, by_clock) if by_clock < same_clock_s else by_readings
