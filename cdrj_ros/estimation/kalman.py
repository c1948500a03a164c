"""One update of an ensemble Kalman filter, (U2) of docs/uncertainty.md.

The gain is computed from the ensemble (Evensen 2003; perturbed observations, restricted to the
cables concerned).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.contest import Witness
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.independent_draws import standard
from cdrj_ros.estimation.preloads import Preloads
from cdrj_ros.estimation.quantities import Quantity

Vector = NDArray[np.float64]


class Innovation(NamedTuple):
    """What a reading says that was not expected."""

    size: float
    """Reading minus what was expected of it [N] or [N m]."""
    variance: float
    """Variance of the errors that are new in every reading."""
    factor: float
    """Change of the reading per unit of its sensor's lasting error [-]."""


def update(
    spread: Spread,
    preloads: Preloads,
    what: Quantity,
    witness: Witness,
    innovation: Innovation,
    lasting: Sequence[Vector],
    values: Vector,
) -> Vector:
    """Correct a state, the ensemble and the sensor's lasting error with one reading.

    Args:
        spread: the ensemble, changed, but for its variances.
        preloads: of the ensemble, changed.
        what: the measured quantity.
        witness: the sensor, whose lasting error is corrected too.
        innovation: of the reading.
        lasting: lasting errors of all sensors in every member, see ``standard``.
        values: of the state, shape (state_size,), changed.

    Returns:
        The gain of every column of the spread.
    """
    deviation = spread.deviation
    members = len(deviation)
    h = deviation[:, what.column] + innovation.factor * witness.deviation
    variance = float(h @ h) / members + innovation.variance
    gain = deviation.T @ h / (members * variance)
    gain[what.others] = 0.0
    errors = sqrt(innovation.variance) * standard(spread.generator, members, lasting)
    differences = innovation.size - h + errors
    change = differences[:, None] * gain
    for c in what.cables:
        elements = preloads.places[c].elements
        preloads.correct(c, values, gain[elements] * innovation.size, change[:, elements])
    own_gain = float(witness.deviation @ h) / (members * variance)
    heard = float(gain[what.column]) + (own_gain if witness.against_effort else 0.0)
    witness.learn(differences * own_gain, own_gain * innovation.size, heard * innovation.size)
    deviation += change - gain * innovation.size
    spread.variance_is_old = True
    return gain
