"""The robot file that follows from what was measured of a new robot.

All measurements so far lead to the file at once: numbers that were measured are written, and all
that is left is fitted to all recordings, so that none counts twice.  docs/commission.md.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from functools import cached_property, lru_cache
from math import inf
from typing import Any, Final

import numpy as np

from cdrj_ros import __version__
from cdrj_ros.estimation.changes import narrowed, preloads_of, reference_at
from cdrj_ros.estimation.conditioner import count_of
from cdrj_ros.estimation.estimator import Sample
from cdrj_ros.foundation.errors import RobotFileError, UsageError
from cdrj_ros.identification.entries import uncertainty_section
from cdrj_ros.identification.observations import Recorded, noise_of, samples_of
from cdrj_ros.identification.parts import PartFit, fit_parts, section_of
from cdrj_ros.identification.poses import Readings, rest_poses, scale_readings
from cdrj_ros.identification.problem import refuse_hidden
from cdrj_ros.model.packing import EFFORT
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.couplings import drum_radii
from cdrj_ros.robot.description import Robot, Uncertainty
from cdrj_ros.robot.names import known_name
from cdrj_ros.robot.parameters import find_number
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.stated import stated_numbers, with_covariance
from cdrj_ros.robot.tolerances import CALLIPER, SCALE_READING, SPRING_SCALE_NOW
from cdrj_ros.robot.writer import with_numbers_in_text, with_section, yaml_number

BACK: Final = (1.0, 0.9999, 0.999, 0.99)
"""Shares of the changes by a fit that are tried until they make a possible robot."""


@dataclass(frozen=True)
class Measured:
    """What was measured of a robot, in the order in which it is used."""

    rest: Recorded | None = None
    """The tare: begins at rest in the reference pose; may go on to further poses."""
    preload: Sequence[Readings] = ()
    """Of a spring scale: by cable in the reference pose, by element in every further one."""
    drum: Mapping[str, float] = field(default_factory=dict)
    """Diameters from middle to middle of the wound cable [m], by motor."""
    motion: Sequence[Recorded] = ()
    """With efforts of the motors."""
    cells: Sequence[Recorded] = ()
    """With load cells."""

    @property
    def recorded(self) -> list[Recorded]:
        """All recordings; that of the tare last."""
        return [one for one in (*self.motion, *self.cells, self.rest) if one]


@dataclass(frozen=True)
class Commissioned:
    """A robot file on its way, and what has led there."""

    fresh: str
    """Text of which nothing was measured."""
    source: str
    measured: Measured
    base: str
    """Text with what was measured without a fit."""
    text: str
    """Text with everything."""
    origins: Mapping[str, str]
    """Where numbers come from, by path."""
    fits: tuple[PartFit, ...]
    """Of every part of the robot that has references."""
    poses: tuple[Sample, ...]
    """Those in which the robot rests in the tare, the reference pose first."""

    def also(self, **more: Any) -> Commissioned:
        """The file after further measurements; recordings are added to those before.

        Args:
            more: values of ``Measured``, by name.

        Raises:
            UsageError: a measurement does not belong to the robot, or there is nothing to fit to.
        """
        for name in more.keys() & {"motion", "cells"}:
            more[name] = (*getattr(self.measured, name), *more[name])
        return commissioned(self.fresh, self.source, replace(self.measured, **more))

    @cached_property
    def model(self) -> Model:
        """The prepared robot of the text."""
        return prepare(parse_robot(self.text, self.source))

    @property
    def unfitted(self) -> Model:
        """The prepared robot without what fits have found."""
        return prepare(parse_robot(self.base, self.source))

    @property
    def interval_ns(self) -> float:
        """Usual time between two readings; infinite if nothing was recorded."""
        for one in self.measured.recorded:
            read = next(iter({**one.motors, **one.joints}.values()))
            return float(np.median(np.diff(read.stamp_ns)))
        return inf

    @cached_property
    def heard(self) -> dict[str, float]:
        """Noise of the efforts that the robot publishes, as they were recorded [N m], by motor."""
        found = {}
        for motor in self.model.layout.motors:
            name = f"{EFFORT}/{motor}"
            if read := [
                one.references[name] for one in self.measured.recorded if name in one.references
            ]:
                found[motor] = max(noise_of(one.value) for one in read)
        return found


def begin(text: str, source: str) -> Commissioned:
    """A robot file of which nothing was measured.

    Raises:
        UsageError: the robot has joints without encoder.
    """
    refuse_hidden(parse_robot(text, source))
    text = with_section(text, "residual", None)  # it was learned with the numbers as they were
    return commissioned(text, source, Measured())


def commissioned(fresh: str, source: str, measured: Measured) -> Commissioned:
    """The file after all measurements.

    Args:
        fresh: text of a file of which nothing was measured.
        source: its name.
        measured: the measurements.

    Raises:
        UsageError: one does not belong to the robot, or there is nothing to fit to.
    """
    recordings = [*measured.motion, *measured.cells]
    counts = _counts(parse_robot(fresh, source), measured.recorded)
    text = with_numbers_in_text(fresh, counts, source)
    robot = parse_robot(text, source)
    origins = dict.fromkeys(counts, "counts of the readings")
    poses: tuple[Sample, ...] = ()

    def write(values: Mapping[str, float], origin: str, *paths: str) -> str:
        origins.update(dict.fromkeys(values, origin))
        return _written(text, source, tuple(values.items()), paths or tuple(values))

    if measured.rest:
        model = prepare(robot)
        poses = rest_poses(robot, samples_of(model, measured.rest), measured.rest.name)
        values = reference_at(model, poses[0]).values
        zeros = [f"joints.{joint.name}" for joint in robot.joints]
        paths = [f"{name}.{key}" for name in zeros for key in ("offset", "reference_angle")]
        text = write(values, f"tare, {measured.rest.name}", *paths)
    if measured.preload:
        preloads, weighed = scale_readings(robot, measured.rest, poses, measured.preload)
        values = preloads_of(prepare(robot), preloads).values
        text = write(values, f"spring scale, {SPRING_SCALE_NOW:.1%}")
        recordings = [*weighed, *recordings]
    if measured.drum:
        text = write(_radii(robot, measured.drum), f"calliper, {1e3 * CALLIPER:g} mm")
    base, fits = text, tuple[PartFit, ...]()
    if recordings:
        robot = parse_robot(base, source)
        fits = fit_parts(robot, base, recordings)
        values = {path: value for one in fits for path, value in one.values.items()}
        names = ", ".join(one.name for one in recordings)
        origins.update(dict.fromkeys(values, f"fit to {names}"))
        text = _with_fitted(base, robot, values)
        text = with_section(text, "uncertainty", section_of(robot, fits))
    return Commissioned(fresh, source, measured, base, text, origins, fits, poses)


def _counts(robot: Robot, recordings: Sequence[Recorded]) -> dict[str, float]:
    """Resolutions that readings show and the file does not state, by path [as published]."""
    found = {}
    for kind, axes in (("motors", robot.motors), ("joints", robot.joints)):
        for axis in axes:
            read = [getattr(one, kind)[axis.name].value for one in recordings]
            if read and not axis.sensor.resolution and (count := count_of(np.concatenate(read))):
                found[f"{kind}.{axis.name}.resolution"] = count
    return found


@lru_cache(maxsize=8)
def _written(
    text: str, source: str, items: tuple[tuple[str, float], ...], paths: tuple[str, ...]
) -> str:
    """The text with numbers that were measured, and what is known of some numbers then."""
    values = dict(items)
    text = with_numbers_in_text(text, values, source)
    robot = parse_robot(text, source)
    known = narrowed(robot, values)
    if known is None:
        return text
    known = _of_one_scale(known, values)
    before: dict[str, Any] = dict(robot.document.get("uncertainty", {}))
    names = dict.fromkeys([*stated_numbers(before).paths, *paths])
    at = [known.parameters.index(name) for name in names if name in known.parameters]
    own = [known.parameters[k] for k in at]
    numbers = with_covariance(own, known.covariance[np.ix_(at, at)])
    return with_section(text, "uncertainty", uncertainty_section(numbers, before, {}, {}))


def _radii(robot: Robot, diameters: Mapping[str, float]) -> dict[str, float]:
    """Radii of drums by path [m] from their diameters by motor.

    Raises:
        UsageError: no drum belongs to such a motor.
    """
    document = dict(robot.document)
    drums = drum_radii(document)
    for several in [
        name for name in drums if " and " in name
    ]:  # any of its motors may stand for it
        for one in several.split(" and "):
            drums.setdefault(one, drums[several])
    diameters = {known_name(name, drums, document): size for name, size in diameters.items()}
    if unknown := [name for name in diameters if name not in drums]:
        raise UsageError(f"there is no drum of {unknown[0]!r}; there are {', '.join(drums)}")
    return {path: 0.5 * size for name, size in diameters.items() for path in drums[name]}


def _of_one_scale(known: Uncertainty, values: Mapping[str, float]) -> Uncertainty:
    """Preloads that were read on one spring scale, whose gain errs in all of them alike."""
    covariance = known.covariance.copy()
    stddev = {
        known.parameters.index(path): SPRING_SCALE_NOW * value
        for path, value in values.items()
        if path.endswith(".preload") and path in known.parameters
    }
    read = [k for k, own in stddev.items() if np.isclose(covariance[k, k], own**2)]
    common = 1.0 - (SCALE_READING / SPRING_SCALE_NOW) ** 2
    for i in read:
        for j in read:
            if i != j:
                covariance[i, j] = common * stddev[i] * stddev[j]
    return replace(known, covariance=covariance)


def _with_fitted(base: str, robot: Robot, fitted: Mapping[str, float]) -> str:
    """The text with fitted numbers.

    Of a robot at the edge of what is possible rounding may make an impossible one: its numbers go
    a little back towards those before the fit.
    """
    document: Any = robot.document
    before = {path: find_number(document, path).value for path in fitted}
    for share in BACK:
        values = {
            path: float(yaml_number(before[path] + share * (value - before[path])))
            for path, value in fitted.items()
        }
        text = with_numbers_in_text(base, values, robot.source)
        try:
            prepare(parse_robot(text, robot.source))
            break
        except RobotFileError:
            if share == BACK[-1]:
                raise
    return text


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
