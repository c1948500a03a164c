"""A simulated recording: what sensors read of the truth, written as a bag."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.messages.topics import BROADCAST, TENSION_SENSORS, in_namespace
from cdrj_ros.model.prepared import Model
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.simulation.assembly import Truth
from cdrj_ros.simulation.sensors import (
    IDEAL_SENSORS,
    CellGroup,
    ReadingTimes,
    SensorSettings,
    encoder_groups,
    measured,
    truth_table,
)

EPOCH_NS: Final = 1_700_000_000_000_000_000
"""Stamp of a simulated recording's start [ns]."""


class Recorder:
    """The sensors of a robot, which read one simulation."""

    def __init__(
        self,
        model: Model,
        sensors: SensorSettings = IDEAL_SENSORS,
        seed: int = 0,
    ) -> None:
        """Prepare the sensors.

        Args:
            model: the robot.
            sensors: what is read, and with which errors; see ``load_rig``.
            seed: of all random numbers.

        Raises:
            UsageError: the sensors do not fit the robot.
        """
        self._model, self._seed = model, seed
        self._encoders = encoder_groups(model, sensors, seed)
        self._cells = CellGroup(model, sensors, seed)
        self._references = sensors.references

    def write(self, path: str | Path, truth: Truth) -> None:
        """Write a bag with the readings, and with references of tensions, forces and efforts.

        Args:
            path: folder of the new bag.
            truth: of the whole simulation; it is read once.

        Raises:
            BagError: the bag exists or cannot be written.
        """
        with BagWriter(path) as bag:
            self._write_readings(bag, truth)
            self._write_references(bag, truth)

    def _stamps(self, times: Vector, offset_s: float = 0.0) -> NDArray[np.int64]:
        """Stamps [ns] of times of the simulation [s]."""
        stamp: NDArray[np.int64] = EPOCH_NS + np.round(times * 1e9).astype(np.int64)
        return stamp + round(offset_s * 1e9)

    def _write_readings(self, bag: BagWriter, truth: Truth) -> None:
        """Write what the robot's sensors read."""
        cells = self._cells
        topics = Topics()
        angle = np.concatenate([truth.motor_angle, truth.joint_angle], axis=1)
        effort = np.concatenate([truth.motor_effort, truth.joint_effort], axis=1)
        table = truth_table(angle, np.gradient(angle, truth.time, axis=0), effort, truth.tension)
        for group in self._encoders:
            read = group.take(truth.time, table)
            topic = {"motors": topics.motors, "joints": topics.joints, "all": BROADCAST}[group.kind]
            arrays = {field: getattr(read, field) for field in group.fields}
            bag.write_joint_states(
                topic, self._stamps(read.stamps) - group.clock_offset_ns, group.names, **arrays,
                log_ns=self._stamps(read.stamps, group.latency) if group.latency else None,
            )  # fmt: skip
        if cells.names:
            stamps, tension = cells.take(truth.time, table)
            bag.write_tensions(
                in_namespace(TENSION_SENSORS), self._stamps(stamps), cells.names, tension,
                np.full(tension.shape, cells.stddev),
                log_ns=self._stamps(stamps, cells.latency),
            )  # fmt: skip

    def _write_references(self, bag: BagWriter, truth: Truth) -> None:
        """Write the true tensions, forces and efforts with the errors of reference sensors."""
        sensors, layout = self._references, self._model.layout
        generator = np.random.default_rng(self._seed)
        plan = ReadingTimes(sensors, [self._seed, 3]).until(float(truth.time[-1]))

        def readings_of(values: Table, noise: float, step: float, bias: float = 0.0) -> Table:
            columns = [np.interp(plan.times, truth.time, column) for column in values.T]
            return measured(np.stack(columns, axis=1), noise, step, generator, bias)

        tensions, forces, torques, *_ = Topics().references
        force = (sensors.noise, sensors.step, sensors.bias)
        torque = (sensors.torque_noise, sensors.torque_step)
        at = self._stamps(plan.stamps)
        bag.write_tensions(tensions, at, layout.elements, readings_of(truth.tension, *force))
        if layout.pulleys:
            x, y, z = _components(truth.force, lambda one: readings_of(one, *force))
            magnitude = np.sqrt(x**2 + y**2 + z**2)
            bag.write_nodal_forces(
                forces, at, layout.pulleys, magnitude, force_x=x, force_y=y, force_z=z,
                frame_id=layout.force_frame,
            )  # fmt: skip
        both = np.concatenate([truth.motor_effort, truth.joint_effort], axis=1)
        bag.write_joint_states(
            torques, at, layout.motors + layout.joints, effort=readings_of(both, *torque)
        )


def _components(
    force: NDArray[np.float64], read: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> Iterator[NDArray[np.float64]]:
    """Readings of the components of forces (n, pulleys, 3); a plane's third one is not measured."""
    for axis in range(3):
        readings = read(force[:, :, axis])
        yield readings if force[:, :, axis].any() else np.zeros_like(readings)
