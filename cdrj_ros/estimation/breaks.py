"""Breaks, in which a robot may have moved unseen: a restart, a gap, a clock that was set; (U15)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import BOUNDS, MOVED
from cdrj_ros.estimation.estimator import Estimate, Sample, State, on_axes, step
from cdrj_ros.estimation.model_error import length_share, stiffness
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.packing import INVALID
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
        moved = float(np.nanmax(np.abs(now - before), initial=0.0))
        return moved > MOVED and not 0 < sample.stamp_ns - self.state.stamp_ns <= UNWATCHED_NS


class Unseen:
    """Changes of all cables' mean tensions in breaks, until sensors or a reset show the angles."""

    def __init__(self, model: Model) -> None:
        """Begin without any."""
        self.use(model)
        self.changes = self._before = np.zeros(len(model.robot.cables))
        """Their standard deviations [N], shape (cables,)."""
        self.known = np.full(len(model.layout.elements), np.nan)
        """Tensions when they were last known, before the gaps in progress [N]; NaN: never."""

    def use(self, model: Model) -> None:
        """Continue with other numbers of the same robot."""
        self._model, self._share = model, length_share(model)
        self._stiffness = stiffness(model.robot, shape_at(model, model.robot.reference_pose))

    def end(self) -> None:
        """End a break."""
        self._before = self.changes

    def note(self, after_gap: NDArray[np.bool_], tension: Vector, status: Vector) -> None:
        """Remember the tensions of all elements, but those over axes that are in a gap.

        Args:
            after_gap: as of the last sample.
            tension: by the model at the last samples [N], shape (n, elements).
            status: flags, likewise.
        """
        valid = (status.astype(np.uint8) & INVALID) == 0
        if after_gap.size:
            valid &= ~on_axes(self._model, after_gap)
        last = len(valid) - 1 - np.argmax(valid[::-1], axis=0)
        there = np.take_along_axis(tension, last[None], axis=0)[0]
        self.known = np.where(valid.any(axis=0), there, self.known)

    def end_run(self, earlier: EarlierRun, sample: Sample) -> Vector:
        """Begin after an earlier run; returns what its state is at the first sample of this one."""
        there = sample._replace(motor_angle=earlier.motor_angle, joint_angle=earlier.joint_angle)
        stamp_ns = min(earlier.state.stamp_ns, sample.stamp_ns - 1_000_000)
        before = State(stamp_ns, earlier.state.values)
        self.known, now = (_tensions(step(self._model, before, one)[1]) for one in (there, sample))
        return now

    def add(self, now: Vector, sample: Sample) -> None:
        """Add what tensions before a break and in or after it differ by.

        The robot may have moved meanwhile, or an encoder may have slipped: in a gap of some axes,
        what changes the cables that lead over them.

        Args:
            now: tensions of all elements [N].
            sample: theirs; its standard deviations explain what they are worth.
        """
        weighed = np.nan_to_num(self._share * (now - self.known))
        if sample.after_gap.size:
            weighed *= on_axes(self._model, sample.after_gap)
        mean = np.abs([weighed[part].sum() for part in self._model.robot.parts])
        if sample.unseen.size:
            mean = np.maximum(mean - BOUNDS * (self._stiffness @ sample.unseen[0]), 0.0)
        self.changes = np.maximum(self.changes, np.hypot(self._before, mean))


def _tensions(estimate: Estimate) -> Vector:
    """Of all elements [N]; NaN where they are not solved."""
    return np.where(estimate.status.astype(np.uint8) & INVALID, np.nan, estimate.tension)
