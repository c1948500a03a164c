"""The rig advanced step by step: motor angles in, truth out.

One joint moves by its dynamics under the cables; the others are held.  Every step is one of the
stepper that carries a whole motion in ``simulation/truth.py``, so the same motor angles give
bit-identical results.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.packing import INVALID, Layout
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation.assembly import make_rig, read_out
from cdrj_ros.simulation.faults import CableFault
from cdrj_ros.simulation.load import UNSOLVED, Load, make_load, resting_start

MOST_TORQUE: Final = 1e4
"""Largest push on a joint [N m], or [N] on a prismatic joint."""

LONGEST_PUSH: Final = 3600.0
"""Longest duration of a push [s]."""


@dataclass(frozen=True)
class LiveSettings:
    """Settings of the rig and its load."""

    load: Load = field(default_factory=lambda: make_load("rolling"))
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
    faults: tuple[CableFault, ...] = ()
    """Faults that happen at their times after the start and after every reset."""


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
            UsageError: no joint, stops outside the range, or an impossible fault.
        """
        self.robot, self.settings = robot, settings or LiveSettings()
        if not robot.motors or not robot.joints:
            raise UsageError("a live rig needs at least one motor and one joint")
        axis = robot.joints[self.settings.joint]
        self.lower = axis.lower if self.settings.lower is None else self.settings.lower
        self.upper = axis.upper if self.settings.upper is None else self.settings.upper
        if not axis.lower <= self.lower < self.upper <= axis.upper:
            raise UsageError(
                f"the stops of {axis.name} must lie within its range [{axis.lower:.4g}, "
                f"{axis.upper:.4g}], the lower one below the upper, got {self.lower:.4g} and "
                f"{self.upper:.4g}"
            )
        self._rig = make_rig(robot, self.settings.cells, self.settings.faults)
        self.load = self.settings.load
        self.reset()

    def reset(self) -> None:
        """Restart at time 0, before all faults; the load and the stops are kept."""
        self.pushes: tuple[Push, ...] = ()
        self.steps = 0
        self.unsolved = 0
        self.stalled = 0
        self.motor_angle = self.robot.reference_motors
        pose = self.robot.reference_pose
        drums = self._rig.drums(self.motor_angle[None])
        start = resting_start(
            self._rig, drums[0], pose, self.settings.joint, self.load, (self.lower, self.upper)
        )
        pose[self.settings.joint] = start
        self.at_stop = start in (self.lower, self.upper)
        self._pose = pose
        self._stepper = _core.Stepper(self._rig.fine.core, self.settings.joint)
        self._stepper.swing = np.array([start, 0.0, 0.0, 0.0])
        self._release()
        self._estimates = np.empty((1, self._rig.fine.layout.size))
        self._imbalance = np.empty(1)
        self._run(self.motor_angle, 0.0)
        self._read()

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self.steps / self.settings.rate

    @property
    def joint_angle(self) -> Vector:
        """Angles of all joints [rad], shape (joints,)."""
        return self._pose.copy()

    @property
    def joint_speed(self) -> float:
        """Speed of the free joint [rad/s]."""
        return float(self._stepper.swing[1])

    @property
    def layout(self) -> Layout:
        """Of ``values``: faulty ends have motors of their own."""
        return self._rig.fine.layout

    def set_load(self, load: Load) -> None:
        """Change the load, effective from the next step."""
        self.load = load
        self._release()

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

    def _release(self) -> None:
        """Let the joint move freely under its load."""
        sign = self.robot.joints[self.settings.joint].effort_sign
        self._stepper.release(self.load.coefficients(), sign, self.lower, self.upper)

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
        dt = now - before
        state, swing, pose = self._stepper.state, self._stepper.swing, self._pose
        if self._advance(motor_angle, dt):
            self.motor_angle = np.array(motor_angle, dtype=np.float64)
            self._read()
            return True
        self.stalled += 1
        self._stepper.state, self._stepper.swing, self._pose = state, swing, pose
        self._hold(float(swing[0]), self.motor_angle, dt)
        if self._valid():
            self._read()
        else:  # the truth does not change
            self._stepper.state = state
        return False

    def _advance(self, motor_angle: Vector, dt: float) -> bool:
        """Advance the joint freely or against a stop; False if a cable cannot follow."""
        self.at_stop = False
        if self._run(motor_angle, dt):
            self.unsolved += int(not abs(self._imbalance[0]) <= UNSOLVED)
            return self._valid()
        angle, speed = self._stepper.swing[:2]
        stop = self.lower if angle - self.lower < self.upper - angle else self.upper
        near = 1e-3 * (self.upper - self.lower) + 3.0 * abs(speed) * dt
        self.at_stop = abs(stop - angle) <= near
        self.unsolved += int(not self.at_stop)
        self._hold(float(stop if self.at_stop else angle), motor_angle, dt)
        return self._valid()

    def _run(self, motor_angle: Vector, dt: float) -> bool:
        """Take a step; returns False and keeps the state if the joint would leave its range."""
        drums = self._rig.drums(motor_angle[None])
        joints = np.empty((1, self._pose.size))
        pushed = np.array([sum(push.torque for push in self.pushes)], dtype=np.float64)
        done = self._stepper.run(
            drums, self._pose[None], pushed,
            np.array([dt]), self._rig.wiring.offset(np.array([self.time_s])),
            np.zeros(1, dtype=np.bool_), np.empty_like(drums), joints, self._imbalance,
            self._estimates,
        )  # fmt: skip
        if done:
            self._pose = joints[0]
        return bool(done)

    def _hold(self, angle: float, motor_angle: Vector, dt: float) -> None:
        """Hold the free joint at an angle for one step and set its speed to zero."""
        joint = self.settings.joint
        self._pose = self._pose.copy()
        self._pose[joint] = angle
        self._stepper.prescribe()
        self._run(motor_angle, dt)
        self._release()
        effort = self._estimates[0, self._rig.fine.layout.joint_effort][joint]
        torque = self.robot.joints[joint].effort_sign * effort
        self._stepper.swing = np.array([angle, 0.0, 0.0, torque])

    def _valid(self) -> bool:
        row, layout = self._estimates[0], self._rig.fine.layout
        status = row[layout.status].astype(np.int64)
        return not np.any(status & INVALID) and bool(np.isfinite(row).all())

    def _read(self) -> None:
        """Store the truth, and tensions [N] and efforts [N m] of it in the robot's order."""
        self.values = self._estimates[0].copy()
        row = (one[0] for one in read_out(self._rig, self._estimates))
        self.tension, _, self.motor_effort, self.joint_effort = row
