"""One sample of a robot with joints without encoder: phases of evaluations until it is solved."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.motor_alone_correction import correct, misfit
from cdrj_ros.estimation.motor_alone_evaluation import evaluate
from cdrj_ros.estimation.motor_alone_prediction import follow, predict
from cdrj_ros.estimation.motor_alone_records import (
    CORRECT,
    DONE,
    FINAL,
    FOLLOW,
    PHASE,
    PREDICT,
    SEARCH,
    SEARCHED,
    Alone,
    Memory,
    Reading,
    Unmeasured,
    memory_of,
    next_phase,
)
from cdrj_ros.estimation.motor_alone_search import begin_search, search
from cdrj_ros.model.compiled import callee, stage
from cdrj_ros.model.friction_history import impose_friction
from cdrj_ros.model.packing import plan_views
from cdrj_ros.model.state import estimate_size, state_views
from cdrj_ros.model.views import copy_part, part

Vector = NDArray[np.float64]

LOST: Final = 5.0
"""A difference between measured and estimated effort above this multiple of the effort's standard
deviation means that the joint is lost,"""

LOST_FOR: Final = 0.05
"""if it lasts this long [s]; its angle is then searched over the whole range."""


@stage
def solve(plan: NDArray[np.int64], alone: Alone, row: int, stamp: int) -> None:
    """Find the angles of one sample with the numbers and the history of one row.

    Args:
        plan: of the prepared robot.
        alone: the estimate and its ensemble, with the readings of the sample; the row is changed.
        row: 0 for the estimate, or a member.
        stamp: of the sample [ns].
    """
    joints, state, numbers = alone.joints, alone.states[row], alone.numbers[row]
    memory = memory_of(alone.memories[row], joints.joints.size)
    dt = (stamp - alone.stamps[row]) * 1e-9 if memory.started[0] != 0.0 else 0.0
    read = Reading(alone.motor_angle, alone.measured_angle, alone.motor_effort, dt)
    _begin(state, read, memory, joints)
    while joints.agenda[PHASE] != DONE:
        if not evaluate(plan, numbers, state, read, joints, alone.shifted):
            continue
        phase = joints.agenda[PHASE]
        if phase == FOLLOW:
            follow(plan, numbers, state, read, memory, joints)
        elif phase == PREDICT:
            predict(memory, read, joints)
        elif phase == CORRECT:
            correct(memory, read, joints)
        elif phase == SEARCH:
            search(read, memory, joints)
        else:
            _end(plan, numbers, state, alone.shares[row], read, memory, joints)
    alone.stamps[row] = stamp


@callee
def _begin(state: Vector, read: Reading, memory: Memory, joints: Unmeasured) -> None:
    """Prepare the solution of one sample."""
    joints.agenda[:] = 0
    for k in range(joints.measured.size):
        joints.angle[joints.measured[k]] = read.measured_angle[k]
    started = memory.started[0] != 0.0
    for a in range(joints.joints.size):
        joints.angle[joints.joints[a]] = memory.angle[a] if started else joints.start[a]
    if not started:
        state[:] = 0.0
        begin_search(joints)
    else:
        next_phase(joints, FOLLOW if read.dt > 0.0 else FINAL, False)


@callee
def _end(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    share: Vector,
    read: Reading,
    memory: Memory,
    joints: Unmeasured,
) -> None:
    """Accept a solution, or search: for the angle of a lost joint, or again with friction."""
    searched, sizes = joints.agenda[SEARCHED] != 0, plan_views(plan).sizes
    if memory.started[0] == 0.0 and state_views(sizes, state).started[0] == 0.0:
        if state_views(sizes, joints.out).started[0] == 0.0:  # no such pose
            joints.agenda[PHASE] = DONE
            return
        copy_part(joints.out, 0, state)
        begin = state.size + estimate_size(sizes)
        impose_friction(plan, numbers, share, state, part(joints.out, begin, joints.out.size))
        begin_search(joints)
        return
    unexplained = misfit(read, joints) > LOST * LOST * read.effort.size
    memory.lost[0] = memory.lost[0] + read.dt if unexplained and not searched else 0.0
    if memory.lost[0] > LOST_FOR:
        memory.lost[0] = 0.0
        begin_search(joints)
        return
    memory.started[0] = 1.0
    copy_part(joints.out, 0, state)
    for a in range(joints.joints.size):
        memory.angle[a] = joints.angle[joints.joints[a]]
        memory.load[a] = joints.load[a]
    joints.agenda[PHASE] = DONE
