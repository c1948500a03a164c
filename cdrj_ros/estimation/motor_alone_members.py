"""The estimate of a robot with joints without encoder and its members, over the samples.

The kernel that ``cdrj_ros.estimation.motor_alone`` calls; see docs/motor_alone.md.
"""

from __future__ import annotations

from math import isfinite, nan, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.motor_alone_records import (
    LAST_STAMP,
    TURN,
    Alone,
    Recorded,
    memory_of,
)
from cdrj_ros.estimation.motor_alone_solution import solve
from cdrj_ros.model.compiled import callee, lean
from cdrj_ros.model.packing import plan_views
from cdrj_ros.model.state import estimate_views
from cdrj_ros.model.status import INVALID
from cdrj_ros.model.views import copy_part, views_of

Vector = NDArray[np.float64]

APART_NS: Final = 1_500_000
"""One member is updated at most this often [ns]."""


@lean
def run_alone(plan: NDArray[np.int64], alone: Alone, recorded: Recorded) -> None:
    """Solve samples one after the other; one or many at a time give the same bits.

    At the first sample all members are solved, later one in turn, at most every ``APART_NS``.

    Args:
        plan: of the prepared robot.
        alone: the estimate and its ensemble, changed.
        recorded: the samples; their results are written.
    """
    alone, recorded = views_of(alone), views_of(recorded)
    members, progress = alone.deviation.shape[0], alone.progress
    for k in range(recorded.stamp_ns.size):
        stamp = recorded.stamp_ns[k]
        heard = False
        for m in range(alone.motor_effort.size):
            heard |= isfinite(recorded.effort[k, m])
        if not heard:
            _forget(alone)
            _write_unknown(plan, recorded, k)
            continue
        first = alone.memories[0, 0] == 0.0
        due = first or stamp - progress[LAST_STAMP] >= APART_NS
        estimate, angle = recorded.estimates[k], recorded.angles[k]
        others = members if first else min(members, 1)
        # row 0 is one of the loop: numba would compile a call with the literal 0 anew
        for turn in range(1 + others if due else 1):
            row = 1 + progress[TURN] % members if turn > 0 else 0
            _read_row(alone, row, recorded, k)
            solve(plan, alone, row, stamp)
            if row == 0:
                _take_estimate(alone, estimate, angle)
            else:
                _take_deviation(alone, row, estimate, angle)
                progress[TURN] += 1
                progress[LAST_STAMP] = stamp
        _write_stddev(alone, estimate, recorded.stddevs[k], recorded.angle_stddevs[k])


@lean
def forget(alone: Alone) -> None:
    """Discard everything that was heard; the next effort starts anew."""
    _forget(views_of(alone))


@callee
def _forget(alone: Alone) -> None:
    """``forget``, for kernels."""
    alone.memories[:] = 0.0
    alone.states[:] = 0.0
    alone.deviation[:] = 0.0
    alone.variance[:] = 0.0
    alone.progress[TURN] = 0


@callee
def _read_row(alone: Alone, row: int, recorded: Recorded, k: int) -> None:
    """Write the readings of sample ``k`` with the errors of one row."""
    errors = alone.reading_errors[alone.progress[TURN] % len(alone.reading_errors)]
    motors = alone.motor_angle.size
    for m in range(motors):
        error = errors[m] if row > 0 else 0.0
        alone.motor_angle[m] = recorded.motor_angle[k, m] + error
        alone.motor_effort[m] = recorded.effort[k, m] + alone.effort_errors[row, m]
    for a in range(alone.measured_angle.size):
        error = errors[motors + a] if row > 0 else 0.0
        alone.measured_angle[a] = recorded.measured_angle[k, a] + error


@callee
def _take_estimate(alone: Alone, estimate: Vector, angle: Vector) -> None:
    """Write the estimate and the angles of row 0."""
    copy_part(alone.joints.out, alone.states.shape[1], estimate)
    for a in range(angle.size):
        angle[a] = alone.memories[0, 2 + a]


@callee
def _take_deviation(alone: Alone, row: int, estimate: Vector, angle: Vector) -> None:
    """Store a member's difference from the estimate and its part of the variance."""
    columns, count = alone.columns.size, alone.deviation.shape[0]
    own = alone.states.shape[1]
    for c in range(columns + angle.size):
        if c < columns:
            d = alone.joints.out[own + alone.columns[c]] - estimate[alone.columns[c]]
        else:
            d = alone.memories[row, 2 + c - columns] - angle[c - columns]
        if not isfinite(d):
            continue
        before = alone.deviation[row - 1, c]
        alone.variance[c] += (d * d - before * before) / count
        alone.deviation[row - 1, c] = d


@callee
def _write_stddev(alone: Alone, estimate: Vector, stddev: Vector, angle_stddev: Vector) -> None:
    """Standard deviations of the quantities, with (U5) and (U6), and of the angles."""
    columns = alone.columns.size
    for c in range(columns):
        total = max(alone.variance[c], 0.0) + alone.unmodelled[0, c]
        slack = alone.unmodelled[1, c]
        if abs(estimate[alone.columns[c]]) <= slack:
            total = max(total, slack * slack)
        stddev[c] = sqrt(total)
    own = memory_of(alone.memories[0], angle_stddev.size)
    for a in range(angle_stddev.size):
        total = max(alone.variance[columns + a], 0.0) + own.covariance[a, a]
        angle_stddev[a] = sqrt(total)


@callee
def _write_unknown(plan: NDArray[np.int64], recorded: Recorded, k: int) -> None:
    """No effort was heard: no numbers, and every element is ``INVALID``."""
    recorded.estimates[k][:] = nan
    estimate_views(plan_views(plan).sizes, recorded.estimates[k]).status[:] = INVALID
    recorded.stddevs[k][:] = nan
    recorded.angles[k][:] = nan
    recorded.angle_stddevs[k][:] = nan
