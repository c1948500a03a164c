"""Numbers of the robot file to identify, single or tied, each with its own coordinate.

The optimiser works on a coordinate ``u`` for every unknown.  It is 0 at the start, and a step of 1
is a fifth of the number, or ``TYPICAL`` if that is larger and the coordinate is linear.  The
coordinate is logarithmic for numbers that can neither be zero nor change sign, and linear for all
others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import repeat
from math import exp, isfinite, log
from typing import Final

import numpy as np

from cdrj_ros.foundation.errors import UsageError, nearest
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.couplings import drum_radii
from cdrj_ros.robot.document import allowed_range
from cdrj_ros.robot.parameters import find_number, joint_range, matching_paths, split_outside

STEP_SHARE: Final = 0.2
"""Fraction of the number to which a coordinate step of 1 corresponds."""

LOG_REACH: Final = 30.0
"""Factor by which a number without other bounds may increase or decrease."""

SIGNED_REACH: Final = 20.0
"""Steps by which a number of either sign may move."""

TYPICAL: Final[Mapping[str, float]] = {
    "mu_c": 0.05,
    "mu_s": 0.05,
    "rho": 0.1,
    "bearing_friction": 0.002,
    "breakaway": 0.1,
    "viscous": 20.0,
    "bristle_damping": 20.0,
    "preload": 1.0,
    "bearing_torque": 1e-3,
    "bearing_diameter": 5e-4,
    "spring_stiffness": 0.01,
    "spring_rest": 0.1,
    "reference_angle": 0.05,
    "offset": 0.02,
    "angle": 0.02,
    "clock_offset": 1e-3,
    "slope": 5e-4,
    "sine": 5e-4,
    "origin": 1e-3,
    "position": 1e-3,
    "value": 1e-3,
}
"""Smallest step of a linear coordinate [SI], by key; 1e-3 for all other keys."""

SHORT_FORMS: Final[Mapping[str, str]] = {
    **{
        key: f"cables.{{*}}.friction.{key}"
        for key in (
            "rho", "mu_c", "mu_s", "stribeck_speed", "stribeck_lag", "bearing_friction",
            "bristle_stiffness", "bristle_damping", "viscous", "breakaway",
        )
    },
    "v_s": "cables.{*}.friction.stribeck_speed",
    "f_d": "cables.{*}.friction.bearing_friction",
    "preload": "cables.{*}.preload",
    "axial_stiffness": "cables.{*}.axial_stiffness",
    "bedding_strain": "cables.{*}.bedding_strain",
    "bedding_tension": "cables.{*}.bedding_tension",
    "creep_share": "cables.{*}.creep_share",
    "creep_time": "cables.{*}.creep_time",
    "flow_time": "cables.{*}.flow_time",
    "EA": "cables.{*}.axial_stiffness",
    "drum_radius": "drum_radius",
    "pulley_bearing_torque": "cables.{*}.nodes.*.bearing_torque",
    "effort_scale": "motors.{*}.effort_scale",
    "joint_offset": "joints.{*}.offset",
    "joint_scale": "joints.{*}.scale",
    "clock_offset": "joints.{*}.clock_offset",
}  # fmt: skip
"""Short names for common patterns: one number for every cable, joint or motor."""


@dataclass(frozen=True)
class Unknown:
    """One number to identify, at one place of the robot file or tied at several."""

    paths: tuple[str, ...]
    factors: tuple[float, ...]
    """The number at ``paths[k]`` is ``factors[k]`` times this one, plus ``shifts[k]``.

    Of several unknowns at the same path the products add up."""
    start: float
    """Starting value [SI]."""
    lower: float
    """Lower bound [SI], below ``upper``."""
    upper: float
    """Upper bound [SI]."""
    step: float
    """Change of the number per unit of the coordinate [SI]; 0 if the coordinate is logarithmic."""
    prior: tuple[float, float] | None = None
    """Mean and standard deviation of prior knowledge [SI]."""
    shifts: tuple[float, ...] = ()
    """Empty: zeros."""

    @property
    def name(self) -> str:
        """Its first path and the count of further paths tied to it."""
        return (
            self.paths[0] if len(self.paths) == 1 else f"{self.paths[0]} (+{len(self.paths) - 1})"
        )

    def value(self, coordinate: float) -> float:
        """The number [SI] at a coordinate."""
        if self.step == 0.0:
            return self.start * exp(STEP_SHARE * coordinate)
        return self.start + self.step * coordinate

    def coordinate(self, value: float) -> float:
        """The inverse of ``value``."""
        if self.step == 0.0:
            return log(value / self.start) / STEP_SHARE
        return (value - self.start) / self.step

    def slope(self, coordinate: float) -> float:
        """Derivative of the number by its coordinate [SI]."""
        if self.step == 0.0:
            return STEP_SHARE * self.value(coordinate)
        return self.step

    @property
    def limits(self) -> tuple[float, float]:
        """Both bounds as coordinates, in increasing order."""
        ends = self.coordinate(self.lower), self.coordinate(self.upper)
        return min(ends), max(ends)


def values_by_path(unknowns: Sequence[Unknown], values: Iterable[float]) -> dict[str, float]:
    """The numbers [SI] by path, tied paths included; what several unknowns change adds up."""
    found: dict[str, float] = {}
    for unknown, value in zip(unknowns, values, strict=True):
        shifts = unknown.shifts or repeat(0.0)
        for path, factor, shift in zip(unknown.paths, unknown.factors, shifts, strict=False):
            found[path] = found.get(path, shift) + factor * value
    return found


def parse_unknowns(document: Document, text: str) -> tuple[Unknown, ...]:
    """The unknowns of a list such as ``rho,cables.*.preload,joints.jaw.offset``.

    Items are paths, patterns or short forms, separated by commas.  A pattern with ``*`` or
    ``[a,b]`` is one common number; a pattern with braces, ``{*}`` or ``{a,b}``, is one number for
    each match.  Paths joined by ``=`` are one number too; a minus before a path changes its sign
    there:
    ``cables.a.spans.3.slope=-cables.b.spans.3.slope``.

    Raises:
        UsageError: an item is not a parameter, or a number belongs to two items.
    """
    unknowns: list[Unknown] = []
    for item in split_outside(text, ","):
        if not item:
            raise UsageError(f"--fit needs names separated by single commas, got {text!r}")
        unknowns += _parse_item(document, item)
    taken: set[str] = set()
    for unknown in unknowns:
        for path in unknown.paths:
            if path in taken:
                raise UsageError(f"{path} would be fitted twice in {text!r}")
            taken.add(path)
    return tuple(unknowns)


def _parse_item(document: Document, item: str) -> list[Unknown]:
    if item == "drum_radius":
        radii = drum_radii(document).values()
        return [_unknown(document, tuple(paths), (1,) * len(paths)) for paths in radii]
    if item.isidentifier() and item not in SHORT_FORMS:
        raise UsageError(f"{item} is not a short form; {nearest(item, list(SHORT_FORMS))}")
    members = split_outside(SHORT_FORMS.get(item, item), "=")
    if len(members) == 1:
        pattern, sign = _signed(members[0])
        if sign < 0:
            raise UsageError(f"{item}: a minus is allowed only after =")
        groups = matching_paths(document, pattern)
        return [_unknown(document, group, (1,) * len(group)) for group in groups]
    paths: list[str] = []
    signs: list[int] = []
    for member in members:
        pattern, sign = _signed(member)
        groups = matching_paths(document, pattern)
        if len(groups) != 1:
            raise UsageError(f"{item}: braces separate numbers and = ties them; use only one")
        paths += groups[0]
        signs += [sign] * len(groups[0])
    if signs[0] < 0:
        raise UsageError(f"{item}: the first path takes no minus; negate the others instead")
    return [_unknown(document, tuple(paths), tuple(signs))]


def _signed(member: str) -> tuple[str, int]:
    return (member[1:].strip(), -1) if member.startswith("-") else (member, 1)


def _unknown(document: Document, paths: tuple[str, ...], signs: tuple[int, ...]) -> Unknown:
    numbers = [find_number(document, path) for path in paths]
    starts = [sign * number.value for number, sign in zip(numbers, signs, strict=True)]
    start = float(np.mean(starts))
    first = numbers[0]
    allowed = allowed_range(first.rules)
    lower, upper = allowed.lower, allowed.upper
    if -1 in signs:
        lower, upper = max(lower, -upper), min(upper, -lower)
    step = max(STEP_SHARE * abs(start), TYPICAL.get(first.key, 1e-3))
    if span := joint_range(document, paths[0]):
        return Unknown(paths, signs, start, *span, step)
    positive = "exclusiveMinimum" in first.rules
    signless = first.key in ("slope", "sine", "scale", "effort_scale") and start != 0.0
    if (positive and start > 0.0) or signless:
        ends = sorted((start / LOG_REACH, start * LOG_REACH))
        return Unknown(paths, signs, start, max(ends[0], lower), min(ends[1], upper), 0.0)
    if lower == 0.0:
        upper = min(upper, max(LOG_REACH * abs(start), 100.0 * step))
    else:
        lower, upper = (
            max(lower, start - SIGNED_REACH * step),
            min(upper, start + SIGNED_REACH * step),
        )
    return Unknown(paths, signs, start, lower, upper, step)


def with_bounds(
    unknowns: Sequence[Unknown], bounds: Mapping[str, Sequence[float | None]]
) -> tuple[Unknown, ...]:
    """The unknowns with other bounds.

    Args:
        unknowns: from ``parse_unknowns``.
        bounds: lower and upper bound [SI] by path, pattern or short form; None: the bound is kept.

    Raises:
        UsageError: an unknown path, or bounds that exclude every value.
    """
    result = list(unknowns)
    for name, (low, high) in bounds.items():
        for k in _chosen(result, name, "bounds"):
            unknown = result[k]
            lower = unknown.lower if low is None else float(low)
            upper = unknown.upper if high is None else float(high)
            if not lower < upper:
                raise UsageError(f"bounds of {name}: {lower:g} must be less than {upper:g}")
            if unknown.step == 0.0 and lower * upper <= 0.0:
                raise UsageError(
                    f"bounds of {name}: {unknown.name} cannot change its sign or be zero"
                )
            result[k] = replace(unknown, lower=lower, upper=upper)
    return tuple(result)


def with_priors(
    unknowns: Sequence[Unknown],
    priors: Mapping[str, tuple[float, float] | None],
    option: str = "prior",
) -> tuple[Unknown, ...]:
    """The unknowns, some of them with another prior.

    Args:
        unknowns: from ``parse_unknowns``.
        priors: mean and standard deviation [SI], the latter above 0, by path, pattern or short
            form; None for no prior.
        option: where the names were given, for messages.

    Raises:
        UsageError: an unknown path.
    """
    result = list(unknowns)
    for name, prior in priors.items():
        for k in _chosen(result, name, option):
            result[k] = replace(result[k], prior=prior)
    return tuple(result)


def starting_values(document: Document, texts: Iterable[str]) -> dict[str, float]:
    """Numbers by path from ``path=value`` [SI], patterns and short forms included.

    Raises:
        UsageError: an unknown parameter, or an invalid number.
    """
    values: dict[str, float] = {}
    for text in texts:
        name, _, given = text.rpartition("=")
        value = _number_of(given, text)
        for member in split_outside(SHORT_FORMS.get(name, name), "="):
            pattern, sign = _signed(member)
            for group in matching_paths(document, pattern):
                values |= dict.fromkeys(group, sign * value)
    return values


def _chosen(unknowns: Sequence[Unknown], name: str, given: str) -> list[int]:
    """Indices of the unknowns that a path, pattern or short form selects."""
    pattern = SHORT_FORMS.get(name, name).replace("{*}", "*")
    chosen = [
        k
        for k, unknown in enumerate(unknowns)
        if any(path == name or fnmatchcase(path, pattern) for path in unknown.paths)
    ]
    if not chosen:
        fitted = ", ".join(unknown.paths[0] for unknown in unknowns)
        raise UsageError(f"{given}: {name} is not among the fitted numbers ({fitted}): fit it, too")
    return chosen


def _number_of(text: str, whole: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise UsageError(f"{text!r} in {whole!r} is not a number") from error
    if not isfinite(value):
        raise UsageError(f"{text!r} in {whole!r} must be finite")
    return value
