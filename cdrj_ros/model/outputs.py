"""Force of a cable on a pulley from its tensions and its wrap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Table = NDArray[np.float64]


def nodal_force_magnitude(before: Table, after: Table, cosine: Table) -> Table:
    """(38), phi = pi - beta: force of a cable on a pulley [N], from its tensions and cos beta.

    This is the law of cosines, for arrays.  The core computes the magnitude from the components of
    the force instead.
    """
    squared = before**2 + after**2 - 2.0 * before * after * cosine
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)))
