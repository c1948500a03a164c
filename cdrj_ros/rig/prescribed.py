"""Motion of the rig prescribed at the joints and the motors, or at the joints alone.

``prescribe`` takes motor and joint angles; ``follow`` turns the motors as a position controller
would.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import prepare
from cdrj_ros.rig.assembly import (
    BATCH,
    Kept,
    Truth,
    make_rig,
    read_out,
    require_taut,
)
from cdrj_ros.rig.faults import Fault
from cdrj_ros.rig.follow import follow_joints
from cdrj_ros.robot.description import Robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Progress = Callable[[int], None]


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
    joints = columns(joint_angle, time.size, len(robot.joints), "joint_angle")
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
    motors = columns(motor_angle, n, len(robot.motors), "motor_angle")
    joints = columns(joint_angle, n, len(robot.joints), "joint_angle")
    offset = rig.wiring.offset(time)
    drums = rig.drums(motors, offset)
    dt = np.diff(time, prepend=time[0])
    state = np.zeros(rig.fine.state_size)
    batch, kept = np.empty((min(n, BATCH), rig.fine.layout.size)), Kept(rig, n)
    for begin in range(0, n, BATCH):
        end = min(begin + BATCH, n)
        estimates = batch[: end - begin]
        rig.fine.core.run(state, drums[begin:end], joints[begin:end], dt[begin:end], estimates)
        require_taut(rig, time[begin:], joints[begin:end], estimates, allow_slack)
        kept.keep(begin, estimates)
        if progress is not None:
            progress(end)
    return read_out(rig, time, motors, joints, kept, offset, np.zeros(n), notes)


def columns(values: NDArray[np.float64], n: int, columns: int, name: str) -> Table:
    """The values in shape (n, columns); a single column may have shape (n,)."""
    shaped = values[:, None] if values.ndim == 1 and columns == 1 else values
    if shaped.shape != (n, columns):
        raise UsageError(f"{name} must have the shape {(n, columns)}, got {values.shape}")
    return np.ascontiguousarray(shaped, dtype=np.float64)
