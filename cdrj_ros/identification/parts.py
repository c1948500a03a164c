"""All causes of error of a robot fitted group by group, as ``commission`` does.

Cables depend on the axes and numbers of their paths alone, so the fingers of a hand are fitted one
after the other, each as if its cables were the whole robot: it gets the numbers that it would get
alone.  What the groups share keeps what is known of it, but for a number of a joint whose own
cables are one of the groups, and for friction that the file states for all cables, of which each
cable of a group gets its own.  docs/commission.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any, Final

import numpy as np

from cdrj_ros.estimation.sensors import sensors_of
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import ProgressBar
from cdrj_ros.identification.alternatives import DrumFinding, doubted
from cdrj_ros.identification.entries import (
    COVARIANCE_LIMIT,
    fit_errors,
    fitted_numbers,
    uncertainty_section,
)
from cdrj_ros.identification.fit import Identification, identify
from cdrj_ros.identification.nuisance import nuisance_causes
from cdrj_ros.identification.observations import Recorded, chosen_channels
from cdrj_ros.identification.priors import unknown_causes
from cdrj_ros.identification.problem import Settings
from cdrj_ros.identification.unknowns import Unknown
from cdrj_ros.inspection.shares import tension_effects
from cdrj_ros.model.packing import EFFORT
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.groups import channels_of, connected_cables, joints_of, part_of
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.stated import StatedNumbers, joined, stated_numbers
from cdrj_ros.robot.writer import urdf_frames

FIT_SAMPLES: Final = 4000
"""Samples to which those of all recordings are thinned, if that leaves 100 per second."""

MEAN_S: Final = 0.2
"""Time over which estimates and references are averaged before they are compared [s]: longer than
errors of readings last, shorter than a stroke."""

FRICTION: Final = "friction."
"""Beginning of the paths of numbers of friction that apply to all cables without their own."""


@dataclass(frozen=True)
class Part:
    """Cables that are fitted together."""

    cables: tuple[int, ...]
    """Their indices."""
    robot: Robot
    """They alone."""
    channels: frozenset[str]
    """References on which they alone act."""
    elsewhere: frozenset[str] = frozenset()
    """Uncertain numbers of the part that are not fitted with it."""
    alone: bool = True
    """Whether it is the whole robot."""

    def recorded(self, one: Recorded) -> Recorded:
        """A recording with its own axes and references alone."""
        motors = {motor.name for motor in self.robot.motors}
        joints = {joint.name for joint in self.robot.joints}
        return replace(
            one,
            motors={name: series for name, series in one.motors.items() if name in motors},
            joints={name: series for name, series in one.joints.items() if name in joints},
            references={
                name: series for name, series in one.references.items() if name in self.channels
            },
        )

    def places(self, path: str) -> tuple[str, ...]:
        """Where the robot's file has a number of the part: friction of all, at every cable."""
        if self.alone or not path.startswith(FRICTION):
            return (path,)
        key = path.removeprefix(FRICTION)
        entries: Any = self.robot.document["cables"]
        own = [one["name"] for one in entries if key not in one.get("friction", {})]
        return tuple(f"cables.{name}.friction.{key}" for name in own)


def parts_of(robot: Robot) -> tuple[Part, ...]:
    """The groups in which a robot is fitted: connected cables, or the branches of large groups."""
    groups: list[tuple[int, ...]] = []
    branches = connected_cables(robot, branches=True)
    for group in connected_cables(robot):
        known = build_robot(part_of(robot, group), robot.source).uncertainty
        many = known is not None and len(known.parameters) > COVARIANCE_LIMIT
        groups += [one for one in branches if set(one) <= set(group)] if many else [group]
    alone = len(groups) == 1
    parts = [
        Part(
            group,
            robot if alone else build_robot(part_of(robot, group), robot.source),
            frozenset(channels_of(robot, group)),
            alone=alone,
        )
        for group in groups
    ]
    return tuple(replace(part, elsewhere=_elsewhere(part, parts)) for part in parts)


def _elsewhere(part: Part, parts: Sequence[Part]) -> frozenset[str]:
    """Numbers that other parts have, too, unless all joints of this one move those parts.

    Friction of all cables is fitted in every part.
    """
    sharing = Counter(chain(*(_uncertain(one.robot) for one in parts)))
    shared = {path for path, count in sharing.items() if count > 1}
    mine = _joints(part.robot)
    return frozenset(
        path
        for path in shared.intersection(_uncertain(part.robot))
        if not path.startswith(FRICTION)
        and not all(
            mine < _joints(one.robot)
            for one in parts
            if one is not part and path in _uncertain(one.robot)
        )
    )


def _uncertain(robot: Robot) -> tuple[str, ...]:
    return robot.uncertainty.parameters if robot.uncertainty is not None else ()


def _joints(robot: Robot) -> frozenset[str]:
    return frozenset().union(*(joints_of(robot, cable) for cable in robot.cables))


@dataclass(frozen=True)
class PartFit:
    """A fit of the numbers of one part."""

    part: Part
    found: Identification

    @property
    def values(self) -> dict[str, float]:
        """Fitted numbers of the robot's file by path [SI]."""
        own = self.found.by_path
        return {place: value for path, value in own.items() for place in self.part.places(path)}

    @property
    def numbers(self) -> StatedNumbers:
        """What is known of the part's numbers after the fit, by paths of the robot's file."""
        before = self.part.robot.document.get("uncertainty", {})
        known = fitted_numbers(self.found, before, self.part.elsewhere)
        places = [
            (place, k) for k, path in enumerate(known.paths) for place in self.part.places(path)
        ]
        spread = known.part([k for _, k in places])
        return spread._replace(paths=tuple(place for place, _ in places))

    @property
    def cables(self) -> str:
        """Names of its cables."""
        return ", ".join(cable.name for cable in self.part.robot.cables)


def fit_parts(robot: Robot, text: str, recordings: Sequence[Recorded]) -> tuple[PartFit, ...]:
    """Fit every part of a robot to its references, if it has any.

    Args:
        robot: the robot before the first fit.
        text: of its file.
        recordings: all are fitted together.

    Raises:
        UsageError: no part has a reference, or all numbers are exact.
    """
    chosen_channels(prepare(robot).layout, recordings, ())
    settings = Settings(
        weights="noise", mean_s=MEAN_S, coarse=True, samples=FIT_SAMPLES, compares_drums=True
    )
    found, parts = [], parts_of(robot)
    with ProgressBar("fitting", len(parts)) as progress:
        for number, part in enumerate(parts):
            own = [part.recorded(one) for one in recordings]
            own = [one for one in own if one.references]
            if own:
                heard = {name for one in own for name in one.references}
                unknowns = unknowns_of(part.robot, text, part.elsewhere, heard)
                document, source = dict(part.robot.document), part.robot.source
                say = partial(progress, number)
                fit = identify(document, source, unknowns, own, settings, say)
                found.append(PartFit(part, fit))
    return tuple(found)


def unknowns_of(
    robot: Robot,
    text: str,
    elsewhere: frozenset[str] = frozenset(),
    references: Collection[str] = (),
) -> tuple[Unknown, ...]:
    """All causes of error, each with what is known of it, those that move the tensions most first.

    A fit has at most ``COVARIANCE_LIMIT`` numbers; the rest has the least effect, and is left as it
    is, as are the numbers of a URDF.

    Args:
        robot: the robot.
        text: of its file.
        elsewhere: numbers that are not fitted.
        references: what is fitted to; the gains of efforts among it are unknown, too.

    Raises:
        UsageError: all numbers are exact.
    """
    document: Any = robot.document
    causes = [one for one in nuisance_causes(robot.uncertainty, ()) if elsewhere.isdisjoint(one)]
    if urdf_frames(text) is not None:  # where alone they can be changed
        causes = [one for one in causes if not any(path.startswith("frames.") for path in one)]
    if not causes:
        raise UsageError("the robot file says that all its numbers are exact")
    model = prepare(robot)
    effect = (tension_effects(model, causes) ** 2).mean(axis=(1, 2))
    chosen: list[Mapping[str, float]] = _gains(model, references)
    for k in np.argsort(-effect).tolist():
        if len({*chain(*chosen), *causes[k]}) <= COVARIANCE_LIMIT:
            chosen.append(causes[k])
    return unknown_causes(document, chosen)


def _gains(model: Model, references: Collection[str]) -> list[Mapping[str, float]]:
    """Errors of the gains of motors' efforts, as large as the estimator expects them."""
    robot, sensors = model.robot, sensors_of(model)
    known = robot.uncertainty.parameters if robot.uncertainty else ()
    gains = {
        f"motors.{one.name}.effort_scale": sensors[one.name].gain * abs(one.effort_scale)
        for one in robot.motors
        if f"{EFFORT}/{one.name}" in references and one.name in sensors
    }
    return [{path: gain} for path, gain in gains.items() if path not in known]


def section_of(robot: Robot, fits: Sequence[PartFit]) -> str:
    """The entry ``uncertainty`` of the robot file after the fits of its parts.

    Args:
        robot: the robot before the fits; what its file states about other numbers is kept.
        fits: of some or all parts.
    """
    document: Any = robot.document
    before = document.get("uncertainty", {})
    errors = {name: size for one in fits for name, size in fit_errors(one.found).items()}
    known = [one.numbers for one in fits]
    written = {path for one in known for path in one.paths}
    stated = stated_numbers(before)
    rest = stated.part([k for k, path in enumerate(stated.paths) if path not in written])
    numbers = joined([*known, rest])
    return uncertainty_section(numbers, before, errors, drums_of(robot, fits))


def drums_of(robot: Robot, fits: Sequence[PartFit]) -> Mapping[str, DrumFinding]:
    """What the fits show of every cable on its drums; nothing if none was judged."""
    judged = {name: drums for one in fits for name, drums in one.found.drums.items()}
    unseen = DrumFinding("may_slip", "has no references", "")
    return {name: judged.get(name, unseen) for name in doubted(robot)} if judged else {}
