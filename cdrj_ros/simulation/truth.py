"""The truth: a simulated rig carried along a prescribed motion.

The estimator lumps the friction of a pulley into one contact.  In the rig every pulley is a chain
of contact cells with one bristle each, in which sliding and adhesion arcs (Grashof) form.

All joints and motors follow the motion, or one joint obeys a condition instead: the cables balance
a wanted torque on it, or it moves freely.  Each is a rule of ``_core.Stepper``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import listed
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation.assembly import (
    BATCH,
    MotionError,
    Rig,
    Truth,
    make_rig,
    moment,
    read_out,
    require_taut,
)
from cdrj_ros.simulation.drives import Following, follow_joints, pull_together
from cdrj_ros.simulation.faults import CableFault
from cdrj_ros.simulation.load import UNSOLVED, Load, balanced_start

Progress = Callable[[int], None]


SPEEDING_UP: Final = 10.0
"""Default largest acceleration of a motor that balances a joint, by its largest speed [1/s]."""

BALANCED: Final = 1e-6
"""Largest imbalance of a joint that does not wait for its motors [N m]."""

WORTH_SAYING: Final = 0.02
"""Imbalance of a waiting joint above which a note reports it, relative to 1 N m plus its torque."""

WORTH_SAYING_M: Final = 1e-6
"""Change of a cable's length that no motor compensates above which a note reports it [m]."""

SEARCHED: Final = 20.0
"""Half the range of the search for the first motor angle, about that of the joints [rad]."""

SEARCH_POINTS: Final = 40001
"""Number of motor angles in that range."""

NEAR_FIRST: Final = (200, 2000, SEARCH_POINTS // 2)
"""How many of them to either side are tried, until a balance is found."""


def simulate(
    robot: Robot,
    time: Vector,
    joint_angle: Table | None = None,
    joint_torque: Vector | None = None,
    motor_speed: float = 5.0,
    cells: int = 8,
    progress: Progress | None = None,
    *,
    motor_acceleration: float | None = None,
    motor_angle: Table | None = None,
    load: Load | None = None,
    start: float | None = None,
    joint: int = 0,
    faults: Sequence[CableFault] = (),
    allow_slack: bool = False,
) -> Truth:
    """Carry a rig along a motion; every argument is an independent choice.

    It is longer than a screen because the stepper's arrays are carried from batch to batch.

    ``joint_torque`` balances one joint: a single motor turns freely, several follow the joints and
    move in addition by a common amount, in the ratios in which they load the joint.  At a reversal
    friction holds the joint's tensions while the motor takes up the difference along the cable, so
    the joint dwells, as on the real machine; where the motor would be too fast, the motion goes on
    more slowly.  ``load`` releases one joint, which then moves by its dynamics.  With neither, all
    joints follow the motion.

    Args:
        robot: any robot; a joint and a motor are needed to balance, a joint to release.
        time: increasing [s], shape (n,).
        joint_angle: prescribed [rad], shape (n,) for one joint, (n, joints) for several; None for
            the reference pose.  The column of a released joint is ignored.
        joint_torque: torque that the cables must exert on the balanced joint [N m], shape (n,).
        motor_speed: largest speed of a balancing motor [rad/s]; the motion waits for the motor.
        cells: contact cells per pulley.
        progress: called with the number of samples done.
        motor_acceleration: its largest acceleration [rad/s^2]; None: full speed after 0.1 s.
        motor_angle: [rad], shape (n,) or (n, motors); None: the motors follow the joints, so that
            the cables keep their lengths.
        load: load of the released joint.
        start: angle at which it is released at rest [rad]; None for its equilibrium.
        joint: index of the balanced or released joint.
        faults: faults of cables.  While a motor compensates one, a balanced joint waits unbalanced.
        allow_slack: whether cables may lose their tension; with faults they always may.

    Raises:
        SlackError: a cable goes slack.
        UsageError: arguments that exclude each other or do not fit the robot, an impossible
            geometry, no equilibrium or no balance, or a joint that leaves its range.
    """
    _require_one_rule(robot, joint_torque, load, motor_angle)
    _require_course(time)
    rig, n = make_rig(robot, cells, faults), time.size
    reference = robot.reference_pose
    poses = np.tile(reference, (n, 1)) if joint_angle is None else joint_angle
    joints = _columns(poses, n, len(robot.joints), "joint_angle")
    _require_range(robot, joints, None if load is None else joint)
    offset, happening = rig.wiring.offset(time), rig.wiring.during(time)
    stepper = _core.Stepper(rig.fine.core, joint)
    torque = np.zeros(n)
    notes: tuple[str, ...] = ()
    if joint_torque is not None:
        torque = joint_torque * robot.joints[joint].effort_sign
        limits = (motor_speed, motor_acceleration or SPEEDING_UP * motor_speed)
        base = _balance(rig, stepper, joints, torque[0], offset[0], joint, limits)
    elif motor_angle is None:
        following = follow_joints(rig.lumped, joints)
        base, notes = rig.drums(following.motor_angle), _untaken_notes(robot, following)
    else:
        base = rig.drums(_columns(motor_angle, n, len(robot.motors), "motor_angle"))
    if load is not None:
        axis = robot.joints[joint]
        if start is None:
            start = balanced_start(rig, base[0] + offset[0], joints[0], joint, load)
        stepper.release(load.coefficients(), axis.effort_sign, axis.lower, axis.upper)
        stepper.swing = np.array([start, 0.0, 0.0, 0.0])
    dt = np.diff(time, prepend=time[0])
    batch, kept = np.empty((min(n, BATCH), rig.fine.layout.size)), []
    imbalance, motors_out, joints_out = np.empty(n), np.empty_like(base), np.empty_like(joints)
    for begin in range(0, n, BATCH):
        rows = slice(begin, min(begin + BATCH, n))
        done = stepper.run(
            base, joints, torque, dt[rows], offset[rows], happening[rows], motors_out[rows],
            joints_out[rows], imbalance[rows], batch[: rows.stop - begin],
        )  # fmt: skip
        upto = begin + done
        require_taut(rig, time[begin:], joints_out[begin:upto], batch[:done], allow_slack)
        kept.append(read_out(rig, batch[:done]))  # the whole would take 7 kB for every sample
        if upto < rows.stop and joint_torque is not None:
            row = int(stepper.phase)
            when = moment(robot, time[upto], joints[row])
            raise _unbalanced(float(joint_torque[row]), when)
        if upto < rows.stop:
            free = robot.joints[joint]
            raise MotionError(
                f"{free.name} leaves its range [{free.lower:.4g}, {free.upper:.4g}] at t = "
                f"{time[upto]:.4g} s: the cables cannot hold the load there"
            )
        if load is not None:
            _require_solved(robot.joints[joint].name, time[rows], imbalance[rows])
        if progress is not None:
            progress(rows.stop)
    notes += _waiting_notes(time, imbalance, torque)
    motors, unseen = (motors_out[:, : len(robot.motors)], offset[:, len(robot.motors) :])
    tension, force, on_motors, on_joints = map(np.concatenate, zip(*kept, strict=True))
    return Truth(
        time, motors, joints_out, tension, force, on_motors, on_joints, imbalance, unseen, notes
    )


def _require_one_rule(
    robot: Robot, joint_torque: Vector | None, load: Load | None, motor_angle: Table | None
) -> None:
    """Refuse what excludes each other or does not fit the robot."""
    if joint_torque is not None:
        if load is not None or motor_angle is not None:
            raise UsageError("a balanced joint takes neither load nor motor_angle")
        if not robot.motors or not robot.joints:
            raise UsageError("a balanced rig needs at least one motor and one joint")
    if load is not None and not robot.joints:
        raise UsageError("a free joint is needed, and the robot has none")


def _require_course(time: Vector) -> None:
    if time.ndim != 1 or not time.size or not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        raise UsageError("time must be finite, increase, and have the shape (n,)")


def _require_range(robot: Robot, joints: Table, free: int | None) -> None:
    """Refuse angles of prescribed joints that their encoders could not read."""
    for j, axis in enumerate(robot.joints):
        slack = 1e-9 * max(abs(axis.lower), abs(axis.upper))
        outside = (joints[:, j] < axis.lower - slack) | (joints[:, j] > axis.upper + slack)
        if j != free and outside.any():
            raise UsageError(
                f"joint_angle: {axis.name} at {joints[outside, j][0]:.4g} is outside of its range "
                f"[{axis.lower:.4g}, {axis.upper:.4g}]"
            )


def _columns(values: Table, n: int, columns: int, name: str) -> Table:
    """The values in shape (n, columns); a single column may have shape (n,)."""
    shaped = values[:, None] if values.ndim == 1 and columns == 1 else values
    if shaped.shape != (n, columns):
        raise UsageError(f"{name} must have the shape {(n, columns)}, got {values.shape}")
    if not np.isfinite(shaped).all():
        raise UsageError(f"{name} must be finite")
    return np.ascontiguousarray(shaped, dtype=np.float64)


def _untaken_notes(robot: Robot, following: Following) -> tuple[str, ...]:
    """A note on the cables that following motors strain, the worst first."""
    worst = np.abs(following.untaken).max(axis=0)
    order = np.argsort(-worst)[: np.count_nonzero(worst > WORTH_SAYING_M)]
    if not order.size:
        return ()
    most, names = 1e3 * worst[order[0]], listed([robot.cables[c].name for c in order])
    return (f"cables are strained, as no motor compensates up to {most:.3g} mm of them: {names}",)


def _require_solved(name: str, time: Vector, imbalance: Vector) -> None:
    worst = float(np.abs(imbalance).max())
    if not worst <= UNSOLVED:
        raise UsageError(
            f"the motion of {name} could not be solved to better than {worst:.3g} N m within "
            f"{time[0]:.4g} .. {time[-1]:.4g} s: take smaller steps"
        )


def _unbalanced(torque: float, where: str) -> MotionError:
    """The error of a sample for which no motor angle was found."""
    return MotionError(
        f"no winch angle balances {torque:.4g} N m at {where}: a cable would have to push"
    )


def _waiting_notes(time: Vector, imbalance: Vector, torque: Vector) -> tuple[str, ...]:
    """A note if the imbalance of the joint while waiting for its motor exceeds ``WORTH_SAYING``."""
    lacking = np.abs(imbalance)
    worst = float(lacking.max())
    if worst <= WORTH_SAYING * (1.0 + float(np.abs(torque).max())):
        return ()
    note = (
        f"the joint waited for its motor in {int((lacking > BALANCED).sum())} samples, unbalanced "
        f"by up to {worst:.3g} N m (t = {time[np.argmax(lacking)]:.4g} s)"
    )
    return (note,)


def _balance(
    rig: Rig,
    stepper: _core.Stepper,
    joints: Table,
    torque: float,
    offset: Vector,
    joint: int,
    limits: tuple[float, float],
) -> Table:
    """Let the motors balance the joint, from the drive that does so without friction.

    The motors have the angles that are returned, those of all motors of the fine robot [rad],
    shape (n, all motors), plus one unknown, the drive, times the ratios of ``pull_together``.
    Largest speed and acceleration of the drive are given as ``limits``.
    """
    direction = rig.drums(pull_together(rig.lumped, joint)[None])[0]
    if (
        len(rig.lumped.robot.motors) == 1
    ):  # it turns freely, at first near the angle that follows the joint
        base = np.zeros((len(joints), direction.size))
        centre = float(follow_joints(rig.lumped, joints[:1]).motor_angle[0, 0])
    else:
        base, centre = rig.drums(follow_joints(rig.lumped, joints).motor_angle), 0.0
    drive, rising = _first_drive(stepper, base[0] + offset, direction, centre, joints[0], torque)
    stepper.balance(direction, rising, *limits, drive)
    return base


def _first_drive(
    stepper: _core.Stepper,
    base: Vector,
    direction: Vector,
    centre: float,
    joint_angle: Vector,
    torque: float,
) -> tuple[float, float]:
    """Drive that balances the joint without friction, and the sign of d(effort)/d(drive)."""
    searched = centre + np.linspace(-SEARCHED, SEARCHED, SEARCH_POINTS)
    for reach in NEAR_FIRST:
        drives = searched[SEARCH_POINTS // 2 - reach : SEARCH_POINTS // 2 + reach + 1]
        poses = np.tile(joint_angle, (drives.size, 1))
        efforts = stepper.efforts(base + np.multiply.outer(drives, direction), poses) - torque
        crossings = np.flatnonzero(efforts[:-1] * efforts[1:] <= 0.0)
        if crossings.size:
            near = crossings[np.argmin(np.abs(drives[crossings] - centre))]
            return float(drives[near]), float(np.sign(efforts[near + 1] - efforts[near]))
    raise _unbalanced(torque, "the start")
