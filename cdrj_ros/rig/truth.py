"""Prescribed motion of the rig: at the joints, at the motors, or at both.

The estimator lumps the friction of a pulley into one contact.  In the rig every pulley is a chain
of contact cells with one bristle each, in which sliding and adhesion arcs (Grashof) form.

``simulate`` finds the motor angle at which the cables balance a joint, ``follow`` turns the motors
as a position controller would, and ``prescribe`` takes motor and joint angles.  In
``rig/forward.py`` a joint moves freely.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.mechanism import advance, advance_all
from cdrj_ros.model.packing import plan_views
from cdrj_ros.model.prepared import prepare
from cdrj_ros.model.state import estimate_size, scratch_size, state_size
from cdrj_ros.rig.assembly import (
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
from cdrj_ros.robot.description import Robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Progress = Callable[[int], None]

BALANCE_TOLERANCE: Final = 1e-6
"""Largest imbalance of the joint [N m]."""

WORTH_SAYING: Final = 0.02
"""Imbalance of a waiting joint above which a note reports it, relative to 1 N m plus its torque."""

BATCH: Final = 1000
"""Samples between two reports of progress."""

SEARCHED: Final = 20.0
"""Half the range of the search for the first motor angle, about that of the joints [rad]."""

SEARCH_POINTS: Final = 40001
"""Number of motor angles tried in that range."""


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
    kernel's state is carried from batch to batch.

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
    joints = _columns(joint_angle, n, len(robot.joints), "joint_angle")
    estimates = np.empty((n, fine.layout.size))
    drive, phases, lacking = np.empty(n), np.empty(n, dtype=np.int64), np.empty(n)
    state = np.zeros(fine.state_size)
    dt = np.diff(time, prepend=time[0])
    torque = joint_torque * robot.joints[joint].effort_sign
    offset = rig.wiring.offset(time)
    happening = rig.wiring.during(time)
    base, direction, centre = _drive(rig, joints, joint)
    place = fine.layout.joint_effort.start + joint
    angle, rising = _start(rig, base[0] + offset[0], direction, centre, joints[0], torque[0], place)
    phase, excused = 0, False
    for begin in range(0, n, BATCH):
        end = min(begin + BATCH, n)
        done, angle, phase, excused, asked = _balance(
            fine.plan, fine.numbers, state, angle, rising, phase, excused, joints, torque,
            dt[begin:end], motor_speed, place, base, direction, offset[begin:end],
            happening[begin:end], drive[begin:end], phases[begin:end], lacking[begin:end],
            estimates[begin:end],
        )  # fmt: skip
        require_taut(rig, time[begin:], joints[phases[begin : begin + done]],
                     estimates[begin : begin + done], allow_slack)  # fmt: skip
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
    return read_out(rig, time, motor_angle, joints[phases], estimates, offset, lacking, notes)


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


def follow(
    robot: Robot,
    time: Vector,
    joint_angle: NDArray[np.float64],
    cells: int = 8,
    progress: Progress | None = None,
    *,
    faults: Sequence[Fault] = (),
    allow_slack: bool = False,
) -> Truth:
    """Move the joints as prescribed and the motors so that the cables keep their lengths.

    Arguments and errors are those of ``simulate``.
    """
    joints = _columns(joint_angle, time.size, len(robot.joints), "joint_angle")
    model = prepare(robot)
    following = follow_joints(model, joints)
    notes = []
    for cable, column in zip(robot.cables, following.untaken.T, strict=True):
        worst = float(np.abs(column).max())
        if worst > 1e-6:
            notes.append(
                f"no motor compensates {1e3 * worst:.3g} mm of {cable.name}: the cable is strained"
            )
    return prescribe(
        robot, time, following.motor_angle, joints, cells, progress,
        faults=faults, allow_slack=allow_slack, notes=tuple(notes),
    )  # fmt: skip


def prescribe(
    robot: Robot,
    time: Vector,
    motor_angle: NDArray[np.float64],
    joint_angle: NDArray[np.float64],
    cells: int = 8,
    progress: Progress | None = None,
    *,
    faults: Sequence[Fault] = (),
    allow_slack: bool = False,
    notes: tuple[str, ...] = (),
) -> Truth:
    """Move motors and joints as prescribed and compute tensions and efforts.

    It takes 9 arguments because each is an independent option.

    Args:
        robot: any robot.
        time: increasing [s], shape (n,).
        motor_angle: [rad], shape (n, motors).
        joint_angle: [rad], shape (n, joints).
        cells, progress, faults, allow_slack: as in ``simulate``.
        notes: notes to store in the truth.

    Raises:
        SlackError: a cable goes slack.
        UsageError: the geometry is impossible or a cable is wound in entirely.
    """
    rig = make_rig(robot, cells, faults)
    n = time.size
    motors = _columns(motor_angle, n, len(robot.motors), "motor_angle")
    joints = _columns(joint_angle, n, len(robot.joints), "joint_angle")
    offset = rig.wiring.offset(time)
    drums = rig.drums(motors, offset)
    dt = np.diff(time, prepend=time[0])
    state = np.zeros(rig.fine.state_size)
    estimates = np.empty((n, rig.fine.layout.size))
    for begin in range(0, n, BATCH):
        end = min(begin + BATCH, n)
        advance_all(
            rig.fine.plan, rig.fine.numbers, state, drums[begin:end], joints[begin:end],
            dt[begin:end], estimates[begin:end],
        )  # fmt: skip
        require_taut(rig, time[begin:], joints[begin:end], estimates[begin:end], allow_slack)
        if progress is not None:
            progress(end)
    return read_out(rig, time, motors, joints, estimates, offset, np.zeros(n), notes)


def _columns(values: NDArray[np.float64], n: int, columns: int, name: str) -> Table:
    """The values in shape (n, columns); a single column may have shape (n,)."""
    shaped = values[:, None] if values.ndim == 1 and columns == 1 else values
    if shaped.shape != (n, columns):
        raise UsageError(f"{name} must have the shape {(n, columns)}, got {values.shape}")
    return np.ascontiguousarray(shaped, dtype=np.float64)


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
    place: int,
) -> tuple[float, float]:
    """Drive that balances the joint without friction, and the sign of d(effort)/d(drive)."""
    angles = centre + np.linspace(-SEARCHED, SEARCHED, SEARCH_POINTS)
    efforts = np.empty(angles.size)
    fine = rig.fine
    _scan(fine.plan, fine.numbers, base, direction, angles, joint_angle, place, efforts)
    efforts -= torque
    crossings = np.flatnonzero(efforts[:-1] * efforts[1:] <= 0.0)
    if crossings.size == 0:
        raise MotionError(
            f"no winch angle balances {torque:.4g} N m at the start: a cable would have to push"
        )
    near = crossings[np.argmin(np.abs(angles[crossings] - centre))]
    return float(angles[near]), float(np.sign(efforts[near + 1] - efforts[near]))


@compiled
def _scan(
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
    for k in range(angles.size):
        advance(plan, numbers, state, base + direction * angles[k], joint_angle, 0.0, out)
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
    advance(plan, numbers, state, motor_angle, joint_angle, dt, out)
    return out[state.size + effort_place] - torque


@compiled
def _balance(
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
        state[:] = out[:size]
        estimates[k] = out[size : size + wanted]
    return dt.size, angle, phase, excused, 0.0
