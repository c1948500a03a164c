"""Which references are fitted, and by what their residuals are divided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from math import sqrt
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.model.channels import EFFORT, channel_columns
from cdrj_ros.model.prepared import Layout

Vector = NDArray[np.float64]

Weights = Literal["spread", "noise"]
WEIGHTS: Final[tuple[Weights, ...]] = get_args(Weights)


def chosen_channels(
    layout: Layout, recordings: Sequence[Recorded], patterns: Sequence[str]
) -> tuple[str, ...]:
    """Channels that are estimated, recorded in at least one bag, and requested.

    Raises:
        UsageError: a pattern matches none of them; the message lists the existing ones.
    """
    recorded = {name for one in recordings for name in one.references}
    there = [name for name in channel_columns(layout) if name in recorded]
    if not there:
        raise UsageError(
            f"the recordings have no reference of this robot; they have "
            f"{', '.join(sorted(recorded)) or 'none at all'}"
        )
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in there):
            raise UsageError(f"no reference is called {pattern}; there are {', '.join(there)}")
    if not patterns:
        return tuple(there)
    return tuple(n for n in there if any(fnmatchcase(n, pattern) for pattern in patterns))


def spreads(
    recordings: Sequence[Recorded], channels: Sequence[str], rule: Weights
) -> dict[str, float]:
    """Divisor of every channel's residuals.

    Args:
        recordings: all recordings.
        channels: names of the channels.
        rule: ``spread``: standard deviation of the references of the channel's kind, so that a fit
            explains as much of the variance of each kind as it can; ``noise``: standard deviation
            of the sensor's noise, from second differences.
    """
    values = {
        name: [one.references[name][1] for one in recordings if name in one.references]
        for name in channels
    }
    if rule == "noise":
        return {name: max(map(_noise, listed)) for name, listed in values.items()}
    kinds: dict[str, list[str]] = {}
    for name in channels:  # each motor and joint is its own kind: lever arms differ
        kind = name.split("/", 1)[0]
        kinds.setdefault(name if kind == EFFORT else kind, []).append(name)
    result: dict[str, float] = {}
    for members in kinds.values():
        variance = [float(np.var(np.concatenate(values[name]))) for name in members]
        result |= dict.fromkeys(members, max(float(np.sqrt(np.mean(variance))), 1e-9))
    return result


def _noise(values: Vector) -> float:
    """Standard deviation of white noise on a smooth signal, at least that of the quantisation."""
    steps = np.abs(np.diff(values))
    count = float(steps[steps > 0.0].min()) if np.any(steps > 0.0) else 0.0
    bend = np.abs(np.diff(values, 2))
    white = float(np.median(bend)) / 0.6745 / sqrt(6.0) if bend.size else 0.0
    return max(white, min(count, float(np.std(values))) / sqrt(12.0), 1e-9)


def given_sigmas(channels: Sequence[str], given: Mapping[str, float]) -> dict[str, float]:
    """Divisors of the residuals of some channels, by patterns of their names [N] or [N m].

    Raises:
        UsageError: a pattern matches none of the channels.
    """
    result: dict[str, float] = {}
    for pattern, sigma in given.items():
        matching = [name for name in channels if fnmatchcase(name, pattern)]
        if not matching:
            raise UsageError(
                f"no fitted reference is called {pattern}; there are {', '.join(channels)}"
            )
        result |= dict.fromkeys(matching, sigma)
    return result
