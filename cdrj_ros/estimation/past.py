"""Estimates of the last moments, with which measurements that arrive late are compared.

They include the corrections made since then; otherwise late measurements would apply the same
correction repeatedly.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

HISTORY_NS: Final = 200_000_000
"""Maximum age of a measurement [ns]."""

KEPT: Final = 5_000
"""Maximum number of past estimates."""


class _Past(NamedTuple):
    """One of them."""

    stamp_ns: int
    values: Vector
    """The estimate, see ``Estimate.values``."""
    corrected: Vector
    """The total correction of each column until then."""
    direction: Sequence[float]
    """Effort per unit of friction of every motor [-], see ``MotorFriction.turn``."""


class PastEstimates:
    """The estimates of the last ``HISTORY_NS``, and the corrections of them all."""

    def __init__(self, columns: NDArray[np.int64]) -> None:
        """Begin without estimates.

        Args:
            columns: places of the spread's quantities in an estimate.
        """
        self._columns = columns
        self._history: deque[_Past] = deque(maxlen=KEPT)
        self.corrected = np.zeros(columns.size)
        """The total correction of each column until now."""

    def forget(self) -> None:
        """Forget all estimates and corrections."""
        self._history.clear()
        self.corrected = np.zeros(self._columns.size)

    def add(self, stamp_ns: int, values: Vector, direction: Sequence[float]) -> None:
        """Add the estimate of a sample.

        Args:
            stamp_ns: of the sample [ns].
            values: the estimate, see ``Estimate.values``.
            direction: see ``MotorFriction.turn``.
        """
        history = self._history
        history.append(_Past(stamp_ns, values, self.corrected, direction))
        while stamp_ns - history[0].stamp_ns > HISTORY_NS:
            history.popleft()

    @property
    def last(self) -> Vector:
        """The last estimate, see ``Estimate.values``."""
        return self._history[-1].values

    def expected(self, stamp_ns: int, column: int, motor: int) -> tuple[float, float] | None:
        """The current estimate for the time of a measurement; None outside the stored history.

        Args:
            stamp_ns: time of the measurement [ns].
            column: of the measured quantity.
            motor: index of the motor whose effort it is; -1 for a load cell.

        Returns:
            The expected quantity, and its change per unit of its sensor's lasting error [-].
        """
        history, place = self._history, int(self._columns[column])
        if not history or not history[0].stamp_ns <= stamp_ns <= history[-1].stamp_ns:
            return None

        now = float(self.corrected[column])

        def then(past: _Past) -> tuple[float, float]:
            value = float(past.values[place]) + (now - float(past.corrected[column]))
            return value, past.direction[motor] if motor >= 0 else 1.0

        k = len(history) - 1
        while k > 0 and history[k - 1].stamp_ns >= stamp_ns:
            k -= 1
        after = history[k]
        found = then(after)
        if after.stamp_ns == stamp_ns or k == 0:
            return found
        before = history[k - 1]
        share = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
        first, factor = then(before)
        return first + share * (found[0] - first), factor + share * (found[1] - factor)
