"""One sample of a whole robot, compiled: geometry, friction bounds, every cable, all outputs.

Few flat arrays (``cdrj_ros.model.packing``) make the call cheap; nothing is allocated per sample.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.cable import (
    BEARING_RATIO,
    BRISTLE,
    BRISTLE_BEFORE,
    CELLS,
    ELEMENT_COLUMNS,
    LENGTH,
    LENGTH_BEFORE,
    LOSS,
    MATERIAL,
    MATERIAL_BEFORE,
    MU_C,
    MU_S,
    PULLEY_COLUMNS,
    RHO,
    SLIP,
    STATIC_SHARE,
    STRIBECK_LAG,
    STRIBECK_SPEED,
    TENSION,
    WORK_COLUMNS,
    acceptable,
    element_tension,
    solve_cable,
)
from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.drum import MEMORY_SIZE, material_held, start_drum, turn_drum
from cdrj_ros.model.friction import blended_loss, stribeck_share
from cdrj_ros.model.geometry import POSE_NUMBERS
from cdrj_ros.model.outputs import passive_torque, report_cable
from cdrj_ros.model.packing import (
    AT_CABLES,
    AT_PULLEYS,
    AXIAL_STIFFNESS,
    AXIS_COLUMNS,
    CABLE_INDICES,
    CABLE_NUMBERS,
    CABLES,
    EFFORT_SIGN,
    ELEMENT_COUNT,
    ELEMENTS,
    FIRST_ELEMENT,
    FIRST_MOTOR,
    FIRST_RADIUS,
    FIRST_WINDING,
    FRAMES,
    IN_AXES,
    IN_CABLES,
    IN_LOSSES,
    IN_MATERIAL,
    IN_MOTORS,
    IN_PULLEYS,
    JOINTS,
    LAW,
    MOTOR_COLUMNS,
    MOTOR_REFERENCE,
    MOTORS,
    PULLEYS,
    STARTED,
    WOUND_TENSION,
    estimate_size,
    scratch_size,
)
from cdrj_ros.model.shape import shape
from cdrj_ros.model.status import INVALID

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def friction_losses(
    plan: Indices, numbers: Vector, wrap: Vector, lagged_speed: Vector, work: Table
) -> None:
    """(37), (41) and their blend for every pulley; wraps that never change cost nothing.

    Static friction fades with the slip speed as it was, lagging by ``STRIBECK_LAG`` (frictional
    memory).  The speed of the sample itself would make friction fall while the cable slips, so
    that a massless cable has several solutions or none: it would jump from sample to sample.
    """
    for p in range(plan[PULLEYS]):
        row = plan[AT_PULLEYS] + p * 2
        at = plan[IN_PULLEYS] + p * PULLEY_COLUMNS
        if plan[row + 1] < 0:  # the wrap never changes
            kinetic = numbers[plan[IN_LOSSES] + 2 * p]
            static = numbers[plan[IN_LOSSES] + 2 * p + 1]
        else:
            kinetic, static = blended_loss(
                numbers[at + RHO],
                numbers[at + MU_C],
                numbers[at + MU_S],
                wrap[p],
                numbers[at + BEARING_RATIO],
                plan[row + 1],
                numbers[at + CELLS],
            )
        share = stribeck_share(lagged_speed[p], numbers[at + STRIBECK_SPEED])
        work[p, STATIC_SHARE] = share
        work[p, LOSS] = kinetic + static * share


@compiled
def _wound_angle(numbers: Vector, plan: Indices, motor: int, winding: float, angle: float) -> float:
    """Drum angle from the reference, positive winding in [rad]."""
    return winding * (angle - numbers[plan[IN_MOTORS] + motor * MOTOR_COLUMNS + MOTOR_REFERENCE])


@compiled
def _start_cable(
    plan: Indices,
    numbers: Vector,
    c: int,
    motor_angle: Vector,
    length: Vector,
    material: Vector,
    tension: Vector,
    drums: Vector,
) -> None:
    """A cable without friction history: one tension throughout, set by the material it has."""
    row = plan[AT_CABLES] + c * CABLE_INDICES
    first, count = plan[row + FIRST_ELEMENT], plan[row + ELEMENT_COUNT]
    at = plan[IN_CABLES] + c * CABLE_NUMBERS
    # what lies on the drum when nothing is known of how it got there
    stretch = 1.0 + numbers[at + WOUND_TENSION] / numbers[at + AXIAL_STIFFNESS]
    total = 0.0
    span = 0.0
    for e in range(first, first + count):
        total += numbers[plan[IN_MATERIAL] + e]
        span += length[e]
    for end in range(2):
        motor = plan[row + FIRST_MOTOR + end]
        if motor >= 0:
            rate = numbers[at + FIRST_RADIUS + 2 * end] / stretch
            winding = numbers[at + FIRST_WINDING + 2 * end]
            angle = _wound_angle(numbers, plan, motor, winding, motor_angle[motor])
            memory = (2 * c + end) * MEMORY_SIZE
            start_drum(drums[memory : memory + MEMORY_SIZE], angle, rate * angle, rate)
            total -= rate * angle
    for e in range(first, first + count):
        material[e] = length[e] * (total / span)
        tension[e] = element_tension(numbers[at + AXIAL_STIFFNESS], length[e], material[e])


@compiled
def _spread_evenly(axial_stiffness: float, elements: Table, entered: float) -> None:
    """What is certain of a cable whose slips were not solved: its elongation as a whole."""
    total = entered
    span = 0.0
    for e in range(elements.shape[0]):
        total += elements[e, MATERIAL_BEFORE]
        span += elements[e, LENGTH]
    for e in range(elements.shape[0]):
        elements[e, MATERIAL] = elements[e, LENGTH] * (total / span)
        elements[e, TENSION] = element_tension(
            axial_stiffness, elements[e, LENGTH], elements[e, MATERIAL]
        )


@compiled
def _turn_drums(
    plan: Indices,
    numbers: Vector,
    c: int,
    motor_angle: Vector,
    first_stretch: float,
    last_stretch: float,
    drums: Vector,
) -> tuple[float, float]:
    """Material [m] that the winches push in at the first and draw out at the last node."""
    row = plan[AT_CABLES] + c * CABLE_INDICES
    at = plan[IN_CABLES] + c * CABLE_NUMBERS
    slips = (0.0, 0.0)
    for end in range(2):
        motor = plan[row + FIRST_MOTOR + end]
        if motor < 0:
            continue
        winding = numbers[at + FIRST_WINDING + 2 * end]
        stretch = max(first_stretch if end == 0 else last_stretch, 1.0)
        memory = (2 * c + end) * MEMORY_SIZE
        drum = drums[memory : memory + MEMORY_SIZE]
        held = material_held(drum)
        angle = _wound_angle(numbers, plan, motor, winding, motor_angle[motor])
        wound = turn_drum(drum, angle, numbers[at + FIRST_RADIUS + 2 * end] / stretch)
        slips = (held - wound, slips[1]) if end == 0 else (slips[0], wound - held)
    return slips


@compiled
def _refuse(plan: Indices, before: Vector, out: Vector) -> None:
    """Leave the state as it was and mark every element ``INVALID``; no force is made up."""
    size, elements = before.size, plan[ELEMENTS]
    out[:size] = before
    out[size : size + estimate_size(plan)] = 0.0
    out[size + elements : size + 2 * elements] = INVALID


@compiled
def advance(
    plan: Indices,
    numbers: Vector,
    before: Vector,
    motor_angle: Vector,
    joint_angle: Vector,
    dt: float,
    out: Vector,
) -> bool:
    """One sample of the robot: (state, angles) -> (state, estimate).

    Args:
        plan, numbers: the prepared robot.
        before: state, shape (state_size,); not changed.
        motor_angle, joint_angle: encoder readings [rad], in the robot's order.
        dt: time since the state [s]; 0 for the first sample or where it is unknown.
        out: new state, estimate and scratch, shape (state + estimate + scratch,), written.

    Returns:
        False where the geometry is impossible at these joint angles (the state is then kept) or
        the slips of some cable could not be solved; the elements concerned are ``INVALID``.
    """
    elements, pulleys, cables = plan[ELEMENTS], plan[PULLEYS], plan[CABLES]
    motors, joints, frames = plan[MOTORS], plan[JOINTS], plan[FRAMES]

    # the state
    length_before, length = before[1 : 1 + elements], out[1 : 1 + elements]
    n = 1 + elements
    material_before, material = before[n : n + elements], out[n : n + elements]
    n += elements
    bristle_before, bristle = before[n : n + pulleys], out[n : n + pulleys]
    n += pulleys
    speed_before, speed = before[n : n + pulleys], out[n : n + pulleys]
    n += pulleys
    lagged_before, lagged = before[n : n + pulleys], out[n : n + pulleys]
    n += pulleys
    axes = motors + joints
    angle_before, angle_now = before[n : n + axes], out[n : n + axes]
    n += axes
    bearing_before, bearing = before[n : n + axes], out[n : n + axes]
    n += axes
    drums = out[n : n + 2 * cables * MEMORY_SIZE]
    for k in range(n, n + 2 * cables * MEMORY_SIZE):
        out[k] = before[k]
    n += 2 * cables * MEMORY_SIZE
    # the estimate
    tension = out[n : n + elements]
    n += elements
    status = out[n : n + elements]
    n += elements
    force = out[n : n + 5 * pulleys].reshape(5, pulleys)
    n += 5 * pulleys
    motor_effort = out[n : n + motors]
    n += motors
    joint_effort = out[n : n + joints]
    n += joints
    iterations = out[n : n + cables]
    n += cables
    residual = out[n : n + cables]
    n += cables
    # scratch
    length_by_joint = out[n : n + elements * joints].reshape(elements, joints)
    n += elements * joints
    direction = out[n : n + 2 * elements].reshape(elements, 2)
    n += 2 * elements
    wrap = out[n : n + pulleys]
    n += pulleys
    element_rows = out[n : n + elements * ELEMENT_COLUMNS].reshape(elements, ELEMENT_COLUMNS)
    n += elements * ELEMENT_COLUMNS
    work = out[n : n + pulleys * WORK_COLUMNS].reshape(pulleys, WORK_COLUMNS)
    n += pulleys * WORK_COLUMNS
    pose = out[n : n + frames * POSE_NUMBERS].reshape(frames, POSE_NUMBERS)
    n += frames * POSE_NUMBERS
    twist = out[n : n + frames * joints * 3].reshape(frames, joints, 3)

    possible = shape(
        plan, numbers, joint_angle, length, length_by_joint, wrap, direction, pose, twist
    )
    if not possible:
        _refuse(plan, before, out)
        return False
    started = before[STARTED] != 0.0
    out[STARTED] = 1.0
    friction_losses(plan, numbers, wrap, lagged_before, work)
    at = plan[IN_PULLEYS]
    constants = numbers[at : at + pulleys * PULLEY_COLUMNS].reshape(pulleys, PULLEY_COLUMNS)
    for m in range(motors):
        motor_effort[m] = 0.0
    for j in range(joints):
        joint_effort[j] = 0.0

    solved_all = True
    for c in range(cables):
        row = plan[AT_CABLES] + c * CABLE_INDICES
        first = plan[row + FIRST_ELEMENT]
        last = first + plan[row + ELEMENT_COUNT]
        p, q = first - c, last - c - 1
        at = plan[IN_CABLES] + c * CABLE_NUMBERS
        stiffness = numbers[at + AXIAL_STIFFNESS]
        solved = True
        if started:
            first_slip, last_slip = _turn_drums(
                plan, numbers, c, motor_angle,
                length_before[first] / material_before[first],
                length_before[last - 1] / material_before[last - 1],
                drums,
            )  # fmt: skip
            for e in range(first, last):
                element_rows[e, LENGTH_BEFORE] = length_before[e]
                element_rows[e, LENGTH] = length[e]
                element_rows[e, MATERIAL_BEFORE] = material_before[e]
            for i in range(p, q):
                work[i, SLIP] = speed_before[i] * dt
                work[i, BRISTLE_BEFORE] = bristle_before[i]
                work[i, BRISTLE] = 0.0
            rows = element_rows[first:last]
            iterations[c], worst = solve_cable(
                stiffness, rows, work[p:q], constants[p:q], first_slip, last_slip,
                plan[row + LAW], dt,
            )  # fmt: skip
            residual[c] = worst
            solved = bool(worst <= acceptable(stiffness) and np.min(rows[:, MATERIAL]) > 0.0)
            if not solved:
                solved_all = False
                _spread_evenly(stiffness, rows, first_slip - last_slip)
                for i in range(p, q):
                    work[i, BRISTLE], work[i, SLIP] = 0.0, 0.0
            for e in range(first, last):
                material[e] = element_rows[e, MATERIAL]
                tension[e] = element_rows[e, TENSION]
            for i in range(p, q):
                bristle[i] = work[i, BRISTLE]
                speed[i] = work[i, SLIP] / dt if dt > 0.0 else 0.0
                lag = constants[i, STRIBECK_LAG]
                lagged[i] = (lag * lagged_before[i] + dt * speed[i]) / (lag + dt)
        else:
            _start_cable(plan, numbers, c, motor_angle, length, material, tension, drums)
            solved = material[first] > 0.0  # a cable cannot be wound in entirely
            solved_all &= solved
            bristle[p:q], speed[p:q], lagged[p:q] = 0.0, 0.0, 0.0
            iterations[c], residual[c] = 0.0, 0.0

        report_cable(
            plan, numbers, c, solved, tension, wrap, direction, speed, length_by_joint,
            status, force, motor_effort, joint_effort,
        )  # fmt: skip
    for a in range(axes):
        at = plan[IN_AXES] + a * AXIS_COLUMNS
        angle = motor_angle[a] if a < motors else joint_angle[a - motors]
        turned = angle - angle_before[a] if started else 0.0
        torque, bearing[a] = passive_torque(numbers, at, bearing_before[a], turned, angle)
        angle_now[a] = angle
        if a < motors:
            motor_effort[a] = numbers[at + EFFORT_SIGN] * (motor_effort[a] + torque)
        else:
            joint_effort[a - motors] = numbers[at + EFFORT_SIGN] * (
                joint_effort[a - motors] + torque
            )
    return solved_all


@compiled
def advance_all(
    plan: Indices,
    numbers: Vector,
    state: Vector,
    motor_angles: Table,
    joint_angles: Table,
    dt: Vector,
    estimates: Table,
) -> None:
    """``advance`` over many samples, the very same function, without returning to Python.

    Args:
        plan, numbers: the prepared robot.
        state: shape (state_size,), replaced by the last one.
        motor_angles, joint_angles: [rad], shapes (samples, motors) and (samples, joints).
        dt: time since the sample before [s], shape (samples,).
        estimates: shape (samples, estimate_size), written.
    """
    size = state.size
    wanted = estimates.shape[1]
    out = np.empty(size + wanted + scratch_size(plan))
    for k in range(dt.size):
        advance(plan, numbers, state, motor_angles[k], joint_angles[k], dt[k], out)
        state[:] = out[:size]
        estimates[k] = out[size : size + wanted]
