"""Sensors of the simulated robot: resolution, rate, phase, noise, bias, jitter, losses, faults.

They read a truth as it comes: a whole simulation at once, or step by step.  Both ways give the same
readings, because random numbers are drawn reading by reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import floor
from typing import Final, Literal, NamedTuple

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Sensor
from cdrj_ros.simulation.faults import EncoderFault

MOST_JITTER: Final = 0.45
"""Largest jitter of a stamp as a share of the period, so that stamps keep their order."""

ROUNDING_S: Final = 1e-12
"""Error of rounding in the times of readings [s]."""


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """When a sensor reads, and which of its readings arrive."""

    rate: float
    """Readings per second [Hz]."""
    phase: float = 0.0
    """Time from the recording's start to the first reading [s]."""
    jitter: float = 0.0
    """Standard deviation of the stamps about the time of reading [s]."""
    dropout: float = 0.0
    """Share of readings that are lost, in [0, 1)."""
    latency: float = 0.0
    """Time from a reading to its message [s]."""


@dataclass(frozen=True, kw_only=True)
class Encoder(Sampling):
    """An incremental angle sensor."""

    counts: int | None = None
    """Counts per turn of the axis; on a prismatic joint, per 2 pi m; None: the resolution that the
    robot file states or, where it states none, ``usual_counts``."""
    usual_counts: int = 16_384
    noise: float = 0.0
    """Standard deviation of the noise before quantisation [rad]."""
    bias: float = 0.0
    """Constant added to every reading [rad]."""


@dataclass(frozen=True, kw_only=True)
class LoadCells(Sampling):
    """Reference sensors of force and torque."""

    rate: float = 100.0
    """Readings per second [Hz]."""
    noise: float = 0.02
    """Standard deviation of the forces' noise [N]."""
    torque_noise: float = 0.0005
    """Standard deviation of the torques' noise [N m]."""
    step: float = 2.0**-7
    """Resolution of the forces [N]."""
    torque_step: float = 2.0**-13
    """Resolution of the torques [N m]."""
    bias: float = 0.0
    """Constant added to every force reading [N]."""


class Schedule(NamedTuple):
    """Times of a sensor's readings, and the stamps of its messages."""

    times: Vector
    """Times of the readings that arrive [s], shape (n,), increasing."""
    stamps: Vector
    """Stamps of the messages [s], shape (n,), increasing."""


MOTOR_ENCODER = Encoder(usual_counts=81_920, rate=1000.0)
JOINT_ENCODER = Encoder(rate=500.0, phase=0.0003)
LOAD_CELLS = LoadCells()


class ReadingTimes:
    """The times at which a sensor reads, with jitter and without lost readings."""

    def __init__(self, sensor: Sampling, seed: Sequence[int]) -> None:
        """Start at 0."""
        self._sensor, self._count = sensor, 0
        self._jitter, self._losses = (np.random.default_rng([*seed, k]) for k in range(2))

    def until(self, end: float) -> Schedule:
        """The readings since the last call and up to ``end`` [s]."""
        sensor, first = self._sensor, self._count
        self._count = max(first, 1 + floor((end + ROUNDING_S - sensor.phase) * sensor.rate))
        size = self._count - first
        if size == 0:
            return Schedule(np.empty(0), np.empty(0))
        times = sensor.phase + np.arange(first, self._count) / sensor.rate
        stamps = times
        if sensor.jitter > 0.0:
            most = MOST_JITTER / sensor.rate
            off = self._jitter.normal(0.0, sensor.jitter, size)
            stamps = times + np.clip(off, -most, most)
        if sensor.dropout > 0.0:
            kept = self._losses.random(size) >= sensor.dropout
            times, stamps = times[kept], stamps[kept]
        return Schedule(times, stamps)


def angle_of(sensor: Sensor, reading: Vector) -> Vector:
    """Angles [rad] that the robot file assigns to readings, which do not wrap around."""
    angle: Vector = sensor.scale * reading + sensor.offset
    if sensor.corrected_at:
        angle = angle + np.interp(angle, sensor.corrected_at, sensor.correction)
    return angle


def reading_of(sensor: Sensor, angle: Vector) -> Vector:
    """Readings without error, to which the robot file assigns these angles [rad]."""
    if sensor.corrected_at:
        correction = np.array(sensor.correction)
        angle = angle - np.interp(angle, correction + sensor.corrected_at, correction)
    reading: Vector = (angle - sensor.offset) / sensor.scale
    return reading


def counted(encoder: Encoder, angle: Vector, noise: float | Vector, sensor: Sensor) -> Vector:
    """Readings of angles [rad] as whole counts, with noise [rad]; all arrays of shape (n,)."""
    unit = abs(sensor.scale)  # counts, bias and noise are those of the axis
    stated = sensor.resolution if encoder.counts is None else 0.0
    step = stated or 2.0 * np.pi / (encoder.counts or encoder.usual_counts) / unit
    seen = reading_of(sensor, angle) + (encoder.bias + noise) / unit
    read: Vector = np.round(seen / step) * step
    if np.isfinite(sensor.period):  # wraps around half a period from 0
        read -= sensor.period * np.round(read / sensor.period)
    return read


def measured(
    ideal: Table, noise: float, step: float, generator: np.random.Generator, bias: float = 0.0
) -> Table:
    """Readings of ideal values with their noise, bias and resolution; shape (n, columns)."""
    read: Table = np.round((ideal + bias + generator.normal(0.0, noise, ideal.shape)) / step) * step
    return read


Kind = Literal["motors", "joints", "all"]
"""Whose readings a message has; all of them, with velocities, under ros2_control."""


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
    faults: tuple[EncoderFault, ...] = ()


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
        self._last: tuple[float, Vector] | None = None
        none = np.empty((0, len(self.axes)))
        self._nothing = Messages(np.empty(0), **dict.fromkeys(self.fields, none))
        self._faults = [fault for fault in settings.faults if fault.encoder in self.names]
        self.restart(0.0)

    @property
    def fields(self) -> tuple[str, ...]:
        """The fields of ``Messages`` that the group fills, besides the stamps."""
        velocity = ("velocity",) if self.kind == "all" else ()
        effort = () if self._effort_noise is None else ("effort",)
        return ("position", *velocity, *effort)

    def restart(self, begin: float) -> None:
        """End all faults; they happen at their times after ``begin`` [s]."""
        self._begin = begin

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
        before, last = (times[0], read[0]) if self._last is None else self._last
        since = np.append(before, times) - self._begin
        for fault in self._faults:
            k = self.names.index(fault.encoder)
            read[:, k] = fault.apply(since, np.append(last[k], read[:, k]))[1:]
        self._last = (times[-1], read[-1])
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
    for fault in settings.faults:
        if fault.encoder not in names:
            raise UsageError(f"an encoder must be one of {', '.join(names)}, got {fault.encoder!r}")
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
        self.names = settings.elements
        self.latency = cells.latency
        self.stddev = float(np.hypot(cells.noise, cells.step / np.sqrt(12.0)))
        """Standard deviation of a reading [N]."""
        self._cells = cells
        first = 3 * len(model.robot.axes)
        wanted = [first + known.index(name) for name in settings.elements]
        self._sampler = _Sampler(cells, wanted, [seed, 3, 0])
        self._errors = np.random.default_rng([seed, 3, 1])

    def take(self, time: Vector, truth: Table) -> tuple[Vector, Table]:
        """Stamps [s] and tensions [N], shape (n, cells); arguments as of ``EncoderGroup.take``."""
        plan, found = self._sampler.take(time, truth)
        cells = self._cells
        return plan.stamps, measured(found, cells.noise, cells.step, self._errors, cells.bias)
