"""Checks whether the estimator's settings match the replay's.  Does not depend on ROS."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.conditioning.conditioner import MODES, Mode
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model

TOLERANCE: Final = 1e-6
"""Relative difference up to which two preloads count as equal."""


class NodeSettings(NamedTuple):
    """Parameters of an estimator node that matter for a replay."""

    conditioning: Mode = MODES[0]
    preload: tuple[float, ...] = ()
    """Current preload of every cable [N]; empty if unknown."""
    max_rate_hz: float = 0.0
    """Maximum rate of published estimates [Hz]; 0: no limit."""


def require_every_sample(settings: NodeSettings) -> None:
    """Check that the node publishes every estimate.

    Raises:
        UsageError: it does not, and the replay would count the missing estimates as lost.
    """
    if settings.max_rate_hz > 0.0:
        raise UsageError(
            "the estimator publishes only some of its estimates (max_rate = "
            f"{settings.max_rate_hz:g} Hz); for a replay start it with max_rate:=0"
        )


def preload_difference(model: Model, settings: NodeSettings) -> str:
    """Describe preloads of the node that differ from the replay's robot, with remedies.

    Args:
        model: the robot from the replay's ``--robot`` and ``--preload``.
        settings: settings of the node.

    Returns:
        One line with both values; empty if they agree or the node's preloads are unknown.
    """
    cables = model.robot.cables
    ours = [cable.preload for cable in cables]
    theirs = settings.preload
    if not theirs or (len(ours) == len(theirs) and np.allclose(ours, theirs, rtol=TOLERANCE)):
        return ""
    names = [cable.name for cable in cables]
    if len(ours) != len(theirs):
        return (
            f"the estimator has {len(theirs)} preloads, {model.robot.name} has {len(ours)}: "
            "it is of another robot"
        )
    text = ", ".join(
        f"{name} {node:g} N in the estimator, {own:g} N here"
        for name, node, own in zip(names, theirs, ours, strict=True)
    )
    return (
        f"preloads differ: {text}. The estimates are those of the estimator; start it with "
        f"-p preload:=[{','.join(f'{own:g}' for own in ours)}], call its ~/set_preload, or give "
        "--use-node-preload"
    )


def slow_playback(rate: float | None, *, paused: bool, clock: bool) -> str:
    """What a slow or paused playback does to the estimator's statuses, with remedies.

    Args:
        rate: multiple of real time; None: as fast as possible.
        paused: whether the playback starts paused.
        clock: whether the playback publishes /clock.

    Returns:
        One line; empty if stamps do not fall behind the estimator's clock.
    """
    if clock or not (paused or (rate is not None and rate < 1.0)):
        return ""
    return (
        "the recording is played slower than it was made: the estimator marks its estimates "
        "STALE, unless it follows the playback (--clock here, use_sim_time:=true there) or has "
        "same_clock_within:=0"
    )
