"""Series of readings, and comparison of estimates that are there as a whole."""

import numpy as np

from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.evaluation.comparison import Comparing
from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.foundation.arrays import Series


def series_of(stamp_ns, values):
    stamps = np.asarray(stamp_ns, np.int64)
    return Series(stamps, stamps, np.ascontiguousarray(values, np.float64))


def each(stamp_ns, columns):
    """Columns that were read at the same times."""
    return {name: series_of(stamp_ns, values) for name, values in columns.items()}


def covered(model, recorded, tension):
    """Share of true tensions within two standard deviations, after the first fifth.

    Args:
        model: the robot as its file says.
        recorded: readings of the encoders.
        tension: of all elements at the stamps of the motors [N].
    """
    stamps = next(iter(recorded.motors.values())).stamp_ns
    conditioned = condition(model.robot, recorded.motors, recorded.joints)
    found = estimate(model, conditioned, uncertainty=True)
    late = found.stamp_ns > stamps[len(stamps) // 5]
    true = np.stack([np.interp(found.stamp_ns, stamps, one) for one in tension.T], axis=1)[late]
    error = np.abs(found.tension[late] - true)
    return float(np.mean(error <= 2.0 * found.tension_stddev[late]))


def compare(estimate_stamp_ns, estimates, references, *, max_gap_ns, angle=None, stddev=None):
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
