"""Types of arrays, named after what their rows are."""

from __future__ import annotations

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
