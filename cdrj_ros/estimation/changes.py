"""Changes of a robot at run time: reference pose, preloads, any number of its file; rest."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import hypot
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.conditioner import half_width
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import Sample, initial_state
from cdrj_ros.estimation.sensors import WaitingReadings
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot, Uncertainty
from cdrj_ros.robot.document import LARGEST, allowed_range, document_complaints
from cdrj_ros.robot.parameters import find_number, number_at, with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.tolerances import (
    CALLIPER,
    POSITION_BY_EYE,
    SPRING_SCALE_NOW,
    ZERO_BY_EYE,
)

REST_NS: Final = 300_000_000
"""Time for which every axis must have stood still before a tare [ns]."""

REST_STEP_NS: Final = 10_000_000
"""Minimum interval between the samples that are checked [ns]."""

CLEARLY: Final = 2.0
"""A change of more standard deviations is taken from the sensors by a tare,"""

CONTRADICTS: Final = 3.0
"""and a reading further from what it should be in the reference pose refuses one."""

RECENT_NS: Final = 1_000_000_000
"""Greatest age of such a reading [ns]."""

REST_FLOOR: Final = 2e-3
"""Movement allowed at rest for an axis whose sensor has neither resolution nor noise [rad]: more
than a count of an encoder of 12 bits, between two of which a reading at rest may alternate."""


class Change(NamedTuple):
    """New numbers of a robot file."""

    values: dict[str, float]
    """By path [SI]."""
    words: str
    """A description."""


def reference_at(model: Model, sample: Sample) -> Change:
    """The change that makes the angles of a sample the reference pose."""
    values, words = {}, []
    for kind, names, angles in (
        ("motor", model.layout.motors, sample.motor_angle),
        ("joint", model.layout.joints, sample.joint_angle),
    ):
        for name, angle in zip(names, angles, strict=True):
            values[f"{kind}s.{name}.reference_angle"] = float(angle)
            words.append(f"{kind} {name} {angle + 0.0:.6g} {model.robot.unit_of(name)}")
    preloads = ", ".join(f"{c.name} {c.preload:g} N" for c in model.robot.cables)
    return Change(values, f"reference is now {', '.join(words)}; there the preloads are {preloads}")


def tare(
    model: Model,
    samples: Sequence[Sample],
    changed: Mapping[str, float],
    measured: Mapping[str, tuple[float, float]],
    readings: WaitingReadings,
) -> Change:
    """The change that makes the last sample the reference pose, or what sensors have shown of it.

    Args:
        model: the robot.
        samples: the last ones, at rest.
        changed: numbers of its file that were measured before, see ``narrowed``.
        measured: by sensors, see ``_shown_by_sensors``.
        readings: of sensors.

    Raises:
        UsageError: the robot is not at rest, or sensors contradict.
    """
    if reason := RestWatch(samples).in_motion(model.robot):
        raise UsageError(reason)
    sample = samples[-1]
    change = _shown_by_sensors(model, sample, measured)
    if not any(path.startswith("joints.") for path in change.values):
        pose = reference_at(model, sample)
        words = "; ".join(filter(None, (pose.words, change.words)))
        change = Change(pose.values | change.values, words)
    there = with_other_numbers(model, change.values)
    known = narrowed(there.robot, {**changed, **change.values})
    if reason := _contradiction(there, known, sample, readings):
        raise UsageError(reason)
    return change


def _shown_by_sensors(
    model: Model, sample: Sample, measured: Mapping[str, tuple[float, float]]
) -> Change:
    """Preloads and reference angles that sensors know better than whoever sets a pose by eye.

    Args:
        model: the robot.
        sample: of a pose that is said to be the reference pose.
        measured: changes of these numbers with their standard deviations, by path.

    Raises:
        UsageError: the pose is another one.
    """
    values, robot = dict[str, float](), model.robot
    read = dict(zip(model.layout.joints, sample.joint_angle.tolist(), strict=True))
    for path, (by, stddev) in measured.items():
        value = number_at(dict(robot.document), path) + by
        joint = path.removeprefix("joints.").removesuffix(".reference_angle")
        by_eye = POSITION_BY_EYE if joint in robot.prismatic_joints else ZERO_BY_EYE
        enough = by_eye / 2.0 if joint in read else SPRING_SCALE_NOW * value
        if stddev > enough or abs(by) < CLEARLY * stddev:
            continue
        values[path] = value
        if joint in read and abs(read[joint] - value) > CONTRADICTS * hypot(stddev, by_eye):
            raise UsageError(
                f"sensors show the reference pose at {joint} = {value:.4g}, but it reads "
                f"{read[joint]:.4g}: move it there, or ~/reset first if cables were mounted anew"
            )
    words = ", ".join(f"{path} = {value:.6g}" for path, value in values.items())
    return Change(values, f"by the sensors, {words}" if values else "")


def _contradiction(
    model: Model, known: Uncertainty | None, sample: Sample, readings: WaitingReadings
) -> str:
    """Why the latest readings of sensors contradict that a pose is the reference pose; or nothing.

    Args:
        model: the robot with this reference pose.
        known: standard deviations of its numbers.
        sample: of the pose.
        readings: of sensors.
    """
    recent = [
        one for one in readings.latest.values() if abs(one.stamp_ns - sample.stamp_ns) <= RECENT_NS
    ]
    if not recent:
        return ""
    ensemble = Ensemble(model, known=known)
    _, estimate = ensemble.step(initial_state(model), sample)
    assert estimate.stddev is not None
    values = estimate.values[ensemble.columns]
    for one in recent:
        sensor = readings.sensors[one.name]
        errors = (
            float(estimate.stddev[sensor.column]), sensor.stddev_of(one),
            SPRING_SCALE_NOW * sensor.scale,
        )  # fmt: skip
        expected, stddev = float(values[sensor.column]), hypot(*errors)
        if abs(one.value - expected) > CONTRADICTS * stddev:
            return (
                f"{sensor.title} reads {one.value:.4g} {sensor.unit}, where the preloads give "
                f"{expected:.4g} +- {stddev:.2g}: the pose is loaded, or preloads have changed "
                "(~/set_preload)"
            )
    return ""


def preloads_of(model: Model, preloads: Mapping[str, float]) -> Change:
    """The change that sets preloads of cables in the reference pose [N], by name.

    Raises:
        UsageError: an unknown cable or a tension out of range.
    """
    known = {cable.name: cable.preload for cable in model.robot.cables if not cable.rest_length}
    if not preloads:
        raise UsageError(f"name at least one cable of {', '.join(known)}")
    for name, value in preloads.items():
        if name not in known:
            raise UsageError(f"there is no cable {name!r}; there are {', '.join(known)}")
        if not 0.0 <= value < 1e6:
            raise UsageError(f"preload of {name} must be in [0, 1e6) N, got {value:g}")
    changed = [f"{n}: {known[n]:g} N, now {v:g} N" for n, v in preloads.items() if v != known[n]]
    return Change(
        {f"cables.{name}.preload": value for name, value in preloads.items()},
        f"preload of {'; '.join(changed)}" if changed else "preloads as before",
    )


def with_other_numbers(model: Model, values: Mapping[str, float]) -> Model:
    """The robot with some numbers of its file replaced, by path [SI].

    Raises:
        UsageError, RobotFileError: a value is invalid.
    """
    document = with_numbers(dict(model.robot.document), values)
    for path, value in values.items():
        if not abs(value) <= LARGEST:
            raise UsageError(f"{path} must be a finite number, got {value:g}")
    if not all(
        value in allowed_range(find_number(document, path).rules) for path, value in values.items()
    ):
        for complaint in document_complaints(document):
            raise UsageError(complaint)
    # friction leaves the geometry as it was when it was checked
    geometry = any("friction." not in path for path in values)
    return prepare(build_robot(document, model.robot.source), check_range=geometry)


class RestWatch:
    """Keeps the samples of the last ``REST_NS``: a tare in motion makes every tension wrong."""

    def __init__(self, samples: Iterable[Sample] = ()) -> None:
        """Take some samples."""
        self._samples: deque[Sample] = deque()
        """At most one sample per ``REST_STEP_NS``."""
        self._last: Sample | None = None
        for one in samples:
            self.add(one)

    def add(self, sample: Sample) -> None:
        """Take the next sample."""
        self._last = sample
        kept = self._samples
        if not kept or sample.stamp_ns - kept[-1].stamp_ns >= REST_STEP_NS:
            kept.append(sample)
            while len(kept) > 2 and sample.stamp_ns - kept[1].stamp_ns >= REST_NS:
                kept.popleft()

    def in_motion(self, robot: Robot) -> str:
        """Why the robot is not considered at rest: the axis, its movement and the allowed movement.

        Empty if every axis has stayed within its sensor's errors for ``REST_NS``.
        """
        samples = [*self._samples, *([self._last] if self._last else [])]
        watched = samples[-1].stamp_ns - samples[0].stamp_ns if samples else 0
        if watched < REST_NS:
            return (
                f"the axes must be at rest for {REST_NS * 1e-9:g} s; so far there are "
                f"readings of {watched * 1e-9:.3g} s"
            )
        angles = np.array([np.concatenate([one.motor_angle, one.joint_angle]) for one in samples])
        for axis, moved in zip(robot.axes, np.ptp(angles, axis=0), strict=True):
            stated = 4.0 * half_width(axis.sensor)
            allowed = stated or REST_FLOOR
            if not moved <= 1.001 * allowed:  # whole counts, but for rounding; not NaN
                unit = robot.unit_of(axis.name)
                key = "" if stated else ", or more with the sensor's resolution or noise stated"
                return (
                    f"not at rest: {axis.name} moved by {moved:.3g} {unit} within the last "
                    f"{watched * 1e-9:.2g} s, where {allowed:.3g} {unit} is allowed{key}"
                )
        return ""


def narrowed(robot: Robot, changed: Mapping[str, float]) -> Uncertainty | None:
    """The robot's uncertainty after reference angles, preloads and radii were measured.

    A tare reads the reference angles from the encoders: their errors become those of the encoders'
    zeros, ``offset``, as the geometry is evaluated at the reading in every pose.  A preload
    counts as read on a spring scale just now, a radius as measured by a calliper, unless it was
    known better.

    Args:
        robot: the robot with the changed numbers.
        changed: their values by path [SI].
    """
    known = robot.uncertainty
    if known is None or not changed:
        return known
    index = {path: k for k, path in enumerate(known.parameters)}
    covariance = known.covariance.copy()
    stated = [k < known.stated for k in index.values()]
    for path in sorted(changed.keys() & index.keys()):
        k, own = index[path], 0.0
        stddev = float(np.sqrt(known.covariance[k, k]))
        if path.endswith((".preload", ".radius")) and stddev > 0.0:
            now = CALLIPER if path.endswith(".radius") else SPRING_SCALE_NOW * changed[path]
            own = min(1.0, now / stddev)
        zero = index.get(path.replace(".reference_angle", ".offset"), k)
        for errors in (covariance, covariance.T):  # the number's own error is reduced or replaced
            errors[k] *= own
            if zero != k:
                errors[k] += errors[zero]
        if zero != k:
            stated[k] = stated[zero]
    order = sorted(index.values(), key=lambda k: not stated[k])
    return replace(
        known, parameters=tuple(known.parameters[k] for k in order),
        covariance=covariance[np.ix_(order, order)], stated=sum(stated),
    )  # fmt: skip
