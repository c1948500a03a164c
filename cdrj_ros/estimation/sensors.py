"""Sensors of a robot besides its encoders: what each reads, how well, and its readings that wait.

A sensor reads the tension of an element, or the effort on a motor or a joint.  All are rows of one
table: nothing but this file asks which they are.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.unknowns import preload_of
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.packing import stddev_places
from cdrj_ros.model.prepared import Model, shape_at
from cdrj_ros.robot.axes import DEFAULT_BREAKAWAY_ANGLE
from cdrj_ros.robot.description import Robot, Winch, turns_of

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
    friction: float
    """Friction of its axis that the file does not know, as the same share."""
    model: float
    """Error of the model, as a share of the reading."""
    model_least: float
    """The least error of the model, as a share of what the preloads contribute."""


CELL: Final = Accuracy(0.005, 0.0005, 0.03, 0.0, 0.01, 0.0)
"""A load cell, within 3 % by its data sheet and its mounting."""

EFFORT: Final = Accuracy(0.02, 0.002, 0.05, 0.1, 0.01, 0.02)
"""An effort computed from a motor's current, or of a joint; it is a small difference of cables."""

VERIFIED_GAIN: Final = 0.02
"""Error of the gain of a sensor that was compared with a known load or a spring scale [-]."""

FRICTION_KNOWN: Final = 0.3
"""Standard deviation of an axis' friction as a share of what the robot file states."""


@dataclass(frozen=True)
class Sensor:
    """What a sensor reads, and how well."""

    name: str
    """``cable/element``, or a motor or joint."""
    title: str
    """The same in words: ``load cell upper/8``."""
    unit: str
    """Of its readings: ``N`` or ``N m``."""
    column: int
    """Index of the quantity that it reads, in ``stddev_columns``."""
    cables: tuple[int, ...]
    """The cables that contribute to it."""
    noise: float
    """Standard deviation of a reading, unless its message states one [N] or [N m]."""
    scale: float
    """What the preloads contribute to its reading, regardless of signs [N] or [N m]."""
    prior: tuple[float, float, float]
    """Standard deviations of its bias [N] or [N m], of the error of its gain [-] and of the
    friction of its axis [N m]: (B3)."""
    drift: float
    """Random walk of the bias after 1 s [N] or [N m]."""
    model: tuple[float, float]
    """Error of the model: as a share of the reading, and at least [N] or [N m]."""
    pulls: tuple[tuple[int, float], ...] = ()
    """Elements whose tensions it reads, and the reading per newton of each [-] or [m]; none where
    that depends on angles."""
    axis: int = -1
    """Axis whose friction the reading contains, of motors, then joints; -1 for none."""
    clock_offset_ns: int = 0
    """Added to the stamps of its readings [ns]."""
    verified: bool = False
    """Whether it was compared with a known load."""

    def model_error(self, value: float) -> float:
        """Standard deviation of the model's error at a reading [N] or [N m]."""
        share, least = self.model
        return max(share * abs(value), least)


def sensors_of(model: Model, confirmed: Collection[str] = ()) -> dict[str, Sensor]:
    """All sensors that a robot may have, by name.

    Args:
        model: the robot.
        confirmed: sensors that count as verified although its file does not say so.
    """
    every = (*_cells(model), *_efforts(model))
    return {
        one.name: _verified(one) if one.verified or one.name in confirmed else one for one in every
    }


def _verified(sensor: Sensor) -> Sensor:
    bias, gain, friction = sensor.prior
    return replace(sensor, prior=(bias, min(gain, VERIFIED_GAIN), friction), verified=True)


def _cells(model: Model) -> Iterator[Sensor]:
    places = stddev_places(model.layout)
    for c, cable in enumerate(model.robot.cables):
        for name in cable.element_names:
            column = places[f"tension/{name}"]
            title, scale = f"load cell {name}", preload_of(cable)
            yield replace(
                _sensor(name, title, "N", column, (c,), cable.sensor_noise, scale, CELL),
                pulls=((column, 1.0),),
                verified=cable.sensor_verified,
            )


def _efforts(model: Model) -> Iterator[Sensor]:
    """Efforts of motors, and of joints whose file gives ``effort_noise``."""
    robot, layout = model.robot, model.layout
    places = stddev_places(layout)
    arms = shape_at(model, robot.reference_pose).lever_arm
    of_joints = np.array([np.abs(arms[part]).max(axis=0, initial=0.0) for part in robot.parts])
    contributes = np.hstack([np.abs(robot.drums), of_joints.reshape(len(robot.cables), -1)])
    preload = np.array([preload_of(cable) for cable in robot.cables])
    for a, axis in enumerate(robot.axes):
        own = contributes[:, a]
        cables = tuple(np.flatnonzero(own > 0.0).tolist())
        if axis.effort_noise is None or not cables:
            continue
        scale = float(own @ preload)
        name = axis.name
        one = _sensor(
            name, f"effort of {name}", "N m", places[f"effort/{name}"], cables, axis.effort_noise,
            scale, EFFORT,
        )  # fmt: skip
        yield replace(
            one,
            prior=(*one.prior[:2], _friction_stddev(robot, a, scale)),
            pulls=tuple(_winding(robot, name)),
            axis=a,
            clock_offset_ns=axis.sensor.clock_offset_ns,
            verified=axis.effort_verified,
        )


def _winding(robot: Robot, motor: str) -> Iterator[tuple[int, float]]:
    """Elements at the drums of a motor, and the effort per newton of each [m]; none of a joint."""
    for cable, part in zip(robot.cables, robot.parts, strict=True):
        for node, element in ((cable.nodes[0], part.start), (cable.nodes[-1], part.stop - 1)):
            turns = turns_of(node).get(motor, 0.0)
            if isinstance(node, Winch) and turns:
                sign = next(one.effort_sign for one in robot.motors if one.name == motor)
                yield element, -sign * turns * node.reel


def _sensor(
    name: str,
    title: str,
    unit: str,
    column: int,
    cables: tuple[int, ...],
    noise: float,
    scale: float,
    accuracy: Accuracy,
) -> Sensor:
    """A sensor whose axis, if it has one, is without friction."""
    return Sensor(
        name, title, unit, column, cables, noise, scale,
        prior=(accuracy.bias * scale, accuracy.gain, 0.0),
        drift=accuracy.drift * scale,
        model=(accuracy.model, accuracy.model_least * scale),
    )  # fmt: skip


def _friction_stddev(robot: Robot, a: int, scale: float) -> float:
    """Standard deviation of the unknown friction of an axis [N m]; the file's, if it states one."""
    axis, known = robot.axes[a], robot.uncertainty
    kind = "motors" if a < len(robot.motors) else "joints"
    path = f"{kind}.{axis.name}.bearing_torque"
    if known is not None and path in known.parameters[: known.stated]:
        return known.stddev[path]
    return float(np.hypot(EFFORT.friction * scale, FRICTION_KNOWN * axis.passive.bearing_torque))


# --- directions of the axes' friction -------------------------------------------------------------

COUNTS: Final = 2.0
"""The direction follows an axis after a turn by as many counts of its encoder at least."""


class Directions:
    """Directions d of the axes' friction in (B3).

    Friction of the cables and friction of the axis both widen the hysteresis of an effort.  That
    of the axis reverses within a milliradian, the cables' only after the cable has given up its
    elongation and its contacts have slipped back.  So the direction follows the axis like the
    friction of a bearing (E13).
    """

    def __init__(self, robot: Robot) -> None:
        """Begin without direction."""
        breakaway = [
            one.bearing_torque / one.bearing_stiffness
            if one.bearing_stiffness > 0.0 and one.bearing_torque > 0.0
            else DEFAULT_BREAKAWAY_ANGLE
            for one in (axis.passive for axis in robot.axes)
        ]
        counts = [abs(axis.sensor.scale) * axis.sensor.resolution for axis in robot.axes]
        self._breakaway = np.maximum(breakaway, COUNTS * np.array(counts))
        self._sign = -np.array([float(axis.effort_sign) for axis in robot.axes])
        self.forget()

    def forget(self) -> None:
        """Forget angles and directions."""
        self._angle: Vector | None = None
        self._direction = np.zeros(self._sign.size)

    def follow(self, angle: Vector) -> Vector:
        """Follow the axes to their angles [rad], shape (axes,).

        Returns:
            Change of every effort per unit of the axis' friction [-], from -1 to 1, shape (axes,).
        """
        if self._angle is not None:
            moved = (angle - self._angle) / self._breakaway
            self._direction = np.minimum(np.maximum(self._direction + moved, -1.0), 1.0)
        self._angle = angle
        return np.asarray(self._sign * self._direction)


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
        self._read_ns: dict[str, int] = {}
        """Stamp of the last reading of every sensor that waits or was used [ns]."""

    @property
    def expected(self) -> bool:
        """Whether the robot has any sensor whose readings may be used."""
        return not self._ignored.issuperset(self.sensors)

    @property
    def heard(self) -> bool:
        """Whether any sensor has sent a reading that may be used."""
        return bool(self._read_ns)

    def forget(self) -> None:
        """Discard all, as overlooked."""
        self.overlooked += len(self._waiting)
        self._waiting.clear()
        self._read_ns.clear()

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
            self._read_ns[name] = at
            if len(self._waiting) >= MOST:
                del self._waiting[: MOST // 2]
                self.overlooked += MOST // 2
            self._waiting.append(Reading(at, name, float(value), noise))

    def _is_wanted(self, name: str, stamp_ns: int) -> bool:
        last = self._read_ns.get(name)
        soon = last is not None and abs(stamp_ns - last) < LEAST_NS
        return name not in self._ignored and not soon

    def due(self, stamp_ns: int) -> Iterator[Reading]:
        """Take the readings up to a sample's stamp [ns] out of the queue, one by one."""
        waiting, self._waiting = self._waiting, []
        for one in waiting:
            if one.stamp_ns <= stamp_ns:
                yield one
            elif one.stamp_ns - stamp_ns <= AHEAD_NS:
                self._waiting.append(one)
            else:
                self.overlooked += 1
