"""The unknowns of a fit and what is known of them before: chosen, of another pose, or all causes.

A number whose accuracy the file does not state has a prior: the file's value, with the standard
deviation of ``cdrj_ros.robot.tolerances``.  In a fit of few numbers to few references, errors of
all other numbers of the file distort the result.  Those of ``ALONG`` are therefore fitted too.
``commission`` fits all causes of error.

Between two poses of an instrument, or after a sensor was zeroed anew, the same cables run over the
same pulleys: ``identify --from FILE``.  Changed are the zeros of the joints and of the springs at
the axes, the preloads (the paths have other lengths), and where a joint without a sensor bends the
path, the wrap angles and the drag of the pulleys.  Corrections that were fitted do not hold where a
joint has left its range.  Everything else stays as the file has it, with its stated accuracy.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.conditioner import angles_of
from cdrj_ros.foundation.errors import RobotFileError, UsageError
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.unknowns import LOG_REACH, Unknown, parse_unknowns, with_priors
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.couplings import own_joints
from cdrj_ros.robot.description import Robot, Uncertainty
from cdrj_ros.robot.document import allowed_range
from cdrj_ros.robot.parameters import find_number, joint_range, with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.tolerances import HANDBOOK_REST, OTHER_BEND, SPRING_SCALE

ALONG: Final = (
    "preload", "EA", "drum_radius", "joints.{*}.reference_angle", "joint_offset",
    "pulley_bearing_torque",
)  # fmt: skip
"""Numbers to fit in addition, in the notation of ``--fit``."""

ALIKE: Final = 1e-9
"""Largest relative difference of numbers that are fitted as one unknown."""


def known_before(
    document: Document, known: Uncertainty | None, unknowns: Sequence[Unknown]
) -> tuple[Unknown, ...]:
    """The unknowns with their default standard deviations as priors.

    Those that the file states are left out: an earlier fit to the same recordings may have found
    them.

    Args:
        document: content of the robot file.
        known: the robot's uncertainty.
        unknowns: those that the user requested.
    """
    stddev = _default_stddev(known)
    result = []
    for one in unknowns:
        own = [stddev.get(_level_of(path, stddev), 0.0) for path in one.paths]
        values = [find_number(document, path).value for path in one.paths]
        apart = np.std(np.multiply(values, one.factors))  # tied numbers that the file has apart
        prior = (one.start, float(np.hypot(np.mean(own), apart)))
        result.append(replace(one, prior=prior) if min(own) > 0.0 else one)
    return tuple(result)


def _default_stddev(known: Uncertainty | None) -> dict[str, float]:
    """Default standard deviations of the numbers whose accuracy the file leaves open [SI]."""
    if known is None:
        return {}
    return dict([*known.stddev.items()][known.stated :])


def _level_of(path: str, stddev: Mapping[str, float]) -> str:
    """The path itself, or that of the level from which the file takes its friction."""
    while path not in stddev and ".friction." in path:
        holder, _, key = path.rpartition(".friction.")
        above = holder.rpartition(".nodes.")[0]
        path = f"{above}.friction.{key}" if above else f"friction.{key}"
    return path


def fitted_along(
    document: Document, known: Uncertainty | None, unknowns: Sequence[Unknown]
) -> tuple[Unknown, ...]:
    """Further unknowns with priors, for numbers whose accuracy the file does not state.

    Args:
        document: content of the robot file.
        known: the robot's uncertainty; numbers that it states or that are exact stay fixed.
        unknowns: those that the user requested.
    """
    stddev = _default_stddev(known)
    taken = {path for unknown in unknowns for path in unknown.paths}
    along: list[Unknown] = []
    for item in ALONG if stddev else ():
        try:
            found = parse_unknowns(document, item)
        except UsageError:  # no joint, or no pulley
            continue
        for one in found:
            spread = [stddev.get(path, 0.0) for path in one.paths]
            values = [find_number(document, path).value for path in one.paths]
            alike = np.ptp(values) <= ALIKE * max(map(abs, values))
            if taken.isdisjoint(one.paths) and min(spread) > 0.0 and alike:
                along.append(replace(one, prior=(one.start, float(np.mean(spread)))))
    return tuple(along)


def chosen_unknowns(
    document: Document, robot: Robot, fit: str, free: Iterable[str], *, only: bool
) -> tuple[Unknown, ...]:
    """The unknowns of a fit, with what is known of them before.

    Args:
        document: content of the robot file.
        robot: the robot that it describes.
        fit: the numbers, as ``parse_unknowns`` takes them.
        free: those of which nothing is known before.
        only: whether no others are fitted along.

    Raises:
        UsageError: a name is no number of the file, or is not among the unknowns.
    """
    known = robot.uncertainty
    unknowns = known_before(document, known, parse_unknowns(document, fit))
    if not only:
        unknowns += fitted_along(document, known, unknowns)
    return with_priors(unknowns, dict.fromkeys(free), "--free")


FAR: Final = 5.0
"""Largest deviation of a cause of error [standard deviations]."""


def unknown_causes(
    document: Document, causes: Iterable[Mapping[str, float]]
) -> tuple[Unknown, ...]:
    """Causes of error as unknowns: each the number of its standard deviations, 0 in the file.

    Args:
        document: content of the robot file.
        causes: one standard deviation of numbers that deviate together [SI], by path.
    """
    found = []
    for cause in causes:
        numbers = [find_number(document, path) for path in cause]
        lower, upper = -FAR, FAR
        for number, path, size in zip(numbers, cause, cause.values(), strict=True):
            allowed = allowed_range(number.rules)
            low, high = allowed.lower, allowed.upper
            if low == 0.0:
                low = number.value / LOG_REACH
            low, high = joint_range(document, path) or (low, high)
            reach = sorted(((low - number.value) / size, (high - number.value) / size))
            lower, upper = max(lower, reach[0]), min(upper, reach[1])
        values = tuple(number.value for number in numbers)
        found.append(
            Unknown(tuple(cause), tuple(cause.values()), 0.0, lower, upper, 1.0, (0.0, 1.0), values)
        )
    return tuple(one for one in found if one.lower < one.upper)


MARGIN: Final = 0.1
"""Distance of the range's ends from the readings and the zero, as a fraction of the stroke."""

OUTLIERS: Final = 1e-3
"""Share of the readings beyond either end that do not count, as of a sensor with glitches."""

REACHES: Final = (1.0, 0.5, 0.25, MARGIN)
"""Distances from the readings within which a zero is sought, in strokes; the greatest that the
geometry allows."""


class Reach(NamedTuple):
    """Angles that the readings of a joint span [rad]."""

    lowest: float
    highest: float

    @property
    def stroke(self) -> float:
        """Distance of the two [rad]."""
        return max(self.highest - self.lowest, 1e-3)


Moved = Mapping[str, Reach]
"""Joints whose readings leave the range of the file."""


class PoseUnknown(NamedTuple):
    """A number that another pose changes, and why."""

    unknown: Unknown
    why: str


def pose_unknowns(document: Document, robot: Robot) -> tuple[PoseUnknown, ...]:
    """The numbers that another pose changes, with the priors of what is known of them.

    Zeros have no prior.  A preload and the drag of a pulley keep the file's number within its
    stated standard deviation, but at least the default one of a file that states none; a wrap angle
    keeps it within the fraction ``OTHER_BEND``.

    Args:
        document: content of the robot file.
        robot: built from it.
    """
    stated = robot.uncertainty.stddev if robot.uncertainty else {}
    found = [*_zeros(document)]
    for cable in document["cables"]:
        at = f"cables.{cable['name']}"
        if cable.get("preload", 0.0) > 0.0:
            path = f"{at}.preload"
            stddev = max(stated.get(path, 0.0), SPRING_SCALE * float(cable["preload"]))
            found.append(_with_prior(document, path, stddev, "the path has another length"))
        for k, node in enumerate(cable["nodes"]):
            found += _pulley(document, f"{at}.nodes.{k + 1}", node, stated)
    return tuple(found)


def _zeros(document: Document) -> Iterator[PoseUnknown]:
    """Zeros of the joints, and of springs at motors and joints."""
    for joint in own_joints(document):
        path = f"joints.{joint['name']}.reference_angle"
        yield PoseUnknown(parse_unknowns(document, path)[0], "the joint is zeroed anew")
    for kind in ("motors", "joints"):
        for axis in document.get(kind, ()):
            if axis.get("spring_stiffness", 0.0) > 0.0:
                path = f"{kind}.{axis['name']}.spring_rest"
                yield PoseUnknown(parse_unknowns(document, path)[0], "its spring rests elsewhere")


def _pulley(
    document: Document, at: str, node: Mapping[str, Any], stated: Mapping[str, float]
) -> Iterator[PoseUnknown]:
    """Wrap angle and drag of a pulley whose wrap the file states as one number."""
    if node["type"] in ("winch", "anchor") or not isinstance(node.get("wrap_angle"), (int, float)):
        return
    if find_number(document, f"{at}.friction.mu_c").value > 0.0:
        stddev = OTHER_BEND * float(node["wrap_angle"])
        yield _with_prior(document, f"{at}.wrap_angle", stddev, "a joint without a sensor bends it")
    if node.get("bearing_torque", 0.0) > 0.0:
        path = f"{at}.bearing_torque"
        stddev = max(stated.get(path, 0.0), HANDBOOK_REST * float(node["bearing_torque"]))
        yield _with_prior(document, path, stddev, "it grows with the bend")


def _with_prior(document: Document, path: str, stddev: float, why: str) -> PoseUnknown:
    (unknown,) = parse_unknowns(document, path)
    return PoseUnknown(replace(unknown, prior=(unknown.start, stddev)), why)


def moved_ranges(
    document: Document, source: str, recordings: Sequence[Recorded]
) -> dict[str, Reach]:
    """Joints whose readings leave the range of the file, with the span of their readings.

    Args:
        document: content of the robot file.
        source: its name.
        recordings: readings of the new pose.
    """
    robot = build_robot(document, source)
    found = {}
    for joint in robot.joints:
        angles = [angles_of(robot, joint.name, one.joints[joint.name]).value for one in recordings]
        every = np.concatenate(angles)
        every = every[np.isfinite(every)]
        if not every.size:
            continue
        ends = np.quantile(every, (OUTLIERS, 1.0 - OUTLIERS), method="nearest").tolist()
        if not joint.lower <= ends[0] <= ends[1] <= joint.upper:
            found[joint.name] = Reach(*ends)
    return found


def outdated_corrections(robot: Robot, moved: Moved) -> dict[str, float]:
    """Fitted corrections of sensors, by path, to be set to zero [rad].

    They are functions of the readings of one pose, and those of two axes make up for each other
    there.  Where a joint's readings have left the range, none of them holds.  A correction that
    the file states without an uncertainty was measured otherwise and is kept.

    Args:
        robot: as the file describes it.
        moved: see ``moved_ranges``.
    """
    known = robot.uncertainty
    if known is None or not moved:
        return {}
    return {path: 0.0 for path in known.parameters if ".correction.value." in path}


def search_ranges(document: Document, source: str, moved: Moved) -> dict[str, float]:
    """Ranges in which the zeros of moved joints are sought, by path [rad]: see ``REACHES``.

    The reference angle of such a joint starts in the middle of its readings.

    Raises:
        RobotFileError: the geometry allows not even the readings and a margin.
    """
    numbers: dict[str, float] = {}
    for name, span in moved.items():
        at = f"joints.{name}"
        numbers |= {f"{at}.range.1": span.lowest, f"{at}.range.2": span.highest}
        numbers[f"{at}.reference_angle"] = 0.5 * (span.lowest + span.highest)
    for name, span in moved.items():
        for end, limit, side in (("1", span.lowest, -1.0), ("2", span.highest, 1.0)):
            path = f"joints.{name}.range.{end}"
            for reach in REACHES:
                wider = numbers | {path: limit + side * reach * span.stroke}
                if reach == REACHES[-1] or _possible(document, source, wider):
                    numbers = wider
                    break
    prepare(build_robot(with_numbers(document, numbers), source))
    return numbers


def _possible(document: Document, source: str, numbers: Mapping[str, float]) -> bool:
    try:
        prepare(build_robot(with_numbers(document, numbers), source))
    except RobotFileError:
        return False
    return True


def pose_ranges(moved: Moved, found: Mapping[str, float]) -> dict[str, float]:
    """Ranges of moved joints for the new file, by path [rad].

    They end where the pose ends: ``MARGIN`` beyond the readings and the zero.

    Args:
        moved: see ``moved_ranges``.
        found: the identified numbers by path.
    """
    numbers = {}
    for name, span in moved.items():
        at, margin = f"joints.{name}", MARGIN * span.stroke
        zero = found[f"{at}.reference_angle"]
        numbers[f"{at}.range.1"] = min(span.lowest, zero) - margin
        numbers[f"{at}.range.2"] = max(span.highest, zero) + margin
    return numbers
