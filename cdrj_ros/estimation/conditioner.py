"""Conditioning of one robot's messages: gates that check the readings, then the common time line.

The core does it, `cdrj_ros/core/conditioner.hpp`; see docs/estimation.md.  First comes what
readings of motors and joints mean and must satisfy, and what their errors are worth.  The readings
of a whole recording take the way of single messages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import hypot, isfinite, sqrt
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros._core import Axis
from cdrj_ros.estimation.ensemble import UNSURE_SHARE
from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.estimation.model_error import stiffness
from cdrj_ros.estimation.refusals import Sizes, clocks_apart, refusal_words
from cdrj_ros.foundation.arrays import Series, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.description import Joint, Motor, Robot, Sensor

NOISE_BAND: Final = 3.0
"""Greatest noise of a reading, in standard deviations."""

UNSEEN_FLOOR: Final = 2e-5
"""Smallest standard deviation between readings that is reported for any sensor [rad]."""

LITTLE: Final = 0.002
"""A standard deviation that is worth less than this part of what makes a tension ``UNSURE`` is not
reported either: all members are updated where one is."""


def half_width(sensor: Sensor) -> float:
    """Greatest error of a reading of the sensor [rad]."""
    return abs(sensor.scale) * (0.5 * sensor.resolution + NOISE_BAND * sensor.noise)


def negligible(sensor: Sensor) -> float:
    """Standard deviation of the sensor's own error [rad], ``UNSEEN_FLOOR`` or more."""
    count = sensor.resolution / sqrt(12.0)
    return max(abs(sensor.scale) * hypot(count, sensor.noise), UNSEEN_FLOOR)


COUNTED: Final = 20_000
"""Number of readings of an axis from which its counts are found."""

ON_GRID: Final = 0.05
"""Largest deviation of differences of readings from whole counts [counts]."""

ROUNDING: Final = 1e-9
"""Differences of readings below this part of their range are none."""

FEWEST: Final = 10
"""Differences of readings below which they may have a common divisor by chance."""

VARIED: Final = 0.01
"""In motion, the steps of a sensor with counts differ from the one before more often than this
share; at constant speed exact readings lie on a grid, too, but their steps are equal."""


def count_of(readings: Vector) -> float:
    """The resolution that readings show, of which all their differences are multiples, or 0."""
    few = readings[np.isfinite(readings)]
    rested = int(np.argmax(few != few[0])) if few.size else 0
    few = few[max(rested - 1, 0) :][:COUNTED]  # from the first motion on
    differences = np.diff(np.unique(few))
    differences = differences[differences > ROUNDING * differences.sum()]
    if differences.size < FEWEST:
        return 0.0
    count = float(differences.min())
    ratio = differences / count
    steps = np.rint(np.abs(np.diff(few)) / count)
    on_grid = float(np.abs(ratio - np.rint(ratio)).max()) < ON_GRID
    moving = steps[1:] + steps[:-1] > 0.0
    return count if on_grid and np.mean((steps[1:] != steps[:-1])[moving]) > VARIED else 0.0


def efforts_of(robot: Robot, names: Sequence[str], efforts: Vector) -> Vector:
    """Efforts [N m] of published ones; those of other names stay.

    Args:
        robot: its motors and joints have the scales.
        names: as published.
        efforts: as published, one per name; if not, the message has none that can be assigned.

    Returns:
        Shape (names,) or empty.
    """
    if len(efforts) != len(names):
        return efforts[:0]
    scale = robot.effort_scale
    return efforts * np.array([scale.get(name, 1.0) for name in names])


def axes_of(
    robot: Robot,
    tracking: float | None = None,
    worth: Sequence[float] = (),
) -> list[Axis]:
    """All motors, then all joints, in the robot's order.

    Args:
        robot: names, sensors and limits.
        tracking: fixed bandwidth [Hz] to use instead of the robot file's; 0 for no tracking.  A
            sensor without resolution and noise is not tracked.
        worth: of every axis, see ``worth_of``; empty where it is not needed.
    """
    axes: tuple[Motor | Joint, ...] = (*robot.motors, *robot.joints)
    known = {} if robot.uncertainty is None else robot.uncertainty.stddev
    kinds = ["motors"] * len(robot.motors) + ["joints"] * len(robot.joints)
    return [
        axis_of(one, tracking, size, known.get(f"{kind}.{one.name}.clock_offset", 0.0))
        for kind, one, size in zip(kinds, axes, worth or [0.0] * len(axes), strict=True)
    ]


def axis_of(
    axis: Motor | Joint,
    tracking: float | None = None,
    worth: float = 0.0,
    clock_stddev: float = 0.0,
) -> Axis:
    """One motor or joint, as ``axes_of``; ``clock_stddev`` of its ``clock_offset`` [s]."""
    sensor, bandwidth = axis.sensor, axis.sensor.tracking_bandwidth
    if tracking is not None and half_width(sensor) > 0.0:
        bandwidth = tracking
    lower, upper = float("-inf"), float("inf")
    if isinstance(axis, Joint):
        lower, upper = axis.lower, axis.upper
    return Axis(
        axis.name,
        lower=lower,
        upper=upper,
        max_speed=axis.max_speed,
        clock_offset_ns=sensor.clock_offset_ns,
        clock_stddev=clock_stddev,
        period=sensor.period,
        scale=sensor.scale,
        offset=sensor.offset,
        corrected_at=sensor.corrected_at,
        correction=sensor.correction,
        bandwidth=bandwidth,
        adaptive=tracking is None and sensor.tracking == "adaptive",
        band=half_width(sensor),
        negligible=max(negligible(sensor), LITTLE * worth if isfinite(worth) else 0.0),
        count=sensor.resolution,
        worth=worth,
        start=axis.reference_angle,
    )


LEAST_STEP: Final = 4.0
"""Smallest step that is found at any rate, by the greatest error of a reading, (C7)."""


class Slip(NamedTuple):
    """What a step of one encoder does before readings show it."""

    axis: str
    unseen: float
    """Steps up to this are not seen even at high rates and in slow motion [rad] or [m]."""
    tension: float
    """What such a step is worth in the tension of a cable [N]."""
    unsure: float
    """A step beyond this makes the elements of its cables ``UNSURE`` [rad] or [m]."""


def slips(model: Model) -> list[Slip]:
    """Of every motor and joint with an encoder on which a cable acts."""
    robot = model.robot
    stiff = stiffness(robot, shape_at(model, robot.reference_pose))
    most = stiff.max(axis=0, initial=0.0).tolist()
    unseen = [LEAST_STEP * half_width(axis.sensor) for axis in robot.axes]
    measured = {axis.name for axis in robot.as_read.axes}
    return [
        Slip(axis.name, step, step * newtons, unsure)
        for axis, step, newtons, unsure in zip(
            robot.axes, unseen, most, _worth(model), strict=True
        )
        if axis.name in measured and newtons > 0.0
    ]  # fmt: skip


def worth_of(robot: Robot) -> list[float]:
    """Change of the angle of every axis with an encoder that alone makes a cable ``UNSURE`` [rad].

    Zero for a robot with joints without encoder, whose estimate does not follow from the angles
    alone.
    """
    if robot.unmeasured:
        return [0.0] * len(robot.as_read.axes)
    return _worth(prepare(robot, check_range=False))


def _worth(model: Model) -> list[float]:
    """Change of the angle of every axis that changes a tension by a share of the preload [rad].

    Of a cable without preload, of a tenth of its greatest tension; infinite where no cable acts on
    the axis.
    """
    robot = model.robot
    usual = [cable.preload or 0.1 * cable.maximum_tension for cable in robot.cables]
    share = stiffness(robot, shape_at(model, robot.reference_pose)) / np.array(usual)[:, None]
    most = share.max(axis=0, initial=0.0).tolist()
    return [UNSURE_SHARE / one if one > 0.0 else np.inf for one in most]


def _axes_of_cables(model: Model) -> list[list[int]]:
    """The axes on which every cable depends, by index among motors, then joints."""
    return [np.flatnonzero(model.touched[:, part.start]).tolist() for part in model.robot.parts]


Mode = Literal["wait", "predict"]
MODES: Final[tuple[Mode, ...]] = get_args(Mode)
"""How a lagging channel is handled: wait for it, or extrapolate it with its velocity meanwhile."""

Kind = Literal["motors", "joints", "both"]
TOPICS: Final[Mapping[Kind, _core.Topic]] = {
    "motors": _core.Topic.MOTORS,
    "joints": _core.Topic.JOINTS,
    "both": _core.Topic.BOTH,
}
"""What a topic carries."""

HORIZON_NS: Final = 20_000_000
"""A channel is predicted at most this far beyond its last reading [ns]."""


class Conditioner(_core.Conditioner):
    """Gates and time line of one robot: takes messages, returns samples.

    Its counters are ``refused`` (readings by a cause of ``refusals.REFUSALS``; for those of
    ``WHOLE``, messages), ``accepted`` and ``elsewhere`` (joints in a message of motors, for
    example), ``clock_jumps`` (the clock went back and conditioning restarted), ``gaps`` (a channel
    was silent for too long), ``steps`` (of sensors: the readings moved further than the axis can,
    and stayed) and ``crowded`` (accepted readings that waited too long for another channel).
    ``held`` readings wait until it is known whether the clock has jumped, ``unheard`` are the names
    without an accepted reading since the last reset, ``silent`` has the time since the last one of
    axes for which others need not wait [ns], ``ahead`` has the stamp of the last reading of
    every axis less its time of arrival [ns], ``displaced`` has the sum of the steps [rad] of every
    sensor that has stepped since then, ``alternating`` are the names whose readings alternate
    between two motions or contradict each other, ``stuck`` those that repeat an old reading with
    new stamps, ``misfitting`` those whose counts do not show their unit although they have moved,
    ``lagging`` has the lag of axes whose topic is always late, or
    whose clock differs, and ``lag_ns`` is the lag of the last sample behind the newest reading.
    """

    def __init__(self, robot: Robot, mode: Mode = "wait", tracking: float | None = None) -> None:
        """Prepare the channels.

        Args:
            robot: names, sensors and limits; joints without encoder have no channel.
            mode: one of ``MODES``.
            tracking: see ``axes_of``.
        """
        if mode not in MODES:
            raise UsageError(f"mode must be one of {', '.join(MODES)}, got {mode!r}")
        model = None if robot.unmeasured else prepare(robot, check_range=False)
        self._robot = robot.as_read
        self.worth = [0.0] * len(self._robot.axes) if model is None else _worth(model)
        axes = axes_of(self._robot, tracking, self.worth)
        cables = [list(range(len(axes)))] if model is None else _axes_of_cables(model)
        super().__init__(axes, len(robot.motors), cables, mode == "predict", HORIZON_NS)

    def memory(self) -> dict[str, Vector]:
        """Values that outlast a restart, for ``recall``: motion so far and the sensors' steps."""
        axes, stepped = self.remembered()
        return {"axes": axes, "stepped": stepped}

    def recall(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore the values of ``memory`` before the first reading; ignore impossible ones."""
        rows, stepped = arrays["axes"], arrays["stepped"]
        if np.all(np.isfinite(rows)) and np.all(rows[:, :-1] >= 0.0):
            self.remember(rows, stepped)

    def expect(self, angles: Vector, stamp_ns: int) -> None:
        """Continue from the last sample of an earlier run.

        Args:
            angles: of motors, then joints [rad], shape (channels,).
            stamp_ns: of that sample [ns].
        """
        robot = self._robot
        if angles.shape == (len(robot.motors) + len(robot.joints),) and not np.isinf(angles).any():
            self.continue_from(angles, stamp_ns)

    def set_tracking(self, tracking: float | None) -> None:
        """Change the tracking bandwidth, see ``axes_of``; no reading is lost."""
        self.use_tracking_of(axes_of(self._robot, tracking, self.worth))


@dataclass(frozen=True)
class Conditioned:
    """The samples of a whole recording, and how many readings were refused."""

    segments: tuple[Samples, ...]
    """One segment, or several if the clock went back between them; none is empty."""
    refused: Mapping[str, int]
    accepted: int
    clock_jumps: int
    gaps: int
    steps: int = 0
    ahead: Mapping[str, int] = field(default_factory=dict)
    """As ``Conditioner.ahead``, at the end."""
    sizes: Sizes = field(default_factory=dict)
    """Of the refused readings."""

    def shortage(self, robot: Robot) -> str:
        """Why there are no samples, or few: clocks that differ, and what was refused; or empty."""
        words = clocks_apart(self.ahead), refusal_words(self.refused, self.sizes, robot)
        return "; ".join(one for one in words if one)


def condition(
    robot: Robot,
    motors: Mapping[str, Series],
    joints: Mapping[str, Series],
) -> Conditioned:
    """Condition a recording, reading by reading in order of arrival.

    No sample is predicted: nothing lags in a recording.

    Args:
        robot: names, sensors and limits of the channels.
        motors: readings by name, of every motor of the robot.
        joints: readings by name, of every joint of the robot.

    Returns:
        The samples, and how many readings were refused.
    """
    conditioner = Conditioner(robot)
    segments = _core.condition(
        conditioner,
        [
            (topic, name, readings.stamp_ns, readings.log_ns, readings.value, readings.by_arrival)
            for topic, channels in ((_core.Topic.MOTORS, motors), (_core.Topic.JOINTS, joints))
            for name, readings in channels.items()
        ],
    )
    return Conditioned(
        tuple(Samples(*columns) for columns in segments if columns[0].size),
        conditioner.refused,
        conditioner.accepted,
        conditioner.clock_jumps,
        conditioner.gaps,
        conditioner.steps,
        conditioner.ahead,
        conditioner.take_refused(),
    )


def angles_of(robot: Robot, name: str, readings: Series) -> Series:
    """Angles that the readings of a motor or joint mean, whether or not they are acceptable.

    NaN where a reading is not finite or larger than any angle.
    """
    (axis,) = (one for one in axes_of(robot) if one.name == name)
    stamps = readings.stamp_ns + axis.clock_offset_ns
    return Series(stamps, readings.log_ns, axis.angles_of(readings.value))
