"""What the sensors of a recording say about the robot.

A live estimator hears the recorded samples and readings in their order, as the node would.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.estimation.group import JUDGED_NS, TICK_NS
from cdrj_ros.estimation.sensors import LEAST_NS
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.estimation.verdict_words import Level, Report
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.model.prepared import Model


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


@dataclass(frozen=True)
class Verdict:
    """What was found in a recording."""

    level: Level
    """The gravest of all."""
    message: str
    """The last words."""
    sensors: tuple[str, ...]
    """Motors and elements whose readings were used."""
    alarms: tuple[Alarm, ...]
    """In the order of time."""
    values: Mapping[str, str]
    """The last figures, by name."""


class RecordedVerdict:
    """Follows recorded samples and readings, piece by piece."""

    def __init__(
        self, model: Model, efforts: Mapping[str, Series], cells: Mapping[str, Series]
    ) -> None:
        """Prepare.

        Args:
            model: the prepared robot.
            efforts: of the motors by name [N m].
            cells: tensions by element [N]; their noise is that of the cable in the robot file.
        """
        self._live = LiveEstimator(model)
        self._sensors = (*efforts, *cells)
        self._readings = _in_time({**efforts, **cells})
        self._next = 0
        self._begin_ns = self._taken_ns = -1
        self._noted_ns = 0
        self._alarms: list[Alarm] = []
        self._report = Report("ok", "too few readings of sensors", {})

    def follow(self, samples: Samples) -> None:
        """Follow consecutive samples of the estimator."""
        k, stamps = 0, samples.stamp_ns
        while True:
            if self._taken_ns >= 0:
                k = int(np.searchsorted(stamps, self._taken_ns + TICK_NS))
            if k >= stamps.size:
                return
            self._taken_ns = int(stamps[k])
            if self._begin_ns < 0:
                self._begin_ns = self._taken_ns
            self._feed()
            self._live.take(samples.alone(k))
            if self._taken_ns - self._noted_ns >= JUDGED_NS:
                self._note()

    def _feed(self) -> None:
        """Queue the readings up to the present sample."""
        first = self._next
        while self._next < len(self._readings) and (
            self._readings[self._next][0] <= self._taken_ns
        ):
            self._next += 1
        for stamp_ns, name, value in self._readings[first : self._next]:
            self._live.readings.feed(stamp_ns, (name,), (value,))

    def _note(self) -> None:
        """Keep a verdict that stands, in its latest words."""
        self._noted_ns = self._taken_ns
        found = self._live.report()
        if found is None:
            return
        now = (self._taken_ns - self._begin_ns) * 1e-9
        before, self._report = self._report, found
        if found.level == "ok":
            return
        if before.level != "ok" and before.named == found.named:
            self._alarms[-1] = replace(self._alarms[-1], message=found.message, end_s=now)
        else:
            self._alarms.append(Alarm(found.level, found.message, now, now))

    def verdict(self) -> Verdict:
        """What was found so far."""
        self._note()
        levels = [self._report.level, *(one.level for one in self._alarms)]
        worst = max(levels, key=("ok", "warn", "error").index)
        return Verdict(
            worst, self._report.message, self._sensors, tuple(self._alarms), self._report.values
        )


def _in_time(given: Mapping[str, Series]) -> list[tuple[int, str, float]]:
    """Readings of all sensors in the order of time, as often as they are used."""
    found = []
    for name, series in given.items():
        k, stamps = 0, series.stamp_ns
        while k < stamps.size:
            stamp = int(stamps[k])
            found.append((stamp, name, float(series.value[k])))
            k = max(k + 1, int(np.searchsorted(stamps, stamp + LEAST_NS)))
    return sorted(found, key=lambda one: one[0])
