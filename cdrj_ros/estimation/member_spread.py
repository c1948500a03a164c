"""Standard deviations from the members' differences, (U1), (U5) and (U6) of docs/uncertainty.md."""

from __future__ import annotations

from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.member_records import Members
from cdrj_ros.model.compiled import callee
from cdrj_ros.model.status import INVALID

Vector = NDArray[np.float64]

# A literal argument has its own type, for which numba would compile the callee again.
ANY: Final[Any] = np.int64(-1)


@callee
def is_invalid(estimate: Vector, elements: int, element: int) -> bool:
    """Whether an element of the estimate is ``INVALID``; for ``ANY``, whether any element is."""
    if element >= 0:
        return int(estimate[elements + element]) & INVALID != 0
    flags = 0
    for e in range(elements):
        flags |= int(estimate[elements + e])
    return flags & INVALID != 0


@callee
def take_deviation(members: Members, elements: int, all_solved: bool, own: Vector, k: int) -> None:
    """Store member ``k``'s difference from the estimate and its part of the variance (U1).

    Quantities not solved in either keep their last difference.
    """
    columns, estimate = members.columns, members.estimate
    deviation, variance = members.deviation, members.variance
    count = deviation.shape[0]
    for c in range(columns.size):
        if not all_solved and (
            is_invalid(estimate, elements, members.element_of[c])
            or is_invalid(own, elements, members.element_of[c])
        ):
            continue
        d = own[columns[c]] - estimate[columns[c]]
        variance[c] += (d * d - deviation[k, c] * deviation[k, c]) / count
        deviation[k, c] = d
    if k == count - 1:  # recompute, so that rounding errors do not accumulate
        for c in range(columns.size):
            total = 0.0
            for i in range(count):
                total += deviation[i, c] * deviation[i, c]
            variance[c] = total / count


@callee
def write_stddev(members: Members, estimate: Vector, stddev: Vector) -> None:
    """Add what no member shows to the spread (U5), and widen it where cables are slack (U6)."""
    columns, unmodelled = members.columns, members.unmodelled
    for c in range(columns.size):
        total = max(members.variance[c], 0.0) + unmodelled[0, c]
        slack = unmodelled[1, c]
        if abs(estimate[columns[c]]) <= slack:
            total = max(total, slack * slack)
        stddev[c] = sqrt(total)
