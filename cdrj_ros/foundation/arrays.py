"""Types of arrays, named after what their rows are, and the time series of one channel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
"""Numbers in an array of any shape."""

Vector = NDArray[np.float64]
"""Shape (n,)."""

Table = NDArray[np.float64]
"""A row per time, shape (n, columns)."""

Matrix = NDArray[np.float64]
"""Shape (rows, columns)."""

Points = NDArray[np.float64]
"""Positions [m], shape (n, 3)."""

Faces = NDArray[np.uint32]
"""Triangles, as indices of their corners, shape (n, 3)."""

Stamps = NDArray[np.int64]
"""Times [ns], shape (n,)."""


@dataclass(frozen=True)
class Series:
    """Readings of one channel in order of arrival; values are as received, including NaN."""

    stamp_ns: NDArray[np.int64]
    """Time of measurement [ns], shape (n,): in a recording the header stamps, and the log time of
    a message whose stamp is zero."""
    log_ns: NDArray[np.int64]
    """Time of arrival [ns], shape (n,), never decreasing: in a recording the log times."""
    value: NDArray[np.float64]
    """Shape (n,); of a channel of vectors (n, components)."""
    by_arrival: bool = False
    """Whether stamps are times of arrival, because those of the headers are zero."""

    def part(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Series:
        """The readings of these rows."""
        return replace(
            self, stamp_ns=self.stamp_ns[rows], log_ns=self.log_ns[rows], value=self.value[rows]
        )
