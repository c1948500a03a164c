"""How well a robot file on its way knows its tensions, and what a recording would bring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.commands.commission_steps import Commissioned, fitted
from cdrj_ros.estimation.estimator import Estimate, Samples, initial_state, run
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.foundation.arrays import Series, Table
from cdrj_ros.foundation.output import ProgressBar
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.inspection.shares import DURATION_S, sweep
from cdrj_ros.model.packing import EFFORT, TENSION, channel_columns
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.groups import connected_cables, part_of
from cdrj_ros.robot.reader import build_robot

SWEEP_SAMPLES: Final = 2000
"""Samples of the motion by which a file is judged; 50 a second."""

KNOWN_FROM: Final = 0.25
"""Fraction of that motion after which it is judged: the friction history is unknown before."""


class Judged(NamedTuple):
    """How well a file knows the tensions, over a motion through the joints' ranges."""

    ok: float
    """Share of all tensions with status OK."""
    relative: Mapping[str, float]
    """Median of standard deviation over tension, by cable."""
    unsure: tuple[str, ...] = ()
    """Elements that are OK in less than half of the time."""


def judged(model: Model, efforts: Mapping[str, float] = MappingProxyType({})) -> Judged:
    """How well a file knows the tensions if it is right but for what it says of its accuracy.

    The estimator of the node reads what the sensors of such a robot would read.  Cables that are
    not connected are judged one group after the other, each as if it were the whole.

    Args:
        model: the robot.
        efforts: noise of those that it publishes, by motor [N m].
    """
    robot, ok, relative = model.robot, list[NDArray[np.bool_]](), dict[str, float]()
    unsure = set[str]()
    groups = connected_cables(robot)
    with ProgressBar("judging", len(groups)) as progress:
        for group in groups:
            own = model
            if len(groups) > 1:
                own = prepare(build_robot(part_of(robot, group), robot.source), check_range=False)
            read = {name: efforts[name] for name in own.layout.motors if name in efforts}
            known, deviation = _estimated(own, read)
            ok.append(known)
            unsure |= {own.layout.elements[k] for k in np.flatnonzero(known.mean(axis=0) < 0.5)}
            for cable, span in zip(own.robot.cables, own.robot.parts, strict=True):
                relative[cable.name] = float(np.median(deviation[:, span]))
            progress(len(ok))
    share, names = float(np.mean(np.hstack(ok))), [cable.name for cable in robot.cables]
    late = tuple(name for name in model.layout.elements if name in unsure)
    return Judged(share, {name: relative[name] for name in names}, late)


def _estimated(model: Model, efforts: Mapping[str, float]) -> tuple[NDArray[np.bool_], Table]:
    """Whether tensions are OK, and their relative deviations, shape (samples, elements) each."""
    elements = len(model.layout.elements)
    read = _made_up(model, _sweep(model), {f"{EFFORT}/{name}": efforts[name] for name in efforts})
    axes = {**read.motors, **read.joints}
    angles = np.stack([one.value for one in axes.values()], axis=1)
    heard = np.array([one.value for one in read.references.values()])
    estimator, made = LiveEstimator(model), list[Estimate]()
    for k, stamp in enumerate(next(iter(axes.values())).stamp_ns.tolist()):
        if efforts:
            estimator.feed_efforts(stamp, [*efforts], heard[:, k])
        made += estimator.feed("both", stamp, list(axes), angles[k])[1]
    after = made[round(KNOWN_FROM * len(made)) :]
    tension = np.stack([one.tension for one in after])
    ok = np.stack([one.values[elements : 2 * elements] for one in after]) == 0.0
    stddev = np.stack([one.stddev for one in after if one.stddev is not None])[:, :elements]
    return ok, stddev / np.maximum(tension, 1e-9)


def _sweep(model: Model) -> Samples:
    motors, joints = sweep(model, SWEEP_SAMPLES)
    stamps = round(DURATION_S / SWEEP_SAMPLES * 1e9) * np.arange(1, SWEEP_SAMPLES + 1)
    return Samples(stamps, np.ascontiguousarray(motors), np.ascontiguousarray(joints))


def foretold(now: Commissioned, step: str) -> Judged:
    """What a recording in motion would bring if the file were right but for its accuracy.

    Args:
        now: the file.
        step: ``motion``, or ``cells``.
    """
    model, heard = now.model, now.heard
    noise = {f"{EFFORT}/{one.name}": one.effort_noise for one in model.robot.motors}
    noise |= {f"{EFFORT}/{name}": read for name, read in heard.items()}
    if step == "cells":
        cable = model.robot.cables[0]
        noise[f"{TENSION}/{cable.element_names[-1]}"] = cable.sensor_noise
    right = replace(now, base=now.text, fits=(), recordings=())
    after = fitted(right, [_made_up(model, _sweep(model), noise)])
    return judged(after.model, {**after.heard, **heard})


def _made_up(model: Model, samples: Samples, noise: Mapping[str, float]) -> Recorded:
    """What encoders and other sensors, given by their noise, would read if the file were right."""
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
