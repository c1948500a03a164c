"""Measured tensions and efforts: what they measure, and when they are compared with estimates.

Measurements wait for the sample with which they are compared.  Those that arrive late are compared
with the estimates of the last moments, which include the corrections made since then; otherwise
late measurements would apply the same correction repeatedly.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot, Winch

HISTORY_NS: Final = 200_000_000
"""Maximum age of a measurement [ns]."""

KEPT: Final = 5_000
"""Maximum number of past estimates."""

EFFORT_INTERVAL_NS: Final = 50_000_000
"""Minimum interval between used efforts of a motor [ns]: their errors are correlated over time."""

MOST: Final = 10_000
"""Most measurements that wait: without angles no sample comes to use them."""

SMALLEST_NOISE: Final = 1e-6
LARGEST_NOISE: Final = 1e6
"""Outside these limits a load cell's standard deviation is replaced by the robot file's [N]."""

AHEAD_NS: Final = 5 * HISTORY_NS
"""Measurements further ahead of the samples are discarded [ns]."""


class Quantity(NamedTuple):
    """The quantity that a sensor measures: the tension of an element, or a motor's effort."""

    column: int
    """Its index in ``stddev_columns``."""
    cables: list[int]
    """The cables that a reading of it corrects."""
    others: NDArray[np.int64]
    """The columns that it does not correct: those of other cables, but no efforts."""
    motor: int = -1
    """Index of the motor whose effort it is; -1 for a tension."""

    @property
    def is_effort(self) -> bool:
        """Whether it is a motor's effort."""
        return self.motor >= 0


def quantities_of(model: Model) -> dict[str, Quantity]:
    """The quantities by the names of their sensors: ``cable/element``, or a motor."""
    layout, robot = model.layout, model.robot
    columns = [name.rsplit("/", 1)[0] for name in (*layout.elements, *layout.pulleys)]
    cables = [layout.cables.index(name) for name in columns]

    def others(own: list[int]) -> NDArray[np.int64]:
        return np.flatnonzero(~np.isin(cables, own))

    found = {
        name: Quantity(k, [cables[k]], others([cables[k]]))
        for k, name in enumerate(layout.elements)
    }
    first_motor = len(layout.elements) + len(layout.pulleys)
    for k, motor in enumerate(layout.motors):
        own = [
            c
            for c, cable in enumerate(robot.cables)
            if any(isinstance(node, Winch) and node.motor == motor for node in cable.nodes)
        ]
        found[motor] = Quantity(first_motor + k, own, others(own), k)
    return found


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
    """The readings of a robot's sensors that wait for a sample, in the order of arrival."""

    def __init__(
        self, robot: Robot, quantities: Mapping[str, Quantity], *, takes_efforts: bool
    ) -> None:
        """Begin empty.

        Args:
            robot: with the noise of load cells and efforts and the clock offsets of motors; may be
                replaced by one with other numbers.
            quantities: what the sensors measure, by name.
            takes_efforts: whether efforts of motors are used.
        """
        self.robot = robot
        self._quantities, self._takes_efforts = quantities, takes_efforts
        self.unknown_elements = 0
        """Load cell readings of elements that the robot does not have."""
        self.overlooked = 0
        """Measurements discarded because no sample reached their stamp."""
        self._waiting: list[Measurement] = []
        self._efforts_ns: dict[str, int] = {}
        """Stamp of every motor's last effort [ns]."""

    def forget(self) -> None:
        """Discard all, as overlooked, and when efforts were measured."""
        self.overlooked += len(self._waiting)
        self.clear()
        self._efforts_ns.clear()

    def clear(self) -> None:
        """Discard all that wait, without counting them."""
        self._waiting.clear()

    def feed_tensions(
        self,
        stamp_ns: int,
        names: Sequence[str],
        tensions: Sequence[float] | Vector,
        stddevs: Sequence[float] | Vector,
    ) -> None:
        """Queue a message of load cells, see ``LiveEstimator.feed_tensions``."""
        for k, name in enumerate(names):
            what = self._quantities.get(name)
            if what is None or what.is_effort:
                self.unknown_elements += 1
                continue
            noise = float(stddevs[k]) if len(stddevs) else 0.0
            if not SMALLEST_NOISE <= noise <= LARGEST_NOISE:
                noise = self.robot.cables[what.cables[0]].sensor_noise
            self._add(Measurement(stamp_ns, name, float(tensions[k]), noise))

    def feed_efforts(
        self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float] | Vector
    ) -> None:
        """Queue measured efforts of motors [N m]; other names are ignored."""
        if not self._takes_efforts:
            return
        for name, effort in zip(names, efforts):  # noqa: B905 fewer efforts than names: none
            what = self._quantities.get(name)
            if what is not None and what.is_effort and not self._is_early(name, stamp_ns):
                motor = self.robot.motors[what.motor]
                at = stamp_ns + motor.sensor.clock_offset_ns
                self._add(Measurement(at, name, float(effort), motor.effort_noise))

    def wants_efforts(self, stamp_ns: int) -> bool:
        """Whether efforts of this stamp [ns] would be used for any motor, see ``feed_efforts``."""
        used = self._efforts_ns.values()
        return self._takes_efforts and (
            len(used) < len(self.robot.motors)
            or any(abs(stamp_ns - last) >= EFFORT_INTERVAL_NS for last in used)
        )

    def _add(self, measurement: Measurement) -> None:
        """Queue a measurement."""
        if len(self._waiting) >= MOST:
            del self._waiting[: MOST // 2]
            self.overlooked += MOST // 2
        self._waiting.append(measurement)

    def _is_early(self, motor: str, stamp_ns: int) -> bool:
        """Whether a motor's effort follows the last one too soon; notes its stamp [ns] if not."""
        last = self._efforts_ns.get(motor)
        if last is not None and abs(stamp_ns - last) < EFFORT_INTERVAL_NS:
            return True
        self._efforts_ns[motor] = stamp_ns
        return False

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


class _Past(NamedTuple):
    """The estimate of one sample."""

    stamp_ns: int
    values: Vector
    """The estimate, see ``Estimate.values``."""
    uncorrected: Vector
    """What it would be without corrections by other sensors."""
    corrected: Vector
    """The total correction of each column until then."""
    direction: Sequence[float]
    """Effort per unit of friction of every motor [-], see ``MotorFriction.turn``."""


class Expected(NamedTuple):
    """What is expected of a measurement."""

    value: float
    """By the estimate [N] or [N m]."""
    uncorrected: float
    """By the model alone, without corrections by other sensors."""
    direction: float
    """Change of ``value`` per unit of the motor's friction [-]; 0 for a load cell."""
    change: float
    """By how much the estimate has changed since the time of the measurement [N] or [N m]."""


class PastEstimates:
    """The estimates of the last ``HISTORY_NS``, and the corrections of them all."""

    def __init__(self, columns: NDArray[np.int64]) -> None:
        """Begin without estimates.

        Args:
            columns: of the quantities in an estimate, see ``stddev_columns``.
        """
        self._columns = columns
        self._history: deque[_Past] = deque(maxlen=KEPT)
        self.corrected = np.zeros(columns.size)
        """The total correction of each column until now."""

    def forget(self) -> None:
        """Forget all estimates and corrections."""
        self._history.clear()
        self.corrected = np.zeros(self._columns.size)

    def add(
        self, stamp_ns: int, values: Vector, uncorrected: Vector, direction: Sequence[float]
    ) -> None:
        """Add the estimate of a sample.

        Args:
            stamp_ns: of the sample [ns].
            values: the estimate, see ``Estimate.values``.
            uncorrected: what it would be without corrections by other sensors.
            direction: see ``MotorFriction.turn``.
        """
        history = self._history
        history.append(_Past(stamp_ns, values, uncorrected, self.corrected, direction))
        while stamp_ns - history[0].stamp_ns > HISTORY_NS:
            history.popleft()

    @property
    def last(self) -> Vector:
        """The last estimate, see ``Estimate.values``."""
        return self._history[-1].values

    def expected(self, stamp_ns: int, column: int, motor: int) -> Expected | None:
        """The current estimate for the time of a measurement; None outside the stored history.

        Args:
            stamp_ns: time of the measurement [ns].
            column: of the measured quantity.
            motor: index of the motor whose effort it is; -1 for a load cell.
        """
        history, index = self._history, int(self._columns[column])
        if not history or not history[0].stamp_ns <= stamp_ns <= history[-1].stamp_ns:
            return None

        corrected = float(self.corrected[column])

        def then(past: _Past) -> tuple[float, float, float]:
            value = float(past.values[index]) + (corrected - float(past.corrected[column]))
            direction = past.direction[motor] if motor >= 0 else 0.0
            return value, float(past.uncorrected[index]), direction

        k = len(history) - 1
        while k > 0 and history[k - 1].stamp_ns >= stamp_ns:
            k -= 1
        now, _, _ = then(history[-1])
        after = history[k]
        value, uncorrected, direction = then(after)
        if after.stamp_ns != stamp_ns and k > 0:
            before = history[k - 1]
            share = (after.stamp_ns - stamp_ns) / (after.stamp_ns - before.stamp_ns)
            value_before, uncorrected_before, direction_before = then(before)
            value += share * (value_before - value)
            uncorrected += share * (uncorrected_before - uncorrected)
            direction += share * (direction_before - direction)
        return Expected(value, uncorrected, direction, now - value)
