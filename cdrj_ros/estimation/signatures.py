"""Signatures: what every unknown of a robot changes in the estimate now."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.estimation.estimator import NEVER
from cdrj_ros.estimation.unknowns import Unknown
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.packing import constant_views
from cdrj_ros.model.prepared import Model

TICK_NS: Final = 20_000_000
"""Shortest time between two samples at which signatures are renewed [ns]; they follow the pose."""

LONGEST_NS: Final = 1_000_000_000
"""After a longer time without a sample the robots start anew [ns]."""


class Signatures:
    """The signatures of all unknowns,

        s = (robot at plus one unit - robot at minus one unit) / 2.                      (B2)

    Both robots are stepped along with the estimate.  A wide difference in place of a derivative
    shows what an unknown does where it makes cables slack, as in the unscented transform.
    """  # noqa: D415 an equation

    def __init__(
        self, model: Model, unknowns: Sequence[Unknown], columns: NDArray[np.int64]
    ) -> None:
        """Prepare the robots.

        Args:
            model: the robot that the unknowns belong to.
            unknowns: with their robots.
            columns: indices in its estimate of the quantities whose signatures are wanted.
        """
        robots = [one.robots for one in unknowns]
        constants = np.stack([end.constants for one in robots for end in (one.more, one.less)])
        residuals: Any = constant_views(model.sizes, constants).residuals
        residuals["bound"] = 0.0  # the estimate alone is corrected by what its file has learned
        self._shift = np.stack(
            [shift for one in robots for shift in (one.angle_more, one.angle_less)]
        )
        self._robots = _core.Population(model.core, constants)
        self._motors, self._columns = len(model.robot.motors), columns
        self.slopes: Table = np.zeros((len(robots), columns.size))
        """Change of every quantity per unit, (B2), shape (unknowns, columns); a new array whenever
        it is renewed."""
        self._stamp_ns = NEVER

    def reset(self) -> None:
        """Discard the histories of all robots."""
        self._robots.reset()
        self._stamp_ns = NEVER

    def follow(self, stamp_ns: int, motor_angle: Vector, joint_angle: Vector) -> bool:
        """Step the robots, unless too soon.

        Args:
            stamp_ns: of a sample [ns].
            motor_angle: of this robot [rad], shape (motors,).
            joint_angle: of this robot [rad], shape (joints,).

        Returns:
            Whether ``slopes`` is renewed.
        """
        passed = stamp_ns - self._stamp_ns
        if self._stamp_ns != NEVER:
            if 0 <= passed < TICK_NS:
                return False
            if not 0 < passed <= LONGEST_NS:
                self.reset()
        dt = 0.0 if self._stamp_ns == NEVER else passed * 1e-9
        self._stamp_ns = stamp_ns
        angles = np.concatenate([motor_angle, joint_angle]) + self._shift
        values = np.empty((len(angles), self._columns.size))
        for k, own in enumerate(angles):
            _, estimate = self._robots.advance(k, own[: self._motors], own[self._motors :], dt)
            values[k] = estimate[self._columns]
        self.slopes = 0.5 * (values[0::2] - values[1::2])
        return True
