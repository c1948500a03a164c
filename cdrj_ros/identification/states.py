"""States of the mechanism that recordings visit: stretches of its main motion, forward and back.

A residual that is not noise depends on the state in which it was measured.  Two residuals in the
same state therefore tell nearly the same, however many cycles lie between them.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.identification.observations import Observations, samples_of, thinned
from cdrj_ros.identification.residuals import Problem

Vector = NDArray[np.float64]
Labels = NDArray[np.int64]

STRETCHES: Final = 4
"""Number of stretches into which the main motion is divided, each forward and back."""

FINE: Final = 16
"""The same for the means of residuals, which differ from stretch to stretch."""

VISITED: Final = 0.01
"""Fraction of a recording from which a state counts as visited."""

RATE_WINDOW_S: Final = 0.05
"""Half the window in which the direction of motion is determined [s]."""


def states_of_samples(problem: Problem, stretches: int = STRETCHES) -> list[tuple[Samples, Labels]]:
    """Samples of every recording and the state of each sample, from 0 to 2 ``stretches`` - 1."""
    samples = [
        one.samples or thinned(samples_of(problem.begin, one.recorded), one.stride)
        for one in problem.observations
    ]
    angles = [np.hstack([one.motor_angle, one.joint_angle]) for one in samples]
    every = np.concatenate(angles)
    scale = np.maximum(every.std(axis=0), 1e-12)
    centre = every.mean(axis=0)
    _, directions = np.linalg.eigh(np.atleast_2d(np.cov(((every - centre) / scale).T)))
    along = [((angle - centre) / scale) @ directions[:, -1] for angle in angles]
    edges = np.quantile(np.concatenate(along), np.linspace(0.0, 1.0, stretches + 1)[1:-1])
    return [
        (one, 2 * np.searchsorted(edges, position) + _moves_forward(one.stamp_ns, position))
        for one, position in zip(samples, along, strict=True)
    ]


def visited_states(problem: Problem) -> int:
    """Number of states that the recordings visit, counted in every recording."""
    count = 0
    for _, state in states_of_samples(problem):
        _, visits = np.unique(state, return_counts=True)
        count += int(np.count_nonzero(visits > VISITED * state.size))
    return count


def independent_states(problem: Problem) -> int:
    """Number of residuals that count as independent when fits are compared, at least 1.

    Errors of the model repeat in every recording of a motion, so it is that of one recording at
    most.
    """
    return max(1, min(visited_states(problem), 2 * STRETCHES))


def states_of_residuals(problem: Problem) -> Labels:
    """State of every residual, numbered through all recordings, shape (n,)."""
    labels, count = [], 0
    for observed, (samples, state) in zip(
        problem.observations, states_of_samples(problem), strict=True
    ):
        labels += [count + one for one in _at_references(observed, samples, state)]
        count += 2 * STRETCHES
    return np.concatenate(labels)


def cells_of_residuals(problem: Problem) -> Labels:
    """``FINE`` state and reference of every residual, one number for both, shape (n,)."""
    labels, count = [], 0
    for observed, (samples, state) in zip(
        problem.observations, states_of_samples(problem, FINE), strict=True
    ):
        for one in _at_references(observed, samples, state):
            labels.append(count + one)
            count += 2 * FINE
    return np.concatenate(labels)


def _at_references(observed: Observations, samples: Samples, state: Labels) -> list[Labels]:
    """States at the stamps of one recording's references, one array per channel."""
    last = samples.stamp_ns.size - 1
    return [
        state[np.clip(np.searchsorted(samples.stamp_ns, channel.stamp_ns), 0, last)]
        for channel in observed.channels
    ]


def _moves_forward(stamp_ns: Labels, position: Vector) -> Labels:
    """1 where the position rises, 0 where it falls; at rest, the previous value."""
    time = (stamp_ns - stamp_ns[0]) * 1e-9
    earlier = np.interp(time - RATE_WINDOW_S, time, position)
    later = np.interp(time + RATE_WINDOW_S, time, position)
    change = later - earlier
    moving = np.abs(change) > 1e-3 * max(float(np.ptp(position)), 1e-12)
    last = np.maximum.accumulate(np.where(moving, np.arange(time.size), 0))
    forward: Labels = (change[last] > 0.0).astype(np.int64)
    return forward
