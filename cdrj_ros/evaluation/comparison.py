"""Comparison of estimates with recorded references at the references' stamps.

References are never shifted or smoothed.  The estimate is taken unchanged where the stamps
coincide and interpolated linearly between its two neighbours elsewhere.  Reference samples for
which there is no estimate are left out and counted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.evaluation.channels import Angle, Channel, quantity_of, unit_of
from cdrj_ros.foundation.arrays import Floats, Series, Stamps

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


class Neighbours(NamedTuple):
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


def neighbours_of(stamps: Stamps, own_stamps: Stamps, max_gap_ns: int) -> Neighbours:
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
    return Neighbours(wanted, source, left, right, share, dropped)


def interpolated(before: Floats, after: Floats, neighbours: Neighbours, part: slice) -> Floats:
    """Linear interpolation between neighbours; exactly ``before`` where the stamps coincide.

    Args:
        before, after: values at ``neighbours.left[part]`` and ``neighbours.right[part]``, shape
            (k,) or, of vectors, (k, 3).
        neighbours: of all stamps.
        part: the stamps to interpolate at.
    """
    same = neighbours.left[part] == neighbours.right[part]
    if same.all():
        return before
    share = neighbours.share[part]
    if before.ndim > 1:
        same, share = same[:, None], share[:, None]
    with np.errstate(invalid="ignore", over="ignore"):
        between = before + share * (after - before)
    return np.where(same, before, between)


def values_at(stamp_ns: Stamps, angle: Angle | None, max_gap_ns: int) -> Floats:
    """Values of a series at stamps, NaN where no reading is close enough, shape of ``stamp_ns``."""
    result = np.full(len(stamp_ns), np.nan)
    if angle is not None:
        values = np.asarray(angle.value, dtype=np.float64)
        there = neighbours_of(stamp_ns, np.asarray(angle.stamp_ns, dtype=np.int64), max_gap_ns)
        everything = slice(None)
        result[there.source] = interpolated(
            values[there.left], values[there.right], there, everything
        )
    return result


class _Target(NamedTuple):
    """A channel's reference, and the estimates at its stamps received so far."""

    neighbours: Neighbours
    reference: Floats
    """Reference values at the stamps of ``neighbours``, shape (k,) or (k, 3)."""
    estimate: Floats
    """Estimates at the same stamps, of the same shape; NaN until they are filled in."""
    not_finite: int
    """Number of reference values left out because they are NaN or infinite."""


class Comparing:
    """Collects the estimates of one pass in pieces and keeps only those at the references' stamps.

    The estimates of one hour take gigabytes, while the references often have far fewer stamps.
    """

    def __init__(
        self,
        names: Sequence[str],
        own_stamps: Stamps,
        references: Mapping[str, Series],
        max_gap_ns: int,
    ) -> None:
        """Find the neighbouring estimates of every reference sample.

        Args:
            names: names of the estimated channels.
            own_stamps: stamps of all estimates that will be added [ns], strictly increasing,
                shape (m,).
            references: by channel name [unit], in any order.
            max_gap_ns: an estimate is interpolated only between neighbours at most this far apart.

        Raises:
            ValueError: a channel name without a known prefix.
        """
        self._max_gap_ns = max_gap_ns
        self._taken = 0
        self._last: dict[str, Floats] = {}
        self._stddev: dict[str, Floats] = {}
        shared: dict[int, Neighbours] = {}
        self._targets: dict[str, _Target] = {}
        for name in names:
            quantity_of(name)
            if name in references:
                self._targets[name] = self._target(references[name], own_stamps, shared)

    def _target(
        self,
        reference: Series,
        own_stamps: Stamps,
        shared: dict[int, Neighbours],
    ) -> _Target:
        """Find the neighbours of one reference, once for all that share an array of stamps."""
        stamps, recorded = reference.stamp_ns, reference.value
        finite = _finite(recorded)
        if finite.all():
            key = id(stamps)
            if key not in shared:
                shared[key] = neighbours_of(stamps, own_stamps, self._max_gap_ns)
            neighbours = shared[key]
        else:
            neighbours = neighbours_of(stamps[finite], own_stamps, self._max_gap_ns)
            recorded = recorded[finite]
        recorded = recorded[_as_slice(neighbours.source)]
        empty = np.full(recorded.shape, np.nan)
        left_out = int(np.count_nonzero(~finite))
        return _Target(neighbours, recorded, empty, left_out)

    def add(self, estimates: Mapping[str, Floats], stddev: Mapping[str, Floats], n: int) -> None:
        """Add the next ``n`` estimates.

        Args:
            estimates: values by channel name [unit of the channel], shape (n,) each, or
                (n, 3) of vectors.
            stddev: by channel name [unit], shape (n,) each; values that are negative or not finite
                are treated as unknown.
            n: number of estimates.
        """
        for name, values in estimates.items():
            target = self._targets.get(name)
            if target is None or not n:
                continue
            self._fill(name, target, target.estimate, values)
            if name in stddev:
                into = self._stddev.setdefault(name, np.full(len(target.estimate), np.nan))
                self._fill(f"stddev {name}", target, into, stddev[name], _known)
        self._taken += n

    def _fill(
        self, key: str, target: _Target, into: Floats, values: Floats,
        accepted: Callable[[Floats], Floats] = np.asarray,
    ) -> None:  # fmt: skip
        """Interpolate at the stamps from the row before ``values``, which is kept, to their end."""
        neighbours, begin = target.neighbours, self._taken
        first, last = np.searchsorted(neighbours.right, (begin, begin + len(values)))
        part = slice(int(first), int(last))
        left = neighbours.left[part] - begin
        before = values[np.maximum(left, 0)]
        before[left < 0] = self._last.get(key, np.nan)
        after = values[neighbours.right[part] - begin]
        into[part] = interpolated(accepted(before), accepted(after), neighbours, part)
        self._last[key] = values[-1].copy()

    def channels(self, angle: Angle | Mapping[str, Angle] | None) -> tuple[Channel, ...]:
        """The compared channels; ``angle``: of all, or of each by name, to draw over."""
        angles: dict[tuple[int, int], Floats] = {}
        made = []
        for name, target in self._targets.items():
            own = angle.get(name) if isinstance(angle, Mapping) else angle
            neighbours, usable = target.neighbours, _finite(target.estimate)
            key = id(neighbours), id(own)
            if key not in angles:
                angles[key] = values_at(neighbours.stamp_ns, own, self._max_gap_ns)
            unit = own.unit if own is not None and name.endswith(f"/{own.name}") else "rad"
            dropped = dict.fromkeys(DROP_CAUSES, 0)
            dropped.update(neighbours.dropped)
            dropped["reference_not_finite"] = target.not_finite
            dropped["estimate_not_finite"] = int(np.count_nonzero(~usable))
            whole = bool(usable.all())
            kept = None if whole else np.flatnonzero(usable)
            made.append(
                Channel(
                    name=name,
                    unit=unit_of(name, unit),
                    stamp_ns=_taken(neighbours.stamp_ns, kept),
                    estimate=_taken(target.estimate, kept),
                    reference=_taken(target.reference, kept),
                    angle=_taken(angles[key], kept),
                    angle_name=own.name if own is not None else "",
                    angle_unit=own.unit if own is not None else "rad",
                    dropped=dropped,
                    stddev=_taken(self._stddev[name], kept) if name in self._stddev else None,
                )
            )
        return tuple(made)


def _taken(values: NDArray[Any], kept: NDArray[np.intp] | None) -> NDArray[Any]:
    """The values at these indices; all of them as the same object, which channels then share.

    Shared arrays are kept, and sent between processes, once.
    """
    return values if kept is None else values[kept]


def _finite(values: Floats) -> NDArray[np.bool_]:
    """Whether every value, or every component of a vector, is finite, shape (n,)."""
    finite: NDArray[np.bool_] = np.isfinite(values)
    return finite if finite.ndim == 1 else np.asarray(finite.all(axis=1))


def _as_slice(source: NDArray[np.intp]) -> NDArray[np.intp] | slice:
    """The indices, as a slice where they follow each other: nothing is copied then."""
    if source.size and not np.any(np.diff(source) != 1):
        return slice(int(source[0]), int(source[-1]) + 1)
    return source


def _known(given: Floats) -> Floats:
    """Standard deviations, with NaN in place of values that are negative or not finite."""
    return np.where(np.isfinite(given) & (given >= 0.0), given, np.nan)
