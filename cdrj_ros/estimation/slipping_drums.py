"""Estimates of a robot whose cables slip on their drums, for comparison with recordings.

The estimator assumes that cable comes off a drum at the strain at which it went on.  Here it has
the strain of the free cable at all times, as in the members of the ensemble that forget.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.estimation.drums_without_memory import advance_slipping
from cdrj_ros.estimation.estimator import NEVER, Estimates, State
from cdrj_ros.model.compiled import ordinary
from cdrj_ros.model.prepared import Model


def run_slipping(
    model: Model, state: State, samples: Samples, into: NDArray[np.float64] | None = None
) -> tuple[State, Estimates]:
    """As ``run`` of the estimator, if the drums forget at which strain cable went on.

    Args:
        model: the prepared robot.
        state: as for ``run``.
        samples: n samples, at least one.
        into: output array for the estimates [SI], shape (n, layout.size); None: a new array.
    """
    stamps, values = samples.stamp_ns, state.values.copy()
    estimates = np.empty((stamps.size, model.layout.size)) if into is None else into
    before = stamps[0] if state.stamp_ns == NEVER else np.int64(state.stamp_ns)
    angles = ordinary(samples.motor_angle), ordinary(samples.joint_angle)
    advance_slipping(
        model.plan, model.numbers, values, *angles, np.diff(stamps, prepend=before) * 1e-9,
        np.empty(model.out_size), estimates,
    )  # fmt: skip
    return State(int(stamps[-1]), values), Estimates(stamps, estimates, model.layout)
