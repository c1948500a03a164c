"""Which recorded nodal forces are vectors, and which have only a magnitude."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from cdrj_ros.foundation.series import Series

NORM_DIFFERS: Final = 0.1
"""Share of the median magnitude of a recording by which magnitude and norm of the components may
differ in the median: both may be measured, each with its own noise."""


def known_vectors(name: str, series: Series) -> tuple[Series | None, str]:
    """The forces of one pulley as vectors; None if the recording has only their magnitudes.

    The components are a vector if their norm usually is the magnitude, as far as a magnitude is
    given.  A single force that disagrees is kept: the comparison shows it.  Components of zero
    beside a magnitude are not known: a sensor that measures only the magnitude writes them so.

    Args:
        name: of the channel, for the note.
        series: components and magnitude [N], shape (n, 4).

    Returns:
        The components [N], shape (n, 3), NaN where they are zero beside a magnitude; None if none
        is other than zero, or if they are no vector.  And a note on what was left out; empty if
        nothing was, or if all components are zero or unknown.
    """
    components = np.ascontiguousarray(series.value[:, :3])
    magnitude = series.value[:, 3]
    norm = np.linalg.norm(components, axis=1)
    present = np.isfinite(norm) & (norm > 0.0)
    if not present.any():
        return None, ""
    both = present & np.isfinite(magnitude)
    if both.any():
        difference = float(np.median(np.abs(norm[both] - magnitude[both])))
        if difference > NORM_DIFFERS * float(np.median(magnitude[both])):
            return None, (
                f"{name}: the norm of the components differs from the magnitude by "
                f"{difference:.3g} N in the median; only magnitudes were compared"
            )
    filled = (norm == 0.0) & (magnitude > 0.0)
    components[filled] = np.nan
    components.flags.writeable = False
    left_out = int(np.count_nonzero(filled))
    note = f"{name}: {left_out} forces with components of zero beside a magnitude were left out"
    return replace(series, value=components), note if left_out else ""
