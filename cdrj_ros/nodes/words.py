"""Log messages of the estimator about its inputs.  Does not depend on ROS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.refusals import REFUSALS
from cdrj_ros.foundation.text import counted, printable
from cdrj_ros.robot.description import Robot

MANY: Final = 8
"""Maximum number of names in a list."""

LONG: Final = 60
"""Maximum number of characters shown of a name."""

SILENT_S: Final = 1.5
"""Time without a message after which a topic counts as silent [s]."""

TOLERATED_PER_S: Final = 5.0
"""Rate of refused readings below which no warning is given [1/s]."""


@dataclass
class TopicHeard:
    """What has been received on one input topic."""

    topic: str
    """Fully qualified name."""
    axes: tuple[str, ...] = ()
    """Motors and joints that it should carry."""
    messages: int = 0
    """Number of messages decoded since the start."""
    names: Sequence[str] = ()
    """Names in the latest message."""
    positions: Sequence[float] | NDArray[np.float64] = ()
    """Positions in the latest message [rad or m]."""
    publishers: int = 0
    silent_s: float = 0.0
    """Time since the last message, to the second, as of the last ``look`` [s]."""
    _seen: tuple[int, float] = (0, 0.0)
    """Number of messages at the last change of it, and its time [s]."""

    def look(self, now_s: float) -> None:
        """Measure the silence; call once a second.

        Args:
            now_s: time of a steady clock [s].
        """
        if self.messages != self._seen[0]:
            self._seen = self.messages, now_s
        self.silent_s = now_s - self._seen[1] if self.messages else 0.0


def listed(names: Sequence[str]) -> str:
    """A list of untrusted names, truncated and made printable."""
    shown = [printable(name)[:LONG] or "''" for name in names[:MANY]]
    more = f" and {len(names) - MANY} more" if len(names) > MANY else ""
    return ", ".join(shown) + more


def refusals(refused: Mapping[str, int]) -> str:
    """Counts of refused readings by cause, with an explanation; empty if there are none."""
    return "; ".join(
        f"{count} {cause} ({REFUSALS.get(cause, cause)})"
        for cause, count in sorted(refused.items(), key=lambda item: -item[1])
        if count
    )


def heard_on(topic: TopicHeard, unheard: Sequence[str], robot: Robot) -> str:
    """Describe one topic: messages received, missing names, and positions out of range."""
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
        topics: what has been received on each input topic.
        unheard: motors and joints without an accepted reading.
        refused: readings refused, by cause.
        robot: provides the joints and their ranges.
    """
    silent = [topic.topic for topic in topics if topic.silent_s > SILENT_S]
    if unheard:
        what = f"no reading of {listed(unheard)} accepted"
    elif silent:
        what = f"no further message on {listed(silent)}"
    else:
        what = "no common time of all axes"
    lines = [what, *(heard_on(topic, unheard, robot) for topic in topics)]
    if words := refusals(refused):
        lines.append(f"refused: {words}")
    return ". ".join(lines)


def refusal_rate(
    refused: Mapping[str, int], before: Mapping[str, int], elapsed_s: float
) -> tuple[float, str]:
    """Rate of refused readings since the last call, and the reasons.

    Unknown names are not counted: a shared topic may carry other axes.

    Returns:
        The rate [1/s] and a description of it, which is empty if the rate is tolerated.
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
