"""Breaks, in which a robot may have moved unseen: a restart, a gap, a clock that was set; (U15)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cdrj_ros._core import BOUNDS, MOVED
from cdrj_ros.estimation.estimator import Sample, State, on_axes, step
from cdrj_ros.estimation.model_error import length_share, stiffness
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.prepared import Model, shape_at

UNWATCHED_NS: Final = 100_000_000
"""After a longer time between two runs, the friction history of a moved robot is unknown [ns]."""


@dataclass(frozen=True)
class EarlierRun:
    """The last state of a run, and the angles there."""

    state: State
    motor_angle: Vector
    """[rad], shape (motors,)."""
    joint_angle: Vector
    """[rad], shape (joints,)."""

    def has_moved(self, sample: Sample) -> bool:
        """Whether the robot has moved along an unknown path until the first sample of this run."""
        before = np.concatenate([self.motor_angle, self.joint_angle])
        now = np.concatenate([sample.motor_angle, sample.joint_angle])
        moved = float(np.max(np.abs(now - before), initial=0.0))
        return moved > MOVED and not 0 < sample.stamp_ns - self.state.stamp_ns <= UNWATCHED_NS


class Unseen:
    """Changes of all cables' mean tensions in breaks, until sensors or a reset show the angles."""

    def __init__(self, model: Model) -> None:
        """Begin without any."""
        self.use(model)
        self.changes = self._before = np.zeros(len(model.robot.cables))
        """Their standard deviations [N], shape (cables,)."""

    def use(self, model: Model) -> None:
        """Continue with other numbers of the same robot."""
        self._model, self._share = model, length_share(model)
        self._stiffness = stiffness(model.robot, shape_at(model, model.robot.reference_pose))

    def end(self) -> None:
        """End a break."""
        self._before = self.changes

    def add(self, earlier: EarlierRun, sample: Sample) -> None:
        """Add what the poses before a break and in or after it differ by.

        The robot may have moved meanwhile, or an encoder may have slipped: in a gap of some axes,
        what changes the cables that lead over them.

        Args:
            earlier: the run before the break.
            sample: since then; its standard deviations explain what they are worth.
        """
        there = sample._replace(motor_angle=earlier.motor_angle, joint_angle=earlier.joint_angle)
        stamp_ns = min(earlier.state.stamp_ns, sample.stamp_ns - 1_000_000)
        before = State(stamp_ns, earlier.state.values)
        then, now = (step(self._model, before, one)[1].tension for one in (there, sample))
        weighed = self._share * (now - then)
        if sample.after_gap.size:
            weighed *= on_axes(self._model, sample.after_gap)
        mean = np.abs([weighed[part].sum() for part in self._model.robot.parts])
        if sample.unseen.size:
            mean = np.maximum(mean - BOUNDS * (self._stiffness @ sample.unseen[0]), 0.0)
        self.changes = np.maximum(self.changes, np.hypot(self._before, mean))
