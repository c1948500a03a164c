"""What the estimator says about its inputs on the console.  No ROS here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.time_line import REFUSALS
from cdrj_ros.foundation.text import counted, printable
from cdrj_ros.robot.description import Robot

MANY: Final = 8
"""Names that are listed at most."""

LONG: Final = 60
"""Characters of a name that are shown at most."""

TOLERATED_PER_S: Final = 5.0
"""Refused readings per second that are nothing to worry about."""


@dataclass
class TopicHeard:
    """What has come on one input topic."""

    topic: str
    """Full name."""
    axes: tuple[str, ...] = ()
    """Motors and joints that it should carry."""
    messages: int = 0
    """Decoded messages, since the start."""
    names: Sequence[str] = ()
    """Of the latest message."""
    positions: Sequence[float] | NDArray[np.float64] = ()
    """Of the latest message [rad or m]."""
    publishers: int = 0


def listed(names: Sequence[str]) -> str:
    """Names from outside, few and short, safe to print."""
    shown = [printable(name)[:LONG] or "''" for name in names[:MANY]]
    more = f" and {len(names) - MANY} more" if len(names) > MANY else ""
    return ", ".join(shown) + more


def refusals(refused: Mapping[str, int]) -> str:
    """Counts of refused readings by cause, with what the cause means; empty if there are none."""
    return "; ".join(
        f"{count} {cause} ({REFUSALS.get(cause, cause)})"
        for cause, count in sorted(refused.items(), key=lambda item: -item[1])
        if count
    )


def heard_on(topic: TopicHeard, unheard: Sequence[str], robot: Robot) -> str:
    """One topic: what it should carry, what it carries instead, and readings out of range."""
    expected = [axis for axis in topic.axes if axis in unheard]
    if not topic.messages:
        there = counted(topic.publishers, "publisher") if topic.publishers else "no publisher"
        return f"{topic.topic}: {there}, no message"
    parts = [counted(topic.messages, "message")]
    if missing := [axis for axis in expected if axis not in topic.names]:
        parts.append(f"the last names {listed(topic.names) or 'nothing'}, not {listed(missing)}")
    parts += _out_of_range(topic, robot)
    return f"{topic.topic}: {', '.join(parts)}"


def _out_of_range(topic: TopicHeard, robot: Robot) -> list[str]:
    at = dict(zip(topic.names, topic.positions, strict=False))
    return [
        f"joint {joint.name} at {at[joint.name]:.4g}, its range is "
        f"{joint.lower:.4g} to {joint.upper:.4g}"
        for joint in robot.joints
        if joint.name in at and not joint.lower <= at[joint.name] <= joint.upper
    ]


def missing_inputs(
    topics: Sequence[TopicHeard],
    unheard: Sequence[str],
    refused: Mapping[str, int],
    robot: Robot,
) -> str:
    """Why there is no estimate.

    Args:
        topics: what has come on each input topic.
        unheard: motors and joints of which no reading has been accepted.
        refused: readings refused, by cause.
        robot: its names and ranges.
    """
    what = f"no reading of {listed(unheard)} accepted" if unheard else "no common time of all axes"
    lines = [what, *(heard_on(topic, unheard, robot) for topic in topics)]
    if words := refusals(refused):
        lines.append(f"refused: {words}")
    return ". ".join(lines)


def refusal_rate(
    refused: Mapping[str, int], before: Mapping[str, int], elapsed_s: float
) -> tuple[float, str]:
    """Refused readings per second since the last look, and why.

    Names that the robot file does not have are left out: other axes on a shared topic are normal.

    Returns:
        The rate [1/s] and the words for it; empty words if it can be tolerated.
    """
    since = {
        cause: count - before.get(cause, 0)
        for cause, count in refused.items()
        if cause != "unknown_name"
    }
    rate = sum(since.values()) / elapsed_s if elapsed_s > 0.0 else 0.0
    if rate <= TOLERATED_PER_S:
        return rate, ""
    return rate, f"{rate:.0f} readings per second refused: {refusals(since)}"
