"""The steps from a new robot file to one whose tensions are known, each by a cheap measurement.

A step changes the text of the robot file: its numbers, their standard deviations and where they
come from.  A fit starts from the file as it was before the first fit, with all recordings so far,
so that no recording counts twice.

A spring scale's gain errs in all readings alike, so only their ratios to those in the reference
pose are fitted: they show what neither a tare nor one reading shows, such as the radius of a drum.
The recording contains the ways between the poses, and so the friction of their directions.
docs/commission.md.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from math import sqrt
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from cdrj_ros import __version__
from cdrj_ros.commands.commission_fits import PartFit, fit_parts, section_of
from cdrj_ros.commands.commission_rests import REST_IN_POSE_NS, pose_words, rest_poses
from cdrj_ros.commands.identify_entries import drum_lines, stated_lines
from cdrj_ros.estimation.changes import (
    narrowed,
    preloads_of,
    reference_at,
)
from cdrj_ros.estimation.estimator import Sample
from cdrj_ros.foundation.arrays import Series, Vector
from cdrj_ros.foundation.errors import RobotFileError, UsageError
from cdrj_ros.identification.observations import Recorded, ScaleReading, noise_of, samples_of
from cdrj_ros.identification.problem import refuse_hidden
from cdrj_ros.identification.unknowns import drum_radii
from cdrj_ros.model.packing import EFFORT, TENSION
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot, Uncertainty
from cdrj_ros.robot.names import known_name
from cdrj_ros.robot.parameters import find_number
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.stated import stated_numbers, with_covariance
from cdrj_ros.robot.tolerances import CALLIPER, SCALE_READING, SPRING_SCALE_NOW
from cdrj_ros.robot.writer import with_numbers_in_text, with_section, yaml_number

BACK: Final = (0.9999, 0.999, 0.99)
"""Shares of a change by a fit that are tried if the whole makes an impossible robot."""


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
    fits: tuple[PartFit, ...] = ()
    """The last fit, of every part of the robot that has references."""
    rest: Recorded | None = None
    """That of the tare."""
    poses: tuple[Sample, ...] = ()
    """Those in which the robot rests there, the reference pose first."""
    readings: tuple[Mapping[str, float], ...] = ()
    """Those of the spring scale [N], by cable or element, in every pose."""

    @property
    def model(self) -> Model:
        """The prepared robot of the text."""
        return prepare(parse_robot(self.text, self.source))

    @property
    def heard(self) -> dict[str, float]:
        """Noise of the efforts that the robot publishes, as they were recorded [N m], by motor."""
        recorded = [one.references for one in (*self.recordings, self.rest) if one]
        found = {}
        for motor in self.model.layout.motors:
            name = f"{EFFORT}/{motor}"
            if read := [one[name].value for one in recorded if name in one]:
                found[motor] = max(map(noise_of, read))
        return found

    @property
    def measured(self) -> Model:
        """The prepared robot without what fits have found."""
        return prepare(parse_robot(self.base, self.source))


def begin(text: str, source: str) -> Commissioned:
    """A robot file of which nothing was measured.

    Raises:
        UsageError: the robot has joints without encoder.
    """
    refuse_hidden(parse_robot(text, source))
    text = with_section(text, "residual", None)  # it was learned with the numbers as they were
    return Commissioned(source, text, text)


def tared(now: Commissioned, recorded: Recorded) -> Commissioned:
    """The file after a tare: the pose in which a recording begins is the reference.

    Raises:
        UsageError: the robot moves there.
    """
    model = now.model
    poses = rest_poses(model.robot, samples_of(model, recorded), recorded.name)
    values = reference_at(model, poses[0]).values
    names = [f"joints.{joint.name}" for joint in model.robot.joints]
    paths = [f"{name}.{key}" for name in names for key in ("offset", "reference_angle")]
    after = _measured(now, values, paths, f"tare, {recorded.name}")
    return replace(after, rest=recorded, poses=poses)


def preloaded(now: Commissioned, readings: Sequence[Mapping[str, float]]) -> Commissioned:
    """The file after a spring scale was read on some cables in some poses.

    Args:
        now: the file.
        readings: tensions [N]: by cable in the reference pose, by element in every further one of
            the tare's recording.

    Raises:
        UsageError: there is no such cable, element or pose, or a value is out of range.
    """
    after, recorded = _weighed(now, readings)
    return fitted(after, recorded) if recorded else after


def read_again(now: Commissioned, readings: Sequence[Mapping[str, float]]) -> Commissioned:
    """The file with other readings of the spring scale, fitted to the same motions."""
    motions = [one for one in now.recordings if not one.scales]
    before = replace(now, text=now.base, fits=(), recordings=())
    after, recorded = _weighed(before, readings)
    return fitted(after, [*recorded, *motions])


def _weighed(
    now: Commissioned, readings: Sequence[Mapping[str, float]]
) -> tuple[Commissioned, list[Recorded]]:
    """The file with the preloads that were read, and the readings in further poses if any."""
    preloads, recorded = scale_readings(now.model.robot, now.rest, now.poses, readings)
    values = preloads_of(now.model, preloads).values
    after = _measured(now, values, list(values), f"spring scale, {SPRING_SCALE_NOW:.1%}")
    return replace(after, readings=(*readings,)), [recorded] if recorded else []


def drums_measured(now: Commissioned, diameters: Mapping[str, float]) -> Commissioned:
    """The file after the drums of some motors were measured by a calliper.

    Args:
        now: the file.
        diameters: from middle to middle of the wound cable [m], by motor.

    Raises:
        UsageError: no drum belongs to such a motor.
    """
    document = dict(now.model.robot.document)
    drums = drum_radii(document)
    diameters = {known_name(name, drums, document): size for name, size in diameters.items()}
    if unknown := [name for name in diameters if name not in drums]:
        raise UsageError(f"there is no drum of {unknown[0]!r}; there are {', '.join(drums)}")
    values = {path: 0.5 * size for name, size in diameters.items() for path in drums[name]}
    return _measured(now, values, list(values), f"calliper, {1e3 * CALLIPER:g} mm")


def _measured(
    now: Commissioned,
    values: Mapping[str, float],
    paths: Sequence[str],
    origin: str,
) -> Commissioned:
    """The file with numbers that were measured, and what their standard deviations are now."""
    robot = parse_robot(now.base, now.source)
    text = with_numbers_in_text(now.base, values, now.source)
    known = narrowed(robot, values)
    if known is not None:
        known = _of_one_scale(known, values)
        text = with_section(text, "uncertainty", _stated(robot, known, paths))
    origins = {**now.origins, **dict.fromkeys(values, origin)}
    after = replace(now, base=text, text=text, origins=origins, fits=())
    return fitted(after, []) if now.recordings else after


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


def _stated(robot: Robot, known: Uncertainty, paths: Sequence[str]) -> str:
    """The block ``uncertainty`` with what it stated before and some numbers more."""
    before: dict[str, Any] = dict(robot.document.get("uncertainty", {}))
    there = set(known.parameters)
    names = [*stated_numbers(before).paths, *(path for path in paths if path in there)]
    names = list(dict.fromkeys(names))
    at = [known.parameters.index(name) for name in names]
    numbers = with_covariance(names, known.covariance[np.ix_(at, at)])
    head = [f"  others: {before['others']}"] if "others" in before else []
    return "\n".join(["uncertainty:", *head, *drum_lines(before, {}), *stated_lines(numbers)])


def fitted(now: Commissioned, recorded: Sequence[Recorded]) -> Commissioned:
    """The file after a fit to all recordings so far and some more.

    Raises:
        UsageError: there is nothing to fit to.
    """
    recordings = (*now.recordings, *recorded)
    robot = parse_robot(now.base, now.source)
    fits = fit_parts(robot, now.base, recordings)
    values = {path: value for one in fits for path, value in one.values.items()}
    text = with_section(_with_fitted(now, robot, values), "uncertainty", section_of(robot, fits))
    names = ", ".join(one.name for one in recordings)
    origins = {**now.origins, **dict.fromkeys(values, f"fit to {names}")}
    return replace(now, text=text, origins=origins, recordings=recordings, fits=fits)


def _with_fitted(now: Commissioned, robot: Robot, fitted: Mapping[str, float]) -> str:
    """The text with fitted numbers.

    Of a robot at the edge of what is possible rounding may make an impossible one: its numbers go
    a little back towards those before the fit.
    """
    document: Any = robot.document
    before = {path: find_number(document, path).value for path in fitted}
    for share in (1.0, *BACK):
        values = {
            path: float(yaml_number(before[path] + share * (value - before[path])))
            for path, value in fitted.items()
        }
        text = with_numbers_in_text(now.base, values, now.source)
        try:
            prepare(parse_robot(text, now.source))
            break
        except RobotFileError:
            if share == BACK[-1]:
                raise
    return text


TAKE: Final[Mapping[str, Callable[[Commissioned, Any], Commissioned]]] = MappingProxyType(
    {"rest": tared, "preload": preloaded, "drum": drums_measured, "motion": fitted, "cells": fitted}
)
"""The steps in their order, each with the function that takes what was measured."""


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


def scale_readings(
    robot: Robot,
    recorded: Recorded | None,
    poses: Sequence[Sample],
    readings: Sequence[Mapping[str, float]],
) -> tuple[dict[str, float], Recorded | None]:
    """What a spring scale read: the preloads, and the tensions in all further poses.

    Args:
        robot: the robot.
        recorded: the recording with the poses, if there is one.
        poses: those in which the robot rests.
        readings: tensions by element, ``upper/8``, or by cable if it has one [N], for every pose.

    Returns:
        The preloads by cable [N], and the recording with the other readings as references; None
        without any.

    Raises:
        UsageError: the readings are not those of the poses, or a name is none.
    """
    if len(readings) > 1 and len(readings) != len(poses):
        rests = "; ".join(pose_words(robot, pose) for pose in poses)
        raise UsageError(
            f"the spring scale was read in {len(readings)} poses; the recording of the tare rests "
            f"for {1e-9 * REST_IN_POSE_NS:g} s or more in {len(poses)}"
            + (f": {rests}" if rests else "")
        )
    elements = {cable.name: cable.element_names for cable in robot.cables}
    for name in readings[0]:
        if "/" in name:
            _element(name, elements)
    preloads = {name.split("/")[0]: value for name, value in readings[0].items()}
    rows: dict[str, list[tuple[int, float]]] = {}
    for pose, read in zip(poses[1:], readings[1:], strict=False):
        for name, value in read.items():
            element, cable = _element(name, elements), name.split("/")[0]
            if not preloads.get(cable, 0.0) > 0.0:
                raise UsageError(f"{name}: read the tension of {cable} in the reference pose too")
            if not 0.0 < value < 1e6:
                raise UsageError(f"the tension of {name} must be in (0, 1e6) N, got {value:g}")
            rows.setdefault(element, []).append((pose.stamp_ns, value))
    references, scales = {}, {}
    for element, row in rows.items():
        stamps, values = (np.array(column) for column in zip(*row, strict=True))
        channel, cable = f"{TENSION}/{element}", element.split("/")[0]
        references[channel] = Series(stamps, stamps, np.asarray(values, dtype=float))
        scales[channel] = ScaleReading(preloads[cable], _noise(values, rows, cable))
    if recorded is None or not references:
        return preloads, None
    return preloads, replace(recorded, name="spring scale", references=references, scales=scales)


def _element(name: str, elements: Mapping[str, Sequence[str]]) -> str:
    """The element of a name, which may be that of its cable if there is only one.

    Raises:
        UsageError: there is none.
    """
    cable = name.partition("/")[0]
    names = elements.get(cable, ())
    element = names[0] if name == cable and len(names) == 1 else name
    if element not in names:
        there = ", ".join(f"{one[0]} to {one[-1]}" for one in elements.values())
        raise UsageError(f"there is no element {name!r}; there are {there}")
    return element


def _noise(values: Vector, rows: Mapping[str, Sequence[object]], cable: str) -> float:
    """Standard deviation of readings [N].

    The error of the reading in the reference pose is common to the ratios of all others of a cable.
    As if each had an own error √(1 + count) times as large, their mean errs as it does.
    """
    count = sum(len(row) for name, row in rows.items() if name.split("/")[0] == cable)
    return SCALE_READING * sqrt(1.0 + count) * float(np.mean(values))
