"""Choices of a fit, and their check."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.references import WEIGHTS, Weights
from cdrj_ros.identification.solution import LOSSES, Loss
from cdrj_ros.identification.unknowns import Unknown


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


def check(unknowns: Sequence[Unknown], recordings: Sequence[Recorded], settings: Settings) -> None:
    """Refuse an impossible fit.

    Raises:
        UsageError: there is nothing to fit or to fit to, or a setting is out of range.
    """
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
