"""The rig advanced step by step: motor angles in, truth out, with the physics of ``swing``.

One joint moves by its dynamics under the cables; the others are held.  Every step runs the function
that ``swing`` runs over a whole recording, so the same motor angles give bit-identical results.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.joint import RollingLoad
from cdrj_ros.model.prepared import Model
from cdrj_ros.model.status import INVALID
from cdrj_ros.rig.assembly import Rig, make_rig
from cdrj_ros.rig.faults import Fault, wire
from cdrj_ros.rig.forward import UNSOLVED
from cdrj_ros.rig.live_faults import Breakable, FaultName, possible_faults
from cdrj_ros.rig.load import WEIGHT, Load
from cdrj_ros.rig.start import resting_start
from cdrj_ros.robot.description import Robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

MOST_TORQUE: Final = 1e4
"""Largest push on a joint [N m], or [N] on a prismatic joint."""

LONGEST_PUSH: Final = 3600.0
"""Longest duration of a push [s]."""

COURSE_ANGLE, COURSE_SPEED, COURSE_ACCELERATION, COURSE_TORQUE, COURSE_SIZE = range(5)
"""Indices into the ``course`` array of ``_core.swing``."""


@dataclass(frozen=True)
class LiveSettings:
    """Settings of the rig and its load."""

    load: Load = field(default_factory=lambda: Load(RollingLoad()))
    """Load of the free joint."""
    cells: int = 8
    """Contact cells per pulley."""
    rate: float = 1000.0
    """Steps per second of simulated time [Hz]."""
    joint: int = 0
    """The joint that moves freely; the others are held in the reference pose."""
    lower: float | None = None
    """Lower end stop of the free joint [rad] or [m]; None for the end of its range."""
    upper: float | None = None
    """Upper end stop [rad] or [m]; None for the end of its range."""
    start: float | None = None
    """Angle at which the joint is released at rest [rad]; None for its equilibrium or end stop."""


@dataclass(frozen=True)
class Push:
    """An external torque on the free joint."""

    torque: float
    """Torque along positive joint angle [N m], or force [N] on a prismatic joint."""
    end_s: float
    """End of the push in simulated time [s]."""


class LiveRig:
    """The rig and its current state.

    ``step`` takes the motors' next angles.  All arrays that it returns are new.
    """

    def __init__(self, robot: Robot, settings: LiveSettings | None = None) -> None:
        """Put the rig at rest: motors at their reference angles, the joint held or on a stop.

        Raises:
            UsageError: no joint, or stops outside the range.
        """
        self.robot = robot
        self.settings = _checked(robot, settings or LiveSettings())
        possible = possible_faults(robot)
        rig = make_rig(robot, self.settings.cells, possible)
        self._breakable = Breakable.of(robot, rig.wiring)
        self._sound: Rig = replace(rig, wiring=replace(rig.wiring, faults=(), turn=np.empty(0)))
        self.load = self.settings.load
        axis = robot.joints[self.settings.joint]
        self.lower = axis.lower if self.settings.lower is None else self.settings.lower
        self.upper = axis.upper if self.settings.upper is None else self.settings.upper
        self._sign = float(axis.effort_sign)
        self._effort_place = rig.fine.layout.joint_effort.start + self.settings.joint
        self.reset()

    def reset(self) -> None:
        """Remove all faults and restart at time 0; the load and the stops are kept."""
        robot, fine = self.robot, self._sound.fine
        motors = np.array([motor.reference_angle for motor in robot.motors])
        joints = np.array([[joint.reference_angle for joint in robot.joints]])
        drums = self._sound.drums(motors[None], self._sound.wiring.offset(np.zeros(1)))
        coefficients = self.load.coefficients()
        start = self.settings.start
        if start is None:
            start = resting_start(
                self._sound, drums[0], joints[0], self.settings.joint, coefficients,
                (self.lower, self.upper),
            )  # fmt: skip
        joints[0, self.settings.joint] = start
        self._rig: Rig = self._sound
        self._coefficients = coefficients
        self._free: tuple[str, ...] = ()
        self.pushes: tuple[Push, ...] = ()
        self.steps = 0
        self.unsolved = 0
        self.stalled = 0
        self.at_stop = start in (self.lower, self.upper)
        self.motor_angle = motors
        self._joints = joints
        self._state = np.zeros(fine.state_size)
        self._course = np.zeros(COURSE_SIZE)
        self._course[COURSE_ANGLE] = start
        self._estimates = np.empty((1, fine.layout.size))
        self._residual = np.empty(1)
        self._swing(drums, np.zeros(1))
        self._read()

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self.steps / self.settings.rate

    @property
    def joint_angle(self) -> Vector:
        """Angles of all joints [rad], shape (joints,)."""
        return self._joints[0].copy()

    @property
    def joint_speed(self) -> float:
        """Speed of the free joint [rad/s]."""
        return float(self._course[COURSE_SPEED])

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Faults injected since the last reset."""
        return tuple(fault for _, fault in self._rig.wiring.faults)

    @property
    def push_torque(self) -> float:
        """Sum of the pushes on the free joint now [N m]."""
        return sum(push.torque for push in self.pushes)

    def set_load(self, load: Load) -> None:
        """Change the load, effective from the next step."""
        self._coefficients = load.coefficients()
        self.load = load

    def push(self, torque: float, duration_s: float) -> None:
        """Push on the free joint from the next step on, in addition to other pushes.

        Raises:
            UsageError: a torque or duration out of its range.
        """
        if not abs(torque) <= MOST_TORQUE:
            raise UsageError(f"torque must be in [-{MOST_TORQUE:g}, {MOST_TORQUE:g}], got {torque}")
        if not 0.0 < duration_s <= LONGEST_PUSH:
            raise UsageError(f"duration must be in (0, {LONGEST_PUSH:g}] s, got {duration_s}")
        self.pushes = (*self.pushes, Push(torque, self.time_s + duration_s))

    def break_cable(self, name: FaultName, cable: str, amount: float | None = None) -> str:
        """Inject a fault now.

        Args:
            name: name of the fault.
            cable: name of the faulty cable.
            amount: length of cable [m] for ``slack`` and ``snap``, angle of the drum [rad] for
                ``slip``; None for the default.  A cut takes no amount.

        Returns:
            A description of the fault.

        Raises:
            UsageError: an unknown fault or cable, or an impossible amount.
        """
        motor, fault = self._breakable.fault(name, cable, amount, self.time_s)
        if name == "cut":
            self._rig = replace(self._rig, fine=self._without_friction(cable))
        before = self._rig.wiring
        wiring = replace(
            before,
            faults=(*before.faults, (motor, fault)),
            turn=np.concatenate([before.turn, wire(self.robot, (fault,)).turn]),
        )
        self._rig = replace(self._rig, wiring=wiring)
        unit = "rad of drum" if name == "slip" else "m of cable"
        return f"{name} of {cable}: {fault.amount:.4g} {unit}, at t = {fault.begin:.4g} s"

    def _without_friction(self, cable: str) -> Model:
        """The fine robot without friction in one cable, since a loose cable has none.

        With friction the solver would need thousands of iterations for a cable without tension.
        """
        names = [*self._free, cable]
        self._free = tuple(dict.fromkeys(names))
        cables = tuple(
            replace(one, law="none") if one.name in self._free else one for one in self.robot.cables
        )
        robot = replace(self.robot, cables=cables)
        return make_rig(robot, self.settings.cells, possible_faults(self.robot)).fine

    def step(self, motor_angle: Vector) -> bool:
        """Advance by one step, turning the motors to ``motor_angle`` [rad], shape (motors,).

        If a cable cannot follow (it is wound in entirely, or its path is impossible), motors and
        joint do not move and ``stalled`` is incremented.

        Returns:
            Whether the motors turned to these angles.
        """
        before = self.time_s
        self.steps += 1
        now = self.time_s
        self.pushes = tuple(push for push in self.pushes if push.end_s > before)
        dt = np.array([now - before])
        state, course, joints = self._state.copy(), self._course.copy(), self._joints.copy()
        if self._advance(self._drums(motor_angle, now), dt):
            self.motor_angle = np.array(motor_angle, dtype=np.float64)
            self._read()
            return True
        self.stalled += 1
        self._state, self._course, self._joints = state.copy(), course, joints
        self._hold(float(course[COURSE_ANGLE]), self._drums(self.motor_angle, now), dt)
        if self._valid():
            self._read()
        else:  # the truth does not change
            self._state = state
        return False

    def _drums(self, motor_angle: Vector, now: float) -> Table:
        """Angles of the fine robot's motors, shape (1, all motors)."""
        offset = self._rig.wiring.offset(np.array([now]))
        return self._rig.drums(motor_angle[None], offset)

    def _advance(self, drums: Table, dt: Vector) -> bool:
        """Advance the joint freely or against a stop; False if a cable cannot follow."""
        self.at_stop = False
        if self._swing(drums, dt):
            self.unsolved += int(not abs(self._residual[0]) <= UNSOLVED)
            return self._valid()
        angle, speed = self._course[COURSE_ANGLE], self._course[COURSE_SPEED]
        stop = self.lower if angle - self.lower < self.upper - angle else self.upper
        near = 1e-3 * (self.upper - self.lower) + 3.0 * abs(speed) * float(dt[0])
        self.at_stop = abs(stop - angle) <= near
        self.unsolved += int(not self.at_stop)
        self._hold(float(stop if self.at_stop else angle), drums, dt)
        return self._valid()

    def _swing(self, drums: Table, dt: Vector) -> bool:
        """Advance the free joint; returns False and keeps the state if it would leave its range."""
        fine, settings = self._rig.fine, self.settings
        coefficients = self._coefficients
        if self.pushes:
            coefficients = coefficients.copy()
            coefficients[WEIGHT] -= self.push_torque
        done = _core.swing(
            fine.core, self._state, self._course, coefficients, settings.joint, self._sign,
            self.lower, self.upper, drums, self._joints, dt, self._residual, self._estimates,
        )  # fmt: skip
        return bool(done == 1)

    def _hold(self, angle: float, drums: Table, dt: Vector) -> None:
        """Hold the free joint at an angle for one step and set its speed to zero."""
        fine = self._rig.fine
        self._joints[0, self.settings.joint] = angle
        fine.core.run(self._state, drums, self._joints, dt, self._estimates)
        torque = self._sign * float(self._estimates[0, self._effort_place])
        self._course[:] = (angle, 0.0, 0.0, torque)

    def _valid(self) -> bool:
        row, layout = self._estimates[0], self._rig.fine.layout
        status = row[layout.status].astype(np.int64)
        return not np.any(status & INVALID) and bool(np.isfinite(row).all())

    def _read(self) -> None:
        """Store the results in the robot's own order, as ``read_out`` does."""
        row, layout = self._estimates[0], self._rig.fine.layout
        self.tension = row[layout.tension].copy()
        """Tensions of all elements [N], shape (elements,)."""
        parts = (layout.force_x, layout.force_y, layout.force_z)
        self.force = np.stack([row[part] for part in parts], axis=-1)
        """Force of the cable on every pulley [N], shape (pulleys, 3), as ``Truth.force``."""
        every = row[layout.motor_effort]
        owner = self._rig.wiring.owner
        self.motor_effort = every[: len(self.robot.motors)].copy()
        """Efforts of the cables on the motors [N m], shape (motors,)."""
        for end in range(len(self.robot.motors), owner.size):
            if owner[end] >= 0:
                self.motor_effort[owner[end]] += every[end]
        self.joint_effort = row[layout.joint_effort].copy()
        """Efforts of the cables on the joints [N m], shape (joints,)."""


def _checked(robot: Robot, settings: LiveSettings) -> LiveSettings:
    if not robot.motors or not robot.joints:
        raise UsageError("a live rig needs at least one motor and one joint")
    if not 0 <= settings.joint < len(robot.joints):
        raise UsageError(f"joint must be in [0, {len(robot.joints) - 1}], got {settings.joint}")
    if not 1 <= settings.cells <= 200:
        raise UsageError(f"cells must be in [1, 200], got {settings.cells}")
    if not 10.0 <= settings.rate <= 1e5:
        raise UsageError(f"rate must be in [10, 1e5] Hz, got {settings.rate:g}")
    axis = robot.joints[settings.joint]
    lower = axis.lower if settings.lower is None else settings.lower
    upper = axis.upper if settings.upper is None else settings.upper
    if not axis.lower <= lower < upper <= axis.upper:
        raise UsageError(
            f"the stops of {axis.name} must lie within its range [{axis.lower:.4g}, "
            f"{axis.upper:.4g}], the lower one below the upper, got {lower:.4g} and {upper:.4g}"
        )
    if settings.start is not None and not lower <= settings.start <= upper:
        raise UsageError(
            f"start must lie between the stops [{lower:.4g}, {upper:.4g}], got {settings.start:g}"
        )
    return settings
