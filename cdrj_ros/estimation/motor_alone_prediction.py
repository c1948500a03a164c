"""Prediction of the joints without encoder from cables and loads, (M1) of docs/motor_alone.md."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.motor_alone_correction import aim, begin_correction
from cdrj_ros.estimation.motor_alone_equations import ITERATIONS, invert, move, weigh
from cdrj_ros.estimation.motor_alone_records import (
    PREDICT,
    SOLVED,
    STEPS,
    Memory,
    Reading,
    Unmeasured,
    next_phase,
)
from cdrj_ros.model.compiled import callee, stage
from cdrj_ros.model.packing import number_views, plan_views
from cdrj_ros.model.state import ScratchViews, estimate_size, scratch_views, state_views
from cdrj_ros.model.views import part

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


@callee
def follow(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    read: Reading,
    memory: Memory,
    joints: Unmeasured,
) -> None:
    """Predict what the cables impose; if anything is known of the loads, they refine it."""
    _turn_with_cables(plan, numbers, state, read, joints)
    aim(joints)
    known = _knows_loads(joints)
    if known:
        next_phase(joints, PREDICT, True)
        joints.agenda[STEPS] = 0
    else:
        _end_prediction(memory, joints, read.dt, known)  # numba compiles it anew for a literal


@callee
def _turn_with_cables(
    plan: NDArray[np.int64], numbers: Vector, state: Vector, read: Reading, joints: Unmeasured
) -> None:
    """Move the angles as the cables would turn the joints if their elongation stayed the same.

    The change is the least-squares solution over all cables; winches and measured joints have
    moved since the state.  ``joints.out`` is that of the angles before.
    """
    joints.matrix[:] = 0.0
    joints.right[:] = 0.0
    for c in range(len(plan_views(plan).cables)):
        longer = _arms(plan, state, joints, c, joints.target)
        longer += _taken(plan, numbers, state, read, c)
        weigh(joints, joints.target, -longer, 1.0)
    most = 0.0
    for a in range(joints.joints.size):
        most = max(most, joints.matrix[a, a])
    if not most > 0.0:
        return
    for a in range(joints.joints.size):
        joints.matrix[a, a] += 1e-9 * most
    invert(joints.matrix, joints.inverse)
    move(joints)


@callee
def _taken(plan: NDArray[np.int64], numbers: Vector, state: Vector, read: Reading, c: int) -> float:
    """Cable that the drums of cable ``c`` have taken up since the state [m]."""
    parts = plan_views(plan)
    constants, before = number_views(parts.sizes, numbers), state_views(parts.sizes, state)
    taken = 0.0
    for end in range(2 * c, 2 * c + 2):
        motor, drum = parts.ends[end].motor, constants.ends[end]
        if motor >= 0:
            turned = read.motor_angle[motor] - before.angle[motor]
            taken += drum.radius * drum.winding * turned
    return taken


@callee
def _arms(
    plan: NDArray[np.int64], state: Vector, joints: Unmeasured, c: int, arms: Vector
) -> float:
    """Write by how much cable ``c`` gets longer per unit of each angle without encoder.

    Returns:
        By how much the measured joints have made it longer since the state [m].
    """
    parts = plan_views(plan)
    cable, before = parts.cables[c], state_views(parts.sizes, state)
    lever_arm = _scratch(plan, state.size, joints.out).lever_arm
    longer = 0.0
    arms[:] = 0.0
    for e in range(cable.first_element, cable.first_element + cable.elements):
        for a in range(arms.size):
            arms[a] += lever_arm[e, joints.joints[a]]
        for k in range(joints.measured.size):
            j = joints.measured[k]
            longer += lever_arm[e, j] * (joints.angle[j] - before.angle[parts.sizes.motors + j])
    return longer


@stage
def _scratch(plan: NDArray[np.int64], state_size: int, out: Vector) -> ScratchViews:
    """The scratch that ``advance`` has written."""
    sizes = plan_views(plan).sizes
    return scratch_views(sizes, part(out, state_size + estimate_size(sizes), out.size))


@callee
def _knows_loads(joints: Unmeasured) -> bool:
    """Whether anything is known of a load."""
    known = False
    for a in range(joints.joints.size):
        known |= joints.load_drift[a] > 0.0
    return known


@callee
def predict(memory: Memory, read: Reading, joints: Unmeasured) -> None:
    """A Gauss-Newton step of the prediction by the loads."""
    known = joints.agenda[SOLVED] != 0
    arrived = True
    if known:
        _weigh_prediction(joints, memory.load, read.dt)
        arrived = move(joints)
    joints.agenda[STEPS] += 1
    if arrived or joints.agenda[STEPS] == ITERATIONS:
        _end_prediction(memory, joints, read.dt, known)


@callee
def _weigh_prediction(joints: Unmeasured, load: Vector, dt: float) -> None:
    """Normal equations of a prediction, (M1): near ``target``, and with loads near ``load``."""
    for a in range(joints.joints.size):
        weight = 1.0 / (joints.wander[a] * dt)
        joints.right[a] = weight * (joints.target[a] - joints.angle[joints.joints[a]])
        for b in range(joints.joints.size):
            joints.matrix[a, b] = weight if a == b else 0.0
    for k in range(joints.joints.size):
        if joints.load_drift[k] > 0.0:
            weight = 1.0 / (joints.load_drift[k] * dt)
            weigh(joints, joints.by_load[k], load[k] - joints.load[k], weight)
    invert(joints.matrix, joints.inverse)


@callee
def _end_prediction(memory: Memory, joints: Unmeasured, dt: float, known: bool) -> None:
    """Take the present angles as predicted, widen their covariance, and prepare the correction.

    ``known`` says whether ``joints.inverse`` is the covariance of the change, or else the joint has
    wandered freely.
    """
    aim(joints)
    for a in range(joints.joints.size):
        for b in range(joints.joints.size):
            own = joints.wander[a] * dt if a == b else 0.0
            memory.covariance[a, b] += joints.inverse[a, b] if known else own
    _limit(memory.covariance, joints)
    begin_correction(memory, joints)


@callee
def _limit(covariance: Table, joints: Unmeasured) -> None:
    """Keep standard deviations within those of an angle that is only known to be in its range."""
    for a in range(joints.joints.size):
        most = (joints.upper[a] - joints.lower[a]) ** 2 / 12.0
        if covariance[a, a] > most:
            share = sqrt(most / covariance[a, a])
            for b in range(joints.joints.size):
                covariance[a, b] *= share
                covariance[b, a] *= share
