"""Passes of a recording whose clock was set back; each is compared with its own references."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.bag import Recording, Series
from cdrj_ros.judgement.channels import Channel
from cdrj_ros.judgement.reversals import clock_resets

BETWEEN_PASSES_NS: Final = 1_000_000_000
"""Time inserted between two passes when they are joined [ns]."""


def slices_of(stamps: NDArray[np.int64]) -> list[slice]:
    """Slices of stamps that increase strictly; the stamps go back between slices."""
    starts = np.flatnonzero(np.diff(stamps) <= 0) + 1
    edges = [0, *starts.tolist(), stamps.size]
    return [slice(a, b) for a, b in pairwise(edges)]


def references_of_passes(
    references: Mapping[str, Series], recording: Recording, passes: int
) -> list[dict[str, Series]]:
    """References of every pass, cut where the clock was set back."""
    if passes == 1 or not references:
        return [dict(references) for _ in range(passes)]
    clock = next(iter({**recording.joints, **recording.motors}.values()))
    return [
        dict(zip(references, column, strict=True))
        for column in zip(
            *(passes_of(series, passes - 1, clock) for series in references.values()), strict=True
        )
    ]


def passes_of(series: Series, jumps: int, clock: Series) -> list[Series]:
    """Cut a series at the jumps of its clock into ``jumps + 1`` parts.

    If its own stamps show a different number of jumps, the series is cut at the log times of the
    jumps of ``clock``.  If their number differs too, every part is the whole series, and the stamps
    alone assign samples to passes.
    """
    at = clock_resets(series.stamp_ns)
    if len(at) != jumps:
        others = clock_resets(clock.stamp_ns)
        if len(others) != jumps:
            return [series] * (jumps + 1)
        at = np.searchsorted(series.log_ns, clock.log_ns[others])
    edges = [0, *at.tolist(), series.stamp_ns.size]
    return [
        Series(series.stamp_ns[a:b], series.log_ns[a:b], series.value[a:b])
        for a, b in pairwise(edges)
    ]


def one_after_another(passes: Sequence[Sequence[Channel]]) -> tuple[Channel, ...]:
    """Join the channels of several passes, with the stamps of later passes shifted.

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
