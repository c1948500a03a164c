"""Where a motion turns round: the friction of every pulley changes sign there.

A cable that sticks on its pulleys is followed by elasticity alone, and by the friction law until it
slips again: what an estimator gets wrong, it gets wrong there.  So errors are told apart.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.gate import CONFIRMATIONS, MAX_GAP_NS

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Stamps = NDArray[np.int64]

REVERSAL_SHARE: Final = 0.05
"""Share of the angle's range that a motion back must cover to make a turn a reversal."""

AROUND_NS: Final = 100_000_000
"""A reversal lasts from this long before the angle's extreme to at least as long after it [ns]."""

_SCAN_BUCKETS: Final = 4000
"""Resolution at which reversals are looked for, in parts of the recording."""


def envelope(buckets: int, *series: Floats) -> Indices:
    """Samples that keep the outline of series drawn in few pixels: no peak is ever lost.

    The samples are cut into buckets of consecutive ones; of each bucket the smallest and the
    largest sample of every series stay, in their order, and the first and last of all.

    Args:
        buckets: how many buckets, at least 1.
        series: finite, shape (n,) each, drawn together.

    Returns:
        Indices to draw, strictly increasing, shape (k,) with k ≤ 2 * buckets * len(series) + 2
        unless the series are as short as that.
    """
    n = len(series[0])
    size = -(-n // max(buckets, 1))
    if size <= 2 * len(series):
        return np.arange(n)
    whole = n // size
    starts = np.arange(whole) * size
    kept = [np.array([0, n - 1])]
    for values in series:
        blocks = values[: whole * size].reshape(whole, size)
        kept += [starts + blocks.argmin(axis=1), starts + blocks.argmax(axis=1)]
        rest = values[whole * size :]
        if len(rest):
            kept.append(whole * size + np.array([rest.argmin(), rest.argmax()]))
    return np.unique(np.concatenate(kept))


def turning_points(angle: Floats) -> Indices:
    """Samples at which a motion turns round, noise and ripple apart.

    Args:
        angle: joint angle [rad], shape (n,); NaN where there is none.

    Returns:
        Indices of the extremes between which the angle covers at least REVERSAL_SHARE of its
        range, strictly increasing; start and end of the recording are none.
    """
    present = np.flatnonzero(np.isfinite(angle))
    if len(present) < 3:
        return np.arange(0)
    values = angle[present]
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
    return present[coarse[np.array(turns, dtype=np.intp)]]


def reversal_zones(stamp_ns: Stamps, angles: Floats) -> Stamps:
    """When any motor or joint is turning round.

    A zone begins AROUND_NS before an extreme of the angle (see ``turning_points``).  It ends when
    the angle has come back by REVERSAL_SHARE of its range, not sooner than AROUND_NS after the
    extreme and not later than the next extreme.  Zones that touch are one.

    Args:
        stamp_ns: increasing [ns], shape (n,).
        angles: of motors and joints [rad], finite, shape (n, channels).

    Returns:
        Begin and end of every zone [ns], increasing, shape (k, 2).
    """
    zones: list[tuple[int, int]] = []
    for angle in np.ascontiguousarray(np.reshape(angles, (len(stamp_ns), -1)).T):
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
    """Which stamps lie in a zone, both ends included; shape of ``stamp_ns``."""
    begun = np.searchsorted(zones[:, 0], stamp_ns, side="right")
    ended = np.searchsorted(zones[:, 1], stamp_ns, side="left")
    inside: NDArray[np.bool_] = begun > ended
    return inside


def clock_resets(stamp_ns: Stamps) -> Indices:
    """First samples after the clock has gone back for good, in order of arrival, shape (k,).

    Samples from there on, CONFIRMATIONS of them where there are as many, increase and lie before
    the middle one of as many samples before: the first by more than MAX_GAP_NS.  One wild stamp is
    no reset.
    """
    resets = []
    for at in (np.flatnonzero(np.diff(stamp_ns) < -MAX_GAP_NS) + 1).tolist():
        before = np.sort(stamp_ns[max(at - CONFIRMATIONS, 0) : at])
        after = stamp_ns[at : at + CONFIRMATIONS]
        middle = before[len(before) // 2]
        follows = len(after) > 1 and np.all(np.diff(after) > 0)
        if follows and after[0] + MAX_GAP_NS < middle and after[-1] < middle:
            resets.append(at)
    return np.array(resets, dtype=np.intp)
