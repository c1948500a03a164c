"""What a load cell says of a preload over a long time, and how much of it may be its own error.

A cell that drifts and a preload that creeps look the same to that cell.  Its most certain statement
is therefore kept.  What it says otherwise later is left open between both, without a change of what
is expected of its readings: only another sensor can decide.  See docs/reliability.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt
from typing import Final

EITHER: Final = 0.5
"""Share of the square of a change that is left open: the change is one of the cell or one of the
preload, and each is as likely."""


HISTORY_ERROR: Final = 0.05
"""Standard deviation of what follows from a sensor's first correction, as a fraction of it: the
friction history was formed at another preload."""

UNSETTLED: Final = 0.2
"""The same until the cell has followed a motion to and fro since then: the cable on the drum and
most of the friction belong to another preload until then."""


@dataclass
class Claim:
    """The most certain statement about a preload that readings of one load cell have led to."""

    first: float = 0.0
    """Size of the cell's first correction [N]."""
    settled: bool = False
    """Whether the cell has followed a motion to and fro since its first correction."""
    change: float = 0.0
    """Sum of the corrections of the preload until then [N]."""
    stddev: float = inf
    """Standard deviation of the preload then [N]."""
    opened: float = 0.0
    """Standard deviation that has been left open since then [N]."""
    _least: float = inf
    _most: float = -inf
    _rise: float = 0.0
    _fall: float = 0.0

    def follow(self, unaided: float, enough: float) -> None:
        """Follow the motion until the claim has settled.

        Args:
            unaided: estimate at the cell without corrections [N].
            enough: how far it must rise and fall [N].
        """
        if self.settled:
            return
        self._least, self._most = min(self._least, unaided), max(self._most, unaided)
        self._rise = max(self._rise, unaided - self._least)
        self._fall = max(self._fall, self._most - unaided)
        if min(self._rise, self._fall) > enough:
            self.settled = True
            self.renew()

    def renew(self) -> None:
        """Forget what has been said: from now on something else holds."""
        self.stddev, self.opened = inf, 0.0

    def contradicted(self, change: float, stddev: float) -> float:
        """How much further to open the preload and the cell's error, since they say otherwise now.

        Args:
            change: sum of the corrections of the preload until now [N].
            stddev: standard deviation of the preload now [N].

        Returns:
            The standard deviation to add [N]; 0 where the statements agree.
        """
        if stddev < self.stddev:
            self.change, self.stddev, self.opened = change, stddev, 0.0
            return 0.0
        error = (HISTORY_ERROR if self.settled else UNSETTLED) * self.first
        beyond = (change - self.change) ** 2 - self.stddev**2 - error**2
        more = EITHER * beyond - self.opened**2
        if more <= 0.0:
            return 0.0
        self.opened = sqrt(EITHER * beyond)
        return sqrt(more)
