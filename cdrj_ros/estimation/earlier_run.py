"""The end of an earlier run, and what may have happened since."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cdrj_ros import _core
from cdrj_ros.estimation.estimator import State, step
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.prepared import Model

UNWATCHED_NS: Final = 100_000_000
"""After a longer time between two runs, the friction history of a moved robot is unknown [ns]."""


@dataclass(frozen=True)
class EarlierRun:
    """The last state of a run, and the angles there."""

    state: State
    motor_angle: Vector | None = None
    """[rad], shape (motors,); None where unknown."""
    joint_angle: Vector | None = None
    """[rad], shape (joints,); None where unknown."""
    uncorrected: Vector | None = None
    """Values of the state without corrections by other sensors; None: those of the state."""

    def has_moved(self, sample: Sample) -> bool:
        """Whether the robot has moved along an unknown path until the first sample of this run."""
        moved = 0.0
        for before, now in (
            (self.motor_angle, sample.motor_angle),
            (self.joint_angle, sample.joint_angle),
        ):
            if before is not None and before.shape == now.shape and now.size:
                moved = max(moved, float(np.max(np.abs(now - before))))
        return moved > _core.MOVED and not 0 < sample.stamp_ns - self.state.stamp_ns <= UNWATCHED_NS

    def pose_change(self, model: Model, sample: Sample) -> Vector:
        """What the difference of the poses is worth in the tensions [N], shape (elements,).

        The robot may have moved meanwhile, or an encoder may have slipped.  0 where the angles of
        the earlier run are unknown.
        """
        motor, joint = self.motor_angle, self.joint_angle
        if motor is None or joint is None:
            return np.zeros(len(model.layout.elements))
        before = State(min(self.state.stamp_ns, sample.stamp_ns - 1_000_000), self.state.values)
        then, now = (
            step(model, before, one)[1].tension
            for one in (sample._replace(motor_angle=motor, joint_angle=joint), sample)
        )
        return np.asarray(now - then)
