"""What is wrong with readings, in words: the axis, its size, and the remedy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise
from math import ceil, isfinite, radians
from typing import Final

import numpy as np

from cdrj_ros._core import MAX_GAP_NS
from cdrj_ros.estimation.ensemble import UNSURE_SHARE
from cdrj_ros.estimation.verdict_words import swap
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.output import listed, printable
from cdrj_ros.robot.description import Joint, Robot

REFUSALS: Final[Mapping[str, str]] = {
    "malformed": "message refused whole: neither one position per name nor none, or not decodable",
    "empty": "message without a name",
    "unstamped": "message with a stamp before zero, or of zero before the clock has started",
    "unknown_name": "name that the robot file does not have",
    "not_finite": "NaN or infinite position",
    "repeated": "stamp equal to the last one accepted",
    "contradictory": "stamp of a reading accepted before, or between two, with another value",
    "late": "stamp before the last one accepted, or before the clock's zero",
    "future": "stamp too far ahead and not confirmed by later readings, or never valid",
    "out_of_range": "joint angle outside its range",
    "implausible": "further from the last reading than max_speed allows, or than any angle",
}
"""Causes for which a reading is refused, and their meaning."""

WHOLE: Final = ("malformed", "empty", "unstamped")
"""Causes for which a message is refused whole and counted once, however many names it has."""

REMEDIES: Final[Mapping[str, str]] = {
    "unstamped": "set header.stamp, or leave it zero to have the time of arrival used",
    "not_finite": "publish only axes that have a reading",
    "repeated": "let one node publish the axis, and stamp every reading anew",
    "contradictory": "let one node publish the axis, once in every message",
    "late": "let one node publish the axis, with one clock",
    "future": "synchronise the clocks, or state the clock_offset",
    "out_of_range": "correct scale, offset or range in the robot file",
    "implausible": "correct scale, resolution or max_speed, or let one node publish the axis",
}
"""What to do about them, where the meaning does not say it."""

Sizes = Mapping[str, Mapping[str, float]]
"""Largest refused reading by axis and cause, see ``Conditioner.take_refused``."""

FAR: Final = 3.0
"""An angle beyond this many times the end of its range may be in another unit."""

BESIDE: Final = 0.1
"""An angle beyond its range by more than this share of it may have the wrong sign."""

NOTED: Final = 0.01
"""Share of a preload that motions between two readings may be worth without a word."""

SHOWN: Final = 4
"""Maximum number of axes that are named for one cause."""


def refusal_words(counts: Mapping[str, int], sizes: Sizes, robot: Robot) -> str:
    """What was refused, the most frequent cause first; empty if nothing was.

    Args:
        counts: refused readings or messages, by cause.
        sizes: of the same time.
        robot: gives ranges and speeds.
    """
    words = []
    for cause, count in sorted(counts.items(), key=lambda item: -item[1]):
        if not count:
            continue
        own = {axis: of_axis[cause] for axis, of_axis in sizes.items() if cause in of_axis}
        if cause == "out_of_range":
            named = range_words(robot, own)
        else:
            named = [_sized(cause, axis, size, robot) for axis, size in own.items()]
        parts = [f"{count} {cause} ({REFUSALS.get(cause, cause)})", listed(named, SHOWN)]
        said = ": ".join(part for part in parts if part)
        words.append(", ".join(part for part in (said, REMEDIES.get(cause, "")) if part))
    return "; ".join(words)


def _sized(cause: str, name: str, size: float, robot: Robot) -> str:
    """An axis and the size of what is wrong with it."""
    shown = printable(name)
    if cause in ("late", "future") and size != 0.0:
        return f"{shown} by {abs(size):.3g} s"
    (axis,) = (one for one in robot.as_read.axes if one.name == name)
    if cause == "implausible" and isfinite(size):
        speed = f"{abs(size):.4g} {robot.unit_of(name)}/s"
        return f"{shown} at {speed}, max_speed is {axis.max_speed:.4g}"
    return shown


def range_words(robot: Robot, angles: Mapping[str, float]) -> list[str]:
    """Joints outside of their ranges, and what may explain one, or two of them.

    Args:
        robot: gives ranges and sensors.
        angles: by joint [rad] or [m].
    """
    outside = [one for one in robot.as_read.joints if one.name in angles]
    words = [
        swap(printable(first.name), printable(second.name))
        for first, second in combinations(outside, 2)
        if all(_beyond(one, angles[one.name]) > BESIDE for one in (first, second))
        and _beyond(second, _at(second, _read(first, angles[first.name]))) <= 0.0
        and _beyond(first, _at(first, _read(second, angles[second.name]))) <= 0.0
    ]
    for joint in outside:
        angle, slides = angles[joint.name], joint.name in robot.prismatic_joints
        hint = _unit_or_sign(joint, angle, slides=slides)
        words.append(
            f"joint {printable(joint.name)} at {angle:.4g}, its range is {joint.lower:.4g} to "
            f"{joint.upper:.4g}{hint}"
        )
    return words


def _unit_or_sign(joint: Joint, angle: float, *, slides: bool) -> str:
    """The unit or sign that may explain an angle outside of the range; empty if none does."""
    unit, words = (1e-3, "mm? scale: 0.001") if slides else (radians(1.0), "degrees? scale_deg: 1")
    far = abs(angle) > FAR * max(abs(joint.lower), abs(joint.upper))
    if far and joint.lower <= unit * angle <= joint.upper:
        return f": in {words}; or another axis's name?"
    in_radians = joint.sensor.offset + _read(joint, angle)
    if joint.sensor.scale == radians(1.0) and joint.lower <= in_radians <= joint.upper:
        return ": in radians? scale: 1 in place of scale_deg"
    if joint.lower <= -angle <= joint.upper and _beyond(joint, angle) > BESIDE:
        return f": the other way? scale: {-joint.sensor.scale:.4g}"
    return ""


def _beyond(joint: Joint, angle: float) -> float:
    """How far an angle is beyond the range, as a share of it; at most 0 inside."""
    return max(joint.lower - angle, angle - joint.upper) / (joint.upper - joint.lower)


def _read(joint: Joint, angle: float) -> float:
    """The published position of an angle, but for a correction."""
    return (angle - joint.sensor.offset) / joint.sensor.scale


def _at(joint: Joint, position: float) -> float:
    """The angle of a published position, but for a correction."""
    return joint.sensor.offset + joint.sensor.scale * position


def clocks_apart(ahead: Mapping[str, int]) -> str:
    """Axes whose clock differs from that of the others by more than a second, and the remedy.

    Args:
        ahead: stamps less times of arrival, by axis [ns], see ``Conditioner.ahead``.

    Returns:
        A sentence without full stop; empty if the clocks agree.
    """
    order = sorted(ahead, key=ahead.__getitem__)
    steps = [ahead[after] - ahead[before] for before, after in pairwise(order)]
    if max(steps, default=0) <= MAX_GAP_NS:
        return ""
    first = 1 + steps.index(max(steps))
    behind, beyond = order[:first], order[first:]
    difference_s = (ahead[beyond[0]] - ahead[behind[-1]]) * 1e-9
    # which clock is right is unknown: the one of fewer axes is named
    few, others, direction, correction_s = beyond, behind, "ahead of", -difference_s
    if len(behind) < len(beyond):
        few, others, direction, correction_s = behind, beyond, "behind", difference_s
    named = ", ".join(map(printable, few))
    return (
        f"the stamps of {named} are {difference_s:.1f} s {direction} those of "
        f"{', '.join(map(printable, others))}: synchronise the clocks, or add {correction_s:.1f} "
        f"to the clock_offset of {named} in the robot file"
    )


def sparse_words(
    robot: Robot, worth: Sequence[float], midway: Vector, rate_hz: float, noted: float = NOTED
) -> str:
    """Axes whose motion between two readings is unknown, and the rate that would show it.

    What a smooth motion leaves unknown midway is as the square of the time between two readings.

    Args:
        robot: names the axes.
        worth: by axis, see ``conditioner.worth_of``.
        midway: standard deviations midway between two samples [rad], shape (axes,).
        rate_hz: rate of the samples [Hz], positive.
        noted: share of a preload from which an axis is named.

    Returns:
        A sentence without full stop; empty if there is no such axis.
    """
    shares = {
        printable(axis.name): UNSURE_SHARE * float(unknown) / own
        for axis, unknown, own in zip(robot.as_read.axes, midway, worth, strict=True)
        if own > 0.0 and UNSURE_SHARE * unknown > noted * own
    }
    if not shares:
        return ""
    most = max(shares.values())
    worst = sorted(shares, key=shares.__getitem__, reverse=True)
    what = f"{listed(worst)} read at {rate_hz:.3g} Hz: too sparse for this motion"
    if not np.isfinite(most):
        return what
    enough = ceil(rate_hz * np.sqrt(most / NOTED))
    return f"{what}, which between two readings is worth {most:.0%} of a preload; {enough} Hz do"
