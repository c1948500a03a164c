"""Estimate beside recorded reference: both on the reference's stamps, nothing else touched.

A reference is never moved or smoothed.  The estimate comes to it: bit for bit where the stamps
coincide, on the straight line between its two neighbours elsewhere.  A reference sample that has
no estimate beside it is left out and counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdrj_ros.judgement.pulley_friction import PulleyFriction
from cdrj_ros.judgement.reversals import within

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]


class Quantity(NamedTuple):
    """What the part of a channel's name before the first slash stands for."""

    title: str
    """In words, for headings: "Tension"."""
    unit: str
    """Unit of the channel's values: "N" or "N·m"."""


QUANTITIES: Final[Mapping[str, Quantity]] = MappingProxyType(
    {
        "tension": Quantity("Tension", "N"),
        "nodal_force": Quantity("Nodal force", "N"),
        "friction": Quantity("Friction", "N"),
        "effort": Quantity("Effort", "N·m"),
    }
)
"""Every quantity that can be compared, by prefix, in the order in which it is shown."""


def quantity_of(name: str) -> str:
    """The prefix of a channel's name, a key of QUANTITIES; ValueError where it is none."""
    prefix, slash, rest = name.partition("/")
    if prefix not in QUANTITIES or not slash or not rest:
        known = ", ".join(f"{key}/…" for key in QUANTITIES)
        raise ValueError(f"channel name must be one of {known}; got {name!r}")
    return prefix


def unit_of(name: str) -> str:
    """Unit of a channel's values, from the prefix of its name; ValueError where it is unknown."""
    return QUANTITIES[quantity_of(name)].unit


@dataclass(frozen=True, eq=False)
class Channel:
    """One quantity, estimated and recorded, on the reference's stamps."""

    name: str
    """What it is: "tension/upper/8", "nodal_force/upper/3" or "effort/spindle"."""
    unit: str
    """Unit of ``estimate`` and ``reference``: "N" or "N·m"."""
    stamp_ns: Stamps
    """When the reference was taken [ns], strictly increasing, shape (n,); where the clock went
    back, later passes are moved behind the ones before."""
    estimate: Floats
    """What was estimated [unit], finite, shape (n,)."""
    reference: Floats
    """What was recorded [unit], finite, shape (n,)."""
    angle: Floats
    """Joint angle [rad] at those stamps, NaN where there is none, shape (n,)."""
    angle_name: str
    """Name of the joint whose angle it is; empty where there is none."""
    dropped: Mapping[str, int] = field(default_factory=dict)
    """Reference samples left out, by cause: the keys of DROP_CAUSES."""
    stddev: Floats | None = None
    """Standard deviation of ``estimate`` [unit], NaN where unknown, shape (n,); None: no such."""
    reversal: NDArray[np.bool_] | None = None
    """Whether a motor or joint is turning round there, shape (n,); None where that is not known."""

    def __post_init__(self) -> None:
        series = (self.stamp_ns, self.estimate, self.reference, self.angle)
        more = (self.stddev, self.reversal)
        shapes = {len(one) if one.ndim == 1 else -1 for one in (*series, *more) if one is not None}
        if len(shapes) != 1 or -1 in shapes:
            raise ValueError(f"{self.name}: stamps and series must all have one shape (n,)")


@dataclass(frozen=True, eq=False)
class BagComparison:
    """Everything one recording says about the estimator."""

    path: str
    """The recording, as the user named it."""
    duration_s: float
    """Length of the recording [s]."""
    channels: tuple[Channel, ...]
    """The compared quantities, in the order in which the robot lists them."""
    counters: Mapping[str, int] = field(default_factory=dict)
    """How many samples were refused or left out, by cause."""
    notes: tuple[str, ...] = ()
    """Sentences for the reader."""
    facts: Mapping[str, str] = field(default_factory=dict)
    """Rows of free text: rate achieved, latency, versions."""
    friction: tuple[PulleyFriction, ...] = ()
    """What friction held at the pulleys, as estimated; empty where that was not kept."""


@dataclass(frozen=True, eq=False)
class Angle:
    """A joint's recorded angle, for drawing a channel over it."""

    name: str
    """Name of the joint."""
    stamp_ns: Stamps
    """Stamps [ns], strictly increasing, shape (k,)."""
    value: Floats
    """Joint angle [rad], shape (k,)."""

    def __post_init__(self) -> None:
        stamps = np.asarray(self.stamp_ns)
        if len(stamps) == 0:
            raise ValueError(f"angle of {self.name!r} must have at least one sample")
        _checked_stamps(stamps, f"angle of {self.name!r}")
        if np.shape(self.value) != stamps.shape:
            raise ValueError(f"angle of {self.name!r} must have one value per stamp")


BETWEEN_PASSES_NS: Final = 1_000_000_000
"""Time between two passes of a recording whose clock went back, where they are joined [ns]."""

DROP_CAUSES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "reference_not_finite": "reference is NaN or infinite",
        "reference_repeated": "another reference sample has the same stamp (the first counts)",
        "outside_estimates": "before the first or after the last estimate",
        "between_distant_estimates": "the estimates on either side are too far apart",
        "estimate_not_finite": "an estimate beside it is NaN or infinite",
    }
)
"""Why a reference sample is left out: name of the counter, and the cause in words."""

Series = tuple[ArrayLike, ArrayLike]
"""(stamps [ns] as integers, values), both of shape (k,)."""


def compare(
    estimate_stamp_ns: ArrayLike,
    estimates: Mapping[str, ArrayLike],
    references: Mapping[str, Series],
    *,
    max_gap_ns: int,
    angle: Angle | Mapping[str, Angle] | None = None,
    stddev: Mapping[str, ArrayLike] | None = None,
    zones: Stamps | None = None,
) -> tuple[Channel, ...]:
    """Put every estimate that has a reference onto that reference's stamps.

    Args:
        estimate_stamp_ns: stamps of the estimates [ns], integers, strictly increasing, shape (m,).
        estimates: by channel name, what was estimated [unit of the name], shape (m,) each.
        references: by channel name, stamps [ns] and values [unit of the name], in any order.
        max_gap_ns: an estimate is interpolated only between neighbours at most this far apart.
        angle: the joint angle to carry along, one for all or by channel name.
        stddev: by channel name, standard deviation of the estimates [unit], shape (m,) each; a
            number that is not finite and at least 0 counts as unknown.
        zones: when the motion turns round [ns], shape (k, 2), see ``reversal_zones``.

    Returns:
        The channels that both sides know, in the order of ``estimates``, empty ones included;
        for what only the references know see ``unknown_references``.

    Raises:
        ValueError: stamps that are not integers or do not increase, shapes that do not match,
            a channel name without a known prefix, or a gap that is not positive.
    """
    if max_gap_ns <= 0:
        raise ValueError(f"max_gap_ns must be positive, got {max_gap_ns}")
    own_stamps = _checked_stamps(estimate_stamp_ns, "estimates")
    recorded = dict(references)
    shared = _Shared({}, {}, {})
    deviations = dict(stddev or {})
    channels = []
    for name, estimate in estimates.items():
        values = np.asarray(estimate, dtype=np.float64)
        if values.shape != own_stamps.shape:
            raise ValueError(
                f"{name}: estimate must have one value per stamp, shape {own_stamps.shape}; "
                f"got {values.shape}"
            )
        quantity_of(name)
        if name not in recorded:
            continue
        channels.append(
            _channel(
                name,
                own_stamps,
                values,
                recorded[name],
                max_gap_ns,
                angle.get(name) if isinstance(angle, Mapping) else angle,
                deviations.get(name),
                zones,
                shared,
            )
        )
    return tuple(channels)


def unknown_references(estimates: Collection[str], references: Collection[str]) -> tuple[str, ...]:
    """Names of the references that nothing is estimated for, in their order."""
    return tuple(name for name in references if name not in estimates)


def compare_bag(
    path: str,
    duration_s: float,
    estimate_stamp_ns: ArrayLike,
    estimates: Mapping[str, ArrayLike],
    references: Mapping[str, Series],
    *,
    max_gap_ns: int,
    angle: Angle | Mapping[str, Angle] | None = None,
    stddev: Mapping[str, ArrayLike] | None = None,
    zones: Stamps | None = None,
    counters: Mapping[str, int] | None = None,
    notes: Sequence[str] = (),
    facts: Mapping[str, str] | None = None,
) -> BagComparison:
    """``compare`` a whole recording; what was left out joins its counters and notes.

    Args:
        path: the recording, as the user named it.
        duration_s: its length [s].
        estimate_stamp_ns, estimates, references, max_gap_ns, angle, stddev, zones: as for
            ``compare``.
        counters: samples refused elsewhere, by cause.
        notes: sentences for the reader.
        facts: rows of free text for the reader.

    Raises:
        ValueError: as ``compare``.
    """
    channels = compare(
        estimate_stamp_ns,
        estimates,
        references,
        max_gap_ns=max_gap_ns,
        angle=angle,
        stddev=stddev,
        zones=zones,
    )
    unknown = unknown_references(estimates, references)
    return summed_up(path, duration_s, channels, unknown, counters, notes, facts)


def summed_up(
    path: str,
    duration_s: float,
    channels: Sequence[Channel],
    unknown: Sequence[str] = (),
    counters: Mapping[str, int] | None = None,
    notes: Sequence[str] = (),
    facts: Mapping[str, str] | None = None,
) -> BagComparison:
    """The comparison of a recording whose channels have been compared; see ``compare_bag``.

    Args:
        unknown: references that nothing is estimated for, see ``unknown_references``.
    """
    counted: Counter[str] = Counter(counters or {})
    for channel in channels:
        counted.update(channel.dropped)
    remarks = list(notes)
    if unknown:
        remarks.append(f"Recorded but not estimated, so not compared: {', '.join(unknown)}.")
    silent = [channel.name for channel in channels if len(channel.stamp_ns) == 0]
    if silent:
        remarks.append(f"No reference sample has an estimate beside it: {', '.join(silent)}.")
    return BagComparison(
        path, duration_s, tuple(channels), dict(counted), tuple(remarks), facts or {}
    )


def one_after_another(passes: Sequence[Sequence[Channel]]) -> tuple[Channel, ...]:
    """The channels of several passes over the same stamps as one; later passes are moved behind.

    Args:
        passes: channels of the same names in the same order, of every pass.
    """
    if len(passes) == 1:
        return tuple(passes[0])
    shifts, end = [], None
    for channels in passes:
        stamps = [channel.stamp_ns for channel in channels if len(channel.stamp_ns)]
        begin = min((int(own[0]) for own in stamps), default=0)
        shifts.append(0 if end is None else end + BETWEEN_PASSES_NS - begin)
        if stamps:
            end = max(int(own[-1]) for own in stamps) + shifts[-1]
    return tuple(
        _joined(
            [replace(one, stamp_ns=one.stamp_ns + s) for one, s in zip(of, shifts, strict=True)]
        )
        for of in zip(*passes, strict=True)
    )


def _joined(parts: Sequence[Channel]) -> Channel:
    def column(name: str) -> NDArray[Any] | None:
        own = [getattr(part, name) for part in parts]
        return None if any(one is None for one in own) else np.concatenate(own)

    dropped: Counter[str] = Counter()
    for part in parts:
        dropped.update(part.dropped)
    arrays: dict[str, Any] = {
        name: column(name)
        for name in ("stamp_ns", "estimate", "reference", "angle", "stddev", "reversal")
    }
    return replace(parts[0], dropped=dict(dropped), **arrays)


class _Placement(NamedTuple):
    """Where reference stamps lie among the estimates' stamps; shapes (k,) unless said."""

    stamp_ns: Stamps
    """Stamps that have an estimate on or around them."""
    source: NDArray[np.intp]
    """Index of each in the reference as given."""
    left: NDArray[np.intp]
    """Index of the last estimate not after the stamp."""
    right: NDArray[np.intp]
    """Index of the first estimate not before the stamp; equal to ``left`` where they coincide."""
    share: Floats
    """How far the stamp lies from ``left`` to ``right``, in [0, 1)."""
    dropped: Mapping[str, int]
    """Stamps left out, by cause."""


class _Shared(NamedTuple):
    """What the channels of one message have in common, computed once; keys are identities."""

    placements: dict[int, _Placement]
    """By the array of reference stamps; only for references that are finite throughout."""
    angles: dict[tuple[int, int], Floats]
    """Joint angle [rad] by placement and Angle."""
    reversals: dict[int, NDArray[np.bool_]]
    """Whether the motion turns round, by placement."""


def _channel(
    name: str,
    own_stamps: Stamps,
    values: Floats,
    reference: Series,
    max_gap_ns: int,
    angle: Angle | None,
    stddev: ArrayLike | None,
    zones: Stamps | None,
    shared: _Shared,
) -> Channel:
    given_stamps, given_values = reference
    stamps = _integers(given_stamps, name)
    recorded = np.asarray(given_values, dtype=np.float64)
    if recorded.shape != stamps.shape:
        raise ValueError(
            f"{name}: reference must have one value per stamp, shape {stamps.shape}; "
            f"got {recorded.shape}"
        )
    finite = np.isfinite(recorded)
    if finite.all():
        key = id(given_stamps)
        if key not in shared.placements:
            shared.placements[key] = _place(stamps, own_stamps, max_gap_ns)
        placement = shared.placements[key]
    else:
        placement = _place(stamps[finite], own_stamps, max_gap_ns)
        recorded = recorded[finite]
    estimate = _interpolated(values, placement)
    usable = np.isfinite(estimate)
    if finite.all() and usable.all():
        pair = id(placement), id(angle)
        if pair not in shared.angles:
            shared.angles[pair] = _angle_at(placement.stamp_ns, angle, max_gap_ns)
        stamp_ns, angle_there = placement.stamp_ns, shared.angles[pair]
        if zones is not None and id(placement) not in shared.reversals:
            shared.reversals[id(placement)] = within(zones, stamp_ns)
        reversal = shared.reversals.get(id(placement))
    else:
        stamp_ns = placement.stamp_ns[usable]
        angle_there = _angle_at(stamp_ns, angle, max_gap_ns)
        reversal = None if zones is None else within(zones, stamp_ns)
    dropped = dict.fromkeys(DROP_CAUSES, 0)
    dropped.update(placement.dropped)
    dropped["reference_not_finite"] = int(np.count_nonzero(~finite))
    dropped["estimate_not_finite"] = int(np.count_nonzero(~usable))
    return Channel(
        name=name,
        unit=unit_of(name),
        stamp_ns=stamp_ns,
        estimate=estimate[usable],
        reference=recorded[placement.source][usable],
        angle=angle_there,
        angle_name=angle.name if angle is not None else "",
        dropped=dropped,
        stddev=None if stddev is None else _deviation(name, stddev, values, placement)[usable],
        reversal=reversal,
    )


def _deviation(name: str, stddev: ArrayLike, values: Floats, placement: _Placement) -> Floats:
    """Standard deviations at the placement's stamps, NaN where unknown."""
    given = np.asarray(stddev, dtype=np.float64)
    if given.shape != values.shape:
        raise ValueError(
            f"{name}: stddev must have one value per estimate, shape {values.shape}; "
            f"got {given.shape}"
        )
    known = np.isfinite(given) & (given >= 0.0)
    return _interpolated(np.where(known, given, np.nan), placement)


def _place(stamps: Stamps, own_stamps: Stamps, max_gap_ns: int) -> _Placement:
    """Find every stamp's neighbours; sorts, and of equal stamps keeps the first."""
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
        within = np.zeros(len(wanted), dtype=np.bool_)
    else:
        within = (wanted >= own_stamps[0]) & (wanted <= own_stamps[-1])
    dropped["outside_estimates"] = int(np.count_nonzero(~within))
    source, wanted = source[within], wanted[within]
    right = np.searchsorted(own_stamps, wanted, side="left")
    left = right - (own_stamps[right] != wanted)
    width = own_stamps[right] - own_stamps[left]
    near = width <= max_gap_ns
    dropped["between_distant_estimates"] = int(np.count_nonzero(~near))
    source, wanted, left, right, width = (
        column[near] for column in (source, wanted, left, right, width)
    )
    # Integers are subtracted before they become floats: epoch stamps exceed a float's 53 bits.
    share = (wanted - own_stamps[left]).astype(np.float64) / np.maximum(width, 1)
    return _Placement(wanted, source, left, right, share, dropped)


def _interpolated(values: Floats, placement: _Placement) -> Floats:
    """The straight line between neighbours; the value itself where the stamps coincide."""
    before = values[placement.left]
    if np.array_equal(placement.left, placement.right):
        return before
    with np.errstate(invalid="ignore", over="ignore"):
        between = before + placement.share * (values[placement.right] - before)
    return np.where(placement.left == placement.right, before, between)


def _angle_at(stamp_ns: Stamps, angle: Angle | None, max_gap_ns: int) -> Floats:
    """Joint angle [rad] at the stamps, NaN where there is none near enough."""
    result = np.full(len(stamp_ns), np.nan)
    if angle is not None:
        values = np.asarray(angle.value, dtype=np.float64)
        placement = _place(stamp_ns, np.asarray(angle.stamp_ns, dtype=np.int64), max_gap_ns)
        result[placement.source] = _interpolated(values, placement)
    return result


def _integers(stamps: ArrayLike, owner: str) -> Stamps:
    array = np.asarray(stamps)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ValueError(
            f"{owner}: stamps must be integer nanoseconds of shape (n,); "
            f"got {array.dtype} of shape {array.shape}"
        )
    return array.astype(np.int64, copy=False)


def _checked_stamps(stamps: ArrayLike, owner: str) -> Stamps:
    array = _integers(stamps, owner)
    late = np.flatnonzero(array[1:] <= array[:-1])
    if len(late):
        at = int(late[0])
        raise ValueError(
            f"{owner}: stamps must increase strictly; [{at + 1}] = {array[at + 1]} ns follows "
            f"[{at}] = {array[at]} ns"
        )
    return array
