"""What a trusted sensor has taught lately, and what follows if its readings contradict that.

A sudden change of a sensor's readings that the encoders do not explain is a fault of the sensor
or a change of the preload.  The readings of that sensor alone cannot tell which, so both stay
possible: the ensemble gives a part of the change to the sensor's own error and a part to the
preload, until other sensors decide.  See docs/uncertainty.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.claims import Claim
from cdrj_ros.estimation.independent_draws import root_mean_square

Vector = NDArray[np.float64]

CONTESTED: Final = 9.0
"""A reading is contested if its squared residual exceeds this multiple of its variance."""

PLAIN: Final = 16.0
"""Beyond this multiple one reading shows a contradiction; up to it, two in a row do."""

CERTAIN: Final = 3.0
"""A sensor is wrong if its lasting error is more standard deviations than this from zero."""

LASTING: Final = 5
"""Contested readings in a row, all on the same side, after which the change is taken for real."""

WINDOW_NS: Final = 1_000_000_000
"""A reading is compared with what the estimate would be without the latest corrections of the same
sensor, over all times up to this [ns]: otherwise a wrong sensor is followed in small steps."""

LONG_WINDOW_NS: Final = 5_000_000_000
"""The same for the only load cell of a cable whose motor's effort is measured, too [ns]: the effort
decides whether a slow change is one of the preload or of the cell.  Over such a time the errors of
a good cell add up as well, so that it is not doubted without another witness."""

KEPT_IN_WINDOW: Final = 50
"""Most corrections that are kept for this comparison, evenly spaced in time."""

LARGEST: Final = 1e300
"""Stands for an infinite standard deviation in a file [N]."""

Answer = Literal["agrees", "contested", "changed"]
"""A reading agrees with the estimate, contradicts it, or is one of several that contradict it."""


RISEN: Final = 2.0
"""A variance that has risen by this factor has causes of its own, for example a gap of the
encoders: what was taught before no longer counts."""


class Taught(NamedTuple):
    """What a sensor had taught before one of its readings."""

    stamp_ns: int
    correction: float
    """Sum of its corrections of what is expected of its readings until then [N] or [N m]."""
    variance: float
    """Expected variance of the innovation of that reading."""


@dataclass
class Witness:
    """A trusted sensor: its own error that lasts, and its latest corrections."""

    deviation: Vector
    """Its lasting error in every member, less ``error``, shape (members,) [N] or [N m]."""
    error: float = 0.0
    """Estimate of this error [N] or [N m]."""
    share: float = 0.0
    """Standard deviation of the part of this error that is in proportion to the readings so far."""
    history: float = 0.0
    """Standard deviation of changes that follow from its first correction [N] or [N m]."""
    against_effort: bool = False
    """Whether it is a load cell for which ``LONG_WINDOW_NS`` holds."""
    claim: Claim = field(default_factory=Claim)
    """What a load cell has said of its cable's preload."""
    surprise: float = 0.0
    """How far the last reading contradicted the estimate [N] or [N m]."""
    _correction: float = 0.0
    """Sum of the corrections of what is expected of its readings [N] or [N m]."""
    _taught: deque[Taught] = field(default_factory=deque)
    _row: int = 0
    """Contested readings in a row; negative where they are below the estimate."""
    contested: bool = False
    """Whether its last readings contradicted the estimate."""

    @property
    def wrong(self) -> str:
        """Why the sensor is wrong, if its lasting error is certain; else empty."""
        size = root_mean_square(self.deviation)
        if abs(self.error) <= CERTAIN * max(size, self.share, self.history):
            return ""
        ratio = abs(self.error) / size
        return f"off by {self.error:.3g}, {ratio:.1f} standard deviations of that"

    def weigh(self, stamp_ns: int, innovation: float, variance: float, drift: float) -> Answer:
        """Compare a reading with the estimate, and with all estimates of the last second, (U8).

        Args:
            stamp_ns: time of the sample that the reading corrects [ns].
            innovation: reading minus estimate minus ``error``.
            variance: expected variance of the innovation.
            drift: variance per second of the random walk of what is expected.
        """
        own = self.share**2 + self.history**2  # need not be constant
        allowed = variance + own
        self.surprise, square = innovation, innovation**2 / allowed
        taught, window_ns = self._taught, LONG_WINDOW_NS if self.against_effort else WINDOW_NS
        while len(taught) > 1 and stamp_ns - taught[1].stamp_ns >= window_ns:
            taught.popleft()
        if taught and variance > RISEN * min([one.variance for one in taught]):
            taught.clear()
        corrected = innovation + self._correction
        for then, correction, before in taught:
            since = max(stamp_ns - then, 0) * 1e-9
            allowed = before + own + drift * since
            moved = corrected - correction
            if moved * moved > square * allowed:
                self.surprise, square = moved, moved * moved / allowed
        if square <= CONTESTED:
            self._row, self.contested = 0, False
            if not taught or KEPT_IN_WINDOW * (stamp_ns - taught[-1].stamp_ns) >= window_ns:
                taught.append(Taught(stamp_ns, self._correction, variance))
            return "agrees"
        side = 1 if self.surprise > 0.0 else -1
        self._row = side + (self._row if side * self._row > 0 else 0)
        self.contested = square > PLAIN or abs(self._row) > 1
        return "contested" if abs(self._row) < LASTING else "changed"

    def learn(self, change: Vector, error: float, correction: float) -> None:
        """Take part in a correction.

        Args:
            change: of ``deviation`` and ``error`` together in every member, shape (members,).
            error: change of ``error``.
            correction: change of what is expected of its readings.
        """
        self.deviation += change - error
        self.error += error
        self._correction += correction

    def memory(self) -> dict[str, Any]:
        """What it is known by, as JSON; ``recalled`` reads it."""
        claim = self.claim
        return {
            "deviation": self.deviation.tolist(),
            "own": [self.error, self.share, self.history],
            "claim": [claim.first, claim.change, min(claim.stddev, LARGEST), claim.opened],
            "settled": claim.settled,
        }

    @classmethod
    def recalled(cls, memory: Mapping[str, Any], members: int) -> Witness:
        """The sensor of an earlier run, from ``memory``.

        Raises:
            KeyError, TypeError, ValueError: not such a memory.
        """
        deviation = finite(memory["deviation"], members)
        error, share, history = finite(memory["own"], 3).tolist()
        first, change, stddev, opened = finite(memory["claim"], 4).tolist()
        claim = Claim(first, bool(memory["settled"]), change, stddev, opened)
        return cls(deviation, error, share, history, claim=claim)

    def forget(self) -> None:
        """Discard what it has taught; its error remains."""
        self._taught.clear()
        self._row, self.contested = 0, False


def finite(values: Sequence[float], count: int) -> Vector:
    """The values as an array.

    Raises:
        ValueError, TypeError: not ``count`` finite numbers.
    """
    array = np.array(values, dtype=np.float64)
    if array.shape != (count,) or not np.all(np.isfinite(array)):
        raise ValueError(f"not {count} finite numbers")
    return array
