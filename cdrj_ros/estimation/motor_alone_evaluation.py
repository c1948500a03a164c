"""Efforts and loads at trial angles of the joints without encoder, and their derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.motor_alone_records import SHIFT, SLOPES, SOLVED, Reading, Unmeasured
from cdrj_ros.model.compiled import callee, stage
from cdrj_ros.model.mechanism import advance_robot
from cdrj_ros.model.packing import plan_views
from cdrj_ros.model.state import EstimateViews, estimate_size, estimate_views
from cdrj_ros.model.views import copy_part, part

Vector = NDArray[np.float64]


@stage
def evaluate(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    read: Reading,
    joints: Unmeasured,
    shifted: Vector,
) -> bool:
    """Evaluate the robot at the present angles, or at the next shifted ones for derivatives.

    Args:
        plan: of the prepared robot.
        numbers: of the prepared robot.
        state: of the robot at the sample before.
        read: the readings.
        joints: the joints, into whose scratch the results are written.
        shifted: scratch, shape (1,).

    Returns:
        Whether the phase has all evaluations that it needs.
    """
    j = joints.joints[joints.agenda[SHIFT] % joints.joints.size]
    shifted[0] = joints.angle[j]
    _shift(joints)
    solved = advance_robot(
        plan, numbers, state, read.motor_angle, joints.angle, read.dt, joints.out
    )
    return not _collect(plan, state, joints, shifted, solved)


@callee
def _shift(joints: Unmeasured) -> None:
    """Shift the angle by which the next derivative is taken."""
    a = joints.agenda[SHIFT]
    if joints.agenda[SLOPES] != 0 and a < joints.joints.size:
        joints.angle[joints.joints[a]] += joints.step[a]


@callee
def _collect(
    plan: NDArray[np.int64], state: Vector, joints: Unmeasured, before: Vector, solved: bool
) -> bool:
    """Take the efforts and loads of an evaluation; whether the phase needs another one.

    For derivatives every angle is shifted in turn; the last evaluation is at the angles themselves.
    ``before`` holds the angle that was shifted.
    """
    agenda, count, a = joints.agenda, joints.joints.size, joints.agenda[SHIFT]
    if a == 0:
        agenda[SOLVED] = 1
    if not solved:
        agenda[SOLVED] = 0
    estimate = _estimate(plan, state.size, joints.out)
    copy_part(estimate.motor_effort, 0, joints.effort)
    for b in range(count):
        joints.load[b] = estimate.joint_effort[joints.joints[b]]
    if agenda[SLOPES] == 0:
        return False
    if a == count:
        agenda[SHIFT] = 0
        _divide(joints)
        return False
    joints.angle[joints.joints[a]] = before[0]
    for m in range(joints.effort.size):
        joints.by_effort[m, a] = joints.effort[m]
    for b in range(count):
        joints.by_load[b, a] = joints.load[b]
    agenda[SHIFT] = a + 1
    return True


@callee
def _divide(joints: Unmeasured) -> None:
    """Turn shifted efforts and loads into derivatives."""
    for a in range(joints.joints.size):
        for m in range(joints.effort.size):
            joints.by_effort[m, a] = (joints.by_effort[m, a] - joints.effort[m]) / joints.step[a]
        for b in range(joints.joints.size):
            joints.by_load[b, a] = (joints.by_load[b, a] - joints.load[b]) / joints.step[a]


@stage
def _estimate(plan: NDArray[np.int64], state_size: int, out: Vector) -> EstimateViews:
    """The estimate that ``advance`` has written."""
    sizes = plan_views(plan).sizes
    return estimate_views(sizes, part(out, state_size, state_size + estimate_size(sizes)))
