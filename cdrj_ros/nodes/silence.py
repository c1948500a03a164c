"""How long the estimator has said nothing, and how old what it said last is.  No ROS here."""

from __future__ import annotations

from math import inf
from typing import Final

COMPARABLE_S: Final = 60.0
"""Stamps less than this behind the node's clock are taken for the same clock [s].  Beyond, they are
those of a recording or of a clock of its own, and only differences between stamps count."""


class Silence:
    """Time since the last estimate, by the node's clock and by a steady one.

    The node's clock may be simulated, and then stand still or not exist.  While it has not moved
    for the timeout, the steady clock counts.
    """

    def __init__(self, timeout_s: float, simulated: bool) -> None:
        """Begin with nothing heard."""
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
        """Nothing has been heard."""
        self._node_ns = None

    def note(self, node_ns: int, steady_s: float) -> None:
        """An estimate has been made, at these times of both clocks."""
        self._node_ns, self._steady_s = node_ns, steady_s

    def seconds(self, node_ns: int, steady_s: float) -> float:
        """Time since the last estimate [s]; infinite before the first."""
        if node_ns != self._clock_ns:
            self._clock_ns, self._moved_s = node_ns, steady_s
        if self._node_ns is None:
            return inf
        steady = steady_s - self._steady_s
        if not self._simulated:  # the system's clock may be set while the node runs
            return steady
        self._node_ns = min(self._node_ns, node_ns)  # set back
        simulated = (node_ns - self._node_ns) * 1e-9
        if steady_s - self._moved_s > self.timeout_s:
            return max(simulated, steady)
        return simulated


def age_s(stamp_ns: int, now_ns: int, lag_s: float, silence_s: float) -> float:
    """Age of the last estimate as a controller would feel it [s].

    Args:
        stamp_ns: of the last estimate [ns].
        now_ns: time of the node's clock [ns].
        lag_s: how far it lay behind the newest reading when it was made [s].
        silence_s: time since then [s].
    """
    by_readings = lag_s + silence_s
    by_clock = (now_ns - stamp_ns) * 1e-9
    return max(by_readings, by_clock) if by_clock < COMPARABLE_S else by_readings
