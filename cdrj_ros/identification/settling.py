"""The last steps of a fit: until what remains is small beside the standard errors."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.identification.residuals import Problem, residuals_together
from cdrj_ros.identification.solution import (
    Loss,
    Progress,
    difference_points,
    jacobian,
    limits,
    robust_weights,
    thresholds,
    with_priors,
)
from cdrj_ros.identification.standard_errors import expected_gain, remaining_step

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

SETTLING_STEPS: Final = 8
SETTLING_GAIN: Final = 1e-3
"""A further step that lowers the cost by less, as a fraction, is not taken for its gain."""
SETTLED: Final = 0.3
"""Further steps smaller than this are not taken [standard errors]."""
UNSETTLED: Final = 1.0
"""A remaining step larger than this is reported [standard errors]."""


def settle(
    last: Problem, rough: Problem, coordinates: Vector, loss: Loss, say: Progress
) -> tuple[Vector, Table, tuple[str, ...]]:
    """Take further steps while they are a considerable fraction of a standard error, or gain.

    Where most of the cost is noise, a tolerance on its relative change ends a fit too early.  The
    Jacobian is that of the thinned samples, which is nearly the same and many times cheaper.

    Returns:
        The coordinates, the Jacobian there without priors, and a message if they have not
        settled.
    """
    lower, upper = limits(last)
    for _ in range(SETTLING_STEPS):
        say("computing standard errors")
        # the long run over all samples and the short ones share the processors
        around = difference_points(rough, coordinates, central=True)
        residuals = residuals_together([(last, [coordinates]), (rough, around)])[0][0]
        slopes = jacobian(rough, coordinates, central=True)[: residuals.size]
        weights = robust_weights(loss, residuals, thresholds(last, residuals))
        step, size = remaining_step(last, coordinates, residuals, slopes, weights)
        worst = int(size.argmax())
        gain = expected_gain(step, residuals, slopes, weights)
        if size[worst] <= SETTLED and gain <= SETTLING_GAIN:
            return coordinates, slopes, ()
        moved = np.clip(coordinates + step, lower, upper)
        after = with_priors(last, moved, last.residuals(moved))
        before = with_priors(last, coordinates, residuals)
        weights = np.concatenate([weights, np.ones(before.size - weights.size)])
        if not weights @ after**2 < weights @ before**2:
            break
        say(f"another step, of {size[worst]:.1f} standard errors")
        coordinates = moved
    slopes = jacobian(rough, coordinates, central=True)[: residuals.size]
    if size[worst] <= UNSETTLED:
        return coordinates, slopes, ()
    sentence = (
        f"The fit has not settled: {last.unknowns[worst].name} would still move by "
        f"{size[worst]:.1f} of its standard errors."
    )
    return coordinates, slopes, (sentence,)
