"""The innovation gate of a trusted sensor, and its evidence about a preload.

A sudden change of a sensor's readings that the encoders do not explain is a fault of the sensor or
a change of the preload.  The readings of that sensor alone cannot tell which, so both stay
possible: the ensemble gives a part of the change to the sensor's own error and a part to the
preload, until other sensors decide (docs/uncertainty.md).

A cell that drifts and a preload that creeps look the same to that cell.  Its most certain evidence
is therefore kept.  What it says otherwise later is left open between both, without a change of what
is expected of its readings: only another sensor can decide (docs/uncertainty.md).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, sqrt
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from cdrj_ros.estimation.lasting_error import LastingError
from cdrj_ros.foundation.arrays import Vector

GATE: Final = 9.0
"""A reading fails the gate if its squared innovation exceeds this multiple of its variance."""

PLAIN: Final = 16.0
"""Beyond this multiple one reading shows a contradiction; up to it, two in a row do."""

LASTING: Final = 5
"""So many failures in a row, all on the same side, are taken for a real change."""

WINDOW_NS: Final = 1_000_000_000
"""A reading is compared with what the estimate would be without the latest corrections of the same
sensor, over all times up to this [ns]: otherwise a wrong sensor is followed in small steps."""

LONG_WINDOW_NS: Final = 5_000_000_000
"""The same for the only load cell of a cable whose motor's effort is measured, too [ns]: the effort
decides whether a slow change is one of the preload or of the cell.  Over such a time the errors of
a good cell add up as well, so that it takes another sensor to doubt it."""

KEPT_IN_WINDOW: Final = 50
"""Most corrections that are kept for this comparison, evenly spaced in time."""

LARGEST: Final = 1e300
"""Stands for an infinite standard deviation in a file [N]."""

RISEN: Final = 2.0
"""A variance that has risen by this factor has causes of its own, for example a gap of the
encoders: earlier corrections no longer count."""

EITHER: Final = 0.5
"""Share of the square of a change that is left open: the change is one of the cell or one of the
preload, and each is as likely."""

HISTORY_ERROR: Final = 0.05
"""Standard deviation of what follows from a sensor's first correction, as a fraction of it: the
friction history was formed at another preload."""

UNSETTLED: Final = 0.2
"""The same until the cell has followed a motion to and fro since then: the cable on the drum and
most of the friction belong to another preload until then."""

FILE_ERROR: Final = 0.05
"""Standard deviation of the first statement about a preload, that of the robot file, as a fraction
of it: where a sensor says otherwise, either may be wrong."""

CLEARER: Final = 0.7
"""A statement about a preload replaces an earlier one if its standard deviation is smaller by this
factor: if every smaller one did, a slow drift would take the evidence along."""

Gated = Literal["agrees", "contradicts", "changed"]
"""A reading agrees with the estimate, contradicts it, or is one of several that contradict it."""


@dataclass
class PreloadEvidence:
    """The most certain statement about a preload: the file's, or what readings have led to."""

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

    def follow(self, uncorrected: float, enough: float) -> None:
        """Follow the motion until the evidence has settled.

        Args:
            uncorrected: estimate at the cell without corrections [N].
            enough: how far it must rise and fall [N].
        """
        if self.settled:
            return
        self._least, self._most = min(self._least, uncorrected), max(self._most, uncorrected)
        self._rise = max(self._rise, uncorrected - self._least)
        self._fall = max(self._fall, self._most - uncorrected)
        if min(self._rise, self._fall) > enough:
            self.settled = True
            self.renew()

    def renew(self) -> None:
        """Forget the evidence so far: from now on something else holds."""
        self.stddev, self.opened = inf, 0.0

    def contradicted(self, change: float, stddev: float) -> float:
        """How much further to open the preload and the cell's error, since they say otherwise now.

        Args:
            change: sum of the corrections of the preload until now [N].
            stddev: standard deviation of the preload now [N].

        Returns:
            The standard deviation to add [N]; 0 where the statements agree.
        """
        error = (HISTORY_ERROR if self.settled else UNSETTLED) * self.first
        beyond = (change - self.change) ** 2 - self.stddev**2 - error**2
        if beyond <= 0.0 and stddev < CLEARER * self.stddev:
            self.change, self.stddev, self.opened = change, stddev, 0.0
        more = EITHER * beyond - self.opened**2
        if more <= 0.0:
            return 0.0
        self.opened = sqrt(EITHER * beyond)
        return sqrt(more)


class Baseline(NamedTuple):
    """What a sensor had corrected before one of its readings."""

    stamp_ns: int
    correction: float
    """Sum of its corrections of what is expected of its readings until then [N] or [N m]."""
    variance: float
    """Expected variance of the innovation of that reading."""


@dataclass
class SensorState:
    """A trusted sensor: its own error that lasts, and its latest corrections."""

    errors: LastingError
    """Its bias, gain and friction."""
    model_error: float = 0.0
    """Standard deviation of what the model leaves out, in proportion to the largest reading so far
    [N] or [N m]."""
    history_error: float = 0.0
    """Standard deviation of changes that follow from its first correction [N] or [N m]."""
    checked_by_effort: bool = False
    """Whether it is a load cell for which ``LONG_WINDOW_NS`` holds."""
    evidence: PreloadEvidence = field(default_factory=PreloadEvidence)
    """What it says of the preloads."""
    contradiction: float = 0.0
    """How far the last reading contradicted the estimate [N] or [N m]."""
    _correction: float = 0.0
    """Sum of the corrections of what is expected of its readings [N] or [N m]."""
    _baselines: deque[Baseline] = field(default_factory=deque)
    _in_a_row: int = 0
    """Readings in a row that fail the gate; negative where they are below the estimate."""
    _doubted: float = inf
    """Least variance of their innovations; infinite without any."""
    contradicts: bool = False
    """Whether its last readings contradicted the estimate."""

    def gate(self, stamp_ns: int, innovation: float, variance: float, drift: float) -> Gated:
        """Compare a reading with the estimate, and with all estimates of the last second, (U8).

        Args:
            stamp_ns: time of the sample that the reading corrects [ns].
            innovation: reading minus estimate minus its lasting error.
            variance: expected variance of the innovation.
            drift: variance per second of the random walk of what is expected.
        """
        own = self.model_error**2 + self.history_error**2  # need not be constant
        # an estimate that has become less certain since does not refute what contradicted it
        certain = min(variance, self._doubted) + own
        self.contradiction, square = innovation, innovation**2 / certain
        baselines = self._baselines
        window_ns = LONG_WINDOW_NS if self.checked_by_effort else WINDOW_NS
        while len(baselines) > 1 and stamp_ns - baselines[1].stamp_ns >= window_ns:
            baselines.popleft()
        if baselines and variance > RISEN * min([one.variance for one in baselines]):
            baselines.clear()
        corrected = innovation + self._correction
        for then, correction, before in baselines:
            since = max(stamp_ns - then, 0) * 1e-9
            allowed = before + own + drift * since
            moved = corrected - correction
            if moved * moved > square * allowed:
                self.contradiction, square = moved, moved * moved / allowed
        if square <= GATE:
            self._in_a_row, self.contradicts, self._doubted = 0, False, inf
            if not baselines or KEPT_IN_WINDOW * (stamp_ns - baselines[-1].stamp_ns) >= window_ns:
                baselines.append(Baseline(stamp_ns, self._correction, variance))
            return "agrees"
        side = 1 if self.contradiction > 0.0 else -1
        self._in_a_row = side + (self._in_a_row if side * self._in_a_row > 0 else 0)
        self._doubted = min(self._doubted, variance)
        self.contradicts = square > PLAIN or abs(self._in_a_row) > 1
        return "contradicts" if abs(self._in_a_row) < LASTING else "changed"

    def note(self, correction: float) -> None:
        """Note a change of what is expected of its readings, by one of them [N] or [N m]."""
        self._correction += correction

    def memory(self) -> dict[str, Any]:
        """What it is known by, as JSON; ``recalled`` reads it."""
        evidence = self.evidence
        return {
            "errors": self.errors.memory(),
            "own": [self.model_error, self.history_error],
            "evidence": [
                evidence.first,
                evidence.change,
                min(evidence.stddev, LARGEST),
                evidence.opened,
            ],
            "settled": evidence.settled,
        }

    @classmethod
    def recalled(cls, memory: Mapping[str, Any], members: int) -> SensorState:
        """The sensor of an earlier run, from ``memory``.

        Raises:
            KeyError, TypeError, ValueError: not such a memory.
        """
        errors = LastingError.recalled(memory["errors"], members)
        model_error, history = finite(memory["own"], 2).tolist()
        first, change, stddev, opened = finite(memory["evidence"], 4).tolist()
        evidence = PreloadEvidence(first, bool(memory["settled"]), change, stddev, opened)
        return cls(errors, model_error, history, evidence=evidence)

    def forget(self) -> None:
        """Discard the latest corrections; its error remains."""
        self._baselines.clear()
        self._in_a_row, self.contradicts, self._doubted = 0, False, inf


def finite(values: Sequence[float], count: int) -> Vector:
    """The values as an array.

    Raises:
        ValueError, TypeError: not ``count`` finite numbers.
    """
    array = np.array(values, dtype=np.float64)
    if array.shape != (count,) or not np.all(np.isfinite(array)):
        raise ValueError(f"not {count} finite numbers")
    return array
