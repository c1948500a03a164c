"""Compiled steps of the ensemble's members, and the standard deviations from them.

Called by ``cdrj_ros.estimation.ensemble``, which says what the members are.
"""

from __future__ import annotations

from math import ceil, sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.friction_history import impose_friction
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.packing import plan_views
from cdrj_ros.model.state import state_views
from cdrj_ros.model.status import INVALID, UNSURE

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

# What is kept of the members' progress.
TURN, LAST_STAMP, BEHIND, PROGRESS = range(4)

MOVED: Final = 0.01
"""An axis that has moved further than this in a gap has an unknown history [rad]."""

UNSEEN_NS: Final = 1_000_000_000
"""A longer time between two samples is a gap [ns]."""

ROUND_NS: Final = 4_000_000
"""Time in which all members are brought up to date while an axis is not seen [ns]."""


# A literal in a call has a type of its own, for which numba compiles the callee once more.
ONE: Final[Any] = np.int64(1)
ANY: Final[Any] = np.int64(-1)


@compiled
def _advance_member(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    share: Vector,
    motor_angle: Vector,
    joint_angle: Vector,
    dt: float,
    estimate_size: int,
    out: Vector,
) -> bool:
    """Bring one member up to date, or start it with its friction history; False: not solved.

    Takes 9 arguments because it passes the 7 of ``advance`` on.
    """
    size, sizes = state.size, plan_views(plan).sizes
    if state_views(sizes, state).started[0] == 0.0:
        advance(plan, numbers, state, motor_angle, joint_angle, 0.0, out)
        if state_views(sizes, out).started[0] == 0.0:  # no such pose
            return False
        state[:] = out[:size]
        impose_friction(plan, numbers, share, state, out[size + estimate_size :])
        dt = 0.0
    solved = advance(plan, numbers, state, motor_angle, joint_angle, dt, out)
    state[:] = out[:size]
    return solved


@compiled
def _is_invalid(estimate: Vector, elements: int, element: int) -> bool:
    """Whether an estimate says nothing of an element, or of some element for ``ANY``."""
    if element >= 0:
        return int(estimate[elements + element]) & INVALID != 0
    flags = 0
    for e in range(elements):
        flags |= int(estimate[elements + e])
    return flags & INVALID != 0


@compiled
def _was_unseen(
    last_stamp: int, stamp: int, last_angle: Vector, motor_angle: Vector, joint_angle: Vector
) -> bool:
    """Whether an axis has moved in a gap before this sample."""
    if last_stamp < 0 or stamp - last_stamp <= UNSEEN_NS:
        return False
    motors = motor_angle.size
    for m in range(motors):
        if abs(motor_angle[m] - last_angle[m]) > MOVED:
            return True
    for j in range(joint_angle.size):
        if abs(joint_angle[j] - last_angle[motors + j]) > MOVED:
            return True
    return False


@compiled
def _is_on_the_way(unseen: Table) -> bool:
    """Whether an axis may have been elsewhere between the sample before and this one."""
    return unseen.shape[0] > 0 and bool(np.any(unseen[1] > 0.0))


@compiled
def _note_unseen(unseen: Table, intervals: NDArray[np.int64]) -> bool:
    """Count every axis's intervals without readings; whether one is not seen now.

    Twice the number of intervals, and one more during one of them.
    """
    hidden = False
    for a in range(intervals.size):
        if unseen.shape[0] and unseen[0, a] > 0.0:
            intervals[a] |= 1
            hidden = True
        else:
            intervals[a] += intervals[a] & 1
            if unseen.shape[0] and unseen[1, a] > 0.0:
                intervals[a] += 2
    return hidden


@compiled
def _deviate(
    readings: Vector,
    deviation: Vector,
    ways: NDArray[np.float64],
    intervals: NDArray[np.int64],
    member: int,
    span: Table,
) -> None:
    """Move a member's readings by its share of what has not been seen, within the axes' ranges.

    A member keeps its sense and size over a whole interval between readings: its way is a smooth
    one, and what slips on it slips.
    """
    for a in range(readings.size):
        if deviation[a] > 0.0:
            way = ways[(intervals[a] >> 1) % ways.shape[0], member, a]
            moved = readings[a] + deviation[a] * way
            low, high = min(span[0, a], readings[a]), max(span[1, a], readings[a])
            readings[a] = min(max(moved, low), high)


@compiled
def _forget(
    states: Table,
    deviation: Table,
    variance: Vector,
    progress: NDArray[np.int64],
    intervals: NDArray[np.int64],
) -> None:
    """Let all members start anew, since nobody knows what they have passed through."""
    states[:] = 0.0
    deviation[:] = 0.0
    variance[:] = 0.0
    progress[TURN] = 0
    intervals[:] = 0


@compiled
def _read(readings: Vector, angle: Vector, errors: Vector) -> None:
    """What a member reads where the axes are at ``angle`` [rad]."""
    for a in range(readings.size):
        readings[a] = angle[a] + errors[a]


@compiled
def _take_deviation(
    columns: NDArray[np.int64],
    element_of: NDArray[np.int64],
    elements: int,
    all_solved: bool,
    estimate: Vector,
    own: Vector,
    deviation: Table,
    variance: Vector,
    member: int,
) -> None:
    """Take over a member's difference from the estimate, and its part in the variance (U1).

    What was not solved in either keeps its last difference.  Takes 9 arguments because kernels
    take arrays and numbers, not objects.
    """
    members = deviation.shape[0]
    for c in range(columns.size):
        if not all_solved and (
            _is_invalid(estimate, elements, element_of[c])
            or _is_invalid(own, elements, element_of[c])
        ):
            continue
        d = own[columns[c]] - estimate[columns[c]]
        variance[c] += (d * d - deviation[member, c] * deviation[member, c]) / members
        deviation[member, c] = d
    if member == members - 1:  # rounding does not add up
        for c in range(columns.size):
            total = 0.0
            for i in range(members):
                total += deviation[i, c] * deviation[i, c]
            variance[c] = total / members


@compiled
def update_members(
    plan: NDArray[np.int64],
    numbers: Table,
    states: Table,
    stamps: NDArray[np.int64],
    shares: Table,
    reading_errors: Table,
    progress: NDArray[np.int64],
    count: int,
    columns: NDArray[np.int64],
    element_of: NDArray[np.int64],
    elements: int,
    stamp: int,
    motor_angle: Vector,
    joint_angle: Vector,
    unseen: Table,
    estimate: Vector,
    deviation: Table,
    variance: Vector,
    last_angle: Vector,
    intervals: NDArray[np.int64],
    ways: NDArray[np.float64],
    span: Table,
    readings: Vector,
    out: Vector,
    stddev: Vector,
) -> None:
    """Bring the next ``count`` members up to date and write the standard deviations.

    All members where they have seen nothing yet, where an axis moved during a gap (their
    histories start anew then), after samples of which something was not solved, and where an axis
    may have been elsewhere since the sample before: each member then takes a path of its own (U3).

    Takes 25 arguments because kernels take arrays and numbers, not objects, and members share
    all of the memory of ``Spread``.  Longer than a screen because its arguments take half of one.
    """
    members, size = states.shape
    motors = motor_angle.size
    if _was_unseen(progress[LAST_STAMP], stamp, last_angle, motor_angle, joint_angle):
        _forget(states, deviation, variance, progress, intervals)
    last_stamp = progress[LAST_STAMP]
    new = stamp != last_stamp
    on_the_way = new and progress[TURN] > 0 and _is_on_the_way(unseen)
    if new and _note_unseen(unseen, intervals) and progress[TURN] > 0:
        passed = (stamp - last_stamp) / ROUND_NS
        count = max(count, min(members, ceil(members * passed)))
    sizes = plan_views(plan).sizes
    middle_angle = 0.5 * last_angle
    half = 0.0
    if on_the_way:
        count = members
        middle_angle[:motors] += 0.5 * motor_angle
        middle_angle[motors:] += 0.5 * joint_angle
        half = (stamp - last_stamp) * 0.5e-9
    progress[LAST_STAMP] = stamp
    last_angle[:motors] = motor_angle
    last_angle[motors:] = joint_angle
    unsolved = _is_invalid(estimate, elements, ANY)
    if progress[TURN] == 0 or (progress[BEHIND] and not unsolved):
        count = members
    progress[BEHIND] = unsolved
    for _ in range(count):
        k = progress[TURN] % members
        errors = reading_errors[progress[TURN] % reading_errors.shape[0]]
        progress[TURN] += 1
        dt = (stamp - stamps[k]) * 1e-9
        started = state_views(sizes, states[k]).started[0] != 0.0
        if on_the_way and started:
            _read(readings, middle_angle, errors)
            _deviate(readings, unseen[1], ways, intervals, k, span)
            _advance_member(
                plan, numbers[k], states[k], shares[k], readings[:motors], readings[motors:],
                dt - half, estimate.size, out,
            )  # fmt: skip
            dt = half
        _read(readings, last_angle, errors)
        if unseen.shape[0]:
            _deviate(readings, unseen[0], ways, intervals, k, span)
        solved = _advance_member(
            plan, numbers[k], states[k], shares[k], readings[:motors], readings[motors:],
            dt, estimate.size, out,
        )  # fmt: skip
        stamps[k] = stamp
        own = out[size : size + estimate.size]
        _take_deviation(
            columns, element_of, elements, solved and not unsolved, estimate, own, deviation,
            variance, k,
        )  # fmt: skip
    for c in range(columns.size):
        stddev[c] = sqrt(max(variance[c], 0.0))


@compiled
def run_members(
    plan: NDArray[np.int64],
    nominal: Vector,
    state: Vector,
    numbers: Table,
    states: Table,
    stamps: NDArray[np.int64],
    shares: Table,
    reading_errors: Table,
    progress: NDArray[np.int64],
    columns: NDArray[np.int64],
    element_of: NDArray[np.int64],
    elements: int,
    sample_stamps: NDArray[np.int64],
    motor_angles: Table,
    joint_angles: Table,
    unseen: NDArray[np.float64],
    dt: Vector,
    deviation: Table,
    variance: Vector,
    last_angle: Vector,
    intervals: NDArray[np.int64],
    ways: NDArray[np.float64],
    span: Table,
    readings: Vector,
    out: Vector,
    estimates: Table,
    stddevs: Table,
) -> None:
    """``advance`` and ``update_members`` over many samples, the very same functions.

    Takes 27 arguments because it passes those of ``update_members`` on.
    """
    size = state.size
    wanted = estimates.shape[1]
    seen = np.empty((0, 0))
    for k in range(dt.size):
        advance(plan, nominal, state, motor_angles[k], joint_angles[k], dt[k], out)
        state[:] = out[:size]
        estimates[k] = out[size : size + wanted]
        update_members(
            plan, numbers, states, stamps, shares, reading_errors, progress, ONE, columns,
            element_of, elements, sample_stamps[k], motor_angles[k], joint_angles[k],
            unseen[k] if unseen.shape[0] else seen, estimates[k],
            deviation, variance, last_angle, intervals, ways, span, readings, out, stddevs[k],
        )  # fmt: skip


@compiled
def mark_unsure(values: Vector, preload: Vector, stddev: Vector, share: float) -> None:
    """Set ``UNSURE`` where a standard deviation exceeds a share of the tension or the preload.

    Args:
        values: an estimate: tensions, then status of all elements, then the rest; changed.
        preload: of every element's cable [N], shape (elements,).
        stddev: of the tensions, then the rest [N].
        share: see ``Options.unsure_share``.
    """
    elements = preload.size
    for e in range(elements):
        if stddev[e] > share * max(values[e], preload[e]):
            flags = int(values[elements + e])
            if flags & INVALID == 0:
                values[elements + e] = flags | UNSURE
