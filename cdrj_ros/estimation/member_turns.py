"""Which of the ensemble's members are updated at a sample, by the time and the motion since."""

from __future__ import annotations

from math import ceil, inf
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.member_records import LAST, TURN, Members
from cdrj_ros.estimation.member_steps import PARTS
from cdrj_ros.model.compiled import callee

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

MOVED: Final = 0.01
"""If an axis moves further than this in a gap, the friction history is unknown [rad]."""

UNSEEN_NS: Final = 1_000_000_000
"""A longer time between two samples counts as a gap [ns]."""

APART_NS: Final = 1_500_000
"""A member is updated at most this often [ns]: at 1 kHz at every second sample."""

ROUND_NS: Final = 4_000_000
"""Time within which all members are updated while an axis has no readings [ns]."""


@callee
def was_unseen(last_stamp: int, stamp: int, last_angle: Vector, angle: Vector) -> bool:
    """Whether a gap precedes this sample during which an axis moved."""
    if last_stamp < 0 or stamp - last_stamp <= UNSEEN_NS:
        return False
    moved = False
    for a in range(angle.size):
        moved |= abs(angle[a] - last_angle[a]) > MOVED
    return moved


@callee
def take_unknown(members: Members, hidden: bool) -> bool:
    """Whether the motion of an axis before this sample is unknown; then it counts as zero."""
    unknown = False
    for a in range(members.angle.size):
        if hidden and members.unseen[1, a] == inf:
            members.unseen[1, a] = 0.0
            unknown = True
    return unknown


@callee
def is_due(members: Members, stamp: int) -> bool:
    """Whether the last update of a member was at least ``APART_NS`` ago."""
    turn = members.progress[TURN]
    since: int = stamp - members.stamps[(turn - 1) % members.stamps.size]
    return turn == 0 or since >= APART_NS


@callee
def note_unseen(unseen: Table, hidden: bool, intervals: NDArray[np.int64]) -> tuple[bool, bool]:
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
def now_due(members: Members, passed: int, hidden: bool, least: int) -> tuple[int, float]:
    """How many members to update after ``passed`` [ns], and ``part_s`` of ``step_members``."""
    count, part_s, everyone = least, 0.0, len(members.states)
    if passed != 0:
        inside, on_the_way = note_unseen(members.unseen, hidden, members.intervals)
        if inside and members.progress[TURN] > 0:
            count = max(count, min(everyone, ceil(everyone * (passed / ROUND_NS))))
        if on_the_way and members.progress[TURN] > 0:
            count = everyone
            part_s = passed * 1e-9 / PARTS
    return count, part_s


@callee
def remember_unseen(members: Members, hidden: bool) -> None:
    """Keep the deviations of this sample's angles for the next one."""
    for a in range(members.angle.size):
        members.unseen[LAST, a] = members.unseen[0, a] if hidden else 0.0


@callee
def forget(members: Members) -> None:
    """Reset all members, because their friction history is unknown."""
    members.states[:] = 0.0
    members.deviation[:] = 0.0
    members.variance[:] = 0.0
    members.progress[TURN] = 0
    members.intervals[:] = 0
