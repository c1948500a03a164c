"""Parameters of the robot file from recordings: a generalisation of eq. (44) of the source.

    minimise over theta   sum_c sum_k loss( ((estimate_c(theta) - reference_c) / sigma_c)^2 )

where ``run``, the same estimator as in the node, computes the estimates causally over whole
recordings.  The source's (44) is the case of one unknown, rho, and two channels.
See docs/identification.md.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.drums import DrumFinding, drums_in_doubt, judge_drums
from cdrj_ros.identification.left_alone import LeftAlone
from cdrj_ros.identification.observations import (
    Observations,
    Recorded,
    changes_samples,
    observe,
    samples_of,
)
from cdrj_ros.identification.references import (
    WEIGHTS,
    Weights,
    chosen_channels,
    given_sigmas,
    spreads,
)
from cdrj_ros.identification.residuals import Pool, Problem, residuals_together
from cdrj_ros.identification.solution import (
    LOSSES,
    Loss,
    Progress,
    difference_points,
    jacobian,
    limits,
    robust_weights,
    solve,
    thresholds,
    with_priors,
)
from cdrj_ros.identification.standard_errors import (
    certainty,
    effective_variance,
    expected_gain,
    remaining_step,
)
from cdrj_ros.identification.starts import many_starts, sought
from cdrj_ros.identification.unknowns import Unknown, values_by_path
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.document import Document
from cdrj_ros.robot.reader import build_robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

COARSE_SAMPLES: Final = 20_000
"""Samples of the first rounds, over all recordings; the friction laws hardly depend on the rate."""

LOWEST_RATE: Final = 100.0
"""Lowest sampling rate in those rounds [Hz]."""

MOST_RESIDUALS: Final = 400_000
"""Largest number of residuals of a round; references are thinned to stay below it."""

SCOUT: Final = 4
"""The search for the minimum uses only every n-th of those samples, and as many residuals fewer."""

COARSE_STEPS: Final = 60
ROBUST_ROUNDS: Final = 3

SETTLING_STEPS: Final = 8
SETTLING_GAIN: Final = 1e-3
"""A further step that lowers the cost by less, as a fraction, is not taken for its gain."""
SETTLED: Final = 0.3
"""Further steps smaller than this are not taken [standard errors]."""
UNSETTLED: Final = 1.0
"""A remaining step larger than this is reported [standard errors]."""


@dataclass(frozen=True)
class Settings:
    """Choices of the fit."""

    channels: tuple[str, ...] = ()
    """Patterns of the references to fit; if empty, all are fitted."""
    weights: Weights = "spread"
    """Rule for the divisor of a channel's residuals, see ``spreads``."""
    sigmas: Mapping[str, float] | None = None
    """Divisors by channel pattern, which override that rule [N] or [N m]."""
    loss: Loss = "linear"
    """Loss of the residuals after the first round."""
    starts: int = 1
    """Number of starts, all but the first of them random."""
    seed: int = 0
    """Seed of the random starts."""
    settle_s: float = 0.0
    """Time at the beginning of each recording that is excluded from the comparison [s]."""
    coarse: bool = False
    """Whether to skip the last round, which uses all samples."""
    sought: tuple[str, ...] = ()
    """Paths of numbers that are first sought over their whole range."""
    judges_drums: bool = False
    """Whether to judge if the cable slips on its drums, where the file leaves it open."""


@dataclass(frozen=True)
class Identification:
    """Result of a fit."""

    unknowns: tuple[Unknown, ...]
    values: Vector
    """Identified numbers [SI], shape (p,)."""
    stddev: Vector
    """Standard errors [SI], shape (p,)."""
    correlation: Table
    """Correlation matrix, shape (p, p)."""
    findings: tuple[str, ...]
    """Messages about what the data cannot determine."""
    channels: tuple[str, ...]
    """References that were fitted."""
    samples: int
    """Number of samples in the last round."""
    residuals: int
    """Number of residuals in the last round."""
    rms: float
    """Root mean square residual of the last round, in units of each channel's sigma."""
    evaluations: int
    """Number of runs over all recordings, including runs over thinned ones."""
    silent: tuple[bool, ...] = ()
    """Whether each number has no influence on the data; it then keeps its starting value and the
    standard deviation that it had before."""
    others: LeftAlone | None = None
    """Numbers that were not fitted, and how the errors of the fitted ones go with theirs."""
    drums: DrumFinding | None = None
    """What the recordings show of the cable on the drums; None if it was not judged."""

    @property
    def by_path(self) -> dict[str, float]:
        """The numbers by path [SI], one for each place of a tied number."""
        return values_by_path(self.unknowns, self.values)

    @property
    def seen(self) -> NDArray[np.int64]:
        """Indices of the unknowns on which the data depend."""
        silent = self.silent or (False,) * len(self.unknowns)
        return np.flatnonzero(~np.array(silent, dtype=bool))


def identify(
    document: Document,
    source: str,
    unknowns: Sequence[Unknown],
    recordings: Sequence[Recorded],
    settings: Settings = Settings(),
    say: Progress | None = None,
    pool: Pool | None = None,
) -> Identification:
    """Identify the unknowns by least squares.

    Args:
        document: content of the robot file, which supplies the starting values.
        source: name of the robot file.
        unknowns: see ``parse_unknowns``.
        recordings: all are fitted together.
        settings: choices of the fit.
        say: called with each progress line.
        pool: computes the residuals; None for the threads of this process.

    Raises:
        UsageError: there are no unknowns or no references.
        RobotFileError: the starting values describe no possible robot.
    """
    _check(unknowns, recordings, settings)
    model = prepare(build_robot(document, source))
    channels = chosen_channels(model.layout, recordings, settings.channels)
    sigmas = spreads(recordings, channels, settings.weights)
    sigmas |= given_sigmas(channels, settings.sigmas or {})
    with ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        samples = tuple(threads.map(partial(samples_of, model), recordings))
        rounds = _Rounds(
            document, source, tuple(unknowns), tuple(recordings), settings, model, samples, sigmas,
            pool or threads, say or _silent,
        )  # fmt: skip
        return _fitted(rounds, channels)


@dataclass(frozen=True)
class _Rounds:
    """Data shared by the rounds of one fit."""

    document: Document
    source: str
    unknowns: tuple[Unknown, ...]
    recordings: tuple[Recorded, ...]
    settings: Settings
    model: Model
    """Model of the starting values."""
    samples: tuple[Samples, ...]
    """The conditioned samples of every recording, with the starting values."""
    sigmas: Mapping[str, float]
    """Unit of the residuals of every channel."""
    pool: Pool
    say: Progress

    def problem(self, *, coarse: bool, scout: int = 1) -> Problem:
        """The problem of a round, over thinned samples or over all samples.

        Args:
            coarse: whether the samples are thinned, see ``COARSE_SAMPLES``.
            scout: further divisor of the samples and of the largest number of residuals.
        """
        moving = changes_samples(path for one in self.unknowns for path in one.paths)
        total = sum(samples.stamp_ns.size for samples in self.samples)
        observations = [
            observe(
                self.model, one, samples, self.sigmas, scout * _stride(one, total) if coarse else 1,
                MOST_RESIDUALS // (scout**2 * len(self.recordings)), self.settings.settle_s,
                moving,
            )
            for one, samples in zip(self.recordings, self.samples, strict=True)
        ]  # fmt: skip
        return Problem(self.document, self.source, self.unknowns, observations, self.pool)


def _fitted(rounds: _Rounds, channels: tuple[str, ...]) -> Identification:
    """Fit to thinned samples, then to all samples, and compute the standard errors."""
    settings, loss, say = rounds.settings, rounds.settings.loss, rounds.say
    rough = rounds.problem(coarse=True)
    say(
        f"first round: {len(rounds.unknowns)} unknowns, {len(channels)} references, "
        f"{_count(rough)} samples"
    )
    scout = rounds.problem(coarse=True, scout=SCOUT)
    coordinates, starts = _roughly(scout, rough, settings, say)
    last, evaluations = rough, scout.evaluations
    if not settings.coarse and max(one.stride for one in rough.observations) > 1:
        last = rounds.problem(coarse=False)
        last.prior_scale = rough.prior_scale
        say(f"last round: all {_count(last)} samples")
    coordinates, slopes, unsettled = _settle(last, rough, coordinates, loss, say)
    if last is not rough:
        evaluations += last.evaluations
    here = rough.residuals(coordinates)
    weights = robust_weights(loss, here, thresholds(rough, here))
    known = certainty(rough, coordinates, here, slopes, weights)
    coordinates = np.where(known.silent, 0.0, coordinates)
    residuals = last.residuals(coordinates)
    drums = None
    if settings.judges_drums and drums_in_doubt(rounds.model.robot):
        drums = judge_drums(rough, coordinates, weights, loss, say)
    return Identification(
        rounds.unknowns,
        last.values(coordinates),
        np.where(known.silent, _stddev_before(rounds, known.stddev), known.stddev),
        known.correlation,
        known.findings + unsettled + starts + ((drums.sentence,) if drums else ()),
        channels,
        _count(last),
        residuals.size,
        float(np.sqrt(np.mean(residuals**2))),
        evaluations + rough.evaluations,
        tuple(known.silent.tolist()),
        known.others,
        drums,
    )


def _stddev_before(rounds: _Rounds, found: Vector) -> Vector:
    """Standard deviations before the fit [SI]; ``found`` where the robot file has none."""
    known = rounds.model.robot.uncertainty
    if known is None:
        return found
    before = dict(zip(known.parameters, np.sqrt(np.diag(known.covariance)).tolist(), strict=True))
    names = [unknown.paths[0] for unknown in rounds.unknowns]
    return np.array([before.get(name, stddev) for name, stddev in zip(names, found, strict=True)])


def _roughly(
    scout: Problem, rough: Problem, settings: Settings, say: Progress
) -> tuple[Vector, tuple[str, ...]]:
    """Fit to thinned samples: from every start to a quarter of them, from the best to all of them.

    Returns:
        Coordinates of the best fit, and a message about the starts if there were several.
    """
    loss = settings.loss
    first = sought(scout, settings.sought)
    found, same = many_starts(
        scout, settings.starts, settings.seed, "linear", COARSE_STEPS, say, first
    )
    # the steps far from the minimum cost a quarter: 1.8 times faster
    best = solve(rough, found[0].coordinates, "linear", COARSE_STEPS, say)
    if any(unknown.prior for unknown in rough.unknowns):
        # a prior has the weight of its standard deviation only if the residuals have theirs
        here = rough.residuals(best.coordinates)
        rough.prior_scale = float(np.sqrt(effective_variance(rough, here)))
        best = solve(rough, best.coordinates, "linear", COARSE_STEPS, say)
    for _ in range(ROBUST_ROUNDS if loss != "linear" else 0):
        # outliers bias the first fit, and thereby the choice of residuals that count as outliers
        best = solve(rough, best.coordinates, loss, COARSE_STEPS, say)
    return best.coordinates, (_of_starts(len(found), same),) if settings.starts > 1 else ()


def _settle(
    last: Problem, rough: Problem, coordinates: Vector, loss: Loss, say: Progress
) -> tuple[Vector, Table, tuple[str, ...]]:
    """Take further steps while they are a considerable fraction of a standard error, or gain.

    Where most of the cost is noise, a tolerance on its relative change ends a fit too early.  The
    Jacobian is that of the thinned samples, which is nearly the same and many times cheaper.

    Returns:
        The coordinates, the Jacobian there without priors, and a message if they have not
        settled.
    """
    lower, upper = limits(last)
    for _ in range(SETTLING_STEPS):
        say("computing standard errors")
        # the long run over all samples and the short ones share the processors
        around = difference_points(rough, coordinates, central=True)
        residuals = residuals_together([(last, [coordinates]), (rough, around)])[0][0]
        slopes = jacobian(rough, coordinates, central=True)[: residuals.size]
        weights = robust_weights(loss, residuals, thresholds(last, residuals))
        step, size = remaining_step(last, coordinates, residuals, slopes, weights)
        worst = int(size.argmax())
        gain = expected_gain(step, residuals, slopes, weights)
        if size[worst] <= SETTLED and gain <= SETTLING_GAIN:
            return coordinates, slopes, ()
        moved = np.clip(coordinates + step, lower, upper)
        after = with_priors(last, moved, last.residuals(moved))
        before = with_priors(last, coordinates, residuals)
        weights = np.concatenate([weights, np.ones(before.size - weights.size)])
        if not weights @ after**2 < weights @ before**2:
            break
        say(f"another step, of {size[worst]:.1f} standard errors")
        coordinates = moved
    slopes = jacobian(rough, coordinates, central=True)[: residuals.size]
    if size[worst] <= UNSETTLED:
        return coordinates, slopes, ()
    sentence = (
        f"The fit has not settled: {last.unknowns[worst].name} would still move by "
        f"{size[worst]:.1f} of its standard errors."
    )
    return coordinates, slopes, (sentence,)


def _silent(text: str) -> None:
    del text


def _check(unknowns: Sequence[Unknown], recordings: Sequence[Recorded], settings: Settings) -> None:
    if not unknowns:
        raise UsageError("there are no unknowns to fit")
    if not recordings:
        raise UsageError("there is no recording to fit to")
    if settings.loss not in LOSSES:
        raise UsageError(f"the loss must be one of {', '.join(LOSSES)}, got {settings.loss!r}")
    if settings.weights not in WEIGHTS:
        raise UsageError(f"weights must be one of {', '.join(WEIGHTS)}, got {settings.weights!r}")
    if not 1 <= settings.starts <= 1000:
        raise UsageError(f"starts must be in [1, 1000], got {settings.starts}")


def _stride(recorded: Recorded, total: int) -> int:
    """Thinning factor of the first rounds, which keeps at least ``LOWEST_RATE``."""
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
    return f"{same} of {count} starts ended in the best minimum; the others ended in worse ones."
