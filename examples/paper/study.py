"""All runs behind the figures and tables, and the figures of what the source describes in words.

A cycle goes from one upper limit of the joint to the next: a stroke down, a stroke up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from cdrj_ros.evaluation.metrics import ChannelError, channel_error, mean_over_channels
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation.load import Load
from examples.paper.joint import rolling_load
from examples.paper.runs import (
    CABLES,
    EXPERIMENTS,
    LOAD,
    Experiment,
    Forces,
    Motion,
    Recording,
    Run,
    estimate,
    move_freely,
    record,
    with_constant_wraps,
    with_friction,
)

COMMON_RHO: Final = (0.2, 0.2)
"""rho of both cables in figures 12 and 13."""

FREE_PRELOAD: Final = (20.0, 20.0)
"""Preload of both cables in figure 9 [N]."""

FREE_RHOS: Final = (0.0, 0.2, 1.0)
"""rho in figure 9: bearings alone, the source's common value, sliding alone."""

CHOICES: Final[Mapping[str, Callable[[Robot], Robot]]] = {
    "ours": lambda r: r,
    "law steady, (24) and (37) with the sign of motion": lambda r: with_friction(r, law="steady"),
    "law lugre, (33)-(36)": lambda r: with_friction(r, law="lugre"),
    "law lugre, sigma1 = 1000 N s/m (Table II)": lambda r: with_friction(
        r, law="lugre", bristle_damping=1000.0
    ),
    "sigma2 = 500 N s/m (Table II)": lambda r: with_friction(r, viscous=500.0),
    "v_s = 0.1 mm/s (text) for 50 mm/s (Table II)": lambda r: with_friction(r, stribeck_speed=1e-4),
    "static friction by the capstan equation for (35)": lambda r: with_friction(
        r, stribeck="capstan"
    ),
    "rho = 0.2 for both cables": lambda r: with_friction(r, rho=COMMON_RHO),
    "arcs constant, (3)": with_constant_wraps,
}
"""Estimators: ours, and those that differ from it in one choice, mostly the source's."""

OURS, STEADY, LUGRE, *_ = CHOICES
COMMON: Final = "rho = 0.2 for both cables"

FORWARD: Final[Mapping[str, tuple[Load, float]]] = {
    "corrected": (LOAD, 1.0),
    "joint dynamics as printed, (7) and (9)": (rolling_load(printed=True), 1.0),
    "lever arm as printed, (10)": (LOAD, 0.5),
}
"""Loads and lever arms of the joint's equation of motion."""

CORRECTED, PRINTED_DYNAMICS, PRINTED_LEVER = FORWARD

TOLD: Final = ("tension/{}/8", "nodal_force/{}/3", "friction/{}/3")
"""Channels of figures 12, 13 and 14, by cable."""


@dataclass(frozen=True)
class Result:
    """One experiment: what the rig's sensors read, and what every estimator says."""

    experiment: Experiment
    rig: Recording
    estimates: Mapping[str, Forces]
    """By the names of ``CHOICES``."""
    forward: Mapping[str, Run | None]
    """The prescribed motion with each of ``FORWARD``; None if a cable would have to push."""

    def used(self, channel: str) -> Vector:
        """The source's estimate of a channel: friction with rho identified, others with 0.2."""
        return self.estimates[OURS if channel.startswith("friction") else COMMON][channel]


@dataclass(frozen=True)
class Study:
    """All runs of a robot."""

    robot: Robot
    motion: Motion
    results: tuple[Result, ...]
    free: Mapping[float, Run]
    """Figure 9: by rho."""


def work(robot: Robot, motion: Motion, *, cells: int, progress: Callable[[float], None]) -> Study:
    """Run everything.

    Args:
        robot: the prototype.
        motion: of the joint.
        cells: contact cells per pulley of the rig.
        progress: called with the share that is done, in [0, 1].
    """
    results = []
    for k, experiment in enumerate(EXPERIMENTS):
        rig = with_friction(robot, experiment.preload, experiment.rho)
        recording = record(rig, motion, cells=cells, seed=k)
        estimates = {name: estimate(recording, choose(rig)) for name, choose in CHOICES.items()}
        forward = {name: _taut(rig, motion, *printed) for name, printed in FORWARD.items()}
        results.append(Result(experiment, recording, estimates, forward))
        progress((k + 1) / (len(EXPERIMENTS) + 1))
    free = {
        rho: move_freely(with_friction(robot, FREE_PRELOAD, (rho, rho)), motion)
        for rho in FREE_RHOS
    }
    progress(1.0)
    return Study(robot, motion, tuple(results), free)


def _taut(robot: Robot, motion: Motion, load: Load, lever: float) -> Run | None:
    try:
        return move_freely(robot, motion, load, lever)
    except UsageError:
        return None


def errors_of(result: Result, choice: str, pattern: str) -> ChannelError:
    """Errors of a pattern of channels, averaged over both cables as in the source."""
    named = (pattern.format(cable) for cable in CABLES)
    estimated, read = result.estimates[choice], result.rig.read
    return mean_over_channels(channel_error(estimated[name], read[name]) for name in named)


def change_of(result: Result, choice: str, pattern: str) -> tuple[float, float]:
    """Change of our estimate by one of ``CHOICES``: mean and largest over both cables [N]."""
    ours, theirs = result.estimates[OURS], result.estimates[choice]
    changes = [np.abs(theirs[name] - ours[name]) for name in map(pattern.format, CABLES)]
    return float(np.mean(changes)), float(np.max(changes))


def forward_change(result: Result, name: str, element: int) -> tuple[float, float] | None:
    """Change of the tensions of a prescribed motion by a printed equation: mean and largest [N].

    The joint waits for different times at reversals, so a tenth of a second before and after each
    is left out.  None if a cable would have to push.
    """
    ours, theirs = result.forward[CORRECTED], result.forward[name]
    if ours is None or theirs is None:
        return None
    kept = from_turn(ours.time, result.rig) > 0.1
    changes = [
        np.abs(np.interp(ours.time, theirs.time, theirs.true[key]) - ours.true[key])[kept]
        for key in (f"tension/{cable}/{element}" for cable in CABLES)
    ]
    return float(np.mean(changes)), float(np.max(changes))


def from_turn(time: Vector, run: Run) -> Vector:
    """Time from or to the nearest turn of a run's joint [s], shape (n,)."""
    return np.asarray(np.min(np.abs(time[:, None] - run.turns), axis=1))


def strokes(run: Run) -> tuple[slice, slice]:
    """The samples of the first cycle's strokes, down and up; both have the turn in between."""
    turn, end = np.searchsorted(run.time, run.turns[1:3])
    return slice(0, int(turn)), slice(int(turn), int(end))


def arch(angle: Vector, values: Vector) -> float:
    """Height of a stroke's curve above the line between its ends, at mid-range [N].

    Positive for an arch, one half of an M.  The tenth of the range next to each limit, where
    friction changes its direction, does not count as an end.
    """
    share = (angle - angle.min()) / np.ptp(angle)
    low, middle, high = (values[np.abs(share - at) < 0.02].mean() for at in (0.1, 0.5, 0.9))
    return float(middle - 0.5 * (low + high))


def loop_width(angle: Vector, values: Vector) -> float:
    """Mean width of a closed cycle's loop, as a share of the mean value."""
    area = np.sum(0.5 * (values + np.roll(values, -1)) * (np.roll(angle, -1) - angle))
    return float(np.abs(area) / np.ptp(angle) / np.mean(values))


def at_mid_range(angle: Vector, values: Vector) -> tuple[float, float]:
    """Value where the angle passes the middle of its range, going up and going down."""
    middle = 0.5 * float(angle.min() + angle.max())
    before, after = angle[:-1] - middle, angle[1:] - middle
    crossings = np.flatnonzero((before < 0.0) != (after < 0.0))
    share = before[crossings] / (before[crossings] - after[crossings])
    there = values[crossings] + share * (values[crossings + 1] - values[crossings])
    rising = after[crossings] > before[crossings]
    return float(there[rising].mean()), float(there[~rising].mean())
