"""From tensions to what is reported: status, nodal forces and efforts."""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.packing import (
    AT_CABLES,
    AT_PULLEYS,
    BEARING_STIFFNESS,
    BEARING_TORQUE,
    CABLE_INDICES,
    CABLE_NUMBERS,
    ELEMENT_COUNT,
    FIRST_ELEMENT,
    FIRST_MOTOR,
    FIRST_RADIUS,
    FIRST_WINDING,
    IN_CABLES,
    IN_HALVES,
    MAXIMUM_TENSION,
    ROUTED,
    SLACK_TENSION,
    SPRING_REST,
    SPRING_STIFFNESS,
)
from cdrj_ros.model.status import INVALID, OK, OVERLOAD, SLACK

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def report_cable(
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
def passive_torque(
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
