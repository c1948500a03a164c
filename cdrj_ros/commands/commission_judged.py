"""How well a robot file on its way knows its tensions, and what a recording would bring.

The node's estimator reads a recording in motion, or what the sensors of a robot would read that is
as the file says, but for friction of its motors, while all joints move through their ranges.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from math import ceil, inf
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import mark_unsure
from cdrj_ros.commands.commission_steps import Commissioned, Measured, commissioned
from cdrj_ros.estimation.ensemble import UNSURE_SHARE
from cdrj_ros.estimation.estimator import NO_DOUBTS, Estimate, Samples, initial_state, run
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.foundation.arrays import Series, Table
from cdrj_ros.foundation.output import ProgressBar
from cdrj_ros.identification.observations import Recorded, samples_of
from cdrj_ros.identification.parts import parts_of
from cdrj_ros.inspection.shares import sweep
from cdrj_ros.model.packing import EFFORT, OK, TENSION, channel_columns
from cdrj_ros.model.prepared import Model, of_cables
from cdrj_ros.robot.groups import connected_cables
from cdrj_ros.simulation.sensors import reading_of

SAMPLE_NS: Final = 20_000_000
"""Between two samples of the motion, if those of the robot are not known or further apart [ns]."""

LEAST_NS: Final = 5_000_000
"""The least that counts: with a fifth of it the shares are the same."""

SWEEP_NS: Final = 5_000_000_000
"""Time of two cycles of the first joint, if half of ``max_speed`` allows it: slower motions know
more of what friction does."""

SWEEPS: Final = 8
"""The motion lasts 40 s at least."""

KNOWN_FROM: Final = 0.25
"""Fraction of that motion after which it is judged: the friction history is unknown before."""

DIFFERS: Final = 1.15
"""Factor by which standard deviations may differ from those foretold: on random motions of twenty
fingers that were not as their files say, half of them recorded with one joint at rest."""


class Judged(NamedTuple):
    """How well a file knows the tensions, over a motion through the joints' ranges."""

    ok: float
    """Share of all tensions with status OK."""
    between: tuple[float, float]
    """The same with standard deviations ``DIFFERS`` times as large, and as small."""
    relative: Mapping[str, float]
    """Median of standard deviation over tension, by cable; infinite if it is mostly slack."""
    unsure: tuple[str, ...] = ()
    """Elements that are OK in less than half of the time."""


def judged(
    model: Model,
    efforts: Mapping[str, float] = MappingProxyType({}),
    interval_ns: float = inf,
    recorded: Recorded | None = None,
) -> Judged:
    """How well a file knows the tensions if it is right but for what it says of its accuracy.

    Cables that are not connected are judged one group after the other, each as if it were the whole
    robot.

    Args:
        model: the robot.
        efforts: noise of those that it publishes, by motor [N m].
        interval_ns: between its readings; those less than ``SAMPLE_NS`` apart tell more of counts.
        recorded: a motion of the robot; None for one through the joints' ranges, as if the file
            were right.
    """
    between = round(min(max(interval_ns, LEAST_NS), SAMPLE_NS))
    robot, ok, relative = model.robot, list[NDArray[np.bool_]](), dict[str, float]()
    groups = connected_cables(robot)
    share = dict[str, float]()
    with ProgressBar("judging", len(groups)) as progress:
        for group in groups:
            own = of_cables(model, group)
            noise = {f"{EFFORT}/{n}": efforts[n] for n in own.layout.motors if n in efforts}
            if recorded is None:
                read = _made_up(own, noise, between)
            else:
                read = _thinned(own, recorded, noise, between)
            known, deviation = _estimated(own, read)
            ok.append(known)
            share |= zip(own.layout.elements, known[1].mean(axis=0).tolist(), strict=True)
            for cable, span in zip(own.robot.cables, own.robot.parts, strict=True):
                relative[cable.name] = float(np.median(deviation[:, span]))
            progress(len(ok))
    least, middle, most = np.concatenate(ok, axis=2).mean(axis=(1, 2)).tolist()
    return Judged(
        middle, (least, most), {cable.name: relative[cable.name] for cable in robot.cables},
        tuple(name for name in model.layout.elements if share[name] < 0.5),
    )  # fmt: skip


def _thinned(
    model: Model, recorded: Recorded, channels: Collection[str], interval_ns: int
) -> Recorded:
    """A recording of a part of its axes and references, whose readings are so far apart."""

    def some(every: Mapping[str, Series], names: Iterable[str]) -> dict[str, Series]:
        found = {}
        for name in names:
            usual_ns = float(np.median(np.diff(every[name].stamp_ns)))
            found[name] = every[name].part(slice(None, None, max(1, round(interval_ns / usual_ns))))
        return found

    layout = model.layout
    joints = [one for one in layout.joints if one in recorded.joints]
    references = [one for one in channels if one in recorded.references]
    return replace(
        recorded,
        motors=some(recorded.motors, layout.motors),
        joints=some(recorded.joints, joints),
        references=some(recorded.references, references),
    )


def _estimated(model: Model, read: Recorded) -> tuple[NDArray[np.bool_], Table]:
    """Whether tensions are OK, with three sizes of their deviations, and the relative deviations.

    Args:
        model: the robot.
        read: its readings and, as references, efforts of motors.

    Returns:
        Shape (3, samples, elements) and (samples, elements).
    """
    elements = len(model.layout.elements)
    estimator, made = LiveEstimator(model, Options(unsure_share=np.inf)), list[Estimate]()
    samples = samples_of(model, read)
    places = [
        np.searchsorted(one.stamp_ns, samples.stamp_ns, "right") for one in read.references.values()
    ]
    for k in range(samples.stamp_ns.size):
        for (name, series), place in zip(read.references.items(), places, strict=True):
            if place[k] > (place[k - 1] if k else 0):
                at = place[k] - 1
                motor = name.removeprefix(f"{EFFORT}/")
                estimator.feed_efforts(int(series.stamp_ns[at]), [motor], series.value[at : at + 1])
        made.append(estimator.take(samples.at(k)))
    after = made[round(KNOWN_FROM * len(made)) :]
    stddev = np.stack([one.stddev for one in after if one.stddev is not None])
    ok = []
    for factor in (DIFFERS, 1.0, 1.0 / DIFFERS):
        values = np.stack([one.values for one in after])
        mark_unsure(model.core, values, factor * stddev, UNSURE_SHARE, NO_DOUBTS)
        ok.append(values[:, model.layout.status] == OK)
    tension = np.stack([one.tension for one in after])
    relative = np.full(tension.shape, np.inf)
    np.divide(stddev[:, :elements], tension, out=relative, where=tension > 0.0)
    return np.array(ok), relative


def foretold(now: Commissioned, step: str) -> Judged:
    """What a recording in motion would bring if the file were right but for its accuracy.

    Args:
        now: the file.
        step: ``motion``, or ``cells``: one in the first cable, which helps those fitted with it.
    """
    model, heard = now.model, now.heard
    noise = {f"{EFFORT}/{one.name}": one.effort_noise for one in model.robot.motors}
    noise |= {f"{EFFORT}/{name}": read for name, read in heard.items()}
    if step == "cells":
        cable = model.robot.cables[0]
        cell = f"{TENSION}/{cable.element_names[-1]}"
        noise[cell] = cable.sensor_noise
        own = next(part.channels for part in parts_of(model.robot) if cell in part.channels)
        noise = {name: size for name, size in noise.items() if name in own}
    after = commissioned(now.text, now.source, Measured(motion=[_made_up(model, noise)]))
    return judged(after.model, {**after.heard, **heard}, now.interval_ns)


def _made_up(model: Model, noise: Mapping[str, float], interval_ns: int = SAMPLE_NS) -> Recorded:
    """What encoders and other sensors, given by their noise, would read if the file were right."""
    samples = round(SWEEP_NS / interval_ns)
    fastest = np.abs(np.diff(np.hstack(sweep(model, samples + 1)), axis=0)).max(axis=0)
    allowed = 0.5 * interval_ns * 1e-9 * np.array([axis.max_speed for axis in model.robot.axes])
    slower = max(1.0, float((fastest / allowed).max()))
    cycles = sweep(model, round(slower * samples) + 1)  # whose last pose is the first one
    repeated = ceil(SWEEPS / slower)
    motor_angle, joint_angle = (np.tile(one[:-1], (repeated, 1)) for one in cycles)
    stamps = interval_ns * np.arange(1, len(joint_angle) + 1)
    swept = Samples(stamps, motor_angle, joint_angle)
    _, estimates = run(model, initial_state(model), swept)
    columns, generator = channel_columns(model.layout), np.random.default_rng(0)
    references = {
        name: Series(
            stamps,
            stamps,
            estimates.values[:, columns[name]] + generator.normal(0.0, stddev, stamps.size),
        )
        for name, stddev in noise.items()
    }
    series = {}
    for axis, angle in zip(model.robot.axes, np.hstack([motor_angle, joint_angle]).T, strict=True):
        sensor = axis.sensor
        reading = reading_of(sensor, angle)
        reading += generator.normal(0.0, sensor.noise, stamps.size)
        if sensor.resolution:
            reading = np.round(reading / sensor.resolution) * sensor.resolution
        series[axis.name] = Series(stamps, stamps, reading)
    robot = model.robot
    motors, joints = (
        {one.name: series[one.name] for one in some} for some in (robot.motors, robot.joints)
    )
    return Recorded("made up", motors, joints, references)
