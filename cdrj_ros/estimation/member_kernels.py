"""Compiled steps of the ensemble's members, and the resulting standard deviations.

Called by ``cdrj_ros.estimation.ensemble``, which describes the members.
"""

from __future__ import annotations

from math import ceil, sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import compiled, lean
from cdrj_ros.model.drum import start_drum
from cdrj_ros.model.friction_history import impose_friction
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.packing import number_views, plan_views
from cdrj_ros.model.state import state_views
from cdrj_ros.model.status import INVALID
from cdrj_ros.model.views import copy_part, part

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

# Indices in the array of the members' progress.
TURN, LAST_STAMP, BEHIND, PROGRESS = range(4)

MOVED: Final = 0.01
"""If an axis moves further than this in a gap, the friction history is unknown [rad]."""

UNSEEN_NS: Final = 1_000_000_000
"""A longer time between two samples counts as a gap [ns]."""

ROUND_NS: Final = 4_000_000
"""Time within which all members are updated while an axis has no readings [ns]."""


# A literal argument has its own type, for which numba would compile the callee again.
ONE: Final[Any] = np.int64(1)
ANY: Final[Any] = np.int64(-1)


@lean
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
    """Update one member, or initialise it with its friction history; False: not solved.

    Takes 9 arguments because it passes the 7 of ``advance`` on.
    """
    sizes = plan_views(plan).sizes
    if state_views(sizes, state).started[0] == 0.0:
        advance(plan, numbers, state, motor_angle, joint_angle, 0.0, out)
        if state_views(sizes, out).started[0] == 0.0:  # no such pose
            return False
        copy_part(out, 0, state)
        impose_friction(
            plan, numbers, share, state, part(out, state.size + estimate_size, out.size)
        )
        dt = 0.0
    solved = advance(plan, numbers, state, motor_angle, joint_angle, dt, out)
    copy_part(out, 0, state)
    return solved


@compiled
def forget_drums(plan: NDArray[np.int64], numbers: Vector, state: Vector) -> None:
    """Give all cable on the drums the present strain, as of a cable that slips on its drum."""
    layout = plan_views(plan)
    values, now = number_views(layout.sizes, numbers), state_views(layout.sizes, state)
    for c in range(len(layout.cables)):
        cable = layout.cables[c]
        for end in range(2):
            if layout.ends[2 * c + end].motor < 0:
                continue
            e = cable.first_element + (0 if end == 0 else cable.elements - 1)
            drum = now.drums[2 * c + end]
            top = int(drum.points) - 1
            rate = values.ends[2 * c + end].radius / max(now.length[e] / now.material[e], 1.0)
            start_drum(drum, drum.angle[top], drum.material[top], rate)


@lean
def _is_invalid(estimate: Vector, elements: int, element: int) -> bool:
    """Whether an element of the estimate is ``INVALID``; for ``ANY``, whether any element is."""
    if element >= 0:
        return int(estimate[elements + element]) & INVALID != 0
    flags = 0
    for e in range(elements):
        flags |= int(estimate[elements + e])
    return flags & INVALID != 0


@lean
def _was_unseen(
    last_stamp: int, stamp: int, last_angle: Vector, motor_angle: Vector, joint_angle: Vector
) -> bool:
    """Whether a gap precedes this sample during which an axis moved."""
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


@lean
def _is_on_the_way(unseen: Table) -> bool:
    """Whether an axis may have moved unseen between the previous sample and this one.

    ``np.any`` would make every start load SciPy's linear algebra.
    """
    if unseen.shape[0] > 0:
        for a in range(unseen.shape[1]):
            if unseen[1, a] > 0.0:
                return True
    return False


@lean
def _note_unseen(unseen: Table, intervals: NDArray[np.int64]) -> bool:
    """Count every axis's intervals without readings; True if an axis is in one now.

    ``intervals`` holds twice the number of past intervals, plus one during an interval.
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


@lean
def _deviate(
    readings: Vector,
    deviation: Vector,
    ways: NDArray[np.float64],
    intervals: NDArray[np.int64],
    member: int,
    span: Table,
) -> None:
    """Shift a member's readings by its share of the angles' deviation, within the axes' ranges.

    A member keeps sign and size of its share throughout an interval between readings, so its path
    is smooth and cables slip along it as they would in a real motion.
    """
    for a in range(readings.size):
        if deviation[a] > 0.0:
            way = ways[(intervals[a] >> 1) % ways.shape[0], member, a]
            moved = readings[a] + deviation[a] * way
            low, high = min(span[0, a], readings[a]), max(span[1, a], readings[a])
            readings[a] = min(max(moved, low), high)


@lean
def _forget(
    states: Table,
    deviation: Table,
    variance: Vector,
    progress: NDArray[np.int64],
    intervals: NDArray[np.int64],
) -> None:
    """Reset all members, because their friction history is unknown."""
    states[:] = 0.0
    deviation[:] = 0.0
    variance[:] = 0.0
    progress[TURN] = 0
    intervals[:] = 0


@lean
def _read(readings: Vector, angle: Vector, errors: Vector) -> None:
    """Write a member's readings, with its errors, for axes at ``angle`` [rad]."""
    for a in range(readings.size):
        readings[a] = angle[a] + errors[a]


@lean
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
    """Store a member's difference from the estimate and its contribution to the variance (U1).

    Quantities not solved in either keep their last difference.  Takes 9 arguments because kernels
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
    if member == members - 1:  # recompute, so that rounding errors do not accumulate
        for c in range(columns.size):
            total = 0.0
            for i in range(members):
                total += deviation[i, c] * deviation[i, c]
            variance[c] = total / members


@lean
def _write_stddev(
    columns: NDArray[np.int64],
    estimate: Vector,
    variance: Vector,
    unmodelled: Table,
    stddev: Vector,
) -> None:
    """Add what no member shows to the spread (U5), and widen it where cables are slack (U6)."""
    for c in range(columns.size):
        total = max(variance[c], 0.0) + unmodelled[0, c]
        slack = unmodelled[1, c]
        if abs(estimate[columns[c]]) <= slack:
            total = max(total, slack * slack)
        stddev[c] = sqrt(total)


@compiled
def update_members(
    plan: NDArray[np.int64],
    numbers: Table,
    states: Table,
    stamps: NDArray[np.int64],
    shares: Table,
    forgetful: NDArray[np.bool_],
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
    unmodelled: Table,
    last_angle: Vector,
    intervals: NDArray[np.int64],
    ways: NDArray[np.float64],
    span: Table,
    readings: Vector,
    out: Vector,
    stddev: Vector,
) -> None:
    """Update the next ``count`` members and write the standard deviations.

    All members are updated at the first sample, after a gap during which an axis moved (their
    histories then start anew), after samples that were not fully solved, and when an axis may have
    moved unseen since the previous sample: each member then takes a path of its own (U3).

    Takes 27 arguments because kernels take arrays and numbers, not objects, and members share
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
    copy_part(motor_angle, 0, part(last_angle, 0, motors))
    copy_part(joint_angle, 0, part(last_angle, motors, last_angle.size))
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
        if forgetful[k] and solved:
            forget_drums(plan, numbers[k], states[k])
        stamps[k] = stamp
        own = out[size : size + estimate.size]
        _take_deviation(
            columns, element_of, elements, solved and not unsolved, estimate, own, deviation,
            variance, k,
        )  # fmt: skip
    _write_stddev(columns, estimate, variance, unmodelled, stddev)


@compiled
def run_members(
    plan: NDArray[np.int64],
    nominal: Vector,
    state: Vector,
    numbers: Table,
    states: Table,
    stamps: NDArray[np.int64],
    shares: Table,
    forgetful: NDArray[np.bool_],
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
    unmodelled: Table,
    last_angle: Vector,
    intervals: NDArray[np.int64],
    ways: NDArray[np.float64],
    span: Table,
    readings: Vector,
    out: Vector,
    estimates: Table,
    stddevs: Table,
) -> None:
    """Call ``advance`` and ``update_members`` for many samples.

    Takes 29 arguments because it passes on those of ``update_members``.
    """
    size = state.size
    seen = np.empty((0, 0))
    for k in range(dt.size):
        advance(plan, nominal, state, motor_angles[k], joint_angles[k], dt[k], out)
        copy_part(out, 0, state)
        copy_part(out, size, estimates[k])
        update_members(
            plan, numbers, states, stamps, shares, forgetful, reading_errors, progress, ONE,
            columns, element_of, elements, sample_stamps[k], motor_angles[k], joint_angles[k],
            unseen[k] if unseen.shape[0] else seen, estimates[k],
            deviation, variance, unmodelled, last_angle, intervals, ways, span, readings, out,
            stddevs[k],
        )  # fmt: skip
