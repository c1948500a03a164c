"""Sensors of a live rig, as in ``sensors.py`` but step by step instead of over a whole run."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot.description import Joint, Motor
from cdrj_ros.simulation.sensors import (
    Encoder,
    LoadCells,
    Schedule,
    read_cells,
    read_encoder,
    schedule,
)

Vector = NDArray[np.float64]

SCHEDULED: Final = 1000
"""Number of readings that are scheduled at once."""

LONGEST_LATENCY_S: Final = 10.0


@dataclass(frozen=True)
class Reading:
    """The content of one message."""

    stamp_s: float
    """Stamp on the rig's clock [s]."""
    values: Vector
    """Values of all axes or channels, shape (n,)."""


class _Due:
    """Times at which a sensor reads, and its readings that have not been sent yet."""

    def __init__(self, sensor: Encoder | LoadCells, seed: Sequence[int], latency_s: float) -> None:
        if not 0.0 <= latency_s <= LONGEST_LATENCY_S:
            raise UsageError(f"latency must be in [0, {LONGEST_LATENCY_S:g}] s, got {latency_s:g}")
        self._sensor = sensor
        self._plans = self._planned(np.random.default_rng(seed))
        self._plan = next(self._plans)
        self._next = 0
        self._latency_s = latency_s
        self._sent: deque[tuple[float, Reading]] = deque()

    def _planned(self, generator: np.random.Generator) -> Iterator[Schedule]:
        """Consecutive schedules of ``SCHEDULED`` readings each."""
        rate = self._sensor.rate
        phase_s = self._sensor.phase_s if isinstance(self._sensor, Encoder) else 0.0
        begin = 0
        while True:
            last = begin + SCHEDULED - 1
            yield schedule(self._sensor, begin / rate, last / rate + phase_s, generator)
            begin += SCHEDULED

    def until(self, now_s: float) -> tuple[Vector, Vector]:
        """Times and stamps of the readings since the last call [s]."""
        times: list[Vector] = []
        stamps: list[Vector] = []
        while True:
            plan = self._plan
            end = self._next
            while end < plan.times.size and plan.times[end] <= now_s:
                end += 1
            times.append(plan.times[self._next : end])
            stamps.append(plan.stamps[self._next : end])
            self._next = end
            if end < plan.times.size:
                break
            self._plan, self._next = next(self._plans), 0
        if len(times) == 1:
            return times[0], stamps[0]
        return np.concatenate(times), np.concatenate(stamps)

    def send(self, time_s: float, reading: Reading) -> None:
        """Queue a reading to be sent."""
        self._sent.append((time_s + self._latency_s, reading))

    def arrived(self, now_s: float) -> list[Reading]:
        """Readings that have arrived."""
        here = []
        while self._sent and self._sent[0][0] <= now_s:
            here.append(self._sent.popleft()[1])
        return here


class LiveEncoders:
    """Encoders of several axes that share electronics and therefore reading times."""

    def __init__(
        self,
        encoder: Encoder,
        axes: Sequence[Motor | Joint],
        seed: Sequence[int],
        latency_s: float = 0.0,
    ) -> None:
        """Start without readings.

        Args:
            encoder: encoder model, the same for every axis.
            axes: motors or joints, in the order of the values.
            seed: seed of the random generator.
            latency_s: time from a reading to its message [s]; the stamp is that of the reading.
        """
        self.axes = tuple(axes)
        self._encoder = encoder
        self._due = _Due(encoder, [*seed, 0], latency_s)
        self._generator = np.random.default_rng([*seed, 1])
        self._before: tuple[float, Vector] | None = None
        self._last: Vector = np.full(len(self.axes), np.nan)
        self._frozen: dict[int, float] = {}

    def freeze(self, name: str) -> bool:
        """Make an axis's encoder repeat its last reading; returns False if there is none yet."""
        index = [axis.name for axis in self.axes].index(name)
        if np.isnan(self._last[index]):
            return False
        self._frozen[index] = float(self._last[index])
        return True

    def thaw(self) -> None:
        """Release all frozen encoders."""
        self._frozen.clear()

    @property
    def frozen(self) -> tuple[str, ...]:
        """Names of the axes whose encoders are frozen."""
        return tuple(self.axes[index].name for index in self._frozen)

    def take(self, now_s: float, angle: Vector) -> list[Reading]:
        """Messages that have arrived by ``now_s``.

        Args:
            now_s: time of the truth, later than in the last call [s].
            angle: angles of the axes [rad], shape (n,).
        """
        time0, angle0 = self._before or (now_s, angle)
        self._before = (now_s, angle.copy())
        times, stamps = self._due.until(now_s)
        if times.size:
            truth_time = np.array([time0, now_s])
            columns = [
                read_encoder(
                    self._encoder, times, truth_time, np.array([angle0[a], angle[a]]),
                    self._generator, axis.sensor,
                )
                for a, axis in enumerate(self.axes)
            ]  # fmt: skip
            for k, time in enumerate(times):
                values = np.array([column[k] for column in columns])
                for index, frozen in self._frozen.items():
                    values[index] = frozen
                self._last = values
                self._due.send(float(time), Reading(float(stamps[k]), values))
        return self._due.arrived(now_s)


class LiveCells:
    """Load cells or torque sensors: several channels that are read together."""

    def __init__(
        self,
        cells: LoadCells,
        noise: float,
        step: float,
        bias: float,
        seed: Sequence[int],
        latency_s: float = 0.0,
    ) -> None:
        """Start without readings.

        Args:
            cells: timing of the readings.
            noise: standard deviation of a reading.
            step: resolution of a reading.
            bias: constant error of the readings.
            seed: seed of the random generator.
            latency_s: time from a reading to its message [s].
        """
        self._noise, self._step, self._bias = noise, step, bias
        self._due = _Due(cells, [*seed, 0], latency_s)
        self._generator = np.random.default_rng([*seed, 1])
        self._before: tuple[float, Vector] | None = None

    def take(self, now_s: float, values: Vector) -> list[Reading]:
        """Messages that have arrived by ``now_s``; arguments as for ``LiveEncoders.take``."""
        time0, before = self._before or (now_s, values)
        self._before = (now_s, values.copy())
        times, stamps = self._due.until(now_s)
        if times.size:
            rows = read_cells(
                np.stack([before, values]), np.array([time0, now_s]), times, self._noise,
                self._step, self._generator, self._bias,
            )  # fmt: skip
            for time, stamp, row in zip(times, stamps, rows, strict=True):
                self._due.send(float(time), Reading(float(stamp), row))
        return self._due.arrived(now_s)
