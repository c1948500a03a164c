"""What friction holds at every pulley over a recording: how much, and its loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.plan import Layout

Floats = NDArray[np.float64]


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
    if not layout.pulleys:
        return ()
    place = {name: k for k, name in enumerate(layout.elements)}
    after = [place[name] for name in layout.pulleys]
    held = np.abs(friction)
    larger = np.maximum(tension[:, [k - 1 for k in after]], tension[:, after])
    share = np.divide(held, larger, out=np.zeros_like(held), where=larger > 0.0)
    taut = np.maximum(np.count_nonzero(larger > 0.0, axis=0), 1)
    mean_share = share.sum(axis=0) / taut
    telling = int(mean_share.argmax())
    step = np.diff(stamp_ns, prepend=stamp_ns[:1]) * 1e-9
    passed = np.cumsum(slip_speed[:, telling] * step)
    return tuple(
        PulleyFriction(
            name,
            float(held[:, k].mean()),
            float(held[:, k].max()),
            float(mean_share[k]),
            float(share[:, k].max()),
            passed if k == telling else None,
            np.ascontiguousarray(friction[:, k]) if k == telling else None,
        )
        for k, name in enumerate(layout.pulleys)
    )
