"""The rounds of a fit: its problem over thinned samples, then over all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.identification.observations import Observations, Recorded, changes_samples, observe
from cdrj_ros.identification.residuals import Pool, Problem
from cdrj_ros.identification.settings import Settings
from cdrj_ros.identification.solution import Progress
from cdrj_ros.identification.unknowns import Unknown
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.document import Document

COARSE_SAMPLES: Final = 20_000
"""Samples of the first rounds, over all recordings; the friction laws hardly depend on the rate."""

LOWEST_RATE: Final = 100.0
"""Lowest sampling rate in those rounds [Hz]."""

MOST_RESIDUALS: Final = 400_000
"""Largest number of residuals of a round; references are thinned to stay below it."""


@dataclass(frozen=True)
class Rounds:
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


def sample_count(problem: Problem) -> int:
    """Number of samples that a problem estimates."""

    def samples(one: Observations) -> int:
        if one.samples is not None:
            return one.samples.stamp_ns.size
        longest = max(
            r.stamp_ns.size for r in {**one.recorded.motors, **one.recorded.joints}.values()
        )
        return longest // one.stride

    return sum(samples(one) for one in problem.observations)


def _stride(recorded: Recorded, total: int) -> int:
    """Thinning factor of the first rounds, which keeps at least ``LOWEST_RATE``."""
    stamps = next(iter({**recorded.motors, **recorded.joints}.values())).stamp_ns
    duration = max(float(stamps[-1] - stamps[0]) * 1e-9, 1e-9)
    rate = stamps.size / duration
    return int(max(1, min(round(total / COARSE_SAMPLES), rate // LOWEST_RATE)))
