"""Position of a reference's stamps among the stamps of the estimates."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.judgement.channels import Angle, Floats, Stamps

DROP_CAUSES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "reference_not_finite": "reference values that are NaN or infinite",
        "reference_repeated": "reference values with the stamp of an earlier one",
        "outside_estimates": "reference values before the first or after the last estimate",
        "between_distant_estimates": "reference values in a gap between estimates",
        "estimate_not_finite": "reference values beside an estimate that is NaN or infinite",
    }
)
"""Reasons for leaving out a reference: name of the counter, and what it counts in words."""


class Placement(NamedTuple):
    """Position of reference stamps among the estimates' stamps; arrays have shape (k,)."""

    stamp_ns: Stamps
    """Reference stamps at or between usable estimates [ns]."""
    source: NDArray[np.intp]
    """Index of each stamp in the given reference."""
    left: NDArray[np.intp]
    """Index of the last estimate not after the stamp."""
    right: NDArray[np.intp]
    """Index of the first estimate not before the stamp; equal to ``left`` where they coincide."""
    share: Floats
    """Fraction of the way from ``left`` to ``right`` at which the stamp lies, in [0, 1)."""
    dropped: Mapping[str, int]
    """Number of stamps left out, by cause."""


def place(stamps: Stamps, own_stamps: Stamps, max_gap_ns: int) -> Placement:
    """Find the neighbours of every stamp.

    Args:
        stamps: of the reference [ns], in any order, shape (m,); of equal stamps the first is used.
        own_stamps: of the estimates [ns], strictly increasing, shape (n,).
        max_gap_ns: largest accepted distance between two neighbours.
    """
    dropped = {}
    if np.all(stamps[1:] > stamps[:-1]):
        source = np.arange(len(stamps))
    else:
        source = np.argsort(stamps, kind="stable")
        in_order = stamps[source]
        first = np.ones(len(source), dtype=np.bool_)
        first[1:] = in_order[1:] != in_order[:-1]
        source = source[first]
    dropped["reference_repeated"] = len(stamps) - len(source)
    wanted = stamps[source]
    if len(own_stamps) == 0:
        inside = np.zeros(len(wanted), dtype=np.bool_)
    else:
        inside = (wanted >= own_stamps[0]) & (wanted <= own_stamps[-1])
    dropped["outside_estimates"] = int(np.count_nonzero(~inside))
    source, wanted = source[inside], wanted[inside]
    right = np.searchsorted(own_stamps, wanted, side="left")
    left = right - (own_stamps[right] != wanted)
    width = own_stamps[right] - own_stamps[left]
    near = width <= max_gap_ns
    dropped["between_distant_estimates"] = int(np.count_nonzero(~near))
    source, wanted, left, right, width = (
        column[near] for column in (source, wanted, left, right, width)
    )
    # Subtract as integers: epoch stamps in nanoseconds exceed the 53-bit mantissa of a float.
    share = (wanted - own_stamps[left]).astype(np.float64) / np.maximum(width, 1)
    return Placement(wanted, source, left, right, share, dropped)


def interpolated(before: Floats, after: Floats, placement: Placement, part: slice) -> Floats:
    """Linear interpolation between neighbours; exactly ``before`` where the stamps coincide.

    Args:
        before, after: values at ``placement.left[part]`` and ``placement.right[part]``, shape (k,)
            or, of vectors, (k, 3).
        placement: of all stamps.
        part: the stamps to interpolate at.
    """
    same = placement.left[part] == placement.right[part]
    if same.all():
        return before
    share = placement.share[part]
    if before.ndim > 1:
        same, share = same[:, None], share[:, None]
    with np.errstate(invalid="ignore", over="ignore"):
        between = before + share * (after - before)
    return np.where(same, before, between)


def angle_at(stamp_ns: Stamps, angle: Angle | None, max_gap_ns: int) -> Floats:
    """Angle [rad] at the stamps, NaN where no reading is close enough, shape of ``stamp_ns``."""
    result = np.full(len(stamp_ns), np.nan)
    if angle is not None:
        values = np.asarray(angle.value, dtype=np.float64)
        there = place(stamp_ns, np.asarray(angle.stamp_ns, dtype=np.int64), max_gap_ns)
        everything = slice(None)
        result[there.source] = interpolated(
            values[there.left], values[there.right], there, everything
        )
    return result
