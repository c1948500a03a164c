"""Status, nodal forces and efforts from tensions."""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import lean, stage
from cdrj_ros.model.packing import SPATIAL, AxisNumbers, Numbers, Plan
from cdrj_ros.model.spatial_records import PULLEY
from cdrj_ros.model.state import EstimateViews, ScratchViews
from cdrj_ros.model.status import INVALID, OK, OVERLOAD, SLACK

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


@stage
def _force_on_pulley(
    plan: Plan,
    numbers: Numbers,
    p: int,
    routed: int,
    t_in: float,
    t_out: float,
    scratch: ScratchViews,
) -> tuple[float, float, float]:
    """Components of a cable's force on a pulley [N], from the tensions before and after it.

    The components of a routed cable are in the base frame.  For other cables x lies along the
    bisector of the cable's two directions and y across it.
    """
    if routed != 0:
        e = plan.pulleys[p].element
        x = t_out * scratch.direction[e + 1, 0] - t_in * scratch.direction[e, 0]
        y = t_out * scratch.direction[e + 1, 1] - t_in * scratch.direction[e, 1]
        z = 0.0
        if routed == SPATIAL:
            z = t_out * scratch.direction[e + 1, 2] - t_in * scratch.direction[e, 2]
        return x, y, z
    along, across = numbers.pulleys[p].half_sine, numbers.pulleys[p].half_cosine
    if plan.pulleys[p].wrap_changes == 1:
        along, across = sin(0.5 * scratch.wrap[p]), cos(0.5 * scratch.wrap[p])
    return (t_out + t_in) * along, (t_out - t_in) * across, 0.0


@stage
def _drum_lever(plan: Plan, numbers: Numbers, c: int, end: int, scratch: ScratchViews) -> float:
    """Moment of a cable about the axis of the drum at one end per newton [m], (E27)."""
    cable = plan.cables[c]
    node = cable.first_node + end * cable.elements
    if cable.routed == SPATIAL and plan.spatial_nodes[node].kind == PULLEY:
        return scratch.touches[node].lever
    return numbers.ends[2 * c + end].radius


@stage
def report_cable(
    plan: Plan,
    numbers: Numbers,
    c: int,
    solved: bool,
    scratch: ScratchViews,
    estimate: EstimateViews,
) -> None:
    """Write status, nodal forces (38) and share in the efforts (E12) of one cable.

    Args:
        plan, numbers: the prepared robot.
        c: the cable.
        solved: whether its fluxes were solved; otherwise its elements are ``INVALID``.
        scratch: wraps, directions and lever arms at the present joint angles.
        estimate: tensions and slip speeds of the cable are given; its efforts are added, the rest
            is written.
    """
    cable, constants = plan.cables[c], numbers.cables[c]
    first, last = cable.first_element, cable.first_element + cable.elements
    tension = estimate.tension
    for e in range(first, last):
        t = tension[e]
        flag = OK if solved else INVALID
        if t <= constants.slack_tension:
            flag |= SLACK
        if t > constants.maximum_tension:
            flag |= OVERLOAD
        estimate.status[e] = flag
        for j in range(estimate.joint_effort.size):
            estimate.joint_effort[j] -= t * scratch.lever_arm[e, j]
    for end in range(2):
        motor = plan.ends[2 * c + end].motor
        if motor >= 0:
            winding = numbers.ends[2 * c + end].winding
            pull = tension[first] if end == 0 else tension[last - 1]
            estimate.motor_effort[motor] -= (
                winding * _drum_lever(plan, numbers, c, end, scratch) * pull
            )
    for p in range(cable.first_pulley, cable.first_pulley + cable.pulleys):
        e = plan.pulleys[p].element
        t_in, t_out = tension[e], tension[e + 1]
        x, y, z = _force_on_pulley(plan, numbers, p, cable.routed, t_in, t_out, scratch)
        estimate.force_x[p] = x
        estimate.force_y[p] = y
        estimate.force_z[p] = z
        estimate.magnitude[p] = sqrt(x * x + y * y + z * z)
        estimate.friction[p] = t_out - t_in
    if not solved:  # the distribution of the elongation is unknown: report no numbers
        estimate.tension[first:last] = 0.0
        for p in range(cable.first_pulley, cable.first_pulley + cable.pulleys):
            estimate.force_x[p], estimate.force_y[p], estimate.force_z[p] = 0.0, 0.0, 0.0
            estimate.magnitude[p], estimate.friction[p], estimate.slip_speed[p] = 0.0, 0.0, 0.0


def nodal_force_magnitude(before: Table, after: Table, cosine: Table) -> Table:
    """(38), phi = pi - beta: force of a cable on a pulley [N], from its tensions and cos beta.

    This is the law of cosines, for arrays.  ``report_cable`` computes the magnitude from the
    components of the force instead.
    """
    squared = before**2 + after**2 - 2.0 * before * after * cosine
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)))


@lean
def passive_torque(
    axis: AxisNumbers, friction_before: float, turned: float, angle: float
) -> tuple[float, float]:
    """Torque of an axis without its cables, and the friction torque in it [N m], (E13).

    Args:
        axis: its constants.
        friction_before: friction torque of its bearing at the sample before [N m].
        turned: change of its angle since then [rad].
        angle: present angle [rad].
    """
    most = axis.bearing_torque
    friction = friction_before + axis.bearing_stiffness * turned
    friction = min(max(friction, -most), most)
    return -friction - axis.spring_stiffness * (angle - axis.spring_rest), friction
