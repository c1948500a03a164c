"""One sample of a whole robot, compiled: geometry, friction bounds, every cable, all outputs.

A call with few flat arrays is cheap; views give their parts names.  A sample allocates nothing
unless a cable has to be solved in pieces.
"""

from __future__ import annotations

from math import inf
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.balance import acceptable, element_tension
from cdrj_ros.model.cable import solve_cable_linked
from cdrj_ros.model.cable_records import Contact, SolverElement
from cdrj_ros.model.compiled import callee, compiled, lean, stage, usable_in_kernels
from cdrj_ros.model.creep import creep_of, crept
from cdrj_ros.model.drum import material_held, start_drum, turn_drum
from cdrj_ros.model.elasticity import Elasticity, elasticity_of, strain_at
from cdrj_ros.model.friction import blended_loss, stribeck_share
from cdrj_ros.model.linked import linked
from cdrj_ros.model.outputs import passive_torque, report_cable
from cdrj_ros.model.packing import Indices, Numbers, Plan, Sizes, number_views, plan_views
from cdrj_ros.model.records import Rows
from cdrj_ros.model.shape import shape_linked
from cdrj_ros.model.state import (
    EstimateViews,
    ScratchViews,
    StateViews,
    estimate_size,
    estimate_views,
    scratch_size,
    scratch_views,
    state_size,
    state_views,
)
from cdrj_ros.model.status import INVALID
from cdrj_ros.model.views import copy_part, is_dense, part

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


class Step(NamedTuple):
    """Views of everything that one sample reads and writes."""

    plan: Plan
    numbers: Numbers
    before: StateViews
    after: StateViews
    estimate: EstimateViews
    scratch: ScratchViews
    workspace: Vector
    """What ``scratch`` views, shape (scratch_size,)."""


@usable_in_kernels
def _step_views(plan: Indices, numbers: Vector, before: Vector, out: Vector) -> Step:
    """Views of the arguments of ``advance``."""
    parts = plan_views(plan)
    sizes = parts.sizes
    estimate = state_size(sizes)
    scratch = estimate + estimate_size(sizes)
    workspace = part(out, scratch, out.size)
    return Step(
        parts,
        number_views(sizes, numbers),
        state_views(sizes, before),
        state_views(sizes, out),
        estimate_views(sizes, part(out, estimate, scratch)),
        scratch_views(sizes, workspace),
        workspace,
    )


@stage
def friction_losses(
    plan: Plan, numbers: Numbers, wrap: Vector, lagged_speed: Vector, contacts: Rows[Contact]
) -> None:
    """(37), (41) and their blend for every pulley; constant wraps use losses computed beforehand.

    Static friction fades with the slip speed delayed by ``stribeck_lag`` (E10), frictional memory.
    With the speed of the sample itself, friction would fall while the cable slips; a massless
    cable then has several solutions or none, and would jump from sample to sample.
    """
    for p in range(len(contacts)):
        pulley = numbers.pulleys[p]
        kinetic, static = pulley.kinetic_loss, pulley.static_loss
        if plan.pulleys[p].wrap_changes == 1:
            kinetic, static = blended_loss(
                pulley.rho,
                pulley.mu_c,
                pulley.mu_s,
                wrap[p],
                pulley.bearing_ratio,
                plan.pulleys[p].stribeck,
                pulley.cells,
            )
        share = stribeck_share(lagged_speed[p], pulley.stribeck_speed)
        contacts[p].static_share = share
        contacts[p].loss = kinetic + static * share


@stage
def _start_cable(step: Step, c: int, motor_angle: Vector) -> bool:
    """Start a cable without friction history: its material determines one tension throughout.

    Returns:
        False if no material is left because the cable is wound in entirely.
    """
    cable, numbers = step.plan.cables[c], step.numbers
    constants, after, tension = numbers.cables[c], step.after, step.estimate.tension
    first, last = cable.first_element, cable.first_element + cable.elements
    # with an unknown history, assume that the drum was wound at the cable's wound tension
    elastic = elasticity_of(constants)
    stretch = 1.0 + strain_at(elastic, constants.wound_tension)
    total = 0.0
    span = 0.0
    for e in range(first, last):
        total += numbers.elements[e].material
        span += after.length[e]
    for end in range(2 * c, 2 * c + 2):
        motor, drum = step.plan.ends[end].motor, numbers.ends[end]
        if motor >= 0:
            rate = drum.radius / stretch
            angle = drum.winding * (motor_angle[motor] - numbers.motors[motor].reference_angle)
            start_drum(after.drums[step.plan.ends[end].drum], angle, rate * angle, rate)
            total -= rate * angle
    for e in range(first, last):
        after.material[e] = after.length[e] * (total / span)
        tension[e] = element_tension(elastic, after.length[e], after.material[e])
        after.delayed[e] = constants.creep_share * strain_at(elastic, constants.preload)
    for p in range(cable.first_pulley, cable.first_pulley + cable.pulleys):
        after.bristle[p], after.slip_speed[p], after.lagged_speed[p] = 0.0, 0.0, 0.0
    step.estimate.iterations[c], step.estimate.residual[c] = 0.0, 0.0
    return after.material[first] > 0.0


@stage
def _turn_drums(step: Step, c: int, motor_angle: Vector) -> tuple[float, float]:
    """Material [m] that enters at the first and leaves at the last node as the winches turn."""
    cable, before = step.plan.cables[c], step.before
    slips = (0.0, 0.0)
    for end in range(2):
        motor, drum = step.plan.ends[2 * c + end].motor, step.numbers.ends[2 * c + end]
        if motor < 0:
            continue
        e = cable.first_element if end == 0 else cable.first_element + cable.elements - 1
        stretch = max(before.length[e] / before.material[e], 1.0)
        memory = step.after.drums[step.plan.ends[2 * c + end].drum]
        held = material_held(memory)
        angle = drum.winding * (motor_angle[motor] - step.numbers.motors[motor].reference_angle)
        wound = turn_drum(memory, angle, drum.radius / stretch)
        slips = (held - wound, slips[1]) if end == 0 else (slips[0], wound - held)
    return slips


@stage
def _yield(step: Step, c: int, dt: float) -> None:
    """Lengthen the material of every element by what it has crept since the sample before."""
    cable, before = step.plan.cables[c], step.before
    law = creep_of(step.numbers.cables[c])
    none = law.share == 0.0 and law.flow_time == inf
    for e in range(cable.first_element, cable.first_element + cable.elements):
        step.after.delayed[e] = before.delayed[e]
        if none:
            continue
        strain = before.length[e] / before.material[e] - 1.0
        delayed, growth = crept(law, strain, before.delayed[e], dt)
        step.after.delayed[e] = delayed
        step.scratch.elements[e].material_before = growth * before.material[e]


@stage
def _move_cable(step: Step, c: int, motor_angle: Vector, dt: float) -> bool:
    """Advance a cable with a friction history; False if its slips could not be solved."""
    cable, before, after = step.plan.cables[c], step.before, step.after
    elastic = elasticity_of(step.numbers.cables[c])
    first, last = cable.first_element, cable.first_element + cable.elements
    pulley, beyond = cable.first_pulley, cable.first_pulley + cable.pulleys
    elements, contacts = step.scratch.elements, step.scratch.contacts
    first_slip, last_slip = _turn_drums(step, c, motor_angle)
    for e in range(first, last):
        elements[e].length_before = before.length[e]
        elements[e].length = after.length[e]
        elements[e].material_before = before.material[e]
    _yield(step, c, dt)
    for p in range(pulley, beyond):
        contacts[p].slip = before.slip_speed[p] * dt
        contacts[p].bristle_before = before.bristle[p]
        contacts[p].bristle = 0.0
    iterations, worst = solve_cable_linked(
        elastic, elements[first:last], contacts[pulley:beyond],
        step.numbers.pulleys[pulley:beyond], first_slip, last_slip, cable.law, dt,
    )  # fmt: skip
    solved = worst <= acceptable(elastic) and _has_material(elements[first:last])
    if not solved:
        _spread_evenly(elastic, elements[first:last], first_slip - last_slip)
        for p in range(pulley, beyond):
            contacts[p].bristle, contacts[p].slip = 0.0, 0.0
    for e in range(first, last):
        after.material[e] = elements[e].material
        step.estimate.tension[e] = elements[e].tension
    for p in range(pulley, beyond):
        after.bristle[p] = contacts[p].bristle
        after.slip_speed[p] = contacts[p].slip / dt if dt > 0.0 else 0.0
        lag = step.numbers.pulleys[p].stribeck_lag  # (E10)
        after.lagged_speed[p] = (lag * before.lagged_speed[p] + dt * after.slip_speed[p]) / (
            lag + dt
        )
    step.estimate.iterations[c], step.estimate.residual[c] = iterations, worst
    return solved


@callee
def _has_material(elements: Rows[SolverElement]) -> bool:
    """Whether every element has some unstretched length."""
    every = True
    for e in range(len(elements)):
        every &= elements[e].material > 0.0
    return every


@callee
def _spread_evenly(elastic: Elasticity, elements: Rows[SolverElement], entered: float) -> None:
    """Distribute the elongation of a cable evenly, because its slips were not solved."""
    total = entered
    span = 0.0
    for e in range(len(elements)):
        total += elements[e].material_before
        span += elements[e].length
    for e in range(len(elements)):
        elements[e].material = elements[e].length * (total / span)
        elements[e].tension = element_tension(elastic, elements[e].length, elements[e].material)


@stage
def _refuse(before: Vector, out: Vector, estimate: EstimateViews, sizes: Sizes) -> None:
    """Keep the state, mark every element ``INVALID`` and report 0 for everything else."""
    state = state_size(sizes)
    copy_part(before, 0, part(out, 0, state))
    out[state : state + estimate_size(sizes)] = 0.0
    estimate.status[:] = INVALID


@stage
def _add_axes(step: Step, motor_angle: Vector, joint_angle: Vector) -> None:
    """Add friction and spring of every motor and joint to the efforts, and apply their signs."""
    before, after = step.before, step.after
    motors = motor_angle.size
    started = before.started[0] != 0.0
    for a in range(motors + joint_angle.size):
        axis = step.numbers.axes[a]
        angle = motor_angle[a] if a < motors else joint_angle[a - motors]
        turned = angle - before.angle[a] if started else 0.0
        torque, friction = passive_torque(axis, before.bearing_friction[a], turned, angle)
        after.angle[a], after.bearing_friction[a] = angle, friction
        if a < motors:
            cables = step.estimate.motor_effort[a]
            step.estimate.motor_effort[a] = axis.effort_sign * (cables + torque)
        else:
            cables = step.estimate.joint_effort[a - motors]
            step.estimate.joint_effort[a - motors] = axis.effort_sign * (cables + torque)


@stage
def _require_angles(sizes: Sizes, motor_angle: Vector, joint_angle: Vector) -> None:
    """Check the arrays of angles, whose memory is read whatever they are.

    Raises:
        ValueError: they are not contiguous, or of another robot.
    """
    dense = is_dense(motor_angle) and is_dense(joint_angle)
    if not dense or motor_angle.size != sizes.motors or joint_angle.size != sizes.joints:
        raise ValueError("the angles are not contiguous or not those of this robot")


@lean
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
        before: begins with the state, as the ``out`` of the sample before does; not changed.
        motor_angle, joint_angle: angles [rad], of prismatic joints [m], in the robot's order.
        dt: time since the state [s]; 0 for the first sample or where it is unknown.
        out: new state, estimate and scratch, shape (state + estimate + scratch,), written.

    Returns:
        False where the geometry is impossible at these joint angles (the state is then kept) or
        the slips of some cable could not be solved; the elements concerned are ``INVALID``.

    Raises:
        ValueError: the angles are not contiguous, or of another robot; nothing has changed then.
    """
    step = _step_views(plan, numbers, before, out)
    _require_angles(step.plan.sizes, motor_angle, joint_angle)
    after, scratch, estimate = step.after, step.scratch, step.estimate
    if not shape_linked(plan, numbers, motor_angle, joint_angle, after.length, step.workspace):
        _refuse(before, out, estimate, step.plan.sizes)
        return False
    friction_losses(
        step.plan, step.numbers, scratch.wrap, step.before.lagged_speed, scratch.contacts
    )
    started = step.before.started[0] != 0.0
    after.started[0] = 1.0
    for d in range(len(after.drums)):
        after.drums[d] = step.before.drums[d]
    estimate.motor_effort[:] = 0.0
    estimate.joint_effort[:] = 0.0
    solved_all = True
    for c in range(len(step.plan.cables)):
        if started:
            solved = _move_cable(step, c, motor_angle, dt)
        else:
            solved = _start_cable(step, c, motor_angle)
        report_cable(step.plan, step.numbers, c, solved, after.slip_speed, scratch, estimate)
        solved_all &= solved
    _add_axes(step, motor_angle, joint_angle)
    return solved_all


advance_robot: Final = linked(
    advance,
    "boolean(Array(int64, 1, 'C', True), Array(float64, 1, 'C', True),"
    " float64[::1], float64[::1], float64[::1], float64, float64[::1])",
)
"""``advance``, to be called by kernels."""


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
    """Call ``advance`` for many samples without returning to Python; results agree bit for bit.

    Args:
        plan, numbers: the prepared robot.
        state: shape (state_size,), replaced by the state after the last sample.
        motor_angles, joint_angles: [rad] or [m], shapes (samples, motors) and (samples, joints).
        dt: time since the sample before [s], shape (samples,).
        estimates: shape (samples, estimate_size), written.
    """
    size = state.size
    out = np.empty(size + estimates.shape[1] + scratch_size(plan_views(plan).sizes))
    for k in range(dt.size):
        advance_robot(plan, numbers, state, motor_angles[k], joint_angles[k], dt[k], out)
        copy_part(out, 0, state)
        copy_part(out, size, estimates[k])
