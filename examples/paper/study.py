"""All runs and numbers behind the figures and tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.evaluation.channels import Channel
from cdrj_ros.evaluation.metrics import ChannelError, channel_error, mean_over_channels
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot.description import Robot
from examples.paper import curves
from examples.paper.joint import RollingLoad
from examples.paper.runs import (
    CABLES,
    COMMON_RHO,
    EPOCH_NS,
    EXPERIMENTS,
    FREE_PRELOAD,
    FREE_RHOS,
    Experiment,
    Free,
    Motion,
    Recording,
    estimate,
    move_freely,
    record,
    with_constant_wraps,
    with_friction,
)

Vector = NDArray[np.float64]

NEAR_S: Final = 0.5
"""Time around a turn of the joint within which an error is attributed to the reversal [s]."""

CHOICES: Final[Mapping[str, Callable[[Robot], Robot]]] = {
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
"""Estimators that differ from ours in one choice; most choices are the source's."""

STEADY, LUGRE = tuple(CHOICES)[:2]

FORWARD: Final[Mapping[str, tuple[RollingLoad, float]]] = {
    "corrected": (RollingLoad(), 1.0),
    "joint dynamics as printed, (7) and (9)": (RollingLoad(form="published"), 1.0),
    "lever arm as printed, (10)": (RollingLoad(), 0.5),
}
"""Loads and lever arms of the joint's equation of motion."""

CORRECTED, PRINTED_DYNAMICS, PRINTED_LEVER = FORWARD

TOLD: Final = ("tension/{}/8", "nodal_force/{}/3", "friction/{}/3")
"""Channels of figures 12, 13 and 14, by cable."""


@dataclass(frozen=True)
class Result:
    """One experiment: the rig's recording and the estimates of several estimators."""

    experiment: Experiment
    recording: Recording
    common: Mapping[str, Channel]
    """Estimated with rho = 0.2, as the source does in figures 12 and 13."""
    identified: Mapping[str, Channel]
    """Estimated with the rig's rho, as the source does in figure 14."""
    choices: Mapping[str, Mapping[str, Channel]]
    """As ``identified``, with one of ``CHOICES``."""
    forward: Mapping[str, Free | None]
    """The prescribed motion with each of ``FORWARD``; None if a cable would have to push."""

    @property
    def label(self) -> str:
        """The preloads, for headings."""
        return "{:.2f} / {:.2f} N".format(*self.experiment.preload)

    def used(self, channel: str) -> Channel:
        """The estimate in the figures: friction with rho identified, others with rho = 0.2."""
        return (self.identified if channel.startswith("friction") else self.common)[channel]

    def seconds(self, channel: Channel) -> Vector:
        """Time of a channel's samples since the first turn [s]."""
        origin = EPOCH_NS + round(self.recording.turns[0] * 1e9)
        return np.asarray((channel.stamp_ns - origin) * 1e-9)

    def true_error(self, channel: Channel) -> Vector:
        """Estimate minus true value, without the noise of the load cells [N]."""
        at = np.searchsorted(self.recording.stamp_ns, channel.stamp_ns)
        return np.asarray(channel.estimate - self.recording.noiseless[channel.name][at])

    @property
    def turns(self) -> tuple[float, ...]:
        """Turns of the joint since the first [s]."""
        return tuple(turn - self.recording.turns[0] for turn in self.recording.turns)


@dataclass(frozen=True)
class Study:
    """All runs of a robot."""

    robot: Robot
    motion: Motion
    cells: int
    """Contact cells per pulley of the rig."""
    results: tuple[Result, ...]
    free: Mapping[float, Free]
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
        rig = with_friction(robot, preload=experiment.preload, rho=experiment.rho)
        recording = record(rig, motion, cells=cells, seed=k)
        forward = {name: _taut(rig, motion, *printed) for name, printed in FORWARD.items()}
        common = estimate(recording, with_friction(rig, rho=COMMON_RHO))
        others = {name: estimate(recording, choose(rig)) for name, choose in CHOICES.items()}
        results.append(
            Result(experiment, recording, common, estimate(recording, rig), others, forward)
        )
        progress((k + 1) / (len(EXPERIMENTS) + 1))
    free = {
        rho: move_freely(with_friction(robot, preload=FREE_PRELOAD, rho=(rho, rho)), motion)
        for rho in FREE_RHOS
    }
    progress(1.0)
    return Study(robot, motion, cells, tuple(results), free)


def _taut(robot: Robot, motion: Motion, load: RollingLoad, lever: float) -> Free | None:
    try:
        return move_freely(robot, motion, load, lever=lever)
    except UsageError:
        return None


def errors_of(channels: Mapping[str, Channel], pattern: str) -> ChannelError:
    """Errors of a pattern of channels, averaged over both cables as in the source."""
    named = (channels[pattern.format(cable)] for cable in CABLES)
    return mean_over_channels(channel_error(c.estimate, c.reference) for c in named)


def change_of(result: Result, choice: str, pattern: str) -> tuple[float, float]:
    """Change of our estimate by one of ``CHOICES``: mean and largest over both cables [N]."""
    changes = [
        np.abs(result.choices[choice][name].estimate - result.identified[name].estimate)
        for name in (pattern.format(cable) for cable in CABLES)
    ]
    return float(np.mean(changes)), float(np.max(changes))


def forward_change(result: Result, name: str, element: int) -> tuple[float, float] | None:
    """Change of the tensions of a prescribed motion by a printed equation: mean and largest [N].

    The joint waits for different times at reversals, so a tenth of a second before and after each
    is left out.  None if a cable would have to push.
    """
    ours, theirs = result.forward[CORRECTED], result.forward[name]
    if ours is None or theirs is None:
        return None
    kept = ~curves.near_turns(ours.time, result.turns, 0.1)
    changes = [
        np.abs(np.interp(ours.time, theirs.time, theirs.tension[key]) - ours.tension[key])[kept]
        for key in (f"{cable}/{element}" for cable in CABLES)
    ]
    return float(np.mean(changes)), float(np.max(changes))


def first_cycle(result: Result, channel: Channel) -> Channel:
    """The samples of the first cycle, from upper limit to upper limit."""
    kept = result.seconds(channel) < result.turns[2]
    return replace(
        channel,
        stamp_ns=channel.stamp_ns[kept],
        estimate=channel.estimate[kept],
        reference=channel.reference[kept],
        angle=channel.angle[kept],
    )


def features(result: Result, channel: Channel, values: Vector) -> dict[str, float]:
    """Features of a channel's first cycle.

    Args:
        result: whose channel it is.
        channel: from ``first_cycle``.
        values: its estimate or its reference.

    Returns:
        ``humps`` (maxima; of the inverted curve for the lower cable), ``bulge_down`` and
        ``bulge_up`` of the two strokes, ``loop_area``, ``mid_up``, ``mid_down``, ``mean``, and
        ``relative_hysteresis`` if all values are positive.
    """
    down = result.seconds(channel) < result.turns[1]
    up = ~down
    angle = channel.angle
    sign = -1.0 if "/lower/" in channel.name else 1.0
    mid_up, mid_down = curves.at_mid_range(angle, values)
    found = {
        "humps": float(curves.humps(sign * values)),
        "bulge_down": curves.bulge(angle[down], values[down]),
        "bulge_up": curves.bulge(angle[up], values[up]),
        "loop_area": curves.loop_area(angle, values),
        "mid_up": mid_up,
        "mid_down": mid_down,
        "mean": float(values.mean()),
    }
    if values.min() > 0.0:
        found["relative_hysteresis"] = curves.relative_hysteresis(angle, values)
    return found


def differences(angle: Vector, upper: Vector, lower: Vector) -> tuple[float, float]:
    """Upper minus lower tension at mid-range [N], moving up and moving down: figure 9."""
    return curves.at_mid_range(angle, upper - lower)


def numbers(study: Study) -> dict[str, Any]:
    """Every number behind the figures, for ``figures.json``."""
    told: dict[str, Any] = {
        "motion": {
            "amplitude_rad": study.motion.amplitude,
            "frequency_hz": study.motion.frequency,
            "cycles": study.motion.cycles,
        },
        "contact_cells": study.cells,
        "free": {},
        "experiments": {},
    }
    for rho, run in study.free.items():
        winch = differences(run.angle, run.tension["upper/1"], run.tension["lower/1"])
        last = differences(run.angle, run.tension["upper/8"], run.tension["lower/8"])
        told["free"][f"rho {rho:g}"] = {
            "winch_difference_up": winch[0],
            "winch_difference_down": winch[1],
            "last_difference_up": last[0],
            "last_difference_down": last[1],
        }
    for result in study.results:
        told["experiments"][result.experiment.name] = _experiment_numbers(result)
    return told


def _experiment_numbers(result: Result) -> dict[str, Any]:
    channels: dict[str, Any] = {}
    patterns = (*TOLD, "tension/{}/1")
    for name in (pattern.format(cable) for pattern in patterns for cable in CABLES):
        channel = result.used(name)
        cycle = first_cycle(result, channel)
        seconds = result.seconds(channel)
        near = curves.near_turns(seconds, result.turns, NEAR_S)
        size = np.abs(result.true_error(result.identified[name]))
        channels[name] = {
            "rig": features(result, cycle, cycle.reference),
            "estimate": features(result, cycle, cycle.estimate),
            "error": vars(channel_error(channel.estimate, channel.reference)),
            "error_rho_known": vars(
                channel_error(result.identified[name].estimate, result.identified[name].reference)
            ),
            "true_error_rho_known": {
                "mean": float(size.mean()),
                "largest": float(size.max()),
                "largest_s_from_turn": float(
                    np.min(np.abs(np.asarray(result.turns) - seconds[np.argmax(size)]))
                ),
                "mean_near_turns": float(size[near].mean()),
                "mean_elsewhere": float(size[~near].mean()),
            },
        }
    upper, lower = (first_cycle(result, result.common[f"tension/{c}/1"]) for c in CABLES)
    up, down = differences(upper.angle, upper.reference, lower.reference)
    return {
        "preload": result.experiment.preload,
        "rho": result.experiment.rho,
        "channels": channels,
        "winch_difference_up": up,
        "winch_difference_down": down,
        "choices": {
            choice: {
                pattern.format("*"): dict(
                    zip(
                        ("mean_change", "largest_change"),
                        change_of(result, choice, pattern),
                        strict=True,
                    )
                )
                | {"mean_error": errors_of(result.choices[choice], pattern).mean_abs_error}
                for pattern in TOLD
            }
            for choice in CHOICES
        },
        "forward": {
            name: {
                f"tension/*/{element}": forward_change(result, name, element) for element in (1, 8)
            }
            for name in FORWARD
        },
    }
