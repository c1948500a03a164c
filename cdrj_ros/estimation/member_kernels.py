"""The ensemble at a sample: its standard deviations, and the members that are updated.

Called by ``cdrj_ros.estimation.ensemble``, which describes the members.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.member_records import BEHIND, LAST_STAMP, TURN, Members, Path
from cdrj_ros.estimation.member_spread import ANY, is_invalid, write_stddev
from cdrj_ros.estimation.member_steps import step_members_linked
from cdrj_ros.estimation.member_turns import (
    forget,
    is_due,
    note_unseen,
    now_due,
    remember_unseen,
    take_unknown,
    was_unseen,
)
from cdrj_ros.model.compiled import callee, lean, stage
from cdrj_ros.model.mechanism import advance_robot
from cdrj_ros.model.packing import plan_views
from cdrj_ros.model.views import copy_part, is_dense, part, views_of

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

UNFIT, DONE, WAITING = range(-1, 2)
"""Results of ``begin_sample``: whether arrays do not fit, and whether a member is to be updated."""

SOLVED, SPECIAL = 2, 4
"""Added to these results by ``advance_with_members``, and a further result of it."""

# A literal argument has its own type, for which numba would compile the callee again.
ONE: Final[Any] = np.int64(1)
AT_ONCE: Final[Any] = np.bool_(True)


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
    own = views_of(members)
    if not _fit(own, motor_angle, joint_angle, estimate):
        return UNFIT
    progress = own.progress
    _join(motor_angle, joint_angle, own.new_angle)
    copy_part(estimate, 0, own.estimate)
    unknown = take_unknown(own, hidden)
    if unknown or was_unseen(progress[LAST_STAMP], stamp, own.angle, own.new_angle):
        forget(own)
    count, part_s = now_due(own, stamp - progress[LAST_STAMP], hidden, least)
    progress[LAST_STAMP] = stamp
    _move(own)
    unsolved = is_invalid(own.estimate, plan_views(plan).sizes.elements, ANY)
    if progress[TURN] == 0 or (progress[BEHIND] != 0 and not unsolved):
        count = len(own.states)
    progress[BEHIND] = 1 if unsolved else 0
    if count > 1:
        step_members_linked(plan, members, count, hidden, part_s)
    remember_unseen(own, hidden)
    write_stddev(own, own.estimate, stddev)
    waiting = count == 1 and is_due(own, stamp)
    if waiting and at_once:
        step_members_linked(plan, members, count, hidden, 0.0)
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
    return not was_unseen(progress[LAST_STAMP], stamp, members.angle, members.new_angle)


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
    own = views_of(members)
    if hidden or not solved or not _is_ordinary(own, motor_angle, joint_angle, stamp):
        return SPECIAL + SOLVED if solved else SPECIAL
    state = own.states.shape[1]
    estimate = part(out, state, state + own.estimate.size)
    if stamp != own.progress[LAST_STAMP]:
        note_unseen(own.unseen, hidden, own.intervals)
    own.progress[LAST_STAMP] = stamp
    _move(own)
    remember_unseen(own, hidden)
    write_stddev(own, estimate, stddev)
    if not is_due(own, stamp):
        return SOLVED + DONE
    copy_part(estimate, 0, own.estimate)
    if not at_once:
        return SOLVED + WAITING
    step_members_linked(plan, members, ONE, hidden, 0.0)
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
