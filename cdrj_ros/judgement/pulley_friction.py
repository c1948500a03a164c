"""What friction holds at every pulley over a recording: how much, and its loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Layout

Floats = NDArray[np.float64]

_AT_ONCE: Final = 4096
"""Samples that fit into a processor's cache."""


@dataclass(frozen=True, eq=False)
class PulleyFriction:
    """Friction at one pulley; its share is |t_i - t_(i-1)| over the larger of the two tensions."""

    name: str
    """``cable/node``."""
    mean: float
    """Mean |t_i - t_(i-1)| [N]."""
    largest: float
    """[N]."""
    mean_share: float
    """Over the samples in which the cable is taut [-]."""
    largest_share: float
    """[-]."""
    passed: Floats | None = None
    """Material that has passed the pulley since the begin [m], shape (n,); for one pulley only."""
    friction: Floats | None = None
    """t_i - t_(i-1) at the same time [N], shape (n,)."""


def pulley_friction(
    layout: Layout,
    stamp_ns: NDArray[np.int64],
    tension: Floats,
    friction: Floats,
    slip_speed: Floats,
) -> tuple[PulleyFriction, ...]:
    """Friction of all pulleys; with its loop that of the largest mean share.

    Args:
        layout: names.
        stamp_ns: increasing [ns], shape (n,).
        tension: of elements [N], shape (n, elements).
        friction: t_i - t_(i-1) [N], shape (n, pulleys).
        slip_speed: of the material past the pulley [m/s], shape (n, pulleys).
    """
    if not layout.pulleys or not len(friction):
        return ()
    place = {name: k for k, name in enumerate(layout.elements)}
    after = [place[name] for name in layout.pulleys]
    before = [k - 1 for k in after]
    n, pulleys = friction.shape
    held_sum, held_most, share_sum, share_most, taut = (np.zeros(pulleys) for _ in range(5))
    for begin in range(0, n, _AT_ONCE):
        rows = slice(begin, begin + _AT_ONCE)
        held = np.abs(friction[rows])
        larger = np.maximum(tension[rows][:, before], tension[rows][:, after])
        pulled = larger > 0.0
        share = np.divide(held, larger, out=np.zeros_like(held), where=pulled)
        held_sum += held.sum(axis=0)
        share_sum += share.sum(axis=0)
        taut += np.count_nonzero(pulled, axis=0)
        np.maximum(held_most, held.max(axis=0), out=held_most)
        np.maximum(share_most, share.max(axis=0), out=share_most)
    mean_share = share_sum / np.maximum(taut, 1)
    telling = int(mean_share.argmax())
    step = np.diff(stamp_ns, prepend=stamp_ns[:1]) * 1e-9
    passed = np.cumsum(slip_speed[:, telling] * step)
    return tuple(
        PulleyFriction(
            name,
            float(held_sum[k]) / n,
            float(held_most[k]),
            float(mean_share[k]),
            float(share_most[k]),
            passed if k == telling else None,
            np.ascontiguousarray(friction[:, k]) if k == telling else None,
        )
        for k, name in enumerate(layout.pulleys)
    )
