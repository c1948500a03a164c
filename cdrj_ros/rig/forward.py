"""Forward simulation: the motors move as prescribed, and one joint moves by its dynamics.

Every step solves for the joint's next angle with the cables' torque at both ends of the step
(trapezoidal rule): cables are stiff, and an explicit step would be unstable for a light joint.
Without friction and damping the rule conserves the energy of a linear spring exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.mechanism import advance_robot
from cdrj_ros.model.packing import plan_views
from cdrj_ros.model.state import scratch_size
from cdrj_ros.model.views import copy_part
from cdrj_ros.rig.assembly import BATCH, Kept, MotionError, Truth, make_rig, read_out, require_taut
from cdrj_ros.rig.faults import Fault
from cdrj_ros.rig.load import (
    DAMPING,
    INERTIA,
    INERTIA_COS,
    WEIGHT,
    WEIGHT_COS,
    WEIGHT_COS_2,
    Load,
)
from cdrj_ros.rig.prescribed import Progress
from cdrj_ros.rig.start import balanced_start
from cdrj_ros.robot.description import Robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

MOTION_TOLERANCE: Final = 1e-9
"""Largest imbalance of torque in a step [N m]."""

UNSOLVED: Final = 1e-4
"""Largest imbalance of torque that is accepted in a step that did not converge [N m]."""


def swing(
    robot: Robot,
    time: Vector,
    motor_angle: NDArray[np.float64],
    load: Load,
    cells: int = 8,
    progress: Progress | None = None,
    *,
    joint: int = 0,
    joint_angle: NDArray[np.float64] | None = None,
    start: float | None = None,
    faults: Sequence[Fault] = (),
    allow_slack: bool = False,
) -> Truth:
    """Turn the motors as prescribed and integrate one joint under cables, weight and inertia.

    It takes 11 arguments because each is an independent option, and is longer than a screen because
    the kernel's state is carried from batch to batch.

    Args:
        robot: at least one joint.
        time: increasing [s], shape (n,).
        motor_angle: [rad], shape (n, motors).
        load: load of the joint.
        cells: contact cells per pulley.
        progress: called with the number of samples done.
        joint: index of the free joint.
        joint_angle: of all joints, shape (n, joints); the column of the free one is ignored.
            If None, the other joints are held in the reference pose.
        start: angle at which the joint is released at rest; None for its equilibrium.
        faults: injected faults.
        allow_slack: whether cables may lose their tension; with faults they always may.

    Raises:
        SlackError: a cable goes slack.
        UsageError: there is no equilibrium at the start, or the joint leaves its range.
    """
    if not robot.joints:
        raise UsageError("a free joint is needed, and the robot has none")
    rig = make_rig(robot, cells, faults)
    fine, axis, n = rig.fine, robot.joints[joint], time.size
    reference = np.array([other.reference_angle for other in robot.joints])
    joints = np.tile(reference, (n, 1)) if joint_angle is None else joint_angle.copy()
    motors = np.reshape(motor_angle, (n, -1))
    if motors.shape[1] != len(robot.motors) or joints.shape != (n, len(robot.joints)):
        raise UsageError(
            f"motor_angle must have the shape {(n, len(robot.motors))} and joint_angle "
            f"{(n, len(robot.joints))}, got {motor_angle.shape} and {joints.shape}"
        )
    offset = rig.wiring.offset(time)
    drums = rig.drums(motors, offset)
    coefficients = load.coefficients()
    if start is None:
        start = balanced_start(rig, drums[0], joints[0], joint, coefficients)
    joints[0, joint] = start
    dt = np.diff(time, prepend=time[0])
    state = np.zeros(fine.state_size)
    batch, kept = np.empty((min(n, BATCH), fine.layout.size)), Kept(rig, n)
    residual = np.empty(n)
    course = np.array([start, 0.0, 0.0, 0.0])
    for begin in range(0, n, BATCH):
        end = min(begin + BATCH, n)
        done = swing_steps(
            fine.plan, fine.numbers, state, course, coefficients, joint, float(axis.effort_sign),
            fine.layout.joint_effort.start + joint, axis.lower, axis.upper, drums[begin:end],
            joints[begin:end], dt[begin:end], residual[begin:end], batch[: end - begin],
        )  # fmt: skip
        upto = begin + done
        require_taut(rig, time[begin:], joints[begin:upto], batch[:done], allow_slack)
        kept.keep(begin, batch[:done])
        if upto < end:
            raise MotionError(
                f"{axis.name} leaves its range [{axis.lower:.4g}, {axis.upper:.4g}] at "
                f"t = {time[upto]:.4g} s: the cables cannot hold the load there"
            )
        worst = float(np.abs(residual[begin:end]).max())
        if not worst <= UNSOLVED:
            raise UsageError(
                f"the motion of {axis.name} could not be solved to better than {worst:.3g} N m "
                f"within {time[begin]:.4g} .. {time[end - 1]:.4g} s: take smaller steps"
            )
        if progress is not None:
            progress(end)
    return read_out(rig, time, motors, joints, kept, offset, residual)


@compiled
def _required(
    load: Vector, q0: float, v0: float, q1: float, dt: float, torque0: float, torque1: float
) -> float:
    """Torque that the step q0 -> q1 needs minus the mean torque of the cables [N m]."""
    q, v = 0.5 * (q0 + q1), (q1 - q0) / dt
    inertia = load[INERTIA] + load[INERTIA_COS] * cos(q)
    held = load[WEIGHT] + load[WEIGHT_COS] * cos(q) + load[WEIGHT_COS_2] * cos(2.0 * q)
    turning = inertia * 2.0 * (v - v0) / dt - 0.5 * load[INERTIA_COS] * sin(q) * v * v
    return turning + load[DAMPING] * v + held - 0.5 * (torque0 + torque1)


@compiled
def swing_steps(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    course: Vector,
    load: Vector,
    joint: int,
    sign: float,
    effort_place: int,
    lower: float,
    upper: float,
    drums: Table,
    joints: Table,
    dt: Vector,
    residual: Vector,
    estimates: Table,
) -> int:
    """Integrate a free joint; returns the number of steps within its range.

    It takes 15 arguments because compiled kernels take arrays and numbers, and is longer than a
    screen because it is one loop over the steps.

    ``course`` holds angle, speed, acceleration and torque of the cables, and is updated in place.
    """
    size = state.size
    wanted = estimates.shape[1]
    out = np.empty(size + wanted + scratch_size(plan_views(plan).sizes))
    pose = np.empty(joints.shape[1])
    for k in range(dt.size):
        copy_part(joints[k], 0, pose)
        q0, v0, torque0 = course[0], course[1], course[3]
        q, excess = q0, 0.0
        if dt[k] > 0.0:
            h = dt[k]
            q = q0 + h * v0 + 0.5 * h * h * course[2]
            slope = 2.0 * (load[INERTIA] + load[INERTIA_COS] * cos(q0)) / (h * h)
            low, high, below, above = -np.inf, np.inf, 0.0, 0.0
            last, last_excess, tried = q, 0.0, False
            for _ in range(100):
                pose[joint] = q
                advance_robot(plan, numbers, state, drums[k], pose, h, out)
                torque = sign * out[size + effort_place]
                excess = _required(load, q0, v0, q, h, torque0, torque)
                if abs(excess) <= MOTION_TOLERANCE:
                    break
                if excess < 0.0:
                    low, below = q, excess
                else:
                    high, above = q, excess
                steep = slope
                if tried and q != last:
                    steep = max((excess - last_excess) / (q - last), slope)
                last, last_excess, tried = q, excess, True
                q -= excess / steep
                if not low < q < high:
                    q = low - below * (high - low) / (above - below)
                if not low < q < high or q == last:
                    break  # within numerical precision
        else:
            pose[joint] = q
            advance_robot(plan, numbers, state, drums[k], pose, 0.0, out)
        pose_angle = pose[joint]
        if not lower <= pose_angle <= upper:
            return k
        if dt[k] > 0.0:
            v1 = 2.0 * (pose_angle - q0) / dt[k] - v0
            course[2] = (v1 - v0) / dt[k]
            course[1] = v1
        course[0] = pose_angle
        course[3] = sign * out[size + effort_place]
        joints[k, joint] = pose_angle
        residual[k] = excess
        copy_part(out, 0, state)
        copy_part(out, size, estimates[k])
    return dt.size
