"""The rig, a robot with contact cells and faulty ends, and the truth simulated on it.

Every pulley gets many contact cells, each with its own bristle.  The estimator's cells are equal
parts of an arc and move with it.  Where an end of an arc moves on its body, the rig's cells are
fixed to the body's surface instead: see ``Surfaces`` of the compiled core.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.inspection.poses import pose_text
from cdrj_ros.model.laws import with_pulleys
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import Course, Model, course_of, poses_in_range, prepare
from cdrj_ros.robot.description import Pulley, Robot, Winch
from cdrj_ros.simulation.faults import CableFault, Wiring, wire

BATCH: Final = 1000
"""Samples between two calls of a progress function."""

AT_REST: Final = 1e-9
"""Motion of an arc on its body below which its ends do not move [m]."""

LONGER: Final = 1.05
"""Longest arc for which cells are at hand, relative to that in the sampled poses; the last cell
takes what is longer still."""


@dataclass(frozen=True)
class Truth:
    """The true values of a simulation, on the simulation's time grid."""

    time: Vector
    """[s], shape (n,)."""
    motor_angle: Table
    """Angles as ideal encoders would read them [rad], shape (n, motors)."""
    joint_angle: Table
    """[rad], shape (n, joints)."""
    tension: Table
    """Tensions of all elements of the lumped robot [N], shape (n, elements)."""
    force: NDArray[np.float64]
    """Force of the cable on every pulley [N], shape (n, pulleys, 3), with the components of
    ``Layout.force_x`` to ``force_z``."""
    motor_effort: Table
    """Efforts of the cables on the motors [N m], shape (n, motors)."""
    joint_effort: Table
    """Efforts of the cables on the joints [N m], shape (n, joints)."""
    imbalance: Vector
    """Effort of the cables minus the effort that the balanced joint needs [N m], shape (n,)."""
    unseen: Table
    """Rotation of each faulty end that no encoder measures [rad], shape (n, faulty ends)."""
    notes: tuple[str, ...] = ()
    """Remarks for the user, one sentence each."""

    @property
    def nodal_force(self) -> Table:
        """Magnitude of the cable's force on every pulley [N], (38), shape (n, pulleys)."""
        return np.asarray(np.linalg.norm(self.force, axis=-1))

    @property
    def slack(self) -> NDArray[np.bool_]:
        """Whether each element is slack, shape (n, elements)."""
        return np.asarray(self.tension <= 0.0)


class MotionError(UsageError):
    """A motion that the rig cannot perform."""


class SlackError(MotionError):
    """A motion in which a cable becomes slack."""


@dataclass(frozen=True)
class Rig:
    """A robot, and the finer robot that is simulated for it."""

    lumped: Model
    fine: Model
    wiring: Wiring

    def drums(self, motor_angle: Table) -> Table:
        """Angles of all motors of the fine robot without faults [rad], shape (n, all motors)."""
        faulty = len(self.wiring.robot.motors) - motor_angle.shape[1]
        return np.pad(motor_angle, ((0, 0), (0, faulty)))


def make_rig(robot: Robot, cells: int, faults: Sequence[CableFault] = ()) -> Rig:
    """Divide contacts into cells and add a motor for every faulty end.

    Raises:
        UsageError: an impossible fault.
    """
    wiring = wire(robot, tuple(faults))
    return Rig(prepare(robot), prepare(divide_contacts(wiring.robot, cells)), wiring)


def moment(robot: Robot, time: float, joint_angle: Vector) -> str:
    """A time and the pose then: ``t = 1.2 s, elbow = 20.0°, slide = 0.120 m``."""
    return ", ".join(filter(None, (f"t = {time:.4g} s", pose_text(robot, joint_angle))))


def require_taut(
    rig: Rig, time: Vector, joints: Table, estimates: Table, allow_slack: bool
) -> None:
    """Reject estimates with invalid elements, and with slack elements unless they are allowed.

    Args:
        rig: the rig.
        time: times of the estimates [s]; may be longer.
        joints: joint angles of the estimates, shape (n, joints).
        estimates: estimates of the fine robot, shape (n, fine layout.size).
        allow_slack: whether cables may lose their tension.

    Raises:
        SlackError: a cable is slack, and neither option nor fault allows it.
        UsageError: a cable that cannot be solved.
    """
    robot = rig.lumped.robot
    status = estimates[:, rig.fine.layout.status].astype(np.int64)
    broken = np.argwhere(status & INVALID)
    if broken.size:
        k, element = broken[0]
        name = rig.fine.layout.elements[element].split("/")[0]
        raise UsageError(
            f"cable {name} has no valid state at {moment(robot, time[k], joints[k])}: it is wound "
            "in entirely, or its path is impossible"
        )
    if allow_slack or rig.wiring.faults:
        return
    tension = estimates[:, rig.fine.layout.tension]
    slack = np.argwhere(tension <= 0.0)
    if slack.size:
        k, element = slack[0]
        raise SlackError(
            f"a cable becomes slack: element {rig.lumped.layout.elements[element]} has no tension "
            f"at {moment(robot, time[k], joints[k])}"
        )


def read_out(rig: Rig, estimates: Table) -> tuple[Table, NDArray[np.float64], Table, Table]:
    """Tensions, forces, efforts of motors and of joints, as in ``Truth``.

    Args:
        rig: the rig.
        estimates: of the fine robot, shape (n, fine layout.size).
    """
    layout = rig.fine.layout
    forces = [estimates[:, part] for part in (layout.force_x, layout.force_y, layout.force_z)]
    return (
        estimates[:, layout.tension].copy(),
        np.stack(forces, axis=-1),
        estimates[:, layout.motor_effort][:, : len(rig.lumped.robot.motors)].copy(),
        estimates[:, layout.joint_effort].copy(),
    )


def divide_contacts(robot: Robot, cells: int) -> Robot:
    """The same robot with contact cells on every pulley; an eyelet, which has no arc, stays whole.

    It has no learned corrections: they are differences of a real robot from the model.

    Args:
        robot: the robot.
        cells: number of cells of the longest arc of every pulley.  With one cell, pulleys are
            those of the estimator.

    Raises:
        RobotFileError: the geometry is impossible in the reference pose.
    """
    count = sum(len(cable.pulleys) for cable in robot.cables)
    widths = cells_on_surfaces(robot, cells) if cells > 1 else np.zeros(count)
    fine = with_pulleys(robot, lambda _, pulley, k: _divided(pulley, cells, float(widths[k])))
    return replace(fine, residuals=())


def _divided(pulley: Pulley, cells: int, width: float) -> Pulley:
    if pulley.kind == "eyelet":
        return replace(pulley, cells=1)
    if width > 0.0:  # an arc of n widths covers parts of n + 1 cells
        return replace(pulley, cells=cells + 1, cell_width=width)
    return replace(pulley, cells=cells)


def cells_on_surfaces(robot: Robot, cells: int) -> Vector:
    """Width of every pulley's cells on its surface [m]; 0 where no end of its arc moves on it.

    Args:
        robot: the robot.
        cells: number of cells of the longest arc.
    """
    model = prepare(robot, check_range=False)
    found = course(model, poses_in_range(robot))
    moving = (np.ptp(found.arc, axis=0) > AT_REST) | (np.ptp(found.track, axis=0) > AT_REST)
    moving |= _beside_wandering_drums(robot)
    longest = found.arc.max(axis=0)
    return np.where(moving & (longest > AT_REST), LONGER * longest / cells, 0.0)


def _beside_wandering_drums(robot: Robot) -> NDArray[np.bool_]:
    """Whether each pulley is the neighbour of a drum along which the cable wanders."""
    beside: list[bool] = []
    for cable in robot.cables:
        own = [False] * len(cable.pulleys)
        for k in (0, -1):
            end = cable.nodes[k]
            if own and isinstance(end, Winch) and end.lead != 0.0:
                own[k] = True
        beside += own
    return np.array(beside, dtype=np.bool_)


def course(model: Model, joint_angle: Table) -> Course:
    """Geometry along a motion, with drums at rest.

    Args:
        model: the prepared robot.
        joint_angle: [rad] or [m], shape (n, joints).

    Raises:
        UsageError: the geometry is impossible in one of the poses.
    """
    found, done = course_of(model, joint_angle)
    if done < joint_angle.shape[0]:
        pose = pose_text(model.robot, joint_angle[done])
        raise UsageError(f"the path of a cable is impossible at {pose}")
    return found
