"""Measurements that wait for the sample with which they are compared."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from cdrj_ros.estimation.past import HISTORY_NS

EFFORT_INTERVAL_NS: Final = 50_000_000
"""Minimum interval between used efforts of a motor [ns]: their errors are correlated over time."""

MOST: Final = 10_000
"""Most measurements that wait: without angles no sample comes to use them."""

AHEAD_NS: Final = 5 * HISTORY_NS
"""Measurements further ahead of the samples are discarded [ns]."""


class Measurement(NamedTuple):
    """A reading of a load cell or of a motor's effort."""

    stamp_ns: int
    name: str
    """``cable/element``, or a motor."""
    value: float
    """[N] or [N m]."""
    noise: float
    """Standard deviation [N] or [N m]."""


class WaitingMeasurements:
    """A queue in the order of arrival."""

    def __init__(self) -> None:
        """Begin empty."""
        self.overlooked = 0
        """Measurements discarded because no sample reached their stamp."""
        self._waiting: list[Measurement] = []
        self._efforts_ns: dict[str, int] = {}
        """Stamp of every motor's last effort [ns]."""

    def __bool__(self) -> bool:
        """Whether any measurement waits."""
        return bool(self._waiting)

    def forget(self) -> None:
        """Discard all, as overlooked, and when efforts were measured."""
        self.overlooked += len(self._waiting)
        self.clear()
        self._efforts_ns.clear()

    def clear(self) -> None:
        """Discard all that wait, without counting them."""
        self._waiting.clear()

    def add(self, measurement: Measurement) -> None:
        """Queue a measurement."""
        if len(self._waiting) >= MOST:
            del self._waiting[: MOST // 2]
            self.overlooked += MOST // 2
        self._waiting.append(measurement)

    def is_early(self, motor: str, stamp_ns: int) -> bool:
        """Whether a motor's effort follows the last one too soon; notes its stamp [ns] if not."""
        last = self._efforts_ns.get(motor)
        if last is not None and abs(stamp_ns - last) < EFFORT_INTERVAL_NS:
            return True
        self._efforts_ns[motor] = stamp_ns
        return False

    def wants_efforts(self, stamp_ns: int, motors: int) -> bool:
        """Whether efforts of this stamp [ns] would be used for any of so many motors."""
        used = self._efforts_ns.values()
        return len(used) < motors or any(
            abs(stamp_ns - last) >= EFFORT_INTERVAL_NS for last in used
        )

    def due(self, stamp_ns: int) -> Iterator[Measurement]:
        """Take the measurements up to a sample's stamp [ns] out of the queue, one by one."""
        waiting, self._waiting = self._waiting, []
        for one in waiting:
            if one.stamp_ns <= stamp_ns:
                yield one
            elif one.stamp_ns - stamp_ns <= AHEAD_NS:
                self._waiting.append(one)
            else:
                self.overlooked += 1
