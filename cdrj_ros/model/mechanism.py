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
from cdrj_ros.model.cable_records import Segment
from cdrj_ros.model.cells import place_contacts, span_segment
from cdrj_ros.model.compiled import callee, compiled, lean, stage, usable_in_kernels
from cdrj_ros.model.creep import creep_of, crept
from cdrj_ros.model.drum import material_held, start_drum, turn_drum
from cdrj_ros.model.elasticity import Elasticity, elasticity_of, strain_at
from cdrj_ros.model.friction import blended_loss, cell_loss, stribeck_share
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
from cdrj_ros.model.surface import cover_surfaces_linked
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


@usable_in_kernels
def _with_history(step: Step) -> Step:
    """Views with the state before by the contact cells of this sample."""
    return Step(
        step.plan,
        step.numbers,
        state_views(step.plan.sizes, step.scratch.history),
        step.after,
        step.estimate,
        step.scratch,
        step.workspace,
    )


@stage
def friction_losses(
    plan: Plan, numbers: Numbers, lagged_speed: Vector, scratch: ScratchViews
) -> None:
    """(37), (41), their blend for every pulley, and (E28) for the cells of one that is divided.

    Constant wraps use losses computed beforehand.

    Static friction fades with the slip speed delayed by ``stribeck_lag`` (E10), frictional memory.
    With the speed of the sample itself, friction would fall while the cable slips; a massless
    cable then has several solutions or none, and would jump from sample to sample.
    """
    for p in range(len(plan.pulleys)):
        pulley, first = numbers.pulleys[p], plan.pulleys[p].first_contact
        kinetic, static = pulley.kinetic_loss, pulley.static_loss
        if plan.pulleys[p].wrap_changes == 1:
            kinetic, static = blended_loss(
                pulley.rho,
                pulley.mu_c,
                pulley.mu_s,
                scratch.wrap[p],
                pulley.bearing_ratio,
                plan.pulleys[p].stribeck,
            )
        share = scratch.contacts[first].share
        fast, more = cell_loss(kinetic, static, share)
        for q in range(first, first + plan.pulleys[p].cells):
            contact = scratch.contacts[q]
            if contact.share != share:
                share = contact.share
                fast, more = cell_loss(kinetic, static, share)
            contact.static_share = stribeck_share(lagged_speed[q], pulley.stribeck_speed)
            contact.loss = fast + more * contact.static_share


@stage
def _segments_of(plan: Plan, c: int) -> tuple[int, int]:
    """First segment of a cable, and the one after its last."""
    first = plan.cables[c].first_contact + c
    return first, first + plan.cables[c].contacts + 1


@stage
def _start_cable(step: Step, c: int, motor_angle: Vector) -> bool:
    """Start a cable without friction history: its material determines one tension throughout.

    Returns:
        False if no material is left because the cable is wound in entirely.
    """
    cable, numbers = step.plan.cables[c], step.numbers
    constants, after = numbers.cables[c], step.after
    first, last = _segments_of(step.plan, c)
    # with an unknown history, assume that the drum was wound at the cable's wound tension
    elastic = elasticity_of(constants)
    stretch = 1.0 + strain_at(elastic, constants.wound_tension)
    total = 0.0
    span = 0.0
    for e in range(first, last):
        total += numbers.segments[e].material
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
        step.scratch.segments[e].tension = element_tension(
            elastic, after.length[e], after.material[e]
        )
        after.delayed[e] = constants.creep_share * strain_at(elastic, constants.preload)
    for q in range(cable.first_contact, cable.first_contact + cable.contacts):
        after.bristle[q], after.slip_speed[q], after.lagged_speed[q] = 0.0, 0.0, 0.0
    step.estimate.iterations[c], step.estimate.residual[c] = 0.0, 0.0
    return after.material[first] > 0.0


@stage
def _turn_drums(step: Step, c: int, motor_angle: Vector) -> tuple[float, float]:
    """Material [m] that enters at the first and leaves at the last node as the winches turn."""
    before, (first, beyond) = step.before, _segments_of(step.plan, c)
    fluxes = (0.0, 0.0)
    for end in range(2):
        motor, drum = step.plan.ends[2 * c + end].motor, step.numbers.ends[2 * c + end]
        if motor < 0:
            continue
        e = first if end == 0 else beyond - 1
        stretch = max(before.length[e] / before.material[e], 1.0)
        memory = step.after.drums[step.plan.ends[2 * c + end].drum]
        held = material_held(memory)
        angle = drum.winding * (motor_angle[motor] - step.numbers.motors[motor].reference_angle)
        wound = turn_drum(memory, angle, drum.radius / stretch)
        fluxes = (held - wound, fluxes[1]) if end == 0 else (fluxes[0], wound - held)
    return fluxes


@stage
def _yield(step: Step, c: int, dt: float) -> None:
    """Lengthen the material of every segment by what it has crept since the sample before."""
    before, (first, beyond) = step.before, _segments_of(step.plan, c)
    law = creep_of(step.numbers.cables[c])
    none = law.share == 0.0 and law.flow_time == inf
    for e in range(first, beyond):
        step.after.delayed[e] = before.delayed[e]
        if none:
            continue
        strain = before.length[e] / before.material[e] - 1.0
        delayed, growth = crept(law, strain, before.delayed[e], dt)
        step.after.delayed[e] = delayed
        step.scratch.segments[e].material_before = growth * before.material[e]


@stage
def _move_cable(step: Step, c: int, motor_angle: Vector, dt: float) -> bool:
    """Advance a cable with a friction history; False if its fluxes could not be solved."""
    cable, before, after = step.plan.cables[c], step.before, step.after
    elastic = elasticity_of(step.numbers.cables[c])
    first, last = _segments_of(step.plan, c)
    contact, beyond = cable.first_contact, cable.first_contact + cable.contacts
    segments, contacts = step.scratch.segments, step.scratch.contacts
    first_flux, last_flux = _turn_drums(step, c, motor_angle)
    for e in range(first, last):
        segments[e].length_before = before.length[e]
        segments[e].material_before = before.material[e]
    _yield(step, c, dt)
    for q in range(contact, beyond):
        contacts[q].flux = before.slip_speed[q] * dt - contacts[q].shift
        contacts[q].bristle_before = before.bristle[q]
        contacts[q].bristle = 0.0
    iterations, worst = solve_cable_linked(
        elastic, segments[first:last], contacts[contact:beyond],
        first_flux, last_flux, cable.law, dt,
    )  # fmt: skip
    solved = worst <= acceptable(elastic) and _has_material(segments[first:last])
    if not solved:
        _spread_evenly(elastic, segments[first:last], first_flux - last_flux)
        for q in range(contact, beyond):
            contacts[q].bristle, contacts[q].flux = 0.0, -contacts[q].shift
    for e in range(first, last):
        after.material[e] = segments[e].material
    for q in range(contact, beyond):
        after.bristle[q] = contacts[q].bristle
        slip = contacts[q].flux + contacts[q].shift  # (E25)
        after.slip_speed[q] = slip / dt if dt > 0.0 else 0.0
    for p in range(cable.first_pulley, cable.first_pulley + cable.pulleys):
        lag, own = step.numbers.pulleys[p].stribeck_lag, step.plan.pulleys[p]
        for q in range(own.first_contact, own.first_contact + own.cells):  # (E10)
            moved = lag * before.lagged_speed[q] + dt * after.slip_speed[q]
            after.lagged_speed[q] = moved / (lag + dt)
    step.estimate.iterations[c], step.estimate.residual[c] = iterations, worst
    return solved


@callee
def _has_material(segments: Rows[Segment]) -> bool:
    """Whether every segment has some unstretched length."""
    every = True
    for e in range(len(segments)):
        every &= segments[e].material > 0.0
    return every


@callee
def _spread_evenly(elastic: Elasticity, segments: Rows[Segment], entered: float) -> None:
    """Distribute the elongation of a cable evenly, because its fluxes were not solved."""
    total = entered
    span = 0.0
    for e in range(len(segments)):
        total += segments[e].material_before
        span += segments[e].length
    for e in range(len(segments)):
        segments[e].material = segments[e].length * (total / span)
        segments[e].tension = element_tension(elastic, segments[e].length, segments[e].material)


@stage
def _report(step: Step, c: int, solved: bool) -> None:
    """Results of one cable: tensions of the free spans, mean slip speed of a pulley's arc."""
    cable, estimate = step.plan.cables[c], step.estimate
    for k in range(cable.elements):
        segment = step.scratch.segments[span_segment(step.plan, c, k)]
        estimate.tension[cable.first_element + k] = segment.tension
    for p in range(cable.first_pulley, cable.first_pulley + cable.pulleys):
        own = step.plan.pulleys[p]
        slip_speed = step.after.slip_speed[own.first_contact]
        if own.cells > 1:
            slip_speed = 0.0
            for q in range(own.first_contact, own.first_contact + own.cells):
                slip_speed += step.scratch.contacts[q].share * step.after.slip_speed[q]
        estimate.slip_speed[p] = slip_speed
    report_cable(step.plan, step.numbers, c, solved, step.scratch, estimate)


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
        the fluxes of some cable could not be solved; the elements concerned are ``INVALID``.

    Raises:
        ValueError: the angles are not contiguous, or of another robot; nothing has changed then.
    """
    step = _step_views(plan, numbers, before, out)
    _require_angles(step.plan.sizes, motor_angle, joint_angle)
    after, scratch, estimate = step.after, step.scratch, step.estimate
    if not shape_linked(plan, numbers, motor_angle, joint_angle, step.workspace):
        _refuse(before, out, estimate, step.plan.sizes)
        return False
    if step.plan.sizes.surfaces > 0:
        cover_surfaces_linked(plan, numbers, before, out, step.workspace)
        step = _with_history(step)
    state = step.before
    for e in range(after.length.size):
        after.length[e] = scratch.segments[e].length
    for k in range(len(after.middles)):
        after.middles[k] = scratch.middles[k]
    for c in range(len(step.plan.cables)):
        place_contacts(step.plan, step.numbers, c, state, after, scratch)
    friction_losses(step.plan, step.numbers, state.lagged_speed, scratch)
    started = state.started[0] != 0.0
    after.started[0] = 1.0
    for d in range(len(after.drums)):
        after.drums[d] = state.drums[d]
    estimate.motor_effort[:] = 0.0
    estimate.joint_effort[:] = 0.0
    solved_all = True
    for c in range(len(step.plan.cables)):
        if started:
            solved = _move_cable(step, c, motor_angle, dt)
        else:
            solved = _start_cable(step, c, motor_angle)
        _report(step, c, solved)
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
