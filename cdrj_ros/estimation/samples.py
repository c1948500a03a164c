"""Encoder readings of all motors and joints, brought to one time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Vector

ALL_SEEN: Vector = _core.ALL_SEEN
"""``Sample.unseen`` where every axis was read often enough: all deviations are zero."""

NONE_CHANGED: Vector = _core.NONE_CHANGED
"""``Sample.offset`` where it is that of the sample before."""

NO_ROWS: NDArray[np.int64] = np.empty(0, dtype=np.int64)
NO_OFFSETS: Vector = np.empty((0, 0, 0))

ALL_SEEN_OVER_TIME: Vector = np.empty((0, 0, 0))
"""``Samples.unseen`` where all deviations of all samples are zero."""

NO_DOUBTS: NDArray[np.bool_] = np.empty(0, dtype=np.bool_)
"""``Samples.doubtful`` where no sample is doubtful."""


class Sample(NamedTuple):
    """Encoder readings of all motors and joints at one time."""

    stamp_ns: int
    """Time since the clock's epoch [ns]."""
    motor_angle: Vector
    """[rad], shape (motors,), in the robot's order."""
    joint_angle: Vector
    """[rad], shape (joints,), in the robot's order."""
    unseen: Vector = ALL_SEEN
    """Standard deviations due to sparse readings, of motors, then joints [rad], shape (2, axes).

    Row 0: at the sample's time.  Row 1: midway between the sample before and this one; infinite
    where the motion between them is unknown.  Shape (0, 0) where all are zero.
    """
    offset: Vector = NONE_CHANGED
    """Standard deviations of lasting errors that the readings do not show, of motors, then joints
    [rad], shape (3, axes).

    Row 0: of offsets, (C9).  Row 1: of what errors of their clocks are worth, (C10).  Row 2: of how
    much that has differed so far, (C11).  Shape (0, 0) where they are those of the sample before.
    """
    doubtful: bool = False
    """Whether an angle may be wrong because the readings of its sensor have stepped."""
    predicted: bool = False
    """Whether an angle is extrapolated.  The next sample that is not predicted follows the last one
    that was not, and may be earlier than this one."""
    silent: bool = False
    """Whether its estimate is not given out, because a predicted sample was at least as late."""


@dataclass(frozen=True)
class Samples:
    """Encoder readings over time."""

    stamp_ns: NDArray[np.int64]
    """Increasing [ns], shape (n,)."""
    motor_angle: NDArray[np.float64]
    """[rad], shape (n, motors)."""
    joint_angle: NDArray[np.float64]
    """[rad], shape (n, joints)."""
    unseen: NDArray[np.float64] = field(default_factory=lambda: ALL_SEEN_OVER_TIME)
    """As ``Sample.unseen``, shape (n, 2, axes); (0, 0, 0) where all are zero."""
    doubtful: NDArray[np.bool_] = field(default_factory=lambda: NO_DOUBTS)
    """As ``Sample.doubtful``, shape (n,); (0,) where all are false."""

    offset_rows: NDArray[np.int64] = field(default_factory=lambda: NO_ROWS)
    """The samples at which the offsets' standard deviations change, increasing, shape (k,)."""
    offset: NDArray[np.float64] = field(default_factory=lambda: NO_OFFSETS)
    """As ``Sample.offset`` of these, shape (k, 3, axes)."""

    def part(self, where: slice) -> Samples:
        """A slice of the samples, as views."""
        unseen = self.unseen[where] if len(self.unseen) else self.unseen
        doubtful = self.doubtful[where] if len(self.doubtful) else self.doubtful
        begin, end, _ = where.indices(self.stamp_ns.size)
        here = slice(*np.searchsorted(self.offset_rows, (begin, end)))
        return Samples(
            self.stamp_ns[where],
            self.motor_angle[where],
            self.joint_angle[where],
            unseen,
            doubtful,
            self.offset_rows[here] - begin,
            self.offset[here],
        )

    def at(self, k: int) -> Sample:
        """One sample, as views."""
        unseen = self.unseen[k] if len(self.unseen) else ALL_SEEN
        doubtful = bool(self.doubtful[k]) if len(self.doubtful) else False
        changed = self.offset[self.offset_rows == k]
        offset = changed[0] if len(changed) else NONE_CHANGED
        return Sample(
            int(self.stamp_ns[k]),
            self.motor_angle[k],
            self.joint_angle[k],
            unseen,
            offset,
            doubtful,
        )
