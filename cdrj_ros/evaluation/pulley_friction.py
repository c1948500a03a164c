"""Friction at every pulley over a recording, as a force and as a share of the tension."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdrj_ros.foundation.arrays import Floats
from cdrj_ros.model.prepared import Layout


@dataclass(frozen=True)
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


class FrictionSums:
    """Accumulates friction over estimates that are given in pieces."""

    def __init__(self, layout: Layout) -> None:
        """Start with empty sums for the pulleys of a robot."""
        index = {name: k for k, name in enumerate(layout.elements)}
        self._layout = layout
        self._after = [index[name] for name in layout.pulleys]
        self._before = [k - 1 for k in self._after]
        self._sum, self._largest, self._share_sum, self._largest_share, self._taut = np.zeros(
            (5, len(layout.pulleys))
        )
        self._count = 0

    def add(self, values: Floats) -> None:
        """Add the next estimates, at least one, shape (n, layout.size)."""
        tension = values[:, self._layout.tension]
        friction = np.abs(values[:, self._layout.friction])
        larger = np.maximum(tension[:, self._before], tension[:, self._after])
        taut = larger > 0.0
        share = np.divide(friction, larger, out=np.zeros_like(friction), where=taut)
        self._sum += friction.sum(axis=0)
        self._share_sum += share.sum(axis=0)
        self._taut += np.count_nonzero(taut, axis=0)
        self._largest = np.maximum(self._largest, friction.max(axis=0))
        self._largest_share = np.maximum(self._largest_share, share.max(axis=0))
        self._count += len(values)

    def result(self) -> tuple[PulleyFriction, ...]:
        """Friction of all pulleys; none without estimates."""
        if not self._count:
            return ()
        columns = (
            self._sum / self._count,
            self._largest,
            self._share_sum / np.maximum(self._taut, 1),
            self._largest_share,
        )
        rows = np.transpose(columns).tolist()
        return tuple(
            PulleyFriction(name, *row) for name, row in zip(self._layout.pulleys, rows, strict=True)
        )
