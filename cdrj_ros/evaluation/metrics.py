"""Error figures of estimates against references: those of the paper and common ones.

The paper reports the mean error and the mean relative error of single channels.  Added to these are
RMSE, the largest error, R², and the share of references within two standard deviations.  Of
vectors, the error is the norm of the difference, and the angle between both is added.  Several
recordings are pooled by joining their samples and not by averaging their figures, so that long
recordings weigh more than short ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdrj_ros.evaluation.channels import BagComparison, Channel, size_of
from cdrj_ros.foundation.arrays import Floats

MINIMUM_SHARE: Final = 0.01
"""Fraction of a channel's largest |reference| below which samples are left out of relative errors.

Where a reference passes through zero, |error| / |reference| grows without bound even for a good
estimate, and one such sample would dominate the mean.
"""

DIRECTION_SHARE: Final = 0.05
"""Fraction of the longest reference below which a vector has no direction to compare.

The angle of a short vector is mostly noise: with a load cell's 0.5 % of the range it is 6° here.
"""


COVERAGE_SIGMAS: Final = 2.0
"""Half width of the band whose coverage is reported [standard deviations of the estimate]."""


@dataclass(frozen=True)
class ChannelError:
    """Error figures of one channel; None where a figure is unknown."""

    n: int
    """Number of compared samples."""
    mean_abs_error: float | None
    """Mean |estimate - reference| [channel's unit]."""
    mean_relative_error: float | None
    """Mean |estimate - reference| / |reference| over samples with |reference| at least
    MINIMUM_SHARE of its largest value [-]."""
    rmse: float | None
    """Root of the mean squared error [channel's unit]."""
    max_abs_error: float | None
    """Largest |estimate - reference| [channel's unit]."""
    r2: float | None
    """1 - SSE/SST: share of the reference's variance that the estimate explains [-]."""
    coverage: float | None = None
    """Share of references within COVERAGE_SIGMAS standard deviations, where these are known [-]."""
    mean_direction_error_deg: float | None = None
    """Mean angle between two vectors [°] over samples where both have a direction."""
    max_direction_error_deg: float | None = None
    """Largest angle between two vectors [°]."""
    unit: str = ""
    """Unit of the channel, "N or N·m" for several; empty for that of its quantity."""


FIGURES: Final = tuple(one.name for one in fields(ChannelError) if one.name not in ("n", "unit"))
"""Names of ChannelError's figures, in display order."""

NO_SAMPLES: Final = ChannelError(0, None, None, None, None, None)
"""The error of a channel that has no sample."""


def channel_error(
    estimate: ArrayLike,
    reference: ArrayLike,
    *,
    stddev: ArrayLike | None = None,
    unit: str = "",
) -> ChannelError:
    """Compare an estimate with its reference, sample by sample.

    Args:
        estimate: finite, shape (n,), or (n, 3) of vectors, in any unit.
        reference: finite, of the same shape, in the same unit.
        stddev: of the estimate, NaN where unknown, shape (n,), in the same unit.
        unit: of estimate and reference.

    Returns:
        Errors in that unit; the other figures are dimensionless.  ``mean_relative_error`` is None
        if the reference is zero throughout, ``r2`` if it does not vary, all figures if n is 0.
    """
    estimated = np.asarray(estimate, dtype=np.float64)
    recorded = np.asarray(reference, dtype=np.float64)
    if (n := len(recorded)) == 0:
        return NO_SAMPLES
    error = estimated - recorded
    size, magnitude = size_of(error), size_of(recorded)
    squares = _sum_of_squares(error)
    turned: NDArray[np.float64] = np.empty(0)
    if recorded.ndim == 2:
        turned = direction_error_deg(estimated, recorded)
        turned = turned[np.isfinite(turned)]
    relative: float | None = None
    if (largest := float(magnitude.max())) > 0.0:
        significant = magnitude >= MINIMUM_SHARE * largest
        relative = float(np.mean(size[significant] / magnitude[significant]))
    return ChannelError(
        n=n,
        mean_abs_error=float(size.mean()),
        mean_relative_error=relative,
        rmse=float(np.sqrt(squares / n)),
        max_abs_error=float(size.max()),
        r2=_r2(recorded, squares),
        coverage=None if stddev is None else _coverage(size, np.asarray(stddev, dtype=np.float64)),
        mean_direction_error_deg=float(turned.mean()) if len(turned) else None,
        max_direction_error_deg=float(turned.max()) if len(turned) else None,
        unit=unit,
    )


def direction_error_deg(
    estimate: NDArray[np.float64], reference: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Angle between estimated and recorded vectors [°], shape (n,).

    NaN where one of them is shorter than DIRECTION_SHARE of the longest reference, or zero.

    Args:
        estimate, reference: finite, shape (n, 3).
    """
    lengths = size_of(estimate), size_of(reference)
    least = np.minimum(*lengths)
    known = (least > 0.0) & (least >= DIRECTION_SHARE * np.max(lengths[1], initial=0.0))
    a, b = (v[known] / s[known, None] for v, s in zip((estimate, reference), lengths, strict=True))
    angle = np.full(len(least), np.nan)
    # the angle of a narrow triangle, exact also near 0° and 180°, where the cosine is flat
    angle[known] = np.degrees(2.0 * np.arctan2(size_of(a - b), size_of(a + b)))
    return angle


def _r2(recorded: NDArray[np.float64], squares: float) -> float | None:
    """1 - SSE/SST; None if the reference does not vary."""
    # Exact comparison, because the rounded mean of equal numbers may differ from them.
    if (recorded == recorded[0]).all():
        return None
    deviation = recorded - recorded.mean(axis=0)
    variation = _sum_of_squares(deviation)
    return 1.0 - squares / variation if variation > 0.0 else None


def _sum_of_squares(values: NDArray[np.float64]) -> float:
    """Sum of squares, with the same digits on every machine.

    ``np.dot`` divides long arrays among the processors: its digits depend on their number, and a
    busy machine waited forty times as long for it.
    """
    return float(np.square(values).sum())


def _coverage(size: NDArray[np.float64], stddev: NDArray[np.float64]) -> float | None:
    known = np.isfinite(stddev)
    if not known.any():
        return None
    return float(np.mean(size[known] <= COVERAGE_SIGMAS * stddev[known]))


@dataclass(frozen=True, eq=False)
class Errors:
    """Recordings and their figures, shared by table, JSON file, report and limits."""

    bags: tuple[BagComparison, ...]
    of_bags: tuple[Mapping[str, ChannelError], ...]
    """Every channel's error in each recording, by channel name."""
    pooled: Mapping[str, ChannelError]
    """Every channel's error over the joined samples of all recordings, by channel name."""


def errors_of(bags: Sequence[BagComparison]) -> Errors:
    """Compute the figures of each recording and of all recordings pooled."""
    of_bags = tuple(pooled_errors([bag]) for bag in bags)
    return Errors(tuple(bags), of_bags, of_bags[0] if len(bags) == 1 else pooled_errors(bags))


def pooled_errors(comparisons: Sequence[BagComparison]) -> dict[str, ChannelError]:
    """Every channel's error over the joined samples of several recordings, by channel name.

    The coverage is None unless every recording has standard deviations.
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
            unit=channels[0].unit,
        )
        for name, channels in parts.items()
    }


def _joined(parts: Sequence[NDArray[Any] | None]) -> NDArray[Any] | None:
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def mean_over_channels(errors: Iterable[ChannelError]) -> ChannelError:
    """Summary of many channels with equal weights, as in the paper's tables.

    Returns:
        ``n`` is the total number of samples, ``max_abs_error`` and ``max_direction_error_deg`` are
        the maxima over all channels; every other figure is its mean over the channels that have it,
        None if no channel has it.
    """
    listed = list(errors)

    def known(figure: str) -> list[float]:
        values = (getattr(error, figure) for error in listed)
        return [float(value) for value in values if value is not None]

    def mean(figure: str) -> float | None:
        values = known(figure)
        return float(np.mean(values)) if values else None

    maxima = {figure: max(known(figure), default=None) for figure in FIGURES if "max_" in figure}
    means = {figure: mean(figure) for figure in FIGURES if figure not in maxima}
    unit = " or ".join(sorted({error.unit for error in listed} - {""}))
    return ChannelError(n=sum(error.n for error in listed), unit=unit, **means, **maxima)


Indices = NDArray[np.intp]

REVERSAL_SHARE: Final = 0.05
"""A reversal counts if the angle then moves back by at least this share of its range [-]."""

_SCAN_BUCKETS: Final = 4000
"""Number of buckets of the envelope in which reversals are searched."""


def envelope(buckets: int, *series: Floats) -> Indices:
    """Choose samples that preserve the outline and every peak of series drawn in few pixels.

    The samples are divided into buckets of consecutive samples.  Kept are the smallest and the
    largest sample of every series in each bucket, and the first and the last sample.

    Args:
        buckets: how many buckets, at least 1.
        series: finite, shape (n,) each, drawn together.

    Returns:
        Indices to draw, strictly increasing, shape (k,) with k ≤ 2 * buckets * len(series) + 2.
    """
    n = len(series[0])
    size = -(-n // max(buckets, 1))
    if size <= 2 * len(series):
        return np.arange(n)
    starts = np.arange(0, n, size)
    kept = [np.array([0, n - 1])]
    for values in series:
        padded = np.append(values, np.full(-n % size, values[-1])).reshape(-1, size)
        kept += [starts + padded.argmin(axis=1), starts + padded.argmax(axis=1)]
    return np.unique(np.minimum(np.concatenate(kept), n - 1))


def turning_points(angle: Floats) -> Indices:
    """Samples at which a motion reverses; noise and ripple are ignored.

    Args:
        angle: joint angle [rad], shape (n,); NaN where unknown.

    Returns:
        Indices of the extremes between which the angle covers at least REVERSAL_SHARE of its
        range, strictly increasing, without the start and the end of the recording.
    """
    finite = np.isfinite(angle)
    present = None if finite.all() else np.flatnonzero(finite)
    values = angle if present is None else angle[present]
    if len(values) < 3:
        return np.arange(0)
    threshold = REVERSAL_SHARE * float(values.max() - values.min())
    if threshold <= 0.0:
        return np.arange(0)
    coarse = envelope(_SCAN_BUCKETS, values)
    turns: list[int] = []
    low = high = 0
    heading = 0
    samples = values[coarse].tolist()
    for at, value in enumerate(samples):
        if heading >= 0 and value > samples[high]:
            high = at
        if heading <= 0 and value < samples[low]:
            low = at
        if heading >= 0 and value < samples[high] - threshold:
            if heading > 0:
                turns.append(high)
            heading, low = -1, at
        elif heading <= 0 and value > samples[low] + threshold:
            if heading < 0:
                turns.append(low)
            heading, high = 1, at
    found = coarse[np.array(turns, dtype=np.intp)]
    return found if present is None else present[found]
