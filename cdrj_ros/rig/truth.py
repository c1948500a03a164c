"""Prescribed motion of the rig's joints, one of which the cables balance.

The estimator lumps the friction of a pulley into one contact.  In the rig every pulley is a chain
of contact cells with one bristle each, in which sliding and adhesion arcs (Grashof) form.

``simulate`` finds the motor angle at which the cables balance the joint.  In ``rig/prescribed.py``
the motors are prescribed too, and in ``rig/forward.py`` a joint moves freely.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.rig.assembly import (
    BATCH,
    Kept,
    MotionError,
    Rig,
    Truth,
    joint_text,
    make_rig,
    read_out,
    require_taut,
)
from cdrj_ros.rig.faults import Fault
from cdrj_ros.rig.follow import follow_joints, pull_together
from cdrj_ros.rig.prescribed import Progress, columns
from cdrj_ros.robot.description import Robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


WORTH_SAYING: Final = 0.02
"""Imbalance of a waiting joint above which a note reports it, relative to 1 N m plus its torque."""


SEARCHED: Final = 20.0
"""Half the range of the search for the first motor angle, about that of the joints [rad]."""

SEARCH_POINTS: Final = 40001
"""Number of motor angles in that range."""

NEAR_FIRST: Final = (200, 2000, SEARCH_POINTS // 2)
"""How many of them to either side are tried, until a balance is found."""


def simulate(
    robot: Robot,
    time: Vector,
    joint_angle: NDArray[np.float64],
    joint_torque: Vector,
    motor_speed: float = 5.0,
    cells: int = 8,
    progress: Progress | None = None,
    *,
    joint: int = 0,
    faults: Sequence[Fault] = (),
    allow_slack: bool = False,
) -> Truth:
    """Move the joints as prescribed and turn the motors so that one joint's torques balance.

    A single motor turns freely.  Several motors follow the joints (``follow``), plus a common
    motion in the ratios in which they load the joint.  The other joints are held.  It takes 10
    arguments because each is an independent option, and is longer than a screen because the
    robot's state is carried from batch to batch.

    Args:
        robot: at least one motor and one joint.
        time: increasing [s], shape (n,).
        joint_angle: prescribed [rad], shape (n,) for one joint, (n, joints) for several.
        joint_torque: torque that the cables must exert on the balanced joint [N m], shape (n,).
        motor_speed: largest motor speed [rad/s]; the joint waits for the motor.  At a reversal
            friction holds the joint's tensions while the motor takes up the difference along the
            cable, so the joint dwells, as on the real machine.
        cells: contact cells per pulley.
        progress: called with the number of samples done.
        joint: index of the balanced joint.
        faults: injected faults.  While the motor compensates a fault the joint waits unbalanced.
        allow_slack: whether cables may lose their tension; with faults they always may.

    Raises:
        SlackError: a cable goes slack.
        UsageError: no motor or joint, or a motion that no taut cable can balance.
    """
    if not robot.motors or not robot.joints:
        raise UsageError("a balanced rig needs at least one motor and one joint")
    rig = make_rig(robot, cells, faults)
    fine = rig.fine
    n = time.size
    joints = columns(joint_angle, n, len(robot.joints), "joint_angle")
    batch, kept = np.empty((min(n, BATCH), fine.layout.size)), Kept(rig, n)
    drive, phases, lacking = np.empty(n), np.empty(n, dtype=np.int64), np.empty(n)
    state = np.zeros(fine.state_size)
    dt = np.diff(time, prepend=time[0])
    torque = joint_torque * robot.joints[joint].effort_sign
    offset = rig.wiring.offset(time)
    happening = rig.wiring.during(time)
    base, direction, centre = _drive(rig, joints, joint)
    angle, rising = _start(rig, base[0] + offset[0], direction, centre, joints[0], torque[0], joint)
    phase, excused = 0, False
    for begin in range(0, n, BATCH):
        end = min(begin + BATCH, n)
        done, angle, phase, excused, asked = _core.balance(
            fine.core, state, angle, rising, phase, excused, joints, torque, dt[begin:end],
            motor_speed, joint, base, direction, offset[begin:end], happening[begin:end],
            drive[begin:end], phases[begin:end], lacking[begin:end], batch[: end - begin],
        )  # fmt: skip
        estimates = batch[:done]
        require_taut(
            rig, time[begin:], joints[phases[begin : begin + done]], estimates, allow_slack
        )
        kept.keep(begin, estimates)
        if done < end - begin:
            where = (
                f"{joint_text(robot, joint, joints[phase, joint])}, t = {time[begin + done]:.4g} s"
            )
            raise _unbalanced(where, float(joint_torque[phase]), asked, motor_speed)
        if progress is not None:
            progress(end)
    motors = len(robot.motors)
    motor_angle = base[phases, :motors] + np.multiply.outer(drive, direction[:motors])
    notes = _waiting_notes(time, phases, lacking, torque[phases])
    return read_out(rig, time, motor_angle, joints[phases], kept, offset, lacking, notes)


def _unbalanced(where: str, torque: float, asked: float, motor_speed: float) -> MotionError:
    """The error of a sample for which no motor angle was found."""
    if asked > motor_speed:
        return MotionError(
            f"the motion needs a motor speed of {asked:.3g} rad/s at {where}, above the limit of "
            f"{motor_speed:.3g} rad/s: move more slowly or raise the limit"
        )
    return MotionError(
        f"no winch angle balances {torque:.4g} N m at {where}: a cable would have to push"
    )


def _waiting_notes(
    time: Vector, phases: NDArray[np.int64], lacking: Vector, torque: Vector
) -> tuple[str, ...]:
    """A note if the imbalance of the joint while waiting for its motor exceeds ``WORTH_SAYING``."""
    waiting = np.diff(phases, prepend=-1) == 0
    worst = float(np.abs(lacking[waiting]).max(initial=0.0))
    if worst <= WORTH_SAYING * (1.0 + float(np.abs(torque).max())):
        return ()
    at = time[waiting][np.argmax(np.abs(lacking[waiting]))]
    note = (
        f"the joint waited for its motor in {int(waiting.sum())} samples, unbalanced by up to "
        f"{worst:.3g} N m (t = {at:.4g} s)"
    )
    return (note,)


def _drive(rig: Rig, joints: Table, joint: int) -> tuple[Table, Vector, float]:
    """Motor angles as ``base`` plus ``direction`` times one unknown, the drive.

    Returns:
        ``base`` [rad], shape (n, all motors of the fine robot), ``direction`` [-], shape (all
        motors,), and the drive about which the first one is sought [rad].
    """
    robot, owner = rig.lumped.robot, rig.wiring.owner
    direction = np.where(owner >= 0, pull_together(rig.lumped, joint)[owner], 0.0)
    if len(robot.motors) == 1:
        base = np.zeros((joints.shape[0], owner.size))
        start = follow_joints(rig.lumped, joints[:1]).motor_angle
        return base, direction, float(start[0, 0])
    motors = follow_joints(rig.lumped, joints).motor_angle
    base = np.where(owner >= 0, motors[:, owner], 0.0)
    return np.ascontiguousarray(base), direction, 0.0


def _start(
    rig: Rig,
    base: Vector,
    direction: Vector,
    centre: float,
    joint_angle: Vector,
    torque: float,
    joint: int,
) -> tuple[float, float]:
    """Drive that balances the joint without friction, and the sign of d(effort)/d(drive)."""
    searched = centre + np.linspace(-SEARCHED, SEARCHED, SEARCH_POINTS)
    for reach in NEAR_FIRST:
        angles = searched[SEARCH_POINTS // 2 - reach : SEARCH_POINTS // 2 + reach + 1]
        efforts = np.empty(angles.size)
        _core.scan(rig.fine.core, base, direction, angles, joint_angle, joint, efforts)
        efforts -= torque
        crossings = np.flatnonzero(efforts[:-1] * efforts[1:] <= 0.0)
        if crossings.size:
            near = crossings[np.argmin(np.abs(angles[crossings] - centre))]
            return float(angles[near]), float(np.sign(efforts[near + 1] - efforts[near]))
    raise MotionError(
        f"no winch angle balances {torque:.4g} N m at the start: a cable would have to push"
    )
