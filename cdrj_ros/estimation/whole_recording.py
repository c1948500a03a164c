"""Conditioning of a whole recording: its readings take the way of single messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.estimation.conditioner import Conditioner
from cdrj_ros.estimation.reading_limits import axes_of
from cdrj_ros.estimation.samples import ALL_SEEN_OVER_TIME, NO_DOUBTS, Samples
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.robot.description import Robot

PIECE: Final = 65_536
"""Readings taken at a time; the results do not depend on it."""


@dataclass(frozen=True)
class Conditioned:
    """The samples of a whole recording, and how many readings were refused."""

    segments: tuple[Samples, ...]
    """One segment, or several if the clock went back between them; none is empty."""
    refused: Mapping[str, int]
    accepted: int
    clock_jumps: int
    gaps: int
    steps: int = 0


class _Piece(NamedTuple):
    """Consecutive samples, see ``_core.Recording.advance``."""

    after_jump: bool
    stamp_ns: NDArray[np.int64]
    motor_angle: NDArray[np.float64]
    joint_angle: NDArray[np.float64]
    unseen_rows: NDArray[np.uint64]
    unseen: NDArray[np.float64]
    offset_rows: NDArray[np.uint64]
    offset: NDArray[np.float64]
    doubtful: NDArray[np.uint64]


def condition(
    robot: Robot,
    motors: Mapping[str, Series],
    joints: Mapping[str, Series],
) -> Conditioned:
    """Condition a recording, reading by reading in order of arrival.

    No sample is predicted: nothing lags in a recording.

    Args:
        robot: names, sensors and limits of the channels.
        motors: readings by name, of every motor of the robot.
        joints: readings by name, of every joint of the robot.

    Returns:
        The samples, and how many readings were refused.
    """
    conditioner = Conditioner(robot)
    recording = _core.Recording(
        conditioner,
        [
            (topic, name, readings.stamp_ns, readings.log_ns, readings.value)
            for topic, channels in ((_core.Topic.MOTORS, motors), (_core.Topic.JOINTS, joints))
            for name, readings in channels.items()
        ],
    )
    segments: list[list[_Piece]] = [[]]
    while not recording.is_over:
        for piece in map(_Piece._make, recording.advance(PIECE)):
            if piece.after_jump:
                segments.append([])
            if piece.stamp_ns.size:
                segments[-1].append(piece)
    return Conditioned(
        tuple(_joined(pieces) for pieces in segments if pieces),
        conditioner.refused,
        conditioner.accepted,
        conditioner.clock_jumps,
        conditioner.gaps,
        conditioner.steps,
    )


def _joined(pieces: list[_Piece]) -> Samples:
    """The samples of all pieces, of which none is kept: an hour of samples takes much memory."""
    n = sum(piece.stamp_ns.size for piece in pieces)
    motors, joints = pieces[0].motor_angle.shape[1], pieces[0].joint_angle.shape[1]
    stamp_ns = np.empty(n, dtype=np.int64)
    motor_angle, joint_angle = np.empty((n, motors)), np.empty((n, joints))
    unseen, doubtful = ALL_SEEN_OVER_TIME, NO_DOUBTS
    rows, offsets = [], []
    if any(piece.unseen_rows.size for piece in pieces):
        unseen = np.zeros((n, 2, motors + joints))
    if any(piece.doubtful.size for piece in pieces):
        doubtful = np.zeros(n, dtype=np.bool_)
    pieces.reverse()
    begin = 0
    while pieces:
        piece = pieces.pop()
        here = slice(begin, begin + piece.stamp_ns.size)
        stamp_ns[here] = piece.stamp_ns
        motor_angle[here], joint_angle[here] = piece.motor_angle, piece.joint_angle
        if piece.unseen_rows.size:
            unseen[here][piece.unseen_rows] = piece.unseen
        rows.append(begin + piece.offset_rows.astype(np.int64))
        offsets.append(piece.offset)
        if piece.doubtful.size:
            doubtful[here][piece.doubtful] = True
        begin = here.stop
    changes = np.concatenate(rows), np.concatenate(offsets)
    return Samples(stamp_ns, motor_angle, joint_angle, unseen, doubtful, *changes)


def angles_of(robot: Robot, name: str, readings: Series) -> Series:
    """Angles that the readings of a motor or joint mean, whether or not they are acceptable.

    NaN where a reading is not finite or larger than any angle.
    """
    (axis,) = (one for one in axes_of(robot) if one.name == name)
    stamps = readings.stamp_ns + axis.clock_offset_ns
    return Series(stamps, readings.log_ns, axis.angles_of(readings.value))
