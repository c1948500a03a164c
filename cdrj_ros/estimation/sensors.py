"""Sensors of a robot besides its encoders: what each reads, how well, and its readings that wait.

A sensor reads the tension of an element, or the effort on a motor or a joint.  All are rows of one
table: nothing but this file asks which they are.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.unknowns import AXIS, efforts_of_preloads, preload_of
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.packing import stddev_places
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Joint, Motor, Robot, Winch, turns_of

LARGEST: Final = 1e9
"""Measured values of larger magnitude are refused [N] or [N m]."""

SMALLEST_NOISE: Final = 1e-6
LARGEST_NOISE: Final = 1e6
"""Outside these limits a message's standard deviation is replaced by the robot file's [N]."""

MOST: Final = 10_000
"""Most readings that wait: without angles no sample comes to use them."""

AHEAD_NS: Final = 1_000_000_000
"""Readings further ahead of the samples are discarded [ns]."""

LEAST_NS: Final = 20_000_000
"""Least time between two readings of a sensor that are used [ns]: errors of model and history last
longer, so that more readings say little more."""


class Accuracy(NamedTuple):
    """What is open about a kind of sensor: standard deviations."""

    bias: float
    """As a share of what the preloads contribute to its reading."""
    drift: float
    """Random walk of the bias after 1 s, as the same share."""
    gain: float
    """Error of the gain [-]."""
    model: float
    """Error of the model, as a share of the reading."""
    model_least: float
    """The least error of the model, as a share of what the preloads contribute."""


CELL: Final = Accuracy(0.005, 0.0005, 0.03, 0.01, 0.0)
"""A load cell, within 3 % by its data sheet and its mounting."""

EFFORT: Final = Accuracy(0.02, 0.002, 0.05, 0.01, 0.02)
"""An effort computed from a motor's current, or of a joint; it is a small difference of cables."""

VERIFIED_GAIN: Final = 0.02
"""Error of the gain of a sensor that was compared with a known load or a spring scale [-]; least
of one that was fitted."""


@dataclass(frozen=True)
class Sensor:
    """What a sensor reads, and how well."""

    name: str
    """``cable/element``, or a motor or joint."""
    column: int
    """Index of the quantity that it reads, in ``stddev_columns``."""
    cables: tuple[int, ...]
    """The cables that contribute to it."""
    noise: float
    """Standard deviation of a reading, unless its message states one [N] or [N m]."""
    scale: float
    """What the preloads contribute to its reading, regardless of signs [N] or [N m],"""
    balance: float
    """and with them; 0 for the effort of a joint."""
    accuracy: Accuracy
    pulls: tuple[tuple[int, float], ...] = ()
    """Elements whose tensions it reads, and the reading per newton of each [-] or [m]; none where
    that depends on angles."""
    axis: int = -1
    """Axis whose effort it reads, of motors, then joints; -1 for a load cell."""
    clock_offset_ns: int = 0
    """Added to the stamps of its readings [ns]."""
    verified: bool = False
    """Whether it was compared with a known load, or a spring scale."""

    @property
    def unit(self) -> str:
        """Of its readings."""
        return "N" if self.axis < 0 else "N m"

    @property
    def title(self) -> str:
        """Its name in words: ``load cell upper/8``."""
        return f"{'load cell' if self.axis < 0 else 'effort of'} {self.name}"

    @property
    def gain(self) -> float:
        """Standard deviation of the error of its gain [-]."""
        return min(self.accuracy.gain, VERIFIED_GAIN) if self.verified else self.accuracy.gain

    def stddev_of(self, reading: Reading) -> float:
        """Standard deviation of a reading whose errors nothing has shown yet [N] or [N m]."""
        own = self.accuracy
        axis = 0.0 if self.axis < 0 else AXIS.unit
        shares = np.array([own.bias, own.model_least, axis]) * self.scale
        errors = [reading.noise, self.gain * reading.value, own.model * reading.value, *shares]
        return float(np.linalg.norm(errors))

    def parts_of(self, robot: Robot) -> Table:
        """What every element's tension contributes to a reading, by cables of the sensor.

        Returns:
            Shape (cables of the sensor, elements of the robot).
        """
        found = np.zeros((len(self.cables), robot.parts[-1].stop))
        for row, c in zip(found, self.cables, strict=True):
            part = robot.parts[c]
            for element, share in self.pulls:
                row[element] += share * (part.start <= element < part.stop)
        return found


def sensors_of(model: Model, confirmed: Collection[str] = ()) -> dict[str, Sensor]:
    """All sensors that a robot may have, by name.

    Args:
        model: the robot.
        confirmed: sensors that count as verified although its file does not say so.
    """
    every = {one.name: one for one in (*_cells(model), *_efforts(model))}
    return every | {name: replace(every[name], verified=True) for name in confirmed}


def _cells(model: Model) -> Iterator[Sensor]:
    places = stddev_places(model.layout)
    for c, cable in enumerate(model.robot.cables):
        for name in cable.element_names:
            column = places[f"tension/{name}"]
            preload = preload_of(cable)
            yield Sensor(
                name, column, (c,), cable.sensor_noise, preload, preload, CELL, ((column, 1.0),),
                verified=cable.sensor_verified,
            )  # fmt: skip


def _efforts(model: Model) -> Iterator[Sensor]:
    """Efforts of motors, and of joints whose file gives ``effort_noise``."""
    robot, places = model.robot, stddev_places(model.layout)
    contributes = efforts_of_preloads(model)
    preloads = [preload_of(cable) for cable in robot.cables for _ in cable.element_names]
    known = robot.uncertainty.stddev if robot.uncertainty else {}
    for a, axis in enumerate(robot.axes):
        path = f"{'motors' if a < len(robot.motors) else 'joints'}.{axis.name}.effort_scale"
        fitted = known.get(path, inf) / abs(axis.effort_scale)
        gain = min(max(fitted, VERIFIED_GAIN), EFFORT.gain)
        cables = tuple(np.flatnonzero(contributes[:, a]).tolist())
        if axis.effort_noise is not None and cables:
            pulls = tuple(_winding(robot, axis, cables))
            balance = sum((share * preloads[element] for element, share in pulls), 0.0)
            yield Sensor(
                axis.name, places[f"effort/{axis.name}"], cables, axis.effort_noise,
                float(contributes[:, a].sum()), balance, EFFORT._replace(gain=gain), pulls, a,
                axis.sensor.clock_offset_ns, axis.effort_verified,
            )  # fmt: skip


def _winding(
    robot: Robot, axis: Motor | Joint, cables: Sequence[int]
) -> Iterator[tuple[int, float]]:
    """Elements at the drums of a motor, and the effort per newton of each [m]; none of a joint."""
    for c in cables:
        cable, part = robot.cables[c], robot.parts[c]
        for node, element in ((cable.nodes[0], part.start), (cable.nodes[-1], part.stop - 1)):
            turns = turns_of(node).get(axis.name, 0.0)
            if isinstance(node, Winch) and turns:
                yield element, -axis.effort_sign * turns * node.effective_radius


# --- readings that wait ---------------------------------------------------------------------------


class Reading(NamedTuple):
    """A reading of a sensor."""

    stamp_ns: int
    name: str
    value: float
    """[N] or [N m]."""
    noise: float
    """Standard deviation [N] or [N m]."""


class WaitingReadings:
    """Readings that wait for the sample with which they are compared, in the order of arrival."""

    def __init__(self, sensors: Mapping[str, Sensor], ignored: Sequence[str] = ()) -> None:
        """Begin empty.

        Args:
            sensors: all that the robot may have, by name.
            ignored: those whose readings are not used; ``*`` for all.
        """
        self.sensors = sensors
        self._ignored = frozenset(sensors if "*" in ignored else ignored)
        self.unknown = 0
        """Readings of sensors that the robot does not have."""
        self.refused = 0
        """Readings that are no numbers, or too large."""
        self.overlooked = 0
        """Readings discarded because no sample reached their stamp."""
        self._waiting: list[Reading] = []
        self.latest: dict[str, Reading] = {}
        """The last reading of every sensor that waits or was used."""

    @property
    def expected(self) -> bool:
        """Whether the robot has any sensor whose readings may be used."""
        return not self._ignored.issuperset(self.sensors)

    @property
    def heard(self) -> bool:
        """Whether any sensor has sent a reading that may be used."""
        return bool(self.latest)

    def forget(self) -> None:
        """Discard all, as overlooked."""
        self.overlooked += len(self._waiting)
        self._waiting.clear()
        self.latest.clear()

    def wants(self, names: Sequence[str], stamp_ns: int) -> bool:
        """Whether a reading at this stamp [ns] of any of these sensors would be used."""
        return any(name in self.sensors and self._is_wanted(name, stamp_ns) for name in names)

    def feed(
        self,
        stamp_ns: int,
        names: Sequence[str],
        values: Sequence[float] | Vector,
        stddevs: Sequence[float] | Vector = (),
    ) -> None:
        """Queue a message.

        Args:
            stamp_ns: stamp of the message [ns].
            names: of its sensors.
            values: one for each [N] or [N m].
            stddevs: one for each [N] or [N m]; empty: the robot file's.
        """
        for k, (name, value) in enumerate(zip(names, values, strict=True)):
            sensor = self.sensors.get(name)
            if sensor is None:
                self.unknown += 1
                continue
            if not abs(value) <= LARGEST:  # NaN too, which drivers send where they have no effort
                self.refused += 1
                continue
            at = stamp_ns + sensor.clock_offset_ns
            if not self._is_wanted(name, at):
                continue
            noise = float(stddevs[k]) if len(stddevs) else 0.0
            if not SMALLEST_NOISE <= noise <= LARGEST_NOISE:
                noise = sensor.noise
            self.latest[name] = Reading(at, name, float(value), noise)
            if len(self._waiting) >= MOST:
                del self._waiting[: MOST // 2]
                self.overlooked += MOST // 2
            self._waiting.append(self.latest[name])

    def _is_wanted(self, name: str, stamp_ns: int) -> bool:
        last = self.latest.get(name)
        soon = last is not None and abs(stamp_ns - last.stamp_ns) < LEAST_NS
        return name not in self._ignored and not soon

    def due(self, stamp_ns: int) -> list[Reading]:
        """Take the readings up to a sample's stamp [ns] out of the queue."""
        found = []
        waiting, self._waiting = self._waiting, []
        for one in waiting:
            if one.stamp_ns <= stamp_ns:
                found.append(one)
            elif one.stamp_ns - stamp_ns <= AHEAD_NS:
                self._waiting.append(one)
            else:
                self.overlooked += 1
        return found
