"""Comparison of estimates that are there as a whole."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from cdrj_ros.evaluation.channels import Angle, Channel
from cdrj_ros.evaluation.comparison import Comparing
from cdrj_ros.foundation.arrays import Series


def series_of(stamp_ns: ArrayLike, values: ArrayLike) -> Series:
    stamps = np.asarray(stamp_ns, np.int64)
    return Series(stamps, stamps, np.asarray(values, np.float64))


def compare(
    estimate_stamp_ns: ArrayLike,
    estimates: Mapping[str, ArrayLike],
    references: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    max_gap_ns: int,
    angle: Angle | Mapping[str, Angle] | None = None,
    stddev: Mapping[str, ArrayLike] | None = None,
) -> tuple[Channel, ...]:
    """The channels of estimates that are added to ``Comparing`` at once."""
    own_stamps = np.asarray(estimate_stamp_ns, np.int64)
    series = {name: series_of(*given) for name, given in references.items()}
    comparing = Comparing(list(estimates), own_stamps, series, max_gap_ns)
    comparing.add(
        {name: np.asarray(values, np.float64) for name, values in estimates.items()},
        {name: np.asarray(values, np.float64) for name, values in (stddev or {}).items()},
        len(own_stamps),
    )
    return comparing.channels(angle)
