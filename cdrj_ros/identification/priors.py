"""What is known of the numbers before a fit: priors, and further numbers that need them.

A number whose accuracy the file does not state has a prior: the file's value, with the standard
deviation of ``cdrj_ros.robot.tolerances``.  In a fit of few numbers to few references, errors of
all other numbers of the file distort the result.  Those of ``ALONG`` are therefore fitted too.
``commission`` fits all causes of error.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.identification.unknowns import LOG_REACH, Unknown, parse_unknowns, without_priors
from cdrj_ros.robot.description import Robot, Uncertainty
from cdrj_ros.robot.document import allowed_range
from cdrj_ros.robot.parameters import find_number

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
    return without_priors(unknowns, free)


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
            if number.key == "reference_angle" and path.startswith("joints."):
                ends = (f"{path.rsplit('.', 1)[0]}.range.{end}" for end in (1, 2))
                low, high = (find_number(document, end).value for end in ends)
            reach = sorted(((low - number.value) / size, (high - number.value) / size))
            lower, upper = max(lower, reach[0]), min(upper, reach[1])
        values = tuple(number.value for number in numbers)
        found.append(
            Unknown(tuple(cause), tuple(cause.values()), 0.0, lower, upper, 1.0, (0.0, 1.0), values)
        )
    return tuple(one for one in found if one.lower < one.upper)
