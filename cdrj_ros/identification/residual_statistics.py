"""Variance of residuals that are not white: (I2), (I5), (I6) in docs/identification.md.

Most of a residual is error of the model, which depends on the state of the mechanism: a stretch of
its main motion, forward or back.  Two residuals in the same state tell nearly the same, however
many cycles lie between them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.identification.observations import (
    Channel,
    Observations,
    noise_of,
    samples_by,
    white_noise,
)
from cdrj_ros.identification.problem import Problem

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
    samples = [samples_by(problem.begin, one) for one in problem.observations]
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
    """Number of states that recordings visit whose noise is open, counted in every one of them."""
    count = 0
    for observed, (_, state) in zip(problem.observations, states_of_samples(problem), strict=True):
        if all(channel.scale is not None for channel in observed.channels):
            continue
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
    states = enumerate(_at_references(problem, STRETCHES))
    return np.concatenate([2 * STRETCHES * k + one for k, parts in states for one in parts])


def cells_of_residuals(problem: Problem) -> Labels:
    """``FINE`` state and reference of every residual, one number for both, shape (n,).

    A residual whose noise is stated has a number of its own.
    """
    states = [one for parts in _at_references(problem, FINE) for one in parts]
    found = np.concatenate([2 * FINE * k + one for k, one in enumerate(states)])
    stated = noise_stated(problem)
    found[stated] = 2 * FINE * len(states) + np.arange(int(stated.sum()))
    return found


def _at_references(problem: Problem, stretches: int) -> Iterator[list[Labels]]:
    """States at the stamps of every recording's references, one array per channel."""
    recordings = zip(problem.observations, states_of_samples(problem, stretches), strict=True)
    for observed, (samples, state) in recordings:
        last = samples.stamp_ns.size - 1
        yield [
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


ROUNDS: Final = 30
"""Largest number of rounds in which the variance is computed."""

SETTLED: Final = 0.01
"""Relative change of the variance that ends the rounds."""


def effective_variance(problem: Problem, residuals: Vector) -> float:
    """(I2): variance that gives residuals and priors their weights in the fit.

    Args:
        problem: problem with the observations of the residuals.
        residuals: residuals with robust weights applied, shape (n,).
    """
    recordings = _measured(problem, residuals)
    if not recordings:
        return max(1.0, problem.least_variance)
    power = np.concatenate([_powers(parts) for parts in recordings])
    size, whole = _size_and_squares(recordings)
    white = white_variance(problem, residuals)
    independent = float(power.sum()) ** 2 / max(float(np.sum(power**2)), 1e-300)
    pieces = max(1.0, min(independent, float(visited_states(problem)), float(size)))
    return max(white + (whole / size - white) * size / pieces, problem.least_variance, 1e-300)


def lasting_squares(problem: Problem, residuals: Vector) -> float:
    """Sum of squares of the residuals if each were the mean over its share of the recordings.

    The shares are those of ``independent_states``: white noise nearly vanishes in such means, and
    what lasts stays.

    Args:
        problem: problem with the observations of the residuals.
        residuals: residuals with robust weights applied, shape (n,).
    """
    size, whole = _size_and_squares(_measured(problem, residuals))
    if not size:
        return 0.0
    return whole + white_variance(problem, residuals) * (independent_states(problem) - size)


def white_variance(problem: Problem, residuals: Vector) -> float:
    """w² of (I2): variance of the white noise on the residuals, at most their mean square.

    Args:
        problem: problem with the observations of the residuals.
        residuals: residuals with robust weights applied, shape (n,).
    """
    size, whole = _size_and_squares(_measured(problem, residuals))
    noise = 0.0
    for _, channel, part in by_channel(problem, residuals):
        if channel.scale is None:  # that of means is known, and too few show it
            noise += part.size * (1.0 if channel.averaged else white_noise(part) ** 2)
    return min(noise, whole) / size if size else 1.0


def noise_stated(problem: Problem) -> NDArray[np.bool_]:
    """Which residuals have a stated noise of 1, as readings of a spring scale have, shape (n,).

    They are independent, so they count with it as priors do; the variances of all others are found.
    """
    channels = [channel for one in problem.observations for channel in one.channels]
    return np.repeat(
        [channel.scale is not None for channel in channels],
        [channel.reference.size for channel in channels],
    )


def _measured(problem: Problem, residuals: Vector) -> list[list[Vector]]:
    """Residuals without stated noise of every channel, one list for each recording with some."""
    found: dict[int, list[Vector]] = {}
    for observed, channel, part in by_channel(problem, residuals):
        if channel.scale is None:
            found.setdefault(id(observed), []).append(part)
    return list(found.values())


def _size_and_squares(recordings: Sequence[Sequence[Vector]]) -> tuple[int, float]:
    parts = [part for parts in recordings for part in parts]
    return sum(part.size for part in parts), sum(float(part @ part) for part in parts)


def by_channel(
    problem: Problem, residuals: Vector
) -> Iterator[tuple[Observations, Channel, Vector]]:
    """Residuals of every channel of every recording, with both."""
    at = 0
    for observed in problem.observations:
        for channel in observed.channels:
            yield observed, channel, residuals[at : at + channel.reference.size]
            at += channel.reference.size


def _powers(parts: Sequence[Vector]) -> Vector:
    """Power of every principal component of several series at every frequency."""
    n = max(part.size for part in parts)
    common = np.linspace(0.0, 1.0, n)
    series = np.array([np.interp(common, np.linspace(0.0, 1.0, max(p.size, 1)), p) for p in parts])
    _, directions = np.linalg.eigh(series @ series.T)
    return (np.abs(np.fft.fft(directions.T @ series, axis=1)) ** 2 / n).ravel()


@dataclass(frozen=True)
class Linear:
    """A linear problem around a solution."""

    slopes: Table
    """Derivatives of the residuals, shape (n, q)."""
    residuals: Vector
    """Shape (n,)."""
    known: Vector
    """Information that each number has beforehand, shape (q,)."""
    pull: Vector
    """Gradient of the half sum of squares of what is known beforehand, shape (q,)."""


@dataclass(frozen=True)
class Places:
    """Where the residuals belong."""

    states: Labels
    """State of the mechanism, shape (n,)."""
    cells: Labels
    """Finer state and reference, shape (n,)."""
    count: int
    """Number of states that count as independent."""


def residual_variance(linear: Linear, places: Places, begin: float, least: float) -> float:
    """(I6): variance that a residual would have if all residuals were independent.

    The numbers are adjusted with that variance, so both are found in turns.

    Args:
        linear: the residuals, as a function of all numbers that are not exact.
        places: of the residuals.
        begin: the first guess.
        least: variance of the residuals' white noise.
    """
    parts = []
    for state in np.unique(places.states):
        rows = places.states == state
        slopes = linear.slopes[rows]
        parts.append((slopes.T @ slopes, slopes.T @ linear.residuals[rows]))
    square = sum((part for part, _ in parts), np.zeros((linear.known.size,) * 2))
    uphill = sum((part for _, part in parts), np.zeros(linear.known.size))
    repeats = linear.residuals.size / max(places.count, 1)
    variance = begin
    for _ in range(ROUNDS):
        covariance = np.linalg.inv(square / variance + np.diag(linear.known))
        moved = -covariance @ (uphill / variance + linear.pull)
        left = linear.residuals + linear.slopes @ moved
        short = variance * _ratio(parts, covariance, moved, variance)
        before, variance = variance, short + lasting_variance(left, places.cells) * repeats
        variance = max(variance, least, 1e-300)
        if abs(variance - before) < SETTLED * before:
            break
    return variance


def _ratio(
    parts: list[tuple[Table, Vector]], covariance: Table, moved: Vector, variance: float
) -> float:
    """Squared gradients of the states over their expectation for independent residuals."""
    found, expected = 0.0, 0.0
    for square, uphill in parts:
        here = (uphill + square @ moved) / variance
        share = covariance @ square / variance
        found += float(here @ covariance @ here)
        expected += float(np.trace(share) - np.sum(share * share.T))
    return found / expected if found > 0.0 and expected > 0.0 else 1.0


def lasting_variance(residuals: Vector, cells: Labels) -> float:
    """Mean square of the residuals' means over cells, less that of white noise.

    Args:
        residuals: shape (n,).
        cells: cell of every residual, shape (n,).
    """
    size = np.bincount(cells)
    used = size > 1
    mean = np.bincount(cells, residuals)[used] / size[used]
    square = np.bincount(cells, residuals**2)[used] / size[used]
    noise = np.maximum(square - mean**2, 0.0) / (size[used] - 1)
    power = float(np.sum(size[used] * (mean**2 - noise)))
    return max(power, 0.0) / max(residuals.size, 1)


ENOUGH: Final = 0.95
"""Smallest share of all residuals within two standard deviations."""

ENOUGH_OF_A_RUN: Final = 0.8
"""The same for every single recording."""

DIGITS: Final = 1e-3
"""Relative accuracy of the error."""


def model_error(residuals: Sequence[Vector], stddevs: Sequence[Vector]) -> float:
    """Standard deviation of the error of the model itself: (I5).

    Args:
        residuals: estimate less reference for every recording that was left out.
        stddevs: standard deviations of these estimates from the numbers alone.

    Returns:
        0 if the standard deviations of the numbers explain the residuals.
    """
    if _covered(residuals, stddevs, 0.0):
        return 0.0
    low, high = 0.0, max(float(np.abs(r).max(initial=0.0)) for r in residuals)
    while high - low > DIGITS * high:
        middle = 0.5 * (low + high)
        if _covered(residuals, stddevs, middle):
            high = middle
        else:
            low = middle
    return high


def _covered(residuals: Sequence[Vector], stddevs: Sequence[Vector], error: float) -> bool:
    """Whether the numbers and an error of the model explain enough of the residuals."""
    inside = [
        float(np.mean(np.abs(r) <= 2.0 * np.hypot(s, error)))
        for r, s in zip(residuals, stddevs, strict=True)
    ]
    overall = np.average(inside, weights=[r.size for r in residuals])
    return bool(overall >= ENOUGH and min(inside) >= ENOUGH_OF_A_RUN)


class Unexplained(NamedTuple):
    """What a fit leaves of a reference."""

    rms: float
    """Root mean square residual [N] or [N m]."""
    noise: float
    """Standard deviation of the sensor's noise."""
    error: float
    """(I5) with the noise in place of the numbers' spread; 0 if it explains the residuals."""


def unexplained(problem: Problem, residuals: Vector) -> dict[str, Unexplained]:
    """What the fitted recordings show beyond the noise of their sensors, by channel.

    The fit has absorbed part of the model's error, so this is the least that is left of it.

    Args:
        problem: the fit.
        residuals: at its solution, shape (n,).
    """
    parts: dict[str, list[Vector]] = {}
    noises: dict[str, list[Vector]] = {}
    single: dict[str, list[Vector]] = {}
    for observed, channel, part in by_channel(problem, residuals):
        values = observed.recorded.references[channel.name].value
        finite = values[np.isfinite(values)]
        noise = channel.scale.noise if channel.scale else noise_of(finite)
        own = channel.sigma if channel.averaged else noise
        parts.setdefault(channel.name, []).append(part * channel.sigma)
        single.setdefault(channel.name, []).append(np.full(part.size, noise))
        noises.setdefault(channel.name, []).append(np.full(part.size, own))
    return {
        name: Unexplained(_rms(own), _rms(single[name]), model_error(own, noises[name]))
        for name, own in parts.items()
    }


def _rms(parts: Sequence[Vector]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
