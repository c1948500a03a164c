"""How well a robot file on its way knows its tensions, and what a step would bring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from cdrj_ros._core import mark_unsure
from cdrj_ros.commands.commission_steps import (
    READING,
    Commissioned,
    drums_measured,
    fitted,
    preloaded,
)
from cdrj_ros.estimation.changes import narrowed
from cdrj_ros.estimation.ensemble import UNSURE_SHARE, Ensemble, preload_of_elements
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.identification.observations import Recorded, samples_of
from cdrj_ros.identification.unknowns import drum_radii
from cdrj_ros.inspection.shares import DURATION_S, sweep
from cdrj_ros.model.packing import EFFORT, TENSION, channel_columns
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Uncertainty
from cdrj_ros.robot.parameters import find_number

SWEEP_SAMPLES: Final = 2000
"""Samples of the motion by which a file is judged; 50 a second."""

KNOWN_FROM: Final = 0.25
"""Fraction of that motion after which it is judged: the friction history is unknown before."""

CELL_NOISE: Final = 0.1
"""Standard deviation of the load cell whose benefit is foretold [N]."""


class Judged(NamedTuple):
    """How well a file knows the tensions, over a motion through the joints' ranges."""

    ok: float
    """Share of all tensions with status OK."""
    relative: Mapping[str, float]
    """Median of standard deviation over tension, by cable."""


def judged(model: Model, known: Uncertainty | None = None) -> Judged:
    """How well a file knows the tensions.

    Args:
        model: the robot.
        known: standard deviations of its numbers; None: those of the file.
    """
    samples = _sweep(model)
    _, found = Ensemble(model, known=known).run(initial_state(model), samples)
    stddev = found.stddev
    assert stddev is not None
    values = found.values
    preload = preload_of_elements(model.robot)
    mark_unsure(model.core, values, preload, stddev, UNSURE_SHARE, samples.doubtful)
    after = slice(round(KNOWN_FROM * len(values)), None)
    tension = values[after, model.layout.tension]
    status = values[after, tension.shape[1] : 2 * tension.shape[1]]
    relative = stddev[after, : tension.shape[1]] / np.maximum(tension, 1e-9)
    cables = np.repeat(
        [cable.name for cable in model.robot.cables],
        [len(cable.element_names) for cable in model.robot.cables],
    )
    return Judged(
        float(np.mean(status == 0.0)),
        {
            cable.name: float(np.median(relative[:, cables == cable.name]))
            for cable in model.robot.cables
        },
    )


def _sweep(model: Model) -> Samples:
    motors, joints = sweep(model, SWEEP_SAMPLES)
    stamps = round(DURATION_S / SWEEP_SAMPLES * 1e9) * np.arange(1, SWEEP_SAMPLES + 1)
    return Samples(stamps, np.ascontiguousarray(motors), np.ascontiguousarray(joints))


def foretold(now: Commissioned, step: str) -> Judged:
    """What a step would bring if the file were right but for what it says of its accuracy.

    Args:
        now: the file.
        step: ``rest``, ``preload``, ``drum``, ``motion`` or ``cells``.
    """
    robot = now.model.robot
    if step == "rest":
        numbers = [f"joints.{joint.name}.reference_angle" for joint in robot.joints]
        return judged(now.model, narrowed(robot, dict.fromkeys(numbers, 0.0)))
    if step == "preload":
        return judged(preloaded(now, _scale_made_up(now)).model)
    if step == "drum":
        document: Any = robot.document
        sizes = {motor: 2.0 * find_number(document, paths[0]).value
                 for motor, paths in drum_radii(document).items()}  # fmt: skip
        return judged(drums_measured(now, sizes).model)
    noise = {f"{EFFORT}/{motor.name}": motor.effort_noise for motor in robot.motors}
    if step == "cells":
        noise[f"{TENSION}/{robot.cables[0].element_names[-1]}"] = CELL_NOISE
    right = replace(now, text=now.base, fits=(), recordings=())
    if any(one.scales for one in now.recordings):
        right = preloaded(right, _scale_made_up(right))
    return judged(fitted(right, [_made_up(right.model, noise)]).model)


def _scale_made_up(now: Commissioned) -> list[dict[str, float]]:
    """What a spring scale would read at the last element of every cable."""
    cables = now.model.robot.cables
    readings = [{cable.name: cable.preload for cable in cables}]
    if now.rest is None or len(now.poses) < 2:
        return readings
    samples = samples_of(now.model, now.rest)
    _, estimates = run(now.model, initial_state(now.model), samples)
    columns, generator = channel_columns(now.model.layout), np.random.default_rng(0)
    for pose in now.poses[1:]:
        values = estimates.values[int(np.searchsorted(samples.stamp_ns, pose.stamp_ns))]
        ends = [cable.element_names[-1] for cable in cables]
        true = {end: float(values[columns[f"{TENSION}/{end}"]]) for end in ends}
        errors = generator.normal(1.0, READING, len(ends)).tolist()
        readings.append({end: true[end] * one for end, one in zip(ends, errors, strict=True)
                         if true[end] > 0.0})  # fmt: skip
    return readings


def _made_up(model: Model, noise: Mapping[str, float]) -> Recorded:
    """What encoders and other sensors, given by their noise, would read if the file were right."""
    samples = _sweep(model)
    _, estimates = run(model, initial_state(model), samples)
    columns, generator = channel_columns(model.layout), np.random.default_rng(0)
    stamps = samples.stamp_ns
    references = {
        name: Series(
            stamps,
            stamps,
            estimates.values[:, columns[name]] + generator.normal(0.0, stddev, stamps.size),
        )
        for name, stddev in noise.items()
    }
    series = {}
    angles = np.hstack([samples.motor_angle, samples.joint_angle])
    for axis, angle in zip(model.robot.axes, angles.T, strict=True):
        sensor = axis.sensor
        reading = (angle - sensor.offset) / sensor.scale
        reading += generator.normal(0.0, sensor.noise, stamps.size)
        if sensor.resolution:
            reading = np.round(reading / sensor.resolution) * sensor.resolution
        series[axis.name] = Series(stamps, stamps, reading)
    motors = {motor.name: series[motor.name] for motor in model.robot.motors}
    joints = {joint.name: series[joint.name] for joint in model.robot.joints}
    return Recorded("made up", motors, joints, references)
