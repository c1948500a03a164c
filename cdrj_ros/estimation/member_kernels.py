"""Compiled steps of the ensemble's members, and the resulting standard deviations.

Called by ``cdrj_ros.estimation.ensemble``, which describes the members.
"""

from __future__ import annotations

from math import ceil, inf, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import callee, lean, stage
from cdrj_ros.model.drum import start_drum
from cdrj_ros.model.friction_history import impose_friction
from cdrj_ros.model.mechanism import advance_robot
from cdrj_ros.model.packing import number_views, plan_views
from cdrj_ros.model.state import state_views
from cdrj_ros.model.status import INVALID
from cdrj_ros.model.views import copy_part, is_dense, part

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

# Indices in the array of the members' progress.
TURN, LAST_STAMP, BEHIND, PROGRESS = range(4)

MOVED: Final = 0.01
"""If an axis moves further than this in a gap, the friction history is unknown [rad]."""

UNSEEN_NS: Final = 1_000_000_000
"""A longer time between two samples counts as a gap [ns]."""

APART_NS: Final = 1_500_000
"""A member is updated at most this often [ns]: at 1 kHz at every second sample."""

ROUND_NS: Final = 4_000_000
"""Time within which all members are updated while an axis has no readings [ns]."""


LAST, BETWEEN = 2, 3
"""Rows of ``Members.unseen``."""

UNFIT, DONE, WAITING = range(-1, 2)
"""Results of ``begin_sample``: whether arrays do not fit, and whether a member is to be updated."""

SOLVED, SPECIAL = 2, 4
"""Added to these results by ``advance_with_members``, and a further result of it."""

PARTS: Final = 4
"""Steps in which a member takes a path of its own between two samples.  Nearly all motions turn
back late on such a path; with two steps, members saw half of these reversals."""

# A literal argument has its own type, for which numba would compile the callee again.
ONE: Final[Any] = np.int64(1)
ANY: Final[Any] = np.int64(-1)
AT_ONCE: Final[Any] = np.bool_(True)


class Members(NamedTuple):
    """All memory of an ensemble."""

    numbers: Table
    """Of the prepared robot of every member, shape (members, numbers); read-only."""
    states: Table
    """Shape (members, state_size)."""
    stamps: NDArray[np.int64]
    """Of every member's last update [ns], shape (members,)."""
    shares: Table
    """Initial friction as a share of its bound, shape (members, pulleys)."""
    forgetful: NDArray[np.bool_]
    """Whether the member's drums forget at which strain cable went on, shape (members,)."""
    reading_errors: Table
    """Rows of reading errors, used in turn [rad], shape (rows, axes)."""
    progress: NDArray[np.int64]
    """Updates so far, last stamp [ns], whether the last estimate was not solved: (PROGRESS,)."""
    columns: NDArray[np.int64]
    """Places in the estimate of the quantities that have a standard deviation."""
    element_of: NDArray[np.int64]
    """An element of each column's cable; -1 for efforts."""
    deviation: Table
    """Differences from the estimate, shape (members, columns)."""
    variance: Vector
    """Shape (columns,)."""
    unmodelled: Table
    """What no member shows, see ``cdrj_ros.estimation.discrepancy``, shape (2, columns)."""
    intervals: NDArray[np.int64]
    """Of every axis, see ``_note_unseen``, shape (axes,)."""
    ways: NDArray[np.float64]
    """Shares of the deviation between readings, shape (ways, members, axes)."""
    span: Table
    """Ranges of all axes [rad], shape (2, axes)."""
    angle: Vector
    """Of all axes at the last sample [rad], shape (axes,)."""
    new_angle: Vector
    """The same of the sample that begins."""
    old_angle: Vector
    """The same of the sample before ``angle``."""
    unseen: Table
    """``Sample.unseen``, its first row at the sample before, and scratch, shape (4, axes).  One
    array, because each further one makes an update slower."""
    estimate: Vector
    """At the last sample at which a member was updated, shape (estimate_size,)."""
    readings: Vector
    """Scratch, shape (axes,)."""
    out: Vector
    """Scratch of ``advance``, shape (out_size,)."""


def no_members() -> Members:
    """Arrays of the right types without content, for which kernels can be compiled."""
    vector, table, counts = np.empty(0), np.empty((0, 0)), np.empty(0, dtype=np.int64)
    numbers, flags = np.empty((0, 0)), np.empty(0, dtype=np.bool_)
    numbers.flags.writeable = False
    return Members(
        numbers=numbers, states=table, stamps=counts, shares=table, forgetful=flags,
        reading_errors=table, progress=counts, columns=counts, element_of=counts, deviation=table,
        variance=vector, unmodelled=table, intervals=counts, ways=np.empty((0, 0, 0)), span=table,
        angle=vector, new_angle=vector, old_angle=vector, unseen=table, estimate=vector,
        readings=vector, out=vector,
    )  # fmt: skip


class Path(NamedTuple):
    """Samples as ``follow_members`` takes them; see ``cdrj_ros.conditioning.samples``."""

    stamp_ns: NDArray[np.int64]
    motor_angle: Table
    joint_angle: Table
    unseen: NDArray[np.float64]


@callee
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
        advance_robot(plan, numbers, state, motor_angle, joint_angle, 0.0, out)
        if state_views(sizes, out).started[0] == 0.0:  # no such pose
            return False
        copy_part(out, 0, state)
        impose_friction(
            plan, numbers, share, state, part(out, state.size + estimate_size, out.size)
        )
        dt = 0.0
    solved = advance_robot(plan, numbers, state, motor_angle, joint_angle, dt, out)
    copy_part(out, 0, state)
    return solved


@lean
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


@callee
def _is_invalid(estimate: Vector, elements: int, element: int) -> bool:
    """Whether an element of the estimate is ``INVALID``; for ``ANY``, whether any element is."""
    if element >= 0:
        return int(estimate[elements + element]) & INVALID != 0
    flags = 0
    for e in range(elements):
        flags |= int(estimate[elements + e])
    return flags & INVALID != 0


@callee
def _was_unseen(last_stamp: int, stamp: int, last_angle: Vector, angle: Vector) -> bool:
    """Whether a gap precedes this sample during which an axis moved."""
    if last_stamp < 0 or stamp - last_stamp <= UNSEEN_NS:
        return False
    moved = False
    for a in range(angle.size):
        moved |= abs(angle[a] - last_angle[a]) > MOVED
    return moved


@callee
def _is_unknown(members: Members, hidden: bool) -> bool:
    """Whether the motion of an axis before this sample is unknown; then it counts as zero."""
    unknown = False
    for a in range(members.angle.size):
        if hidden and members.unseen[1, a] == inf:
            members.unseen[1, a] = 0.0
            unknown = True
    return unknown


@callee
def _is_due(members: Members, stamp: int) -> bool:
    """Whether the last update of a member was at least ``APART_NS`` ago."""
    turn = members.progress[TURN]
    since: int = stamp - members.stamps[(turn - 1) % members.stamps.size]
    return turn == 0 or since >= APART_NS


@callee
def _note_unseen(unseen: Table, hidden: bool, intervals: NDArray[np.int64]) -> tuple[bool, bool]:
    """Count every axis's intervals without readings.

    ``intervals`` holds twice the number of past intervals, plus one during an interval.  Where not
    ``hidden``, all of ``unseen`` counts as zero.

    Returns:
        Whether an axis is in an interval now, and whether one may have moved unseen since the
        sample before.
    """
    inside, on_the_way = False, False
    for a in range(intervals.size):
        moved = hidden and unseen[1, a] > 0.0
        on_the_way |= moved
        if hidden and unseen[0, a] > 0.0:
            intervals[a] |= 1
            inside = True
        else:
            intervals[a] += intervals[a] & 1
            if moved:
                intervals[a] += 2
    return inside, on_the_way


@callee
def _deviate(members: Members, deviation: Vector, k: int) -> None:
    """Shift a member's readings by its share of the angles' deviation, within the axes' ranges.

    A member keeps sign and size of its share throughout an interval between readings, so its path
    is smooth and cables slip along it as they would in a real motion.
    """
    readings, span = members.readings, members.span
    for a in range(readings.size):
        if deviation[a] > 0.0:
            way = members.ways[(members.intervals[a] >> 1) % members.ways.shape[0], k, a]
            moved = readings[a] + deviation[a] * way
            low, high = min(span[0, a], readings[a]), max(span[1, a], readings[a])
            readings[a] = min(max(moved, low), high)


@callee
def _forget(members: Members) -> None:
    """Reset all members, because their friction history is unknown."""
    members.states[:] = 0.0
    members.deviation[:] = 0.0
    members.variance[:] = 0.0
    members.progress[TURN] = 0
    members.intervals[:] = 0


@callee
def _read(readings: Vector, angle: Vector, errors: Vector) -> None:
    """Write a member's readings, with its errors, for axes at ``angle`` [rad]."""
    for a in range(readings.size):
        readings[a] = angle[a] + errors[a]


@callee
def _take_deviation(members: Members, elements: int, all_solved: bool, own: Vector, k: int) -> None:
    """Store member ``k``'s difference from the estimate and its part of the variance (U1).

    Quantities not solved in either keep their last difference.
    """
    columns, estimate = members.columns, members.estimate
    deviation, variance = members.deviation, members.variance
    count = deviation.shape[0]
    for c in range(columns.size):
        if not all_solved and (
            _is_invalid(estimate, elements, members.element_of[c])
            or _is_invalid(own, elements, members.element_of[c])
        ):
            continue
        d = own[columns[c]] - estimate[columns[c]]
        variance[c] += (d * d - deviation[k, c] * deviation[k, c]) / count
        deviation[k, c] = d
    if k == count - 1:  # recompute, so that rounding errors do not accumulate
        for c in range(columns.size):
            total = 0.0
            for i in range(count):
                total += deviation[i, c] * deviation[i, c]
            variance[c] = total / count


@callee
def _write_stddev(members: Members, estimate: Vector, stddev: Vector) -> None:
    """Add what no member shows to the spread (U5), and widen it where cables are slack (U6)."""
    columns, unmodelled = members.columns, members.unmodelled
    for c in range(columns.size):
        total = max(members.variance[c], 0.0) + unmodelled[0, c]
        slack = unmodelled[1, c]
        if abs(estimate[columns[c]]) <= slack:
            total = max(total, slack * slack)
        stddev[c] = sqrt(total)


@callee
def _pass_by(members: Members, share: float) -> None:
    """Write angles and deviations at a share of the way from the sample before to the last one.

    The angles follow a straight line, the deviations the parabola through those of both samples
    and the one midway between them, which is (C3) if all three lie in the same interval.
    """
    start, end = (1.0 - share) * (1.0 - 2.0 * share), share * (2.0 * share - 1.0)
    middle = 4.0 * share * (1.0 - share)
    unseen = members.unseen
    for a in range(members.angle.size):
        members.readings[a] = (1.0 - share) * members.old_angle[a] + share * members.angle[a]
        deviation = start * unseen[LAST, a] + middle * unseen[1, a] + end * unseen[0, a]
        unseen[BETWEEN, a] = max(deviation, 0.0)


@callee
def _walk(
    plan: NDArray[np.int64], members: Members, k: int, errors: Vector, dt: float, part_s: float
) -> float:
    """Take member ``k`` along its path between two samples, but for the last of ``PARTS``.

    Returns:
        The time that is left until the sample [s].
    """
    sizes, readings = plan_views(plan).sizes, members.readings
    motor_angle = part(readings, 0, sizes.motors)
    joint_angle = part(readings, sizes.motors, sizes.motors + sizes.joints)
    dt -= (PARTS - 1) * part_s
    for p in range(1, PARTS):
        _pass_by(members, p / PARTS)
        _read(readings, readings, errors)
        _deviate(members, members.unseen[BETWEEN], k)
        _advance_member(
            plan, members.numbers[k], members.states[k], members.shares[k], motor_angle,
            joint_angle, dt, members.estimate.size, members.out,
        )  # fmt: skip
        dt = part_s
    return dt


@lean
def step_members(
    plan: NDArray[np.int64], members: Members, count: int, hidden: bool, part_s: float
) -> None:
    """Update the next ``count`` members to the sample and the estimate in ``members``.

    Args:
        plan: of the prepared robot.
        members: the ensemble, changed.
        count: number of members.
        hidden: whether ``members.unseen`` holds deviations of the angles.
        part_s: if an axis may have moved unseen since the sample before, the time since then
            divided by ``PARTS`` [s]: each member then takes a path of its own; otherwise 0.
    """
    sizes = plan_views(plan).sizes
    readings, progress = members.readings, members.progress
    states, stamp = members.states, progress[LAST_STAMP]
    motors, axes = sizes.motors, sizes.motors + sizes.joints
    size, wanted = states.shape[1], members.estimate.size
    unsolved = progress[BEHIND] != 0
    for _ in range(count):
        k = progress[TURN] % len(states)
        errors = members.reading_errors[progress[TURN] % len(members.reading_errors)]
        progress[TURN] += 1
        numbers, state, share = members.numbers[k], states[k], members.shares[k]
        motor_angle, joint_angle = part(readings, 0, motors), part(readings, motors, axes)
        dt = (stamp - members.stamps[k]) * 1e-9
        if part_s > 0.0 and state_views(sizes, state).started[0] != 0.0:
            dt = _walk(plan, members, k, errors, dt, part_s)
        _read(readings, members.angle, errors)
        if hidden:
            _deviate(members, members.unseen[0], k)
        solved = _advance_member(
            plan, numbers, state, share, motor_angle, joint_angle, dt, wanted, members.out
        )
        if members.forgetful[k] and solved:
            forget_drums(plan, numbers, state)
        members.stamps[k] = stamp
        own = part(members.out, size, size + wanted)
        _take_deviation(members, sizes.elements, solved and not unsolved, own, k)


@callee
def _join(motor_angle: Vector, joint_angle: Vector, both: Vector) -> None:
    """Write the angles of motors and joints one after the other."""
    copy_part(motor_angle, 0, part(both, 0, motor_angle.size))
    copy_part(joint_angle, 0, part(both, motor_angle.size, both.size))


@callee
def _move(members: Members) -> None:
    """Replace the angles by those of the sample that begins, and keep the old ones."""
    for a in range(members.angle.size):
        members.old_angle[a] = members.angle[a]
        members.angle[a] = members.new_angle[a]


@callee
def _fit(members: Members, motor_angle: Vector, joint_angle: Vector, estimate: Vector) -> bool:
    """Whether the arrays are contiguous and those of the members' robot."""
    dense = is_dense(motor_angle) and is_dense(joint_angle) and is_dense(estimate)
    axes = motor_angle.size + joint_angle.size
    return dense and axes == members.angle.size and estimate.size == members.estimate.size


@callee
def _now_due(members: Members, passed: int, hidden: bool, least: int) -> tuple[int, float]:
    """How many members to update after ``passed`` [ns], and ``part_s`` of ``step_members``."""
    count, part_s, everyone = least, 0.0, len(members.states)
    if passed != 0:
        inside, on_the_way = _note_unseen(members.unseen, hidden, members.intervals)
        if inside and members.progress[TURN] > 0:
            count = max(count, min(everyone, ceil(everyone * (passed / ROUND_NS))))
        if on_the_way and members.progress[TURN] > 0:
            count = everyone
            part_s = passed * 1e-9 / PARTS
    return count, part_s


@callee
def _remember_unseen(members: Members, hidden: bool) -> None:
    """Keep the deviations of this sample's angles for the next one."""
    for a in range(members.angle.size):
        members.unseen[LAST, a] = members.unseen[0, a] if hidden else 0.0


@lean
def begin_sample(
    plan: NDArray[np.int64],
    members: Members,
    motor_angle: Vector,
    joint_angle: Vector,
    estimate: Vector,
    least: int,
    stamp: int,
    hidden: bool,
    at_once: bool,
    stddev: Vector,
) -> int:
    """Write the standard deviations at a sample and its estimate, and note both in ``members``.

    In the ordinary case they are those after the sample before, and one member waits to be
    updated if ``APART_NS`` have passed since the last update: ``step_members`` can follow when the
    estimate has been sent.  More than one member is updated here, before the standard deviations
    are written: all at the first sample, after a gap during which an axis moved (their histories
    then start anew), after samples that were not fully solved, and when an axis may have moved
    unseen since the previous sample (U3); several while an axis has no readings.

    Args:
        plan: of the prepared robot.
        members: the ensemble, changed; ``unseen`` is given.
        motor_angle, joint_angle, estimate, stamp: of the sample; the stamp in nanoseconds.
        least: number of members to be updated at least.
        hidden: whether ``members.unseen`` holds deviations of the angles.
        at_once: whether the member that waits is updated here, after the standard deviations.
        stddev: shape (columns,), written.

    Returns:
        ``WAITING`` if one member is still to be updated, ``DONE`` if not; ``UNFIT``, with nothing
        changed, if the arrays are not contiguous or of another robot.

    Takes 10 arguments, because copying them in Python takes longer than the rest.
    """
    if not _fit(members, motor_angle, joint_angle, estimate):
        return UNFIT
    progress = members.progress
    _join(motor_angle, joint_angle, members.new_angle)
    copy_part(estimate, 0, members.estimate)
    unknown = _is_unknown(members, hidden)
    if unknown or _was_unseen(progress[LAST_STAMP], stamp, members.angle, members.new_angle):
        _forget(members)
    passed = stamp - progress[LAST_STAMP]
    count, part_s = _now_due(members, passed, hidden, least)
    progress[LAST_STAMP] = stamp
    _move(members)
    unsolved = _is_invalid(members.estimate, plan_views(plan).sizes.elements, ANY)
    if progress[TURN] == 0 or (progress[BEHIND] != 0 and not unsolved):
        count = len(members.states)
    progress[BEHIND] = 1 if unsolved else 0
    if count > 1:
        step_members(plan, members, count, hidden, part_s)
    _remember_unseen(members, hidden)
    _write_stddev(members, members.estimate, stddev)
    waiting = count == 1 and _is_due(members, stamp)
    if waiting and at_once:
        step_members(plan, members, count, hidden, 0.0)
    return WAITING if waiting and not at_once else DONE


@stage
def _is_ordinary(members: Members, motor_angle: Vector, joint_angle: Vector, stamp: int) -> bool:
    """Whether one member at most is to be updated at a solved sample without unseen motion.

    ``members.new_angle`` is written.
    """
    progress = members.progress
    if progress[TURN] == 0 or progress[BEHIND] != 0:
        return False
    _join(motor_angle, joint_angle, members.new_angle)
    return not _was_unseen(progress[LAST_STAMP], stamp, members.angle, members.new_angle)


@lean
def advance_with_members(
    plan: NDArray[np.int64],
    nominal: Vector,
    before: Vector,
    members: Members,
    motor_angle: Vector,
    joint_angle: Vector,
    dt: float,
    stamp: int,
    hidden: bool,
    at_once: bool,
    out: Vector,
    stddev: Vector,
) -> int:
    """``advance``, then ``begin_sample`` in the ordinary case, in one call from Python.

    The other cases are left to a second call, because the code for them slows the ordinary one.

    Args:
        plan, nominal, before, motor_angle, joint_angle, dt, out: as for ``advance``.
        members, stamp, hidden, at_once, stddev: as for ``begin_sample``.

    Returns:
        As ``begin_sample``, or ``SPECIAL`` if it is still to be called; plus ``SOLVED`` if
        ``advance`` returned True.

    Raises:
        ValueError: as ``advance``.
    """
    solved = advance_robot(plan, nominal, before, motor_angle, joint_angle, dt, out)
    if hidden or not solved or not _is_ordinary(members, motor_angle, joint_angle, stamp):
        return SPECIAL + SOLVED if solved else SPECIAL
    state = members.states.shape[1]
    estimate = part(out, state, state + members.estimate.size)
    if stamp != members.progress[LAST_STAMP]:
        _note_unseen(members.unseen, hidden, members.intervals)
    members.progress[LAST_STAMP] = stamp
    _move(members)
    _remember_unseen(members, hidden)
    _write_stddev(members, estimate, stddev)
    if not _is_due(members, stamp):
        return SOLVED + DONE
    copy_part(estimate, 0, members.estimate)
    if not at_once:
        return SOLVED + WAITING
    step_members(plan, members, ONE, hidden, 0.0)
    return SOLVED + DONE


@lean
def follow_members(
    plan: NDArray[np.int64], members: Members, samples: Path, estimates: Table, stddevs: Table
) -> None:
    """Call ``begin_sample`` for many samples and their estimates.

    Args:
        plan: of the prepared robot.
        members: the ensemble, changed.
        samples: n samples.
        estimates: shape (n, estimate_size).
        stddevs: shape (n, columns), written.
    """
    hidden = samples.unseen.shape[0] > 0
    for k in range(samples.stamp_ns.size):
        if hidden:
            for a in range(members.angle.size):
                members.unseen[0, a] = samples.unseen[k, 0, a]
                members.unseen[1, a] = samples.unseen[k, 1, a]
        begin_sample(
            plan, members, samples.motor_angle[k], samples.joint_angle[k], estimates[k], ONE,
            samples.stamp_ns[k], hidden, AT_ONCE, stddevs[k],
        )  # fmt: skip


@lean
def advance_slipping(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    motor_angles: Table,
    joint_angles: Table,
    dt: Vector,
    out: Vector,
    estimates: Table,
) -> None:
    """As ``advance_all`` of the model, for a robot whose cables slip on their drums.

    The arguments are those of ``advance_all``, with ``out``, scratch of shape (out_size,).
    """
    for k in range(dt.size):
        solved = advance_robot(plan, numbers, state, motor_angles[k], joint_angles[k], dt[k], out)
        copy_part(out, 0, state)
        copy_part(out, state.size, estimates[k])
        if solved:
            forget_drums(plan, numbers, state)
