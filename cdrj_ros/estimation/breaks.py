"""Breaks, in which a robot may have moved unseen: a restart, a gap, a clock that was set; (U15)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import BOUNDS, MOVED
from cdrj_ros.estimation.estimator import Sample, State, on_axes
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
    tension: Vector
    """As ``Unseen.known``."""

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
        self._waiting = np.zeros(self.changes.size, bool)
        """Cables to compare with them once all of their axes are read, shape (cables,)."""

    def use(self, model: Model) -> None:
        """Continue with other numbers of the same robot."""
        self._model, self._share = model, length_share(model)
        self._stiffness = stiffness(model.robot, shape_at(model, model.robot.reference_pose))

    def end(self) -> None:
        """End the breaks of all cables that do not wait."""
        if self._waiting.any():
            self._before = np.where(self._waiting, self._before, self.changes)
        else:
            self._before = self.changes

    def end_run(self, tension: Vector) -> None:
        """Begin after an earlier run, with what it has ``known``: all cables wait."""
        self.known, self._waiting = tension, np.ones_like(self._waiting)

    def is_due(self, sample: Sample) -> bool:
        """Whether a cable is after a gap, or waits and all of its axes are read again."""
        if sample.after_gap.size:
            return True
        if not self._waiting.any():
            return False
        return bool((self._waiting & ~self._over(np.isnan(sample.angles))).any())

    def _over(self, axes: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The cables over some axes, shape (cables,)."""
        return self._with(on_axes(self._model, axes))

    def _with(self, elements: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The cables of some elements, shape (cables,)."""
        return np.array([elements[part].any() for part in self._model.robot.parts])

    def note(self, last: Sample, tension: Vector, status: Vector) -> None:
        """Remember the tensions of all elements, but those over axes that are in a gap.

        Args:
            last: the last sample.
            tension: by the model at the last samples [N], shape (n, elements).
            status: flags, likewise.
        """
        open_still = self._waiting | self._over(last.after_gap)
        valid = (status.astype(np.uint8) & INVALID) == 0
        valid &= ~self._model.robot.per_element(open_still)
        row = len(valid) - 1 - np.argmax(valid[::-1], axis=0)
        there = np.take_along_axis(tension, row[None], axis=0)[0]
        self.known = np.where(valid.any(axis=0), there, self.known)
        self._waiting = self._waiting | self._over(np.isnan(last.angles))

    def add(self, tension: Vector, status: Vector, sample: Sample) -> None:
        """Add what tensions before a break and after it differ by, where it is due.

        The robot may have moved meanwhile, or an encoder may have slipped: in a gap of some axes,
        what changes the cables that lead over them.  Cables that are not solved wait.

        Args:
            tension: of all elements [N].
            status: flags, likewise.
            sample: theirs; its standard deviations explain what they are worth.
        """
        in_gap = self._over(sample.after_gap)
        unsolved = self._with((status.astype(np.uint8) & INVALID) != 0)
        concerned = self._waiting | in_gap
        weighed = np.nan_to_num(self._share * (tension - self.known))
        mean = np.abs([weighed[part].sum() for part in self._model.robot.parts])
        mean *= concerned & ~unsolved
        if sample.unseen.size:
            mean = np.maximum(mean - BOUNDS * (self._stiffness @ sample.unseen[0]), 0.0)
        self.changes = np.maximum(self.changes, np.hypot(self._before, mean))
        self._waiting = concerned & unsolved
        self._before = np.where(self._waiting | in_gap, self._before, self.changes)
