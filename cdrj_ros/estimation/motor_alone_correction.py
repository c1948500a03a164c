"""Correction of the joints without encoder by the measured efforts, (M2) of docs/motor_alone.md."""

from __future__ import annotations

from math import isfinite
from typing import Final

from cdrj_ros.estimation.motor_alone_equations import ITERATIONS, invert, move, weigh
from cdrj_ros.estimation.motor_alone_records import (
    CORRECT,
    FINAL,
    SOLVED,
    STEPS,
    Memory,
    Reading,
    Unmeasured,
    next_phase,
)
from cdrj_ros.model.compiled import callee

CORRELATED: Final = 0.05
"""Time over which the error of an effort persists [s]; errors further apart are independent."""


@callee
def aim(joints: Unmeasured) -> None:
    """Make the present angles the predicted ones."""
    for a in range(joints.joints.size):
        joints.target[a] = joints.angle[joints.joints[a]]


@callee
def begin_correction(memory: Memory, joints: Unmeasured) -> None:
    """The next phase corrects the angles around ``joints.target``."""
    for a in range(joints.joints.size):
        for b in range(joints.joints.size):
            joints.matrix[a, b] = memory.covariance[a, b]
    invert(joints.matrix, joints.information)
    next_phase(joints, CORRECT, True)
    joints.agenda[STEPS] = 0


@callee
def correct(memory: Memory, read: Reading, joints: Unmeasured) -> None:
    """A Gauss-Newton step of the correction by the efforts."""
    arrived = True
    if joints.agenda[SOLVED] != 0:
        _weigh_correction(joints, read)
        arrived = move(joints)
        for a in range(joints.joints.size):
            for b in range(joints.joints.size):
                memory.covariance[a, b] = joints.inverse[a, b]
    joints.agenda[STEPS] += 1
    if arrived or joints.agenda[STEPS] == ITERATIONS:
        next_phase(joints, FINAL, False)


@callee
def _weigh_correction(joints: Unmeasured, read: Reading) -> None:
    """Normal equations of a correction, (M2): near ``target``, and with the measured efforts.

    At the start ``read.dt`` is 0, and the efforts count as independent of earlier ones.
    """
    independent = min(read.dt / CORRELATED, 1.0) if read.dt > 0.0 else 1.0
    for a in range(joints.joints.size):
        joints.right[a] = 0.0
        for b in range(joints.joints.size):
            away = joints.target[b] - joints.angle[joints.joints[b]]
            joints.right[a] += joints.information[a, b] * away
            joints.matrix[a, b] = joints.information[a, b]
    for m in range(read.effort.size):
        if isfinite(read.effort[m]):
            weight = independent / joints.noise[m] ** 2
            weigh(joints, joints.by_effort[m], read.effort[m] - joints.effort[m], weight)
    invert(joints.matrix, joints.inverse)


@callee
def misfit(read: Reading, joints: Unmeasured) -> float:
    """Sum of the squared differences of measured and estimated efforts, in standard deviations."""
    total = 0.0
    for m in range(read.effort.size):
        if isfinite(read.effort[m]):
            total += ((read.effort[m] - joints.effort[m]) / joints.noise[m]) ** 2
    return total
