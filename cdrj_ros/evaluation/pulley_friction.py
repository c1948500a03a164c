"""Friction at every pulley over a recording: its magnitude, and its loop over the cable passed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.evaluation.reversals import envelopes
from cdrj_ros.model.prepared import Layout

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

BLOCK: Final = 4096
"""Samples per block, such that a block fits into the processor's cache."""

LOOP_BUCKETS: Final = 16
"""Buckets per BLOCK; of each bucket the loop keeps the smallest and largest sample."""


@dataclass(frozen=True, eq=False)
class PulleyFriction:
    """Friction at one pulley; its share is |t_i - t_(i-1)| over the larger of the two tensions."""

    name: str
    """Name of the pulley, ``cable/node``."""
    mean: float
    """Mean |t_i - t_(i-1)| [N]."""
    largest: float
    """Largest |t_i - t_(i-1)| [N]."""
    mean_share: float
    """Mean share over the samples in which the cable is taut [-]."""
    largest_share: float
    """Largest share [-]."""
    passed: Floats | None = None
    """Length of cable that has passed the pulley since the beginning [m], shape (n,), thinned such
    that extremes are kept; given for one pulley only."""
    friction: Floats | None = None
    """t_i - t_(i-1) at the same samples [N], shape (n,)."""


class FrictionSums:
    """Accumulates friction over the estimates of one pass, given in pieces."""

    def __init__(self, layout: Layout) -> None:
        """Start with empty sums for the pulleys of a robot."""
        place = {name: k for k, name in enumerate(layout.elements)}
        pulleys = len(layout.pulleys)
        self._layout = layout
        self._after = [place[name] for name in layout.pulleys]
        self._before = [k - 1 for k in self._after]
        self._sum, self._most, self._share_sum, self._share_most, self._taut = (
            np.zeros(pulleys) for _ in range(5)
        )
        self._count = 0
        self._last_ns: int | None = None
        self._passed = np.zeros(pulleys)
        self._loops: list[tuple[Indices, Floats, Floats]] = []
        """Of every block: the samples kept, cable passed and friction there, a row per pulley."""

    def add(self, stamp_ns: NDArray[np.int64], values: Floats) -> None:
        """Add the next estimates.

        Sums do not depend on the pieces if the size of each but the last is a multiple of BLOCK.

        Args:
            stamp_ns: increasing [ns], shape (n,).
            values: shape (n, layout.size).
        """
        if not self._layout.pulleys:
            return
        for begin in range(0, len(stamp_ns), BLOCK):
            self._add_block(stamp_ns[begin : begin + BLOCK], values[begin : begin + BLOCK])

    def _add_block(self, stamp_ns: NDArray[np.int64], values: Floats) -> None:
        layout = self._layout
        tension, friction = values[:, layout.tension], values[:, layout.friction]
        held = np.abs(friction)
        larger = tension[:, self._before]
        np.maximum(larger, tension[:, self._after], out=larger)
        pulled = larger > 0.0
        share = np.divide(held, larger, out=np.zeros_like(held), where=pulled)
        self._sum += held.sum(axis=0)
        self._share_sum += share.sum(axis=0)
        self._taut += np.count_nonzero(pulled, axis=0)
        np.maximum(self._most, held.max(axis=0), out=self._most)
        np.maximum(self._share_most, share.max(axis=0), out=self._share_most)
        self._count += len(stamp_ns)
        first = int(stamp_ns[0]) if self._last_ns is None else self._last_ns
        step = np.diff(stamp_ns, prepend=np.int64(first)) * 1e-9
        moved = values[:, layout.slip_speed] * step[:, np.newaxis]
        passed = self._passed + np.cumsum(moved, axis=0)
        self._passed, self._last_ns = passed[-1], int(stamp_ns[-1])
        by_pulley = np.ascontiguousarray(passed.T), np.ascontiguousarray(friction.T)
        kept = envelopes(LOOP_BUCKETS, *by_pulley)
        passed, friction = (np.take_along_axis(rows, kept, axis=1) for rows in by_pulley)
        self._loops.append((kept, passed, friction))

    def result(self) -> tuple[PulleyFriction, ...]:
        """Friction of all pulleys; only the pulley of the largest mean share has a loop."""
        n = self._count
        if not n:
            return ()
        mean_share = self._share_sum / np.maximum(self._taut, 1)
        largest = int(mean_share.argmax())
        passed, friction = self._loop(largest)
        return tuple(
            PulleyFriction(
                name,
                float(self._sum[k]) / n,
                float(self._most[k]),
                float(mean_share[k]),
                float(self._share_most[k]),
                passed if k == largest else None,
                friction if k == largest else None,
            )
            for k, name in enumerate(self._layout.pulleys)
        )

    def _loop(self, pulley: int) -> tuple[Floats, Floats]:
        """Cable passed and friction at the samples kept of a pulley, each once."""
        parts = []
        for kept, passed, friction in self._loops:
            new = np.diff(kept[pulley], prepend=-1) > 0
            parts.append((passed[pulley, new], friction[pulley, new]))
        whole_passed, whole_friction = (np.concatenate(part) for part in zip(*parts, strict=True))
        return whole_passed, whole_friction
