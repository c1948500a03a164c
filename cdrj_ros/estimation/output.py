"""What the live estimator gives for one sample."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import Angles, Estimate

Vector = NDArray[np.float64]


class Output(NamedTuple):
    """One estimate and its standard deviations."""

    estimate: Estimate
    stddev: Vector | None
    """In the order of ``spread_columns``; None if no uncertainty is estimated."""


class OutputAlone(Output):
    """An output of a robot with joints without encoder."""

    angles: Angles | None = None
    """Of these joints, one row; None where no effort is heard."""
