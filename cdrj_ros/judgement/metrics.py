"""Figures for the difference between estimates and references: the paper's, and common ones.

The paper reports mean error and mean relative error of single channels; RMSE, the largest error
and R² stand beside them, the mean error at reversals apart from the rest, and how often the
reference lies within two standard deviations.  Several recordings are pooled by joining their
samples, never by averaging their figures: a short recording does not weigh as much as a long one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdrj_ros.judgement.channels import BagComparison, Channel

MINIMUM_SHARE: Final = 0.01
"""Share of a channel's largest |reference| below which a sample has no relative error.

Where a reference passes through zero, |error| / |reference| grows without bound however good the
estimate is, and one such sample would outweigh a thousand others.
"""


COVERAGE_SIGMAS: Final = 2.0
"""Half width of the band whose coverage is reported [standard deviations of the estimate]."""


@dataclass(frozen=True)
class ChannelError:
    """Difference of one channel's estimate from its reference; None where it is not known."""

    n: int
    """Compared samples."""
    mean_abs_error: float | None
    """Mean |estimate - reference| [channel's unit]."""
    mean_relative_error: float | None
    """Mean |estimate - reference| / |reference| over samples of at least MINIMUM_SHARE."""
    rmse: float | None
    """Root of the mean squared error [channel's unit]."""
    max_abs_error: float | None
    """Largest |estimate - reference| [channel's unit]."""
    r2: float | None
    """1 - SSE/SST: share of the reference's variance that the estimate explains."""
    reversal_error: float | None = None
    """Mean |estimate - reference| where a motor or joint reverses [channel's unit]."""
    smooth_error: float | None = None
    """Mean |estimate - reference| everywhere else [channel's unit]."""
    coverage: float | None = None
    """Share of samples of known standard deviation within COVERAGE_SIGMAS of the estimate."""


FIGURES: Final = (
    "mean_abs_error",
    "mean_relative_error",
    "rmse",
    "max_abs_error",
    "r2",
    "reversal_error",
    "smooth_error",
    "coverage",
)
"""Names of ChannelError's figures, in the order in which they are shown."""

NO_SAMPLES: Final = ChannelError(0, None, None, None, None, None)
"""The error of a channel that has no sample."""


def channel_error(
    estimate: ArrayLike,
    reference: ArrayLike,
    *,
    stddev: ArrayLike | None = None,
    reversal: NDArray[np.bool_] | None = None,
) -> ChannelError:
    """Compare an estimate with its reference, sample by sample.

    Args:
        estimate: finite, shape (n,), in any unit.
        reference: finite, shape (n,), in the same unit.
        stddev: of the estimate, NaN where unknown, shape (n,), in the same unit.
        reversal: whether the motion reverses there, shape (n,).

    Returns:
        Errors in that unit, the others without one.  ``mean_relative_error`` is None where the
        reference is zero throughout, ``r2`` where it does not vary, ``coverage`` where no standard
        deviation is known, all where n is 0.

    Raises:
        ValueError: shapes that differ, or values that are not finite.
    """
    estimated = np.asarray(estimate, dtype=np.float64)
    recorded = np.asarray(reference, dtype=np.float64)
    if estimated.shape != recorded.shape or recorded.ndim != 1:
        raise ValueError(
            "estimate and reference must have one shape (n,); "
            f"got {estimated.shape} and {recorded.shape}"
        )
    if not (np.isfinite(estimated).all() and np.isfinite(recorded).all()):
        raise ValueError("estimate and reference must be finite")
    if (n := len(recorded)) == 0:
        return NO_SAMPLES
    error = estimated - recorded
    size = np.abs(error)
    squares = float(np.dot(error, error))
    magnitude = np.abs(recorded)
    largest = float(magnitude.max())
    relative: float | None = None
    if largest > 0.0:
        telling = magnitude >= MINIMUM_SHARE * largest
        relative = float(np.mean(size[telling] / magnitude[telling]))
    r2: float | None = None
    # Compared exactly, since the mean of equal numbers need not round to that number.
    if n >= 2 and recorded.min() < recorded.max():
        deviation = recorded - recorded.mean()
        variation = float(np.dot(deviation, deviation))
        r2 = 1.0 - squares / variation if variation > 0.0 else None
    return ChannelError(
        n=n,
        mean_abs_error=float(size.mean()),
        mean_relative_error=relative,
        rmse=float(np.sqrt(squares / n)),
        max_abs_error=float(size.max()),
        r2=r2,
        reversal_error=None if reversal is None else _mean(size[reversal]),
        smooth_error=None if reversal is None else _mean(size[~reversal]),
        coverage=None if stddev is None else _coverage(size, np.asarray(stddev, dtype=np.float64)),
    )


def _mean(values: NDArray[np.float64]) -> float | None:
    return float(values.mean()) if len(values) else None


def _coverage(size: NDArray[np.float64], stddev: NDArray[np.float64]) -> float | None:
    known = np.isfinite(stddev)
    if not known.any():
        return None
    return float(np.mean(size[known] <= COVERAGE_SIGMAS * stddev[known]))


@dataclass(frozen=True, eq=False)
class Errors:
    """Recordings and their figures, computed once for table, JSON, report and limits."""

    bags: tuple[BagComparison, ...]
    of_bags: tuple[Mapping[str, ChannelError], ...]
    """Every channel's error in each recording, by channel name."""
    pooled: Mapping[str, ChannelError]
    """Every channel's error over the joined samples of all recordings, by channel name."""


def errors_of(bags: Sequence[BagComparison]) -> Errors:
    """Compute the figures of recordings, each by itself and pooled."""
    of_bags = tuple(pooled_errors([bag]) for bag in bags)
    return Errors(tuple(bags), of_bags, of_bags[0] if len(bags) == 1 else pooled_errors(bags))


def pooled_errors(comparisons: Sequence[BagComparison]) -> dict[str, ChannelError]:
    """Every channel's error over the joined samples of several recordings, by channel name.

    Figures of reversals and standard deviations are None unless every recording has them.
    """
    parts: dict[str, list[Channel]] = {}
    for comparison in comparisons:
        for channel in comparison.channels:
            parts.setdefault(channel.name, []).append(channel)
    return {
        name: channel_error(
            np.concatenate([channel.estimate for channel in channels]),
            np.concatenate([channel.reference for channel in channels]),
            stddev=_joined([channel.stddev for channel in channels]),
            reversal=_joined([channel.reversal for channel in channels]),
        )
        for name, channels in parts.items()
    }


def _joined(parts: Sequence[NDArray[Any] | None]) -> NDArray[Any] | None:
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def mean_over_channels(errors: Iterable[ChannelError]) -> ChannelError:
    """One line for many channels, each channel counting alike, as in the paper's tables.

    Returns:
        ``n``: samples of all channels together; ``max_abs_error``: the largest of all channels;
        every other figure: its mean over the channels that have it, None where none has.
    """
    listed = list(errors)

    def known(figure: str) -> list[float]:
        values = (getattr(error, figure) for error in listed)
        return [float(value) for value in values if value is not None]

    def mean(figure: str) -> float | None:
        values = known(figure)
        return float(np.mean(values)) if values else None

    return ChannelError(
        n=sum(error.n for error in listed),
        mean_abs_error=mean("mean_abs_error"),
        mean_relative_error=mean("mean_relative_error"),
        rmse=mean("rmse"),
        max_abs_error=max(known("max_abs_error"), default=None),
        r2=mean("r2"),
        reversal_error=mean("reversal_error"),
        smooth_error=mean("smooth_error"),
        coverage=mean("coverage"),
    )
