"""Kernels that find the motor angle at which the cables balance a joint."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.mechanism import advance_robot
from cdrj_ros.model.packing import plan_views
from cdrj_ros.model.state import estimate_size, scratch_size, state_size
from cdrj_ros.model.views import copy_part

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


BALANCE_TOLERANCE: Final = 1e-6
"""Largest imbalance of the joint [N m]."""


@compiled
def scan(
    plan: NDArray[np.int64],
    numbers: Vector,
    base: Vector,
    direction: Vector,
    angles: Vector,
    joint_angle: Vector,
    effort_place: int,
    efforts: Vector,
) -> None:
    """Effort on a joint for many drives, without friction."""
    sizes = plan_views(plan).sizes
    size = state_size(sizes)
    state = np.zeros(size)
    out = np.empty(size + estimate_size(sizes) + scratch_size(sizes))
    motor_angle = np.empty(base.size)
    for k in range(angles.size):
        for m in range(base.size):
            motor_angle[m] = base[m] + direction[m] * angles[k]
        advance_robot(plan, numbers, state, motor_angle, joint_angle, 0.0, out)
        efforts[k] = out[size + effort_place]


@compiled
def _imbalance(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    motor_angle: Vector,
    base: Vector,
    direction: Vector,
    offset: Vector,
    drive: float,
    joint_angle: Vector,
    torque: float,
    dt: float,
    effort_place: int,
    out: Vector,
) -> float:
    """Effort of the cables on the joint minus the torque that it needs [N m].

    It takes 13 arguments because compiled kernels take arrays and numbers.
    """
    for m in range(motor_angle.size):
        motor_angle[m] = base[m] + direction[m] * drive + offset[m]
    advance_robot(plan, numbers, state, motor_angle, joint_angle, dt, out)
    return out[state.size + effort_place] - torque


@compiled
def balance(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    angle: float,
    rising: float,
    phase: int,
    excused: bool,
    joints: Table,
    torque: Vector,
    dt: Vector,
    motor_speed: float,
    effort_place: int,
    base: Table,
    direction: Vector,
    offset: Table,
    happening: NDArray[np.bool_],
    drive: Vector,
    phases: NDArray[np.int64],
    lacking: Vector,
    estimates: Table,
) -> tuple[int, float, int, bool, float]:
    """Drive of the motors sample by sample: bracket, then regula falsi (Illinois).

    Just after a reversal, friction makes the joint's effort a very flat function of the winch
    angle, so the bracket is widened geometrically.  It takes 20 arguments because compiled kernels
    take arrays and numbers, and is longer than a screen because it is one loop over the samples.

    Returns:
        Number of samples done, drive [rad], phase, whether the motor is compensating a fault, and
        the motor speed required in the sample that could not be balanced [rad/s].
    """
    size = state.size
    wanted = estimates.shape[1]
    out = np.empty(size + wanted + scratch_size(plan_views(plan).sizes))
    motors = np.empty(direction.size)
    for k in range(dt.size):
        following = min(phase + 1, torque.size - 1) if dt[k] > 0.0 else phase
        q, needed, start, moved = joints[following], torque[following], base[following], offset[k]
        far = 2.0 * motor_speed * dt[k] + 1e-2
        a = angle
        fa = _imbalance(
            plan, numbers, state, motors, start, direction, moved, a, q, needed, dt[k],
            effort_place, out,
        )  # fmt: skip
        b, fb = a, fa
        width = 1e-5
        towards = -rising if fa > 0.0 else rising
        while abs(fb) > BALANCE_TOLERANCE and fa * fb > 0.0 and width < 2.0 * far:
            a, fa = b, fb
            b = angle + towards * width
            fb = _imbalance(
                plan, numbers, state, motors, start, direction, moved, b, q, needed, dt[k],
                effort_place, out,
            )  # fmt: skip
            width *= 2.0
        side = 0
        for _ in range(200):
            if abs(fb) <= BALANCE_TOLERANCE or fa * fb > 0.0:
                break
            c = b - fb * (b - a) / (fb - fa)
            fc = _imbalance(
                plan, numbers, state, motors, start, direction, moved, c, q, needed, dt[k],
                effort_place, out,
            )  # fmt: skip
            if fc * fb < 0.0:
                a, fa = b, fb
                side = 0
            else:
                side += 1
                fa *= 0.5 if side > 0 else 1.0
            b, fb = c, fc
        excused = excused or happening[k]
        if abs(b - angle) > motor_speed * dt[k] and dt[k] > 0.0:
            following = phase  # the joint waits for the motor
            asked = abs(b - angle) / dt[k] if abs(fb) <= BALANCE_TOLERANCE else 0.0
            b = angle + (motor_speed * dt[k] if b > angle else -motor_speed * dt[k])
            before = _imbalance(
                plan, numbers, state, motors, base[phase], direction, moved, angle, joints[phase],
                torque[phase], dt[k], effort_place, out,
            )  # fmt: skip
            fb = _imbalance(
                plan, numbers, state, motors, base[phase], direction, moved, b, joints[phase],
                torque[phase], dt[k], effort_place, out,
            )  # fmt: skip
            if abs(fb - before) > 0.1 * (1.0 + abs(torque[phase])) and not excused:
                return k, angle, phase, excused, asked
        elif abs(fb) > BALANCE_TOLERANCE:
            return k, angle, phase, excused, 0.0
        else:
            excused = happening[k]
        angle, phase = b, following
        drive[k], phases[k], lacking[k] = b, phase, fb
        copy_part(out, 0, state)
        copy_part(out, size, estimates[k])
    return dt.size, angle, phase, excused, 0.0
