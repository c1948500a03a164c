"""Estimates of the last moments, with which measurements that arrive late are compared.

They include the corrections made since then; otherwise late measurements would apply the same
correction repeatedly.
"""

from __future__ import annotations

from collections import deque
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
    direction: Vector
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

    def add(self, stamp_ns: int, values: Vector, direction: Vector) -> None:
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

        def then(k: int) -> Vector:
            past = history[k]
            value = past.values[place] + (self.corrected[column] - past.corrected[column])
            return np.array([value, past.direction[motor] if motor >= 0 else 1.0])

        after = len(history) - 1
        while after > 0 and history[after - 1].stamp_ns >= stamp_ns:
            after -= 1
        found = then(after)
        stamp = history[after].stamp_ns
        if stamp != stamp_ns and after > 0:
            before = history[after - 1].stamp_ns
            share = (stamp_ns - before) / (stamp - before)
            found = then(after - 1) + share * (found - then(after - 1))
        return float(found[0]), float(found[1])
