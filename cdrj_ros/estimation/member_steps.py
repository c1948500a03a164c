"""Compiled steps of the ensemble's members, on the path of the readings or on one of their own."""

from __future__ import annotations

from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.drums_without_memory import forget_drums
from cdrj_ros.estimation.member_records import (
    BEHIND,
    BETWEEN,
    LAST,
    LAST_STAMP,
    TURN,
    Members,
    no_members,
)
from cdrj_ros.estimation.member_spread import take_deviation
from cdrj_ros.model.compiled import callee, lean
from cdrj_ros.model.friction_history import impose_friction
from cdrj_ros.model.linked import linked
from cdrj_ros.model.mechanism import advance_robot
from cdrj_ros.model.packing import plan_views
from cdrj_ros.model.state import state_views
from cdrj_ros.model.views import copy_part, part, views_of

Vector = NDArray[np.float64]

PARTS: Final = 4
"""Steps in which a member takes a path of its own between two samples.  Nearly all motions turn
back late on such a path; with two steps, members saw half of these reversals."""


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


@callee
def _read(readings: Vector, angle: Vector, errors: Vector) -> None:
    """Write a member's readings, with its errors, for axes at ``angle`` [rad]."""
    for a in range(readings.size):
        readings[a] = angle[a] + errors[a]


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
    sizes, members = plan_views(plan).sizes, views_of(members)
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
        take_deviation(members, sizes.elements, solved and not unsolved, own, k)


def _signature() -> Any:
    """Types of ``step_members``."""
    kinds: Any = numba.types
    plan = kinds.Array(kinds.int64, 1, "C", readonly=True)
    members = numba.typeof(no_members())  # type: ignore[no-untyped-call,unused-ignore]
    return kinds.none(plan, members, kinds.int64, kinds.boolean, kinds.float64)


step_members_linked: Final = linked(step_members, _signature())
"""``step_members``, to be called by kernels."""
