"""The steps from a new robot file to one whose tensions are known, each by a cheap measurement.

A step changes the text of the robot file: its numbers, their standard deviations and where they
come from.  A fit starts from the file as it was before the first fit, with all recordings so far,
so that no recording counts twice.  docs/commission.md.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from itertools import chain
from typing import Any, Final, NamedTuple

import numpy as np

from cdrj_ros import __version__
from cdrj_ros._core import mark_unsure
from cdrj_ros.commands.identify_uncertainty import (
    COVARIANCE_LIMIT,
    fit_errors,
    stated_lines,
    uncertainty_section,
)
from cdrj_ros.estimation.changes import (
    CALLIPER,
    SPRING_SCALE_NOW,
    RestWatch,
    narrowed,
    preloads_of,
    reference_at,
)
from cdrj_ros.estimation.ensemble import UNSURE_SHARE, Ensemble, preload_of_elements
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Sample, Samples
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.fit import Identification, identify
from cdrj_ros.identification.nuisance import nuisance_causes
from cdrj_ros.identification.observations import Recorded, samples_of
from cdrj_ros.identification.priors import unknown_causes
from cdrj_ros.identification.problem import Progress, Settings
from cdrj_ros.identification.unknowns import Unknown
from cdrj_ros.inspection.shares import DURATION_S, sweep, tension_effects
from cdrj_ros.model.prepared import EFFORT, TENSION, Model, channel_columns, prepare
from cdrj_ros.robot.description import Robot, Uncertainty, Winch
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.writer import number_of_urdf, with_numbers_in_text, with_section, yaml_number

SWEEP_SAMPLES: Final = 2000
"""Samples of the motion by which a file is judged; 50 a second."""

FIT_SAMPLES: Final = 6000
"""Samples to which those of all recordings are thinned, if that leaves 100 per second."""

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


@dataclass(frozen=True)
class Commissioned:
    """A robot file on its way, and what has led there."""

    source: str
    base: str
    """Text with what was measured without a fit."""
    text: str
    """Text with everything."""
    origins: Mapping[str, str] = field(default_factory=dict)
    """Where numbers come from, by path."""
    recordings: tuple[Recorded, ...] = ()
    """All that were fitted."""
    found: Identification | None = None

    @property
    def model(self) -> Model:
        """The prepared robot of the text."""
        return prepare(parse_robot(self.text, self.source))


def begin(text: str, source: str) -> Commissioned:
    """A robot file of which nothing was measured."""
    text = with_section(text, "residual", None)  # it was learned with the numbers as they were
    return Commissioned(source, text, text)


def tared(now: Commissioned, recorded: Recorded) -> Commissioned:
    """The file after a tare: the pose of a recording at rest is the reference.

    Raises:
        UsageError: the robot moved.
    """
    model = now.model
    samples = samples_of(model, recorded)
    watch = RestWatch()
    for k in range(samples.stamp_ns.size):
        watch.add(samples.at(k))
        if k % 1000 == 999 and (reason := watch.in_motion(model.robot)):
            raise UsageError(f"{recorded.name}: {reason}")
    if reason := watch.in_motion(model.robot):
        raise UsageError(f"{recorded.name}: {reason}")
    mean = Sample(
        int(samples.stamp_ns[-1]),
        samples.motor_angle.mean(axis=0),
        samples.joint_angle.mean(axis=0),
    )
    values = reference_at(model, mean).values
    names = [joint.name for joint in model.robot.joints if joint.measured]
    paths = [f"joints.{name}.{key}" for name in names for key in ("offset", "reference_angle")]
    return _measured(now, values, paths, f"tare, {recorded.name}")


def preloaded(now: Commissioned, preloads: Mapping[str, float]) -> Commissioned:
    """The file after the preloads of some cables were read on a spring scale [N].

    Raises:
        UsageError: there is no such cable, or a value is out of range.
    """
    values = preloads_of(now.model, preloads).values
    return _measured(now, values, list(values), f"spring scale, {SPRING_SCALE_NOW:.0%}")


def drums_measured(now: Commissioned, diameters: Mapping[str, float]) -> Commissioned:
    """The file after the drums of some motors were measured by a calliper.

    Args:
        now: the file.
        diameters: from middle to middle of the wound cable [m], by motor.

    Raises:
        UsageError: no drum belongs to such a motor.
    """
    drums = _drums(now.model.robot)
    if unknown := [name for name in diameters if name not in drums]:
        raise UsageError(f"there is no drum of {unknown[0]!r}; there are {', '.join(drums)}")
    values = {path: 0.5 * size for name, size in diameters.items() for path in drums[name]}
    return _measured(now, values, list(values), f"calliper, {1e3 * CALLIPER:g} mm")


def _drums(robot: Robot) -> dict[str, list[str]]:
    """Paths of the radii of all drums, by motor."""
    found: dict[str, list[str]] = {}
    for cable in robot.cables:
        for k, node in enumerate(cable.nodes):
            if isinstance(node, Winch):
                path = f"cables.{cable.name}.nodes.{k + 1}.radius"
                found.setdefault(node.motor, []).append(path)
    return found


def _measured(
    now: Commissioned, values: Mapping[str, float], paths: Sequence[str], origin: str
) -> Commissioned:
    """The file with numbers that were measured, and what their standard deviations are now."""
    if now.found is not None:
        raise UsageError("tare, spring scale and calliper come before the recordings to fit")
    robot = now.model.robot
    text = with_numbers_in_text(now.base, values, now.source)
    known = narrowed(robot, values)
    if known is not None:
        text = with_section(text, "uncertainty", _stated(robot, known, paths))
    origins = {**now.origins, **dict.fromkeys(values, origin)}
    return replace(now, base=text, text=text, origins=origins)


def _stated(robot: Robot, known: Uncertainty, paths: Sequence[str]) -> str:
    """The block ``uncertainty`` with what it stated before and some numbers more."""
    before: dict[str, Any] = dict(robot.document.get("uncertainty", {}))
    there = set(known.parameters)
    names = [*before.get("parameters", ()), *(path for path in paths if path in there)]
    names = list(dict.fromkeys(names))
    at = [known.parameters.index(name) for name in names]
    covariance = known.covariance[np.ix_(at, at)]
    stddev = np.sqrt(np.diag(covariance))
    safe = np.where(stddev > 0.0, stddev, 1.0)
    correlation = covariance / np.outer(safe, safe)
    np.fill_diagonal(correlation, 1.0)
    head = [f"  {key}: {before[key]}" for key in ("others", "drums") if key in before]
    return "\n".join(["uncertainty:", *head, *stated_lines(names, stddev.tolist(), correlation)])


def unknowns_of(robot: Robot, text: str) -> tuple[Unknown, ...]:
    """All causes of error, each with what is known of it, those that move the tensions most first.

    A robot file can hold the covariance of ``COVARIANCE_LIMIT`` numbers; the rest has the least
    effect, and is left as it is, as are the numbers of a URDF.

    Args:
        robot: the robot.
        text: of its file.

    Raises:
        UsageError: all numbers are exact.
    """
    document: Any = robot.document
    causes = [
        cause
        for cause in nuisance_causes(robot.uncertainty, ())
        if not any(number_of_urdf(text, path) for path in cause)
    ]
    if not causes:
        raise UsageError("the robot file says that all its numbers are exact")
    effect = (tension_effects(prepare(robot), causes) ** 2).mean(axis=(1, 2))
    chosen: list[Mapping[str, float]] = []
    for k in np.argsort(-effect).tolist():
        if sum(map(len, chosen)) + len(causes[k]) <= COVARIANCE_LIMIT:
            chosen.append(causes[k])
    return unknown_causes(document, chosen)


def fitted(
    now: Commissioned, recorded: Sequence[Recorded], say: Progress | None = None
) -> Commissioned:
    """The file after a fit to all recordings so far and some more.

    Raises:
        UsageError: there is nothing to fit to.
    """
    recordings = (*now.recordings, *recorded)
    robot = parse_robot(now.base, now.source)
    unknowns = unknowns_of(robot, now.base)
    if now.found is not None:  # where the last fit ended; the priors stay
        last = dict(zip((u.paths for u in now.found.unknowns), now.found.values, strict=True))
        unknowns = tuple(replace(u, start=float(last.get(u.paths, u.start))) for u in unknowns)
    found, text = _fit(now, robot, unknowns, recordings, say)
    names = ", ".join(one.name for one in recordings)
    origins = {**now.origins, **dict.fromkeys(found.by_path, f"fit to {names}")}
    return replace(now, text=text, origins=origins, recordings=recordings, found=found)


def _fit(
    now: Commissioned,
    robot: Robot,
    unknowns: tuple[Unknown, ...],
    recordings: Sequence[Recorded],
    say: Progress | None,
) -> tuple[Identification, str]:
    """A fit from the file before the first one, and the text of the new file."""
    there = {name for one in recordings for name in one.references}
    wanted = tuple(name for name in sorted(there) if name.startswith((EFFORT, TENSION)))
    settings = Settings(
        wanted, weights="noise", coarse=True, samples=FIT_SAMPLES, compares_drums=True
    )
    document: Any = robot.document
    found = identify(document, now.source, unknowns, recordings, settings, say)
    values = {path: float(yaml_number(value)) for path, value in found.by_path.items()}
    text = with_numbers_in_text(now.base, values, now.source)
    before = dict(document.get("uncertainty", {}))
    block = uncertainty_section(found, before, fit_errors(found))
    return found, with_section(text, "uncertainty", block)


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
    mark_unsure(values, preload, stddev, UNSURE_SHARE, samples.doubtful)
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
    model = now.model
    robot = model.robot
    numbers = {
        "rest": {f"joints.{j.name}.reference_angle": j.reference_angle for j in robot.joints},
        "preload": {f"cables.{cable.name}.preload": cable.preload for cable in robot.cables},
        "drum": dict.fromkeys(chain.from_iterable(_drums(robot).values()), 0.0),
    }
    if step in numbers:
        return judged(model, narrowed(robot, numbers[step]))
    noise = {f"{EFFORT}/{motor.name}": motor.effort_noise for motor in robot.motors}
    if step == "cells":
        noise[f"{TENSION}/{robot.cables[0].element_names[-1]}"] = CELL_NOISE
    base = parse_robot(now.base, now.source)
    _, text = _fit(now, base, unknowns_of(base, now.base), [_made_up(prepare(base), noise)], None)
    return judged(prepare(parse_robot(text, now.source)))


def _made_up(model: Model, noise: Mapping[str, float]) -> Recorded:
    """What encoders and other sensors, given by their noise, would read if the file were right."""
    samples = _sweep(model)
    _, estimates = run(model, initial_state(model), samples)
    columns, generator = channel_columns(model.layout), np.random.default_rng(0)
    stamps = samples.stamp_ns
    references = {
        name: (
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


def provenance(now: Commissioned) -> str:
    """The entry ``identified`` of the robot file: where its numbers come from."""
    return "\n".join(
        [
            "identified:                     # origin of the numbers",
            f"  date: {datetime.now(timezone.utc):%Y-%m-%d}",
            f"  tool: cdrj_ros {__version__} commission",
            "  numbers:",
            *(f"    {path}: {json.dumps(origin)}" for path, origin in now.origins.items()),
        ]
    )
