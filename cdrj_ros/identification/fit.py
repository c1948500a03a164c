"""Parameters of the robot file from recordings: a generalisation of eq. (44) of the source.

    minimise over theta   sum_c sum_k loss( ((estimate_c(theta) - reference_c) / sigma_c)^2 )

where ``run``, the same estimator as in the node, computes the estimates causally over whole
recordings.  The source's (44) is the case of one unknown, rho, and two channels.
See docs/identification.md.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.interruption import thread_pool
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.identification.alternatives import (
    DrumFinding,
    compare_drums,
    doubted,
    sought,
)
from cdrj_ros.identification.nuisance import Nuisance
from cdrj_ros.identification.observations import (
    Recorded,
    chosen_channels,
    residual_scales,
    samples_of,
)
from cdrj_ros.identification.problem import (
    Problem,
    Progress,
    Rounds,
    Settings,
    check,
    refuse_hidden,
    sample_count,
)
from cdrj_ros.identification.reading_errors import reading_variance
from cdrj_ros.identification.residual_statistics import Unexplained, unexplained
from cdrj_ros.identification.solver import Minimum, minimise
from cdrj_ros.identification.standard_errors import accuracy
from cdrj_ros.identification.unknowns import Unknown, values_by_path
from cdrj_ros.model.packing import EFFORT
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import build_robot

DISTRUST: Final = 1.25
"""Factor by which (I6) exceeds (I2) where the fit has trusted its residuals too much."""

SPARSER: Final = 4
"""The search for the minimum uses only every n-th of the thinned samples, and of the residuals."""


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
    others: Nuisance | None = None
    """Numbers that were not fitted, and how the errors of the fitted ones go with theirs."""
    drums: Mapping[str, DrumFinding] = field(default_factory=dict)
    """What the recordings show of cables on their drums, of which the file did not say it."""
    unexplained: Mapping[str, Unexplained] = field(default_factory=dict)
    """What is left of every reference."""

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
    settings: Settings | None = None,
    say: Progress | None = None,
) -> Identification:
    """Identify the unknowns by least squares.

    Args:
        document: content of the robot file, which supplies the starting values.
        source: name of the robot file.
        unknowns: see ``parse_unknowns``.
        recordings: all are fitted together.
        settings: choices of the fit; None: the defaults.
        say: called with each progress line.

    Raises:
        UsageError: there are no unknowns or no references.
        RobotFileError: the starting values describe no possible robot.
    """
    settings = settings or Settings()
    check(unknowns, recordings, settings)
    model = prepare(build_robot(document, source))
    refuse_hidden(model.robot)
    document = dict(model.robot.document)  # all trials have the contact cells of the first
    channels = chosen_channels(model.layout, recordings, settings.channels)
    sigmas = residual_scales(recordings, channels, settings.weights)
    with thread_pool(os.cpu_count() or 1) as threads:
        samples = tuple(threads.map(partial(samples_of, model), recordings))
        rounds = Rounds(
            document, source, tuple(unknowns), tuple(recordings), settings, model, samples, sigmas,
            threads, say or (lambda _: None),
        )  # fmt: skip
        return _fitted(rounds, channels)


def _fitted(rounds: Rounds, channels: tuple[str, ...]) -> Identification:
    """Fit to thinned samples, then to all samples, and compute the standard errors."""
    settings, loss, say = rounds.settings, rounds.settings.loss, rounds.say
    rough = rounds.problem(coarse=True)
    say(
        f"first round: {len(rounds.unknowns)} unknowns, {len(channels)} references, "
        f"{sample_count(rough)} samples"
    )
    sparse = rounds.problem(coarse=True, sparser=SPARSER)
    last = rough
    if not settings.coarse and max(one.stride for one in rough.observations) > 1:
        last = rounds.problem(coarse=False)
    if settings.mean_s > 0.0:
        least = reading_variance(rough, np.zeros(len(rounds.unknowns)))
        for problem in (sparse, rough, last):
            problem.least_variance = least
    begin = _search(sparse, settings, say)
    if last is not rough:
        say(f"last round: all {sample_count(last)} samples")
    found = minimise(last, begin, loss, say, rough=rough)
    known = accuracy(rough, found)
    if known.variance > DISTRUST * found.variance and any(one.prior for one in rounds.unknowns):
        # what is known before would otherwise be given up for residuals that tell less
        say("fitting once more, with residuals that tell less")
        rough.least_variance = last.least_variance = known.variance
        found = minimise(last, found.coordinates, loss, say, rough=rough)
        known = accuracy(rough, found)
    unsettled = _unsettled(last, found)
    coordinates = np.where(known.silent, 0.0, found.coordinates)
    residuals = last.residuals(coordinates)
    left = unexplained(last, residuals)
    drums = {}
    if settings.compares_drums and (names := doubted(rounds.model.robot)):
        drums = dict.fromkeys(names, compare_drums(rough, coordinates, loss, say))
    return Identification(
        rounds.unknowns,
        last.values(coordinates),
        np.where(known.silent, _stddev_before(rounds, known.stddev), known.stddev),
        known.correlation,
        (*lacking(left), *known.findings, *unsettled, *sentences(drums)),
        channels,
        sample_count(last),
        residuals.size,
        float(np.sqrt(np.mean(residuals**2))),
        sum({id(one): one.evaluations for one in (sparse, rough, last)}.values()),
        tuple(known.silent.tolist()),
        known.others,
        drums,
        left,
    )


LACKING: Final = 3.0
"""A residual that is this many times the noise of its sensor is reported."""


def lacking(left: Mapping[str, Unexplained]) -> tuple[str, ...]:
    """At most one message: the reference that is furthest from its sensor's noise."""
    name, worst = max(left.items(), key=lambda item: item[1].rms / item[1].noise)
    if worst.rms < LACKING * worst.noise:
        return ()
    unit = "N" if not name.startswith(EFFORT) else "N m"
    size = f"{worst.rms:.2g} {unit}, {worst.rms / worst.noise:.2g} times the noise of its sensor"
    why = "the file lacks something, or a wrong number was not fitted"
    return (f"The residual of {name} is {size}: {why}.",)


def sentences(drums: Mapping[str, DrumFinding]) -> tuple[str, ...]:
    """What is printed about the drums."""
    return tuple({one.sentence: None for one in drums.values()})


def _stddev_before(rounds: Rounds, found: Vector) -> Vector:
    """Standard deviations before the fit [SI]; ``found`` where the robot file has none."""
    known = rounds.model.robot.uncertainty
    if known is None:
        return found
    before = known.stddev
    names = [unknown.paths[0] for unknown in rounds.unknowns]
    return np.array([before.get(name, stddev) for name, stddev in zip(names, found, strict=True)])


def _search(sparse: Problem, settings: Settings, say: Progress) -> Vector:
    """Coordinates of a fit to a quarter of the thinned samples."""
    first = _taut(sparse, sought(sparse, settings.sought), say)
    # residuals in units of their noise do not leave the priors their weight
    variance = 1.0 if settings.weights == "spread" else None
    best = minimise(sparse, first, "linear", say, variance=variance, settled=np.inf)
    # outliers bias the first fit, and a prior has its weight only if the residuals have theirs
    return minimise(sparse, best.coordinates, settings.loss, say).coordinates


SOFTER: Final = 0.25
"""Factor by which the stiffness of all cables is lowered until none is slack."""

SOFTEST: Final = 1e-3
"""Share of their stiffness below which it is not lowered."""


def _taut(sparse: Problem, begin: Vector, say: Progress) -> Vector:
    """Coordinates of a start at which no cable is slack, if there is one.

    A radius that is 3 % off stretches a stiff cable by more than its preload.  Where a cable is
    slack, its tension has no slope, and a fit would stay where it began.  Softer cables are not
    slack; what is fitted to them is the start for stiffer ones.
    """
    here, share = begin, 0.0
    while share < (stiffer := _stiffest(sparse, here)) < 1.0:
        share = stiffer
        soft = sparse.softer(share)
        here = minimise(soft, here, "linear", say, settled=np.inf).coordinates
    costs = [float(np.sum(found**2)) for found in sparse.residuals_of([here, begin])]
    return here if costs[0] < costs[1] else begin


def _stiffest(sparse: Problem, here: Vector) -> float:
    """Greatest share of the stiffness with which no cable is slack, or the least that is tried."""
    share = 1.0
    while share > SOFTEST and sparse.softer(share).slackens(here):
        share *= SOFTER
    return share


UNSETTLED: Final = 1.0
"""A remaining step larger than this is reported [standard errors]."""


def _unsettled(problem: Problem, found: Minimum) -> tuple[str, ...]:
    """A message if a further step would change a number by more than its standard error."""
    worst = int(found.size.argmax())
    if found.size[worst] <= UNSETTLED:
        return ()
    name, size = problem.unknowns[worst].name, found.size[worst]
    text = f"The fit has not settled: {name} would still move by {size:.1f} of its standard errors."
    return (text,)
