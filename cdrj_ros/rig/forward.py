"""Forward simulation: the motors move as prescribed, and one joint moves by its dynamics.

Every step solves for the joint's next angle with the cables' torque at both ends of the step
(trapezoidal rule): cables are stiff, and an explicit step would be unstable for a light joint.
Without friction and damping the rule conserves the energy of a linear spring exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.rig.assembly import BATCH, Kept, MotionError, Truth, make_rig, read_out, require_taut
from cdrj_ros.rig.faults import Fault
from cdrj_ros.rig.load import Load
from cdrj_ros.rig.prescribed import Progress
from cdrj_ros.rig.start import balanced_start
from cdrj_ros.robot.description import Robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

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
    the state is carried from batch to batch.

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
        done = _core.swing(
            fine.core, state, course, coefficients, joint, axis.effort_sign, axis.lower,
            axis.upper, drums[begin:end], joints[begin:end], dt[begin:end], residual[begin:end],
            batch[: end - begin],
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
