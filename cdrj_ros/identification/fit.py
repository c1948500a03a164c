"""Parameters of the robot file from recordings: eq. (44) of the source and everything beyond it.

    minimise over theta   sum_c sum_k loss( ((estimate_c(theta) - reference_c) / sigma_c)^2 )

where the estimates come from ``run``, the one estimator, causally, over whole recordings.  The
source's (44) is the case of one unknown, rho, and two channels.  docs/identification.md.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.residuals import (
    CONDITIONING_KEYS,
    WEIGHTS,
    Observations,
    Problem,
    Recorded,
    Weights,
    chosen_channels,
    observe,
    samples_of,
    spreads,
)
from cdrj_ros.identification.solution import (
    LAST_TOLERANCE,
    LOSSES,
    Loss,
    Progress,
    jacobian,
    limits,
    many_starts,
    robust_weights,
    solve,
    thresholds,
    with_priors,
)
from cdrj_ros.identification.standard_errors import certainty, effective_variance, remaining_step
from cdrj_ros.identification.unknowns import Unknown, values_by_path
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.document import Document
from cdrj_ros.robot.reader import build_robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

COARSE_SAMPLES: Final = 20_000
"""Samples of the first rounds, all recordings together: friction hardly depends on rate."""

LOWEST_RATE: Final = 100.0
"""Samples a second that the first rounds keep at least [Hz]."""

MOST_RESIDUALS: Final = 400_000
"""References are thinned until a round has no more."""

COARSE_STEPS: Final = 60
FINE_STEPS: Final = 6
ROBUST_ROUNDS: Final = 3

SETTLING_STEPS: Final = 5
SETTLED: Final = 0.3
"""A further step that is smaller than this is not taken [standard errors]."""
UNSETTLED: Final = 1.0
"""One that is larger, and could not be taken, is told [standard errors]."""


@dataclass(frozen=True)
class Settings:
    """How to identify."""

    channels: tuple[str, ...] = ()
    """Patterns of the references to fit; empty: all."""
    weights: Weights = "spread"
    """What a channel's residuals are divided by, one of ``WEIGHTS``."""
    sigmas: Mapping[str, float] | None = None
    """Or by this, by pattern of the channel [N] or [N m]."""
    loss: Loss = "linear"
    """One of ``LOSSES``."""
    starts: int = 1
    seed: int = 0
    settle_s: float = 0.0
    """Time at the beginning of each recording that is not compared [s]."""
    coarse: bool = False
    """Leave out the last round, over every sample."""


@dataclass(frozen=True)
class Identification:
    """What was found."""

    unknowns: tuple[Unknown, ...]
    values: Vector
    """[SI], shape (p,)."""
    stddev: Vector
    """[SI], shape (p,)."""
    correlation: Table
    """Shape (p, p)."""
    findings: tuple[str, ...]
    """What the data could not tell, in sentences."""
    channels: tuple[str, ...]
    """References that were fitted."""
    samples: int
    """Of the last round."""
    residuals: int
    """Of the last round."""
    rms: float
    """Root mean square residual of the last round, in units of each channel's sigma."""
    evaluations: int
    """Runs of all recordings, thinned ones included."""

    @property
    def by_path(self) -> dict[str, float]:
        """The numbers by path [SI], tied ones each."""
        return values_by_path(self.unknowns, self.values)


def identify(
    document: Document,
    source: str,
    unknowns: Sequence[Unknown],
    recordings: Sequence[Recorded],
    settings: Settings = Settings(),
    say: Progress | None = None,
) -> Identification:
    """Find the unknowns.

    Args:
        document: the robot file's, with the numbers to start from.
        source: its name.
        unknowns: see ``parse_unknowns``.
        recordings: all are fitted together.
        settings: how.
        say: called with a line now and then.

    Raises:
        UsageError: nothing to fit, or nothing to fit it to.
        RobotFileError: the numbers to start from describe no possible robot.
    """
    _check(unknowns, recordings, settings)
    say = say or _silent
    model = prepare(build_robot(document, source))
    channels = chosen_channels(model.layout, recordings, settings.channels)
    sigmas = spreads(recordings, channels, settings.weights)
    sigmas |= _given_sigmas(channels, settings.sigmas or {})
    moving = any(_changes_samples(path) for unknown in unknowns for path in unknown.paths)
    total = sum(samples_of(model, one).stamp_ns.size for one in recordings)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:

        def problem(coarse: bool) -> Problem:
            observations = [
                observe(
                    model, one, sigmas, _stride(one, total) if coarse else 1,
                    MOST_RESIDUALS // len(recordings), settings.settle_s, moving,
                )
                for one in recordings
            ]  # fmt: skip
            return Problem(document, source, unknowns, observations, pool)

        rough = problem(coarse=True)
        strides = [one.stride for one in rough.observations]
        last_round = not settings.coarse and max(strides) > 1
        say(f"{len(unknowns)} unknowns, {len(channels)} references, {_count(rough)} samples first")
        loss = settings.loss
        found, same = many_starts(
            rough, settings.starts, settings.seed, "linear", COARSE_STEPS, say
        )
        best = found[0]
        if any(unknown.prior for unknown in unknowns):
            # a prior weighs as much as its standard deviation says only if the residuals do
            here = rough.residuals(best.coordinates)
            rough.prior_scale = float(np.sqrt(effective_variance(rough, here)))
            best = solve(rough, best.coordinates, "linear", COARSE_STEPS, say)
        for _ in range(ROBUST_ROUNDS if loss != "linear" else 0):
            # outliers have moved the first fit, and with it what counts as one: look again
            best = solve(rough, best.coordinates, loss, COARSE_STEPS, say)
        last, coordinates, evaluations = rough, best.coordinates, 0
        if last_round:
            last = problem(coarse=False)
            last.prior_scale = rough.prior_scale
            say(f"all {_count(last)} samples")
            coordinates = solve(
                last, coordinates, loss, FINE_STEPS, say, LAST_TOLERANCE, rough
            ).coordinates
            evaluations = last.evaluations
        coordinates, slopes, unsettled = _settle(last, rough, coordinates, loss, say)
        here = rough.residuals(coordinates)
        bend = thresholds(rough, here)
        known = certainty(rough, coordinates, here, slopes, robust_weights(loss, here, bend))
        residuals = last.residuals(coordinates)
        findings = known.findings + unsettled
        if settings.starts > 1:
            findings += (_of_starts(len(found), same),)
        return Identification(
            tuple(unknowns),
            last.values(coordinates),
            known.stddev,
            known.correlation,
            findings,
            channels,
            _count(last),
            residuals.size,
            float(np.sqrt(np.mean(residuals**2))),
            evaluations + rough.evaluations,
        )


def _settle(
    last: Problem, rough: Problem, coordinates: Vector, loss: Loss, say: Progress
) -> tuple[Vector, Table, tuple[str, ...]]:
    """Go on while a further step would be worth a good part of a standard error.

    A cost that hardly falls any more ends a fit too early where most of it is noise.

    Returns:
        The coordinates, the Jacobian there without priors, and what is to be said if they still
        move.
    """
    lower, upper = limits(last)
    for _ in range(SETTLING_STEPS):
        residuals = last.residuals(coordinates)
        say("standard errors")
        slopes = jacobian(rough, coordinates, central=True)[: residuals.size]
        weights = robust_weights(loss, residuals, thresholds(last, residuals))
        step, size = remaining_step(last, coordinates, residuals, slopes, weights)
        worst = int(size.argmax())
        if size[worst] <= SETTLED:
            return coordinates, slopes, ()
        moved = np.clip(coordinates + step, lower, upper)
        after = with_priors(last, moved, last.residuals(moved))
        before = with_priors(last, coordinates, residuals)
        weights = np.concatenate([weights, np.ones(before.size - weights.size)])
        if not weights @ after**2 < weights @ before**2:
            break
        say(f"one more step, of {size[worst]:.1f} standard errors")
        coordinates = moved
    slopes = jacobian(rough, coordinates, central=True)[: residuals.size]
    if size[worst] <= UNSETTLED:
        return coordinates, slopes, ()
    sentence = (
        f"The fit has not settled: {last.unknowns[worst].name} would still move by "
        f"{size[worst]:.1f} of its standard errors."
    )
    return coordinates, slopes, (sentence,)


def _changes_samples(path: str) -> bool:
    parts = path.split(".")
    return parts[0] in ("motors", "joints") and not set(parts).isdisjoint(CONDITIONING_KEYS)


def _silent(text: str) -> None:
    del text


def _check(unknowns: Sequence[Unknown], recordings: Sequence[Recorded], settings: Settings) -> None:
    if not unknowns:
        raise UsageError("there is nothing to fit")
    if not recordings:
        raise UsageError("there is no recording to fit to")
    if settings.loss not in LOSSES:
        raise UsageError(f"the loss must be one of {', '.join(LOSSES)}, got {settings.loss!r}")
    if settings.weights not in WEIGHTS:
        raise UsageError(f"weights must be one of {', '.join(WEIGHTS)}, got {settings.weights!r}")
    if not 1 <= settings.starts <= 1000:
        raise UsageError(f"starts must be in [1, 1000], got {settings.starts}")


def _given_sigmas(channels: Sequence[str], given: Mapping[str, float]) -> dict[str, float]:
    from fnmatch import fnmatchcase

    result: dict[str, float] = {}
    for pattern, sigma in given.items():
        matching = [name for name in channels if fnmatchcase(name, pattern)]
        if not matching:
            raise UsageError(f"no fitted reference is called {pattern}: {', '.join(channels)}")
        result |= dict.fromkeys(matching, sigma)
    return result


def _stride(recorded: Recorded, total: int) -> int:
    """Thinning of the first rounds, never below ``LOWEST_RATE``."""
    stamps = next(iter({**recorded.motors, **recorded.joints}.values())).stamp_ns
    duration = max(float(stamps[-1] - stamps[0]) * 1e-9, 1e-9)
    rate = stamps.size / duration
    return int(max(1, min(round(total / COARSE_SAMPLES), rate // LOWEST_RATE)))


def _count(problem: Problem) -> int:
    def samples(one: Observations) -> int:
        if one.samples is not None:
            return one.samples.stamp_ns.size
        longest = max(
            r.stamp_ns.size for r in {**one.recorded.motors, **one.recorded.joints}.values()
        )
        return longest // one.stride

    return sum(samples(one) for one in problem.observations)


def _of_starts(count: int, same: int) -> str:
    if same == count:
        return f"All {count} starts ended in the same minimum."
    return f"{same} of {count} starts ended in the best minimum; the others stayed in worse ones."
