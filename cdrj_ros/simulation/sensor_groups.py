"""Sensors that read a truth as it comes: a whole simulation at once, or step by step.

Both ways give the same readings, because random numbers are drawn reading by reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model
from cdrj_ros.simulation.sensors import (
    JOINT_ENCODER,
    LOAD_CELLS,
    MOTOR_ENCODER,
    Encoder,
    LoadCells,
    ReadingTimes,
    Sampling,
    Schedule,
    counted,
    measured,
)

Kind = Literal["motors", "joints", "all"]
"""Whose readings a message has; all of them, with velocities, under ros2_control."""


@dataclass(frozen=True)
class Freeze:
    """The fault of an encoder that repeats its last reading."""

    name: str
    """Motor or joint."""
    begin: float
    """Start of the fault [s]."""


@dataclass(frozen=True)
class SensorSettings:
    """All sensors of a robot, and their faults."""

    motors: Encoder = MOTOR_ENCODER
    joints: Encoder = JOINT_ENCODER
    effort_noise: float | None = None
    """Standard deviation of the efforts beside the motors' angles [N m]; None: none are read."""
    elements: tuple[str, ...] = ()
    """Elements with a load cell."""
    load_cells: LoadCells = LOAD_CELLS
    references: LoadCells = LOAD_CELLS
    """Sensors with which a bag's references are measured."""
    update_rate: float | None = None
    """Rate of messages with motors and joints together, as ros2_control's joint_state_broadcaster
    publishes them [Hz]; None: motors and joints have messages of their own."""
    freezes: tuple[Freeze, ...] = ()


IDEAL_SENSORS = SensorSettings()


def truth_table(position: Table, velocity: Table, effort: Table, tension: Table) -> Table:
    """What sensors may read, a row per time.

    Args:
        position: angles of all motors, then all joints [rad], shape (n, axes).
        velocity: [rad/s], shape (n, axes).
        effort: of the cables [N m], shape (n, axes).
        tension: of all elements [N], shape (n, elements).
    """
    return np.concatenate([position, velocity, effort, tension], axis=1)


class Messages(NamedTuple):
    """The content of messages, a row for each."""

    stamps: Vector
    """[s], shape (n,)."""
    position: Table
    """Readings of encoders, shape (n, axes)."""
    velocity: Table | None = None
    """Change of the readings [1/s]; None: not read."""
    effort: Table | None = None
    """Efforts in the unit of publication, not a number for axes without a drive; None: not read."""


class _Sampler:
    """Columns of the truth at the times at which a sensor reads."""

    def __init__(self, sensor: Sampling, columns: Sequence[int], seed: Sequence[int]) -> None:
        self._times = ReadingTimes(sensor, seed)
        self._columns = list(columns)
        self._before: tuple[Vector, Table] | None = None

    def take(self, time: Vector, truth: Table) -> tuple[Schedule, Table]:
        """The readings until the last of the times, and the columns then, shape (m, columns)."""
        plan = self._times.until(float(time[-1]))
        found = np.empty((plan.times.size, len(self._columns)))
        if plan.times.size:
            known, rows = time, truth[:, self._columns]
            if self._before is not None and plan.times[0] < time[0]:
                known = np.concatenate([self._before[0], time])
                rows = np.concatenate([self._before[1][:, self._columns], rows])
            for k in range(len(self._columns)):
                found[:, k] = np.interp(plan.times, known, rows[:, k])
        self._before = (time[-1:], truth[-1:])
        return plan, found


class EncoderGroup:
    """Encoders that share electronics, and therefore reading times and messages."""

    def __init__(
        self,
        model: Model,
        columns: Sequence[int],
        settings: SensorSettings,
        seed: Sequence[int],
    ) -> None:
        """Start without readings.

        Args:
            model: the robot.
            columns: indices of the group's axes among all motors, then all joints.
            settings: the sensors.
            seed: seed of the random generators.
        """
        axes, motors = model.robot.axes, len(model.robot.motors)
        self.axes = tuple(axes[k] for k in columns)
        self.names = tuple(axis.name for axis in self.axes)
        self.clock_offset_ns = self.axes[0].sensor.clock_offset_ns
        self._driven = np.array([k < motors for k in columns])
        self._encoders = [settings.motors if driven else settings.joints for driven in self._driven]
        timing = self._encoders[0]
        self.kind: Kind = "motors" if self._driven[0] else "joints"
        if settings.update_rate is not None:
            self.kind = "all"
            timing = replace(timing, rate=settings.update_rate, phase=0.0)
        self.latency = timing.latency
        self._effort_noise = settings.effort_noise if self._driven.any() else None
        self._scale = np.array([axis.sensor.scale for axis in self.axes])
        self._effort_scale = np.array([axis.effort_scale for axis in self.axes])
        self._noise = np.array([encoder.noise for encoder in self._encoders])
        wanted = [
            column + k * len(axes)
            for k, field in enumerate(("position", "velocity", "effort"))
            if field in self.fields
            for column in columns
        ]
        self._sampler = _Sampler(timing, wanted, [*seed, 0])
        self._errors = np.random.default_rng([*seed, 1])
        self._effort_errors = np.random.default_rng([*seed, 2])
        self._last: Vector = np.full(len(self.axes), np.nan)
        none, fields = np.empty((0, len(self.axes))), self.fields
        self._nothing = Messages(
            np.empty(0),
            none,
            none if "velocity" in fields else None,
            none if "effort" in fields else None,
        )
        self._planned = {
            self.names.index(fault.name): fault.begin
            for fault in settings.freezes
            if fault.name in self.names
        }
        self.restart(0.0)

    @property
    def fields(self) -> tuple[str, ...]:
        """The fields of ``Messages`` that the group fills, besides the stamps."""
        velocity = ("velocity",) if self.kind == "all" else ()
        effort = () if self._effort_noise is None else ("effort",)
        return ("position", *velocity, *effort)

    def freeze(self, name: str, begin: float) -> None:
        """Let an encoder repeat its last reading from a time on [s]."""
        self._frozen[self.names.index(name)] = begin

    def restart(self, begin: float) -> None:
        """End all faults; those of the settings happen at their times after ``begin`` [s]."""
        self._frozen = {axis: begin + after for axis, after in self._planned.items()}

    def frozen(self, now: float) -> tuple[str, ...]:
        """Names of the axes whose encoders are frozen at a time [s]."""
        return tuple(self.names[k] for k, begin in self._frozen.items() if begin <= now)

    def take(self, time: Vector, truth: Table) -> Messages:
        """The messages of readings since the last call.

        Args:
            time: times of the truth, later than in the last call [s], shape (n,).
            truth: of ``truth_table``.
        """
        plan, found = self._sampler.take(time, truth)
        if not plan.times.size:
            return self._nothing
        count = len(self.axes)
        position = self._positions(plan.times, found[:, :count])
        velocity = found[:, count : 2 * count] / self._scale if self.kind == "all" else None
        if self._effort_noise is None:
            return Messages(plan.stamps, position, velocity)
        effort = self._efforts(found[:, -count:], self._effort_noise)
        return Messages(plan.stamps, position, velocity, effort)

    def _positions(self, times: Vector, angle: Table) -> Table:
        errors = np.zeros(angle.shape)
        if self._noise.any():
            errors = self._errors.normal(0.0, self._noise, angle.shape)
        read = np.empty(angle.shape)
        for k, (encoder, axis) in enumerate(zip(self._encoders, self.axes, strict=True)):
            read[:, k] = counted(encoder, angle[:, k], errors[:, k], axis.sensor)
        for k, begin in self._frozen.items():
            first = int(np.searchsorted(times, begin))
            before = read[first - 1, k] if first else self._last[k]
            if first < times.size:
                read[first:, k] = read[first, k] if np.isnan(before) else before
        self._last = read[-1]
        return read

    def _efforts(self, effort: Table, noise: float) -> Table:
        read = measured(effort, noise, LOAD_CELLS.torque_step, self._effort_errors)
        read[:, ~self._driven] = np.nan
        return read / self._effort_scale


def encoder_groups(model: Model, settings: SensorSettings, seed: int) -> list[EncoderGroup]:
    """Groups of the encoders that share messages: a message has one stamp, so one clock.

    Raises:
        UsageError: a frozen encoder does not exist, or axes of different clocks share messages.
    """
    axes, motors = model.robot.axes, len(model.robot.motors)
    names = [axis.name for axis in axes]
    for fault in settings.freezes:
        if fault.name not in names:
            raise UsageError(f"an encoder must be one of {', '.join(names)}, got {fault.name!r}")
    clock = [axis.sensor.clock_offset_ns for axis in axes]
    kinds = {0: range(motors), 1: range(motors, len(axes))}
    if settings.update_rate is not None:
        kinds = {0: range(len(axes))}
        if len(set(clock)) > 1:
            raise UsageError("motors and joints in one message need one clock_offset")
    groups = []
    for kind, columns in kinds.items():
        for offset in dict.fromkeys(clock[k] for k in columns):
            alike = [k for k in columns if clock[k] == offset]
            groups.append(EncoderGroup(model, alike, settings, [seed, 1 + kind, alike[0]]))
    return groups


class CellGroup:
    """The load cells, which are read together."""

    def __init__(self, model: Model, settings: SensorSettings, seed: int) -> None:
        """Start without readings; arguments as of ``encoder_groups``.

        Raises:
            UsageError: an element does not exist.
        """
        known, cells = model.layout.elements, settings.load_cells
        for name in settings.elements:
            if name not in known:
                raise UsageError(
                    f"an element with a load cell must be one of {', '.join(known)}, got {name!r}"
                )
        self.elements = [known.index(name) for name in settings.elements]
        """Their indices."""
        self.names = settings.elements
        self.latency = cells.latency
        self.stddev = float(np.hypot(cells.noise, cells.step / np.sqrt(12.0)))
        """Standard deviation of a reading [N]."""
        self._cells = cells
        first = 3 * len(model.robot.axes)
        wanted = [first + element for element in self.elements]
        self._sampler = _Sampler(cells, wanted, [seed, 3, 0])
        self._errors = np.random.default_rng([seed, 3, 1])

    def take(self, time: Vector, truth: Table) -> tuple[Vector, Table]:
        """Stamps [s] and tensions [N], shape (n, cells); arguments as of ``EncoderGroup.take``."""
        plan, found = self._sampler.take(time, truth)
        cells = self._cells
        return plan.stamps, measured(found, cells.noise, cells.step, self._errors, cells.bias)
