"""One sample of a whole robot, compiled: geometry, friction bounds, every cable, all outputs.

The robot is prepared once (``cdrj_ros.model.plan``) as two flat arrays, ``plan`` (integers) and
``numbers`` (reals): few arguments make the call cheap, and nothing is allocated per sample.  The
header of ``plan`` says where each block lies.
"""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.cable import (
    BEARING_RATIO,
    BRISTLE,
    BRISTLE_BEFORE,
    CELLS,
    DRAG,
    ELEMENT_COLUMNS,
    LENGTH,
    LENGTH_BEFORE,
    LOSS,
    MATERIAL,
    MATERIAL_BEFORE,
    MU_C,
    MU_S,
    PULLEY_COLUMNS,
    RADIUS,
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
from cdrj_ros.model.friction import NONE, blended_loss, stribeck_share
from cdrj_ros.model.geometry import (
    FRAME_INDICES,
    FRAME_NUMBERS,
    NODE_INDICES,
    NODE_NUMBERS,
    POSE_NUMBERS,
    TABLE_INTERVALS,
    place_frames,
    route,
    table_value,
)

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Indices = NDArray[np.int64]

# Status of an element, bit flags; the same values stand in cdrj_msgs/CableTensions.
OK, SLACK, OVERLOAD, UNSURE, STALE, INVALID = 0, 1, 2, 4, 8, 16

# Header of ``plan``: sizes, then where each block begins in ``plan`` (AT_*) or ``numbers`` (IN_*).
(
    MOTORS,
    JOINTS,
    CABLES,
    ELEMENTS,
    PULLEYS,
    FRAMES,
    TERMS,
    AT_CABLES,
    AT_PULLEYS,
    AT_FRAMES,
    AT_NODES,
    AT_TERMS,
    IN_CABLES,
    IN_PULLEYS,
    IN_SPANS,
    IN_MATERIAL,
    IN_WRAPS,
    IN_LOSSES,
    IN_HALVES,
    IN_FRAMES,
    IN_NODES,
    IN_MOTORS,
    IN_JOINTS,
    IN_AXES,
    IN_TABLES,
    HEADER,
) = range(26)

# Integer columns of a cable; first_motor and last_motor are -1 where the end is an anchor.
(
    FIRST_ELEMENT,
    ELEMENT_COUNT,
    FIRST_MOTOR,
    LAST_MOTOR,
    LAW,
    STRIBECK,
    ROUTED,
    CABLE_INDICES,
) = range(8)

# Real columns of a cable.
(
    AXIAL_STIFFNESS,
    PRELOAD,
    MAXIMUM_TENSION,
    FIRST_RADIUS,
    FIRST_WINDING,
    LAST_RADIUS,
    LAST_WINDING,
    WOUND_TENSION,
    SLACK_TENSION,
    CABLE_NUMBERS,
) = range(10)

# A term adds a tabulated function of one joint to a span or a wrap.
TARGET, TARGET_INDEX, TERM_JOINT, TERM_TABLE, TERM_COLUMNS = range(5)
SPAN, WRAP = 0, 1

# Rows of motors and joints.
MOTOR_REFERENCE, MOTOR_COLUMNS = range(2)
TABLE_LOW, TABLE_STEP, JOINT_COLUMNS = range(3)

# Rows of axes: all motors, then all joints.
(
    EFFORT_SIGN,
    BEARING_TORQUE,
    BEARING_STIFFNESS,
    SPRING_STIFFNESS,
    SPRING_REST,
    AXIS_COLUMNS,
) = range(6)

STARTED: Final = 0
"""Place of the flag in the state that says whether a first sample has been seen."""


@compiled
def state_size(plan: Indices) -> int:
    """Floats of the state.

    In this order: the flag ``STARTED``, length and material of every element, bristle force, slip
    speed and lagged slip speed of every pulley, angle and bearing friction of every axis, the
    drums of both ends of every cable.
    """
    return (
        1
        + 2 * plan[ELEMENTS]
        + 3 * plan[PULLEYS]
        + 2 * (plan[MOTORS] + plan[JOINTS])
        + 2 * plan[CABLES] * MEMORY_SIZE
    )


@compiled
def estimate_size(plan: Indices) -> int:
    """Floats of the estimate, in the order of ``cdrj_ros.model.plan.Layout``."""
    return 2 * plan[ELEMENTS] + 5 * plan[PULLEYS] + plan[MOTORS] + plan[JOINTS] + 2 * plan[CABLES]


@compiled
def scratch_size(plan: Indices) -> int:
    """Floats of the scratch space behind state and estimate."""
    elements, pulleys, joints = plan[ELEMENTS], plan[PULLEYS], plan[JOINTS]
    return (
        elements * (joints + 2 + ELEMENT_COLUMNS)
        + pulleys * (1 + WORK_COLUMNS)
        + plan[FRAMES] * (POSE_NUMBERS + 3 * joints)
    )


@compiled
def _tabulated_shape(
    plan: Indices,
    numbers: Vector,
    joint_angle: Vector,
    length: Vector,
    length_by_joint: Table,
    wrap: Vector,
) -> None:
    """Spans and wraps from constants and tables over joint angle, arcs not yet added."""
    elements, pulleys = plan[ELEMENTS], plan[PULLEYS]
    at = plan[IN_SPANS]
    for e in range(elements):
        length[e] = numbers[at + e]
    at = plan[IN_WRAPS]
    for p in range(pulleys):
        wrap[p] = numbers[at + p]
    length_by_joint[:] = 0.0
    for term in range(plan[TERMS]):
        row = plan[AT_TERMS] + term * TERM_COLUMNS
        joint = plan[row + TERM_JOINT]
        grid = plan[IN_JOINTS] + joint * JOINT_COLUMNS
        step = numbers[grid + TABLE_STEP]
        position = (joint_angle[joint] - numbers[grid + TABLE_LOW]) / step
        interval = min(max(int(position), 0), TABLE_INTERVALS - 1)
        base = plan[IN_TABLES] + (plan[row + TERM_TABLE] * TABLE_INTERVALS + interval) * 4
        value, slope = table_value(numbers, base, position - interval)
        target = plan[row + TARGET_INDEX]
        if plan[row + TARGET] == SPAN:
            length[target] += value
            length_by_joint[target, joint] += slope / step
        else:
            # half of the arc belongs to either neighbour; pulley p of cable c lies between
            # elements p + c and p + c + 1, which the plan stores as the pulley's element
            wrap[target] += value
            radius = numbers[plan[IN_PULLEYS] + target * PULLEY_COLUMNS + RADIUS]
            half = 0.5 * radius * slope / step
            element = plan[plan[AT_PULLEYS] + target * 2]
            length_by_joint[element, joint] += half
            length_by_joint[element + 1, joint] += half


@compiled
def shape(
    plan: Indices,
    numbers: Vector,
    joint_angle: Vector,
    length: Vector,
    length_by_joint: Table,
    wrap: Vector,
    direction: Table,
    pose: Table,
    twist: NDArray[np.float64],
) -> bool:
    """Geometry of all cables at the joint angles; False where a cable cannot run so.

    Args:
        plan, numbers: the prepared robot.
        joint_angle: [rad] or [m], shape (joints,).
        length: of every element, arcs included [m], shape (elements,), written.
        length_by_joint: its derivatives, shape (elements, joints), written.
        wrap: of every pulley [rad], shape (pulleys,), written.
        direction: unit vectors of routed elements in the base frame, shape (elements, 2), written.
        pose, twist: frames, see ``place_frames``, written.
    """
    possible = True
    cables = plan[CABLES]
    _tabulated_shape(plan, numbers, joint_angle, length, length_by_joint, wrap)
    frames = plan[FRAMES]
    if frames > 0:
        at, inside = plan[AT_FRAMES], plan[IN_FRAMES]
        place_frames(
            plan[at : at + frames * FRAME_INDICES].reshape(frames, FRAME_INDICES),
            numbers[inside : inside + frames * FRAME_NUMBERS].reshape(frames, FRAME_NUMBERS),
            joint_angle,
            pose,
            twist,
        )
    node = 0
    for c in range(cables):
        row = plan[AT_CABLES] + c * CABLE_INDICES
        first = plan[row + FIRST_ELEMENT]
        count = plan[row + ELEMENT_COUNT]
        pulley = first - c
        if plan[row + ROUTED] == 1:
            at = plan[AT_NODES] + node * NODE_INDICES
            inside = plan[IN_NODES] + node * NODE_NUMBERS
            nodes = count + 1
            possible &= route(
                plan[at : at + nodes * NODE_INDICES].reshape(nodes, NODE_INDICES),
                numbers[inside : inside + nodes * NODE_NUMBERS].reshape(nodes, NODE_NUMBERS),
                pose,
                twist,
                length[first : first + count],
                length_by_joint[first : first + count],
                wrap[pulley : pulley + count - 1],
                direction[first : first + count],
            )
        else:
            for p in range(count - 1):
                radius = numbers[plan[IN_PULLEYS] + (pulley + p) * PULLEY_COLUMNS + RADIUS]
                half = 0.5 * radius * wrap[pulley + p]
                length[first + p] += half
                length[first + p + 1] += half
        node += count + 1
    return possible


@compiled
def _friction_losses(
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
def _report_cable(
    plan: Indices,
    numbers: Vector,
    c: int,
    solved: bool,
    tension: Vector,
    wrap: Vector,
    direction: Table,
    speed: Vector,
    length_by_joint: Table,
    status: Vector,
    force: Table,
    motor_effort: Vector,
    joint_effort: Vector,
) -> None:
    """From one cable's tensions to status, nodal forces and its share of the efforts."""
    row = plan[AT_CABLES] + c * CABLE_INDICES
    at = plan[IN_CABLES] + c * CABLE_NUMBERS
    first = plan[row + FIRST_ELEMENT]
    last = first + plan[row + ELEMENT_COUNT]
    most = numbers[at + MAXIMUM_TENSION]
    least = numbers[at + SLACK_TENSION]
    for e in range(first, last):
        t = tension[e]
        flag = OK if solved else INVALID
        if t <= least:
            flag |= SLACK
        if t > most:
            flag |= OVERLOAD
        status[e] = flag
        for j in range(joint_effort.size):
            joint_effort[j] -= t * length_by_joint[e, j]  # virtual work
    for end in range(2):
        motor = plan[row + FIRST_MOTOR + end]
        if motor >= 0:
            arm = numbers[at + FIRST_WINDING + 2 * end] * numbers[at + FIRST_RADIUS + 2 * end]
            motor_effort[motor] -= arm * (tension[first] if end == 0 else tension[last - 1])
    routed = plan[row + ROUTED] == 1
    for i in range(first - c, last - c - 1):
        e = i + c
        t_in, t_out = tension[e], tension[e + 1]
        if routed:
            x = t_out * direction[e + 1, 0] - t_in * direction[e, 0]
            y = t_out * direction[e + 1, 1] - t_in * direction[e, 1]
        else:
            if plan[plan[AT_PULLEYS] + 2 * i + 1] < 0:  # the wrap never changes
                along = numbers[plan[IN_HALVES] + 2 * i]
                across = numbers[plan[IN_HALVES] + 2 * i + 1]
            else:
                along, across = sin(0.5 * wrap[i]), cos(0.5 * wrap[i])
            x = (t_out + t_in) * along
            y = (t_out - t_in) * across
        force[0, i] = x
        force[1, i] = y
        force[2, i] = sqrt(x * x + y * y)  # (38)
        force[3, i] = t_out - t_in
        force[4, i] = speed[i]
    if not solved:  # how the elongation is shared out is not known: say so, and no number
        tension[first:last] = 0.0
        force[:, first - c : last - c - 1] = 0.0


@compiled
def _passive_torque(
    numbers: Vector, at: int, friction_before: float, turned: float, angle: float
) -> tuple[float, float]:
    """Torque of an axis beside its cables and the friction in it [N m], (E13).

    Args:
        numbers: the prepared robot.
        at: the axis' row.
        friction_before: of its bearing [N m].
        turned: since then [rad].
        angle: now [rad].
    """
    most = numbers[at + BEARING_TORQUE]
    friction = friction_before + numbers[at + BEARING_STIFFNESS] * turned
    friction = min(max(friction, -most), most)
    return -friction - numbers[at + SPRING_STIFFNESS] * (
        angle - numbers[at + SPRING_REST]
    ), friction


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
    _friction_losses(plan, numbers, wrap, lagged_before, work)
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

        _report_cable(
            plan, numbers, c, solved, tension, wrap, direction, speed, length_by_joint,
            status, force, motor_effort, joint_effort,
        )  # fmt: skip
    for a in range(axes):
        at = plan[IN_AXES] + a * AXIS_COLUMNS
        angle = motor_angle[a] if a < motors else joint_angle[a - motors]
        turned = angle - angle_before[a] if started else 0.0
        torque, bearing[a] = _passive_torque(numbers, at, bearing_before[a], turned, angle)
        angle_now[a] = angle
        if a < motors:
            motor_effort[a] = numbers[at + EFFORT_SIGN] * (motor_effort[a] + torque)
        else:
            joint_effort[a - motors] = numbers[at + EFFORT_SIGN] * (
                joint_effort[a - motors] + torque
            )
    return solved_all


@compiled
def impose_friction(
    plan: Indices,
    numbers: Vector,
    joint_angle: Vector,
    share: Vector,
    state: Vector,
    scratch: Vector,
) -> None:
    """Give a cable that has just been started a friction history, its elongation kept.

    Args:
        plan, numbers: the prepared robot.
        joint_angle: [rad], shape (joints,).
        share: of every pulley's bound that its friction holds, in [-1, 1], positive where the
            tension rises towards the last node, shape (pulleys,).
        state: as ``advance`` has left it after a first sample, changed.
        scratch: shape (scratch_size,).
    """
    elements, pulleys, frames = plan[ELEMENTS], plan[PULLEYS], plan[FRAMES]
    joints = plan[JOINTS]
    n = 0
    length = scratch[n : n + elements]
    n += elements
    length_by_joint = scratch[n : n + elements * joints].reshape(elements, joints)
    n += elements * joints
    wrap = scratch[n : n + pulleys]
    n += pulleys
    work = scratch[n : n + pulleys * WORK_COLUMNS].reshape(pulleys, WORK_COLUMNS)
    n += pulleys * WORK_COLUMNS
    pose = scratch[n : n + frames * POSE_NUMBERS].reshape(frames, POSE_NUMBERS)
    n += frames * POSE_NUMBERS
    twist = scratch[n : n + frames * joints * 3].reshape(frames, joints, 3)
    n += frames * joints * 3
    direction = scratch[n : n + 2 * elements].reshape(elements, 2)
    if not shape(plan, numbers, joint_angle, length, length_by_joint, wrap, direction, pose, twist):
        return
    material = state[1 + elements : 1 + 2 * elements]
    bristle = state[1 + 2 * elements : 1 + 2 * elements + pulleys]
    lagged = state[1 + 2 * elements + 2 * pulleys : 1 + 2 * elements + 3 * pulleys]
    _friction_losses(plan, numbers, wrap, lagged, work)
    for c in range(plan[CABLES]):
        row = plan[AT_CABLES] + c * CABLE_INDICES
        first = plan[row + FIRST_ELEMENT]
        last = first + plan[row + ELEMENT_COUNT]
        stiffness = numbers[plan[IN_CABLES] + c * CABLE_NUMBERS + AXIAL_STIFFNESS]
        if plan[row + LAW] == NONE:
            continue
        total = 0.0
        span = 0.0
        for e in range(first, last):
            total += material[e]
            span += length[e]
        mean = stiffness * (span / total - 1.0)
        if not mean > 0.0:
            continue
        # ratios of the tensions, then the one factor that keeps the elongation
        ratio = 1.0
        weighted = 0.0
        for e in range(first, last):
            if e > first:
                i = e - 1 - c
                drag = numbers[plan[IN_PULLEYS] + i * PULLEY_COLUMNS + DRAG]
                hold = max(1.0 - work[i, LOSS] - drag / (mean + drag), 1e-3)
                ratio *= hold ** (-share[i])
            scratch[e] = ratio  # the lengths are those of the state: their place is free
            weighted += state[1 + e] * ratio
        scale = mean * span / weighted
        for _ in range(3):
            held = 0.0
            slope = 0.0
            for e in range(first, last):
                stretch = 1.0 + scale * scratch[e] / stiffness
                held += state[1 + e] / stretch
                slope -= state[1 + e] * scratch[e] / (stiffness * stretch * stretch)
            scale -= (held - total) / slope
        for e in range(first, last):
            material[e] = state[1 + e] / (1.0 + scale * scratch[e] / stiffness)
            if e > first:
                bristle[e - 1 - c] = scale * (scratch[e] - scratch[e - 1])


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
