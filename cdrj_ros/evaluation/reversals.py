"""Reversals of motion, at which the friction of every pulley changes sign.

After a reversal the cable sticks on its pulleys until it slips the other way.  Most of an
estimator's error arises in that time, so errors at reversals are reported apart from the rest.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Floats, Stamps

Indices = NDArray[np.intp]

REVERSAL_SHARE: Final = 0.05
"""A reversal counts if the angle then moves back by at least this share of its range [-]."""

AROUND_NS: Final = 100_000_000
"""Time before the angle's extreme, and least time after it, that belongs to a reversal [ns]."""

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


def reversal_zones(stamp_ns: Stamps, angles: Iterable[Floats]) -> Stamps:
    """Time intervals in which any motor or joint reverses.

    A zone begins AROUND_NS before an extreme of the angle (see ``turning_points``).  It ends when
    the angle has come back by REVERSAL_SHARE of its range, not sooner than AROUND_NS after the
    extreme and not later than the next extreme.  Zones that touch are joined.

    Args:
        stamp_ns: increasing [ns], shape (n,).
        angles: of motors and joints [rad], finite, shape (n,) each.

    Returns:
        Begin and end of every zone [ns], increasing, shape (k, 2).
    """
    zones: list[tuple[int, int]] = []
    for column in angles:
        angle = np.ascontiguousarray(column)
        turns = turning_points(angle)
        if not len(turns):
            continue
        enough = REVERSAL_SHARE * float(angle.max() - angle.min())
        ends = [*turns[1:].tolist(), len(angle) - 1]
        for turn, last in zip(turns.tolist(), ends, strict=True):
            back = np.abs(angle[turn : last + 1] - angle[turn]) >= enough
            done = turn + int(back.argmax()) if back.any() else last
            at = int(stamp_ns[turn])
            zones.append((at - AROUND_NS, max(at + AROUND_NS, int(stamp_ns[done]))))
    joined: list[list[int]] = []
    for begin, end in sorted(zones):
        if joined and begin <= joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], end)
        else:
            joined.append([begin, end])
    return np.array(joined, dtype=np.int64).reshape(-1, 2)


def within(zones: Stamps, stamp_ns: Stamps) -> NDArray[np.bool_]:
    """Whether each stamp lies in a zone, both ends included; shape of ``stamp_ns``."""
    begun = np.searchsorted(zones[:, 0], stamp_ns, side="right")
    ended = np.searchsorted(zones[:, 1], stamp_ns, side="left")
    inside: NDArray[np.bool_] = begun > ended
    return inside
