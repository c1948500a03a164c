"""The health monitor over a recording.

The monitor is the node's, and it gets the same samples and readings in the same order.  Only those
samples are passed on that its models would take.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.estimation.health_evaluation import Evaluation
from cdrj_ros.estimation.health_monitor import LEAST_NS, TICK_NS, HealthMonitor
from cdrj_ros.estimation.health_verdict import Level
from cdrj_ros.foundation.arrays import Series, Table
from cdrj_ros.model.prepared import Model

ASKED_NS: Final = 1_000_000_000
"""Time between two looks for a broken cable, as in the node [ns]."""


@dataclass(frozen=True)
class Alarm:
    """One verdict other than agreement, for as long as it stood."""

    level: Level
    message: str
    """The last words while it stood."""
    begin_s: float
    """When it began to stand, from the first sample [s]."""
    end_s: float
    """When it ended, or the last sample [s]."""
    first_cycle: int
    """Cycle at whose end it began to stand; the first cycle evaluated is 1."""
    last_cycle: int
    """Last cycle evaluated while it stood."""


@dataclass(frozen=True)
class Verdict:
    """What the monitor found in a recording."""

    level: Level
    """The gravest of all."""
    message: str
    """The last words of the monitor."""
    cycles: int
    """Cycles that were compared."""
    sensors: tuple[str, ...]
    """Motors and elements whose readings were compared."""
    alarms: tuple[Alarm, ...]
    """In the order of time."""
    values: Mapping[str, str]
    """The monitor's last figures, by name."""


class RecordedHealth:
    """Lets the monitor follow recorded samples, piece by piece."""

    def __init__(self, model: Model, sensors: Sequence[str]) -> None:
        """Prepare all models.

        Args:
            model: the prepared robot.
            sensors: motors and elements that have readings.
        """
        self._monitor = HealthMonitor(model, model.robot.uncertainty)
        self._monitor.prepare()
        self._begin_ns = self._now_ns = self._taken_ns = self._asked_ns = 0
        self._alarms: list[Alarm] = []
        self._standing: Evaluation | None = None
        self._sensors = tuple(sensors)
        self.begin_pass({}, {})

    def begin_pass(self, efforts: Mapping[str, Series], cells: Mapping[str, Series]) -> None:
        """Begin a pass of the recording.

        Args:
            efforts: of the motors by name [N m].
            cells: tensions by element [N]; their noise is that of the cable in the robot file.
        """
        self._readings = _Readings(efforts, cells)
        self._first = True

    def follow(self, samples: Samples, stddev: Table | None) -> None:
        """Follow consecutive samples.

        Args:
            samples: of the estimator.
            stddev: of its estimates, in the order of ``stddev_columns``, shape (n, columns); None:
                zero.
        """
        stamps, k = samples.stamp_ns, 0
        while True:
            if not self._first:
                k = int(np.searchsorted(stamps, self._taken_ns + TICK_NS))
            if k >= stamps.size:
                return
            self._take(samples, k, None if stddev is None else stddev[k])

    def verdict(self) -> Verdict:
        """What was found so far."""
        last = self._monitor.report()
        self._note()
        levels: list[Level] = [one.level for one in self._alarms]
        worst: Level = "error" if "error" in levels else "warn" if levels else last.level
        return Verdict(
            worst, last.message, self._monitor.cycles, self._sensors, tuple(self._alarms),
            last.values,
        )  # fmt: skip

    def _take(self, samples: Samples, k: int, spread: Table | None) -> None:
        sample = samples.at(k)
        if self._first and not self._begin_ns:
            self._begin_ns = self._asked_ns = sample.stamp_ns
        self._first = False
        self._taken_ns = sample.stamp_ns
        self._now_ns = max(self._now_ns, sample.stamp_ns)
        for stamp_ns, name, value, is_effort in self._readings.until(sample.stamp_ns):
            if is_effort:
                self._monitor.read_efforts(stamp_ns, (name,), (value,))
            else:
                self._monitor.read_tensions(stamp_ns, (name,), (value,))
        self._monitor.follow(sample, spread)
        if not 0 <= sample.stamp_ns - self._asked_ns < ASKED_NS:
            self._asked_ns = sample.stamp_ns
            self._monitor.report()
        self._note()

    def _note(self) -> None:
        """Keep a verdict that stands, in its latest words."""
        standing = self._monitor.standing
        if standing is None or standing is self._standing:
            if standing is None:
                self._standing = None
            elif self._alarms:
                self._alarms[-1] = replace(
                    self._alarms[-1], end_s=self._now_s, last_cycle=self._monitor.cycles
                )
            return
        words = self._monitor.report()
        now, cycle = self._now_s, self._monitor.cycles
        before = self._standing
        if before is not None and (before.explained, before.named) == (
            standing.explained,
            standing.named,
        ):
            self._alarms[-1] = replace(
                self._alarms[-1], message=words.message, end_s=now, last_cycle=cycle
            )
        else:
            self._alarms.append(Alarm(words.level, words.message, now, now, cycle, cycle))
        self._standing = standing

    @property
    def _now_s(self) -> float:
        return (self._now_ns - self._begin_ns) * 1e-9


class _Readings:
    """Readings of all sensors in the order of time, as often as the monitor uses them."""

    def __init__(self, efforts: Mapping[str, Series], cells: Mapping[str, Series]) -> None:
        self._all: list[tuple[int, str, float, bool]] = []
        for given, is_effort in ((efforts, True), (cells, False)):
            for name, series in given.items():
                k, stamps = 0, series.stamp_ns
                while k < stamps.size:
                    stamp = int(stamps[k])
                    self._all.append((stamp, name, float(series.value[k]), is_effort))
                    k = max(k + 1, int(np.searchsorted(stamps, stamp + LEAST_NS)))
        self._all.sort(key=lambda one: one[0])
        self._next = 0

    def until(self, stamp_ns: int) -> list[tuple[int, str, float, bool]]:
        """The readings up to a stamp that were not returned before."""
        begin = self._next
        while self._next < len(self._all) and self._all[self._next][0] <= stamp_ns:
            self._next += 1
        return self._all[begin : self._next]
