"""From tensions to what is reported: status, nodal forces and efforts."""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import compiled, stage
from cdrj_ros.model.packing import AxisNumbers, Numbers, Plan
from cdrj_ros.model.state import EstimateViews, ScratchViews
from cdrj_ros.model.status import INVALID, OK, OVERLOAD, SLACK

Vector = NDArray[np.float64]


@stage
def report_cable(
    plan: Plan,
    numbers: Numbers,
    c: int,
    solved: bool,
    slip_speed: Vector,
    scratch: ScratchViews,
    estimate: EstimateViews,
) -> None:
    """From one cable's tensions to status, nodal forces and its share of the efforts."""
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
            estimate.joint_effort[j] -= t * scratch.length_by_joint[e, j]  # virtual work
    for end in range(2):
        motor = plan.ends[2 * c + end].motor
        if motor >= 0:
            drum = numbers.ends[2 * c + end]
            pull = tension[first] if end == 0 else tension[last - 1]
            estimate.motor_effort[motor] -= drum.winding * drum.radius * pull
    for p in range(cable.first_pulley, cable.first_pulley + cable.pulleys):
        e = plan.pulleys[p].element
        t_in, t_out = tension[e], tension[e + 1]
        if cable.routed == 1:
            x = t_out * scratch.direction[e + 1, 0] - t_in * scratch.direction[e, 0]
            y = t_out * scratch.direction[e + 1, 1] - t_in * scratch.direction[e, 1]
        else:
            along, across = numbers.pulleys[p].half_sine, numbers.pulleys[p].half_cosine
            if plan.pulleys[p].wrap_changes == 1:
                along, across = sin(0.5 * scratch.wrap[p]), cos(0.5 * scratch.wrap[p])
            x = (t_out + t_in) * along
            y = (t_out - t_in) * across
        estimate.force_x[p] = x
        estimate.force_y[p] = y
        estimate.magnitude[p] = sqrt(x * x + y * y)  # (38)
        estimate.friction[p] = t_out - t_in
        estimate.slip_speed[p] = slip_speed[p]
    if not solved:  # how the elongation is shared out is not known: say so, and no number
        estimate.tension[first:last] = 0.0
        for p in range(cable.first_pulley, cable.first_pulley + cable.pulleys):
            estimate.force_x[p], estimate.force_y[p], estimate.magnitude[p] = 0.0, 0.0, 0.0
            estimate.friction[p], estimate.slip_speed[p] = 0.0, 0.0


@compiled
def passive_torque(
    axis: AxisNumbers, friction_before: float, turned: float, angle: float
) -> tuple[float, float]:
    """Torque of an axis beside its cables and the friction in it [N m], (E13).

    Args:
        axis: its constants.
        friction_before: of its bearing [N m].
        turned: since then [rad].
        angle: now [rad].
    """
    most = axis.bearing_torque
    friction = friction_before + axis.bearing_stiffness * turned
    friction = min(max(friction, -most), most)
    return -friction - axis.spring_stiffness * (angle - axis.spring_rest), friction
