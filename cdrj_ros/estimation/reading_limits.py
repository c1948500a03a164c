"""What readings of motors and joints mean and must satisfy, and what their errors are worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot, isfinite, sqrt
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros._core import Axis
from cdrj_ros.estimation.ensemble import UNSURE_SHARE
from cdrj_ros.estimation.model_error import stiffness
from cdrj_ros.foundation.arrays import Table, Vector
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


def axes_of(robot: Robot, tracking: float | None = None, worth: Sequence[float] = ()) -> list[Axis]:
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
        worth=worth,
        start=axis.reference_angle,
    )


REFUSALS: Final[Mapping[str, str]] = {
    "malformed": "message refused whole: not as many positions as names, or not decodable",
    "empty": "message without a name",
    "unstamped": "message with a stamp that is not after zero",
    "unknown_name": "name that the robot file does not have",
    "not_finite": "NaN or infinite position",
    "repeated": "stamp equal to the last one accepted",
    "late": "stamp before the last one accepted, or before the clock's zero",
    "future": "stamp too far ahead and not confirmed by later readings, or never valid",
    "out_of_range": "joint angle outside its range",
    "implausible": "further from the last reading than max_speed allows, or than any angle",
}
"""Causes for which a reading is refused, and their meaning."""

WHOLE: Final = ("malformed", "empty", "unstamped")
"""Causes for which a message is refused whole and counted once, however many names it has."""


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
    """A step beyond this makes all elements ``UNSURE`` [rad] or [m]."""


def slips(model: Model) -> list[Slip]:
    """Of every motor and joint with an encoder on which a cable acts."""
    robot = model.robot
    most = _stiffness(model).max(axis=0, initial=0.0).tolist()
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

    A cable without preload counts with a tenth of its greatest tension.  Infinite where no cable
    acts on the axis.
    """
    usual = [cable.preload or 0.1 * cable.maximum_tension for cable in model.robot.cables]
    share = _stiffness(model) / np.array(usual)[:, None]
    most = share.max(axis=0, initial=0.0)
    return [UNSURE_SHARE / one if one > 0.0 else np.inf for one in most.tolist()]


def _stiffness(model: Model) -> Table:
    """See ``stiffness``, in the reference pose."""
    pose = model.robot.reference_pose
    return stiffness(model.robot, shape_at(model, pose))
