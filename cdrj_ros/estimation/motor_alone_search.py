"""Search of the angles without encoder over their ranges, where nothing else is known of them."""

from __future__ import annotations

from typing import Final

from cdrj_ros.estimation.motor_alone_correction import aim, begin_correction, misfit
from cdrj_ros.estimation.motor_alone_records import (
    JOINT,
    PLACE,
    ROUND,
    SEARCH,
    SEARCHED,
    SOLVED,
    Memory,
    Reading,
    Unmeasured,
    next_phase,
)
from cdrj_ros.model.compiled import callee

PLACES: Final = 301
"""Angles of each joint that are tried where the angle is unknown."""

ROUNDS: Final = 3
"""Rounds of a search over several joints."""


@callee
def begin_search(joints: Unmeasured) -> None:
    """The next phase searches the angles over their ranges."""
    joints.agenda[JOINT] = joints.agenda[PLACE] = joints.agenda[ROUND] = 0
    joints.best[0] = joints.best[1] = joints.angle[joints.joints[0]]
    joints.best[2] = 1e300
    joints.angle[joints.joints[0]] = joints.lower[0]
    next_phase(joints, SEARCH, False)


@callee
def search(read: Reading, memory: Memory, joints: Unmeasured) -> None:
    """One place of a search: one joint after the other, several times if there are several.

    Among angles that explain the efforts equally well, the nearest to the one before is taken.
    The angles found are then corrected.
    """
    agenda, best = joints.agenda, joints.best
    a = agenda[JOINT]
    j, span = joints.joints[a], joints.upper[a] - joints.lower[a]
    away = (joints.angle[j] - best[0]) / span
    total = misfit(read, joints) + 1e-3 * away * away
    if agenda[SOLVED] != 0 and total < best[2]:
        best[1], best[2] = joints.angle[j], total
    agenda[PLACE] += 1
    if agenda[PLACE] < PLACES:
        joints.angle[j] = joints.lower[a] + span * (agenda[PLACE] / (PLACES - 1.0))
        return
    joints.angle[j] = best[1]
    agenda[PLACE] = 0
    agenda[JOINT] = (a + 1) % joints.joints.size
    if agenda[JOINT] == 0:
        agenda[ROUND] += 1
    if agenda[ROUND] < (1 if joints.joints.size == 1 else ROUNDS):
        j = joints.joints[agenda[JOINT]]
        best[0] = best[1] = joints.angle[j]
        best[2] = 1e300
        joints.angle[j] = joints.lower[agenda[JOINT]]
        return
    _end_search(memory, joints)


@callee
def _end_search(memory: Memory, joints: Unmeasured) -> None:
    """Nothing is known of the angles but their ranges and what the search has found."""
    aim(joints)
    for a in range(joints.joints.size):
        for b in range(joints.joints.size):
            span = joints.upper[a] - joints.lower[a]
            memory.covariance[a, b] = span * span / 12.0 if a == b else 0.0
    joints.agenda[SEARCHED] = 1
    begin_correction(memory, joints)
