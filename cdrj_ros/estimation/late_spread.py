"""What an ensemble misses while its kernels are being compiled."""

from __future__ import annotations

from collections import deque
from time import perf_counter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import Estimate

Vector = NDArray[np.float64]

MOST: Final = 20_000
"""Number of samples that are kept, some 2 kB each.  If there are more, the ensemble begins with a
later one."""


class LateSpread:
    """Samples and estimates that an ensemble has yet to be updated with.

    Until it has been, standard deviations are unknown, that is infinite.  From then on they are
    those of an ensemble that has been there from the start, bit for bit.
    """

    def __init__(self, columns: int) -> None:
        """Nothing has been missed.

        Args:
            columns: number of standard deviations of an estimate.
        """
        self.unknown: Vector = np.full(columns, np.inf)
        """Standard deviations meanwhile, shape (columns,)."""
        self._missed: deque[tuple[Sample, Estimate]] = deque()

    def note(self, sample: Sample, estimate: Estimate) -> None:
        """Keep a sample with its estimate, without the state that the estimate's memory holds."""
        if len(self._missed) == MOST:
            self._missed.clear()
        own = Estimate(
            estimate.stamp_ns, estimate.values.copy(), estimate.layout, solved=estimate.solved
        )
        self._missed.append((sample, own))

    def forget(self) -> None:
        """Forget all samples: the ensemble begins with the next one."""
        self._missed.clear()

    def update(self, spread: Spread, within_s: float) -> bool:
        """Update an ensemble with what it has missed, the oldest first.

        Args:
            spread: the ensemble.
            within_s: time after which no further sample is begun [s].

        Returns:
            Whether it has now been updated with everything.
        """
        end = perf_counter() + within_s
        while self._missed:
            spread.update(*self._missed.popleft())
            if perf_counter() > end:
                break
        return not self._missed
