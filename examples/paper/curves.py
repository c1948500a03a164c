"""Features of curves: numbers for properties that the source describes in words.

A cycle goes from one upper limit of the joint to the next: a stroke down, a stroke up.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

LIGHT: Final = 0.03
"""Width of the moving average, as a share of a cycle."""

PROMINENCE: Final = 0.10
"""Share of a curve's range by which a hump must stand out on both sides."""


def smooth(values: Vector, share: float = LIGHT) -> Vector:
    """Moving average over a share of a closed cycle, shape kept."""
    half = int(0.5 * share * values.size)
    if half == 0:
        return values
    closed = np.concatenate([values[-half:], values, values[:half]])
    sums = np.cumsum(np.insert(closed, 0, 0.0))
    averaged: Vector = (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)
    return averaged


def humps(values: Vector) -> int:
    """Maxima of a closed cycle after light smoothing: 2 for an M, as for a W upside down."""
    from scipy.signal import find_peaks  # slow to import, so only where used

    once = smooth(values)
    start = int(np.argmin(once))  # begins at the lowest point, so that no hump is cut in two
    turned = np.concatenate([once[start:], once[: start + 1]])
    return len(
        find_peaks(
            turned,
            prominence=PROMINENCE * float(np.ptp(turned)),
            distance=max(LIGHT * values.size, 1.0),  # a flat top is one hump
        )[0]
    )


def bulge(angle: Vector, values: Vector) -> float:
    """Height of a stroke's curve above the line between its ends, at mid-range.

    Args:
        angle: joint angle over one stroke [rad].
        values: over the same stroke.

    Returns:
        In the unit of ``values``; positive for an arch, one half of an M.  The tenth of the range
        next to each limit, where friction changes its direction, does not count as an end.
    """
    low, high = float(angle.min()), float(angle.max())
    share = (angle - low) / (high - low)

    def near(at: float) -> float:
        return float(values[np.abs(share - at) < 0.02].mean())

    return near(0.5) - 0.5 * (near(0.1) + near(0.9))


def loop_area(angle: Vector, values: Vector) -> float:
    """Area inside a closed cycle [rad times the unit of ``values``].

    Positive where the curve is higher while the angle rises than while it falls.
    """
    following = np.roll(angle, -1) - angle
    return float(np.sum(0.5 * (values + np.roll(values, -1)) * following))


def relative_hysteresis(angle: Vector, values: Vector) -> float:
    """Mean width of a closed cycle's loop, as a share of the mean value."""
    return abs(loop_area(angle, values)) / float(np.ptp(angle)) / float(np.mean(values))


def at_mid_range(angle: Vector, values: Vector) -> tuple[float, float]:
    """Value where the angle passes the middle of its range, going up and going down."""
    middle = 0.5 * float(angle.min() + angle.max())
    before, after = angle[:-1] - middle, angle[1:] - middle
    crossings = np.flatnonzero((before < 0.0) != (after < 0.0))
    share = before[crossings] / (before[crossings] - after[crossings])
    there = values[crossings] + share * (values[crossings + 1] - values[crossings])
    rising = after[crossings] > before[crossings]
    return float(there[rising].mean()), float(there[~rising].mean())


def near_turns(time: Vector, turns: tuple[float, ...], within: float) -> NDArray[np.bool_]:
    """Whether each time [s] is at most ``within`` [s] from a turn of the joint."""
    distance = np.min(np.abs(time[:, None] - np.asarray(turns)[None, :]), axis=1)
    return np.asarray(distance <= within)
