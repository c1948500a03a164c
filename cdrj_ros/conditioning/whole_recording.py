"""Conditioning of a whole recording by vector operations; samples as message by message."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.angles import angle_of
from cdrj_ros.conditioning.conditioner import Conditioner
from cdrj_ros.conditioning.gate import LARGEST, MAX_GAP_NS, RANGE_MARGIN, Limits, limits_of
from cdrj_ros.conditioning.motion import curvatures
from cdrj_ros.conditioning.refusals import REFUSALS
from cdrj_ros.conditioning.samples import ALL_SEEN_OVER_TIME, NO_DOUBTS, Sample, Samples
from cdrj_ros.conditioning.tracking import Vector, track_all
from cdrj_ros.foundation.series import Series
from cdrj_ros.model.compiled import ordinary
from cdrj_ros.robot.description import Robot

Stamps = NDArray[np.int64]

PIECE: Final = 65_536
"""Readings or samples processed at a time; the results do not depend on it."""


@dataclass(frozen=True)
class Conditioned:
    """The samples of a whole recording, and how many readings were refused."""

    segments: tuple[Samples, ...]
    """One segment, or several if the clock went back between them."""
    refused: Mapping[str, int]
    accepted: int
    clock_jumps: int
    gaps: int
    steps: int = 0


def condition(
    robot: Robot,
    motors: Mapping[str, Series],
    joints: Mapping[str, Series],
) -> Conditioned:
    """Condition a recording; the samples equal those of single messages bit for bit.

    Predicted samples are not among them: nothing lags in a recording.

    Args:
        robot: names, sensors and limits of the channels.
        motors: readings by name, of every motor of the robot.
        joints: readings by name, of every joint of the robot.

    Returns:
        The samples, and how many readings were refused.
    """
    known = [motors[motor.name] for motor in robot.motors]
    known += [joints[joint.name] for joint in robot.joints]
    samples = _at_once(robot, known)
    if samples is None:
        return _replay(robot, motors, joints)
    names = {*(motor.name for motor in robot.motors), *(joint.name for joint in robot.joints)}
    refused = dict.fromkeys(REFUSALS, 0)
    refused["unknown_name"] = sum(
        readings.stamp_ns.size
        for channels in (motors, joints)
        for name, readings in channels.items()
        if name not in names
    )
    accepted = sum(readings.stamp_ns.size for readings in known)
    return Conditioned((samples,), refused, accepted, 0, 0)


def _at_once(robot: Robot, channels: Sequence[Series]) -> Samples | None:
    """All samples without a loop over them; None if a reading would be refused or leaps."""
    if not all(np.all(np.abs(readings.value) <= LARGEST) for readings in channels):
        return None
    limits = limits_of(robot)
    angles = [_angles(readings, limit) for readings, limit in zip(channels, limits, strict=True)]
    if not all(map(_is_clean, channels, angles, limits)):
        return None
    curved = []
    for readings, limit in zip(angles, limits, strict=True):
        curvature = curvatures(limit.motion(), readings.stamp_ns, readings.value)
        if curvature is None:
            return None
        curved.append(curvature)
    return _merge(list(map(_between_counts, angles, limits)), curved, limits, len(robot.motors))


def _angles(readings: Series, limits: Limits) -> Series:
    """Angles of readings, as by ``Channel.angle_at``."""
    stamps, value, sensor = readings.stamp_ns, readings.value, limits.sensor
    if sensor.clock_offset_ns:
        stamps = stamps + sensor.clock_offset_ns
    if sensor.period != float("inf") and value.size:
        turns = limits.first_turn(float(value[0])) + np.cumsum(
            np.rint(-np.diff(value, prepend=value[:1]) / sensor.period)
        )
        value = value + sensor.period * turns
    return Series(stamps, readings.log_ns, angle_of(sensor, value))


def _between_counts(readings: Series, limits: Limits) -> Series:
    """As ``Channel.between_counts``, for a clean channel."""
    if not limits.bandwidth > 0.0:
        return readings
    angle = np.empty_like(readings.value)
    stamps, values = ordinary(readings.stamp_ns), ordinary(readings.value)
    track_all(stamps, values, limits.bandwidth, limits.band, limits.adaptive, angle)
    return Series(readings.stamp_ns, readings.log_ns, np.clip(angle, limits.lower, limits.upper))


def angles_of(robot: Robot, name: str, readings: Series) -> Series:
    """Angles that the readings of a motor or joint mean, whether or not they are acceptable."""
    (limits,) = (one for one in limits_of(robot) if one.name == name)
    return _angles(readings, limits)


def _is_clean(readings: Series, angles: Series, limits: Limits) -> bool:
    """Whether the gate would accept every reading of a channel.

    Args:
        readings: as received.
        angles: the same as angles, see ``_angles``.
        limits: of the channel.
    """
    stamps, value = angles.stamp_ns, angles.value
    if stamps.size == 0 or readings.stamp_ns[0] <= 0 or stamps[0] <= 0:
        return False
    ahead = np.diff(stamps)
    return bool(
        np.all(ahead > 0)
        and np.all(ahead <= MAX_GAP_NS)
        and np.all(value >= limits.lower - RANGE_MARGIN)
        and np.all(value <= limits.upper + RANGE_MARGIN)
        and np.all(np.abs(np.diff(value)) <= limits.max_speed * (ahead * 1e-9))
    )


def _merge(
    channels: Sequence[Series],
    curved: Sequence[Vector],
    limits: Sequence[Limits],
    motor_count: int,
) -> Samples:
    """The time line of clean channels, without a loop over samples."""
    begin = max(int(readings.stamp_ns[0]) for readings in channels)
    until = min(int(readings.stamp_ns[-1]) for readings in channels)
    stamps = channels[0].stamp_ns
    for readings in channels[1:]:
        if readings.stamp_ns is not stamps and not np.array_equal(readings.stamp_ns, stamps):
            stamps = _union(stamps, readings.stamp_ns)
    first, end = np.searchsorted(stamps, begin), np.searchsorted(stamps, until, side="right")
    stamps = np.ascontiguousarray(stamps[first:end])
    return Samples(
        stamps,
        _interpolated(channels[:motor_count], stamps),
        _interpolated(channels[motor_count:], stamps),
        _unseen(channels, curved, limits, stamps),
    )


def _union(one: Stamps, two: Stamps) -> Stamps:
    """All stamps of two sorted rows, once each; 60 times as fast as ``np.union1d``."""
    both = np.sort(np.concatenate([one, two]), kind="stable")  # a stable sort merges sorted parts
    return both[np.concatenate([[True], both[1:] != both[:-1]])]


def _unseen(
    channels: Sequence[Series],
    curved: Sequence[Vector],
    limits: Sequence[Limits],
    stamps: Stamps,
) -> NDArray[np.float64]:
    """``Samples.unseen``, with the arithmetic of the time line."""
    found = []
    for k, (readings, curvature, limit) in enumerate(zip(channels, curved, limits, strict=True)):
        if not np.any(curvature):
            continue
        own = readings.stamp_ns
        after = np.searchsorted(own, stamps, side="left")
        rows = np.flatnonzero(curvature[after])
        after, stamp = after[rows], stamps[rows]
        before = np.where(own[after] == stamp, after, after - 1)
        passed = stamp - stamps[np.maximum(rows - 1, 0)]
        bridge = curvature[after]
        deviation = bridge * (stamp - own[before]) * (own[after] - stamp)
        way = bridge * passed * passed * 0.25
        way[way <= limit.negligible] = 0.0
        if np.any(deviation) or np.any(way):
            found.append((rows, k, deviation, way))
    if not found:
        return ALL_SEEN_OVER_TIME
    unseen = np.zeros((stamps.size, 2, len(channels)))
    for rows, k, deviation, way in found:
        unseen[rows, 0, k], unseen[rows, 1, k] = deviation, way
    return unseen


def _interpolated(channels: Sequence[Series], stamps: Stamps) -> NDArray[np.float64]:
    """Angles of some channels at ``stamps``, shape (n, channels) [rad]."""
    values = np.empty((stamps.size, len(channels)))
    for begin in range(0, stamps.size, PIECE):
        piece = slice(begin, begin + PIECE)
        for k, readings in enumerate(channels):
            values[piece, k] = _values_at(readings, stamps[piece])
    return values


def _values_at(readings: Series, stamps: Stamps) -> Vector:
    """``interpolation.values_at`` of one channel for many stamps, with the same arithmetic."""
    own, value = readings.stamp_ns, readings.value
    at = np.searchsorted(own, stamps, side="right") - 1
    after = np.minimum(at + 1, own.size - 1)
    exact = own[at] == stamps
    span = np.where(exact, 1, own[after] - own[at])
    between = value[at] + (value[after] - value[at]) * ((stamps - own[at]) / span)
    return np.where(exact, value[at], between)


def _replay(
    robot: Robot, motors: Mapping[str, Series], joints: Mapping[str, Series]
) -> Conditioned:
    """Condition reading by reading, in order of arrival."""
    conditioner = Conditioner(robot)
    sources = [(conditioner.feed_motors, (name,), r) for name, r in motors.items()]
    sources += [(conditioner.feed_joints, (name,), r) for name, r in joints.items()]
    feeds = [(feed, name) for feed, name, _ in sources]
    motor_count, joint_count = len(robot.motors), len(robot.joints)
    segments = [_Segment(motor_count, joint_count)]
    jumps = 0
    for readings in _in_order([readings for _, _, readings in sources]):
        for k, stamp, value in readings:
            feed, name = feeds[k]
            samples = feed(stamp, name, (value,))
            if conditioner.clock_jumps != jumps:
                jumps = conditioner.clock_jumps
                segments.append(_Segment(motor_count, joint_count))
            for sample in samples:
                segments[-1].append(sample)
    return Conditioned(
        tuple(segment.samples() for segment in segments if segment),
        conditioner.refused,
        conditioner.accepted,
        conditioner.clock_jumps,
        conditioner.gaps,
        conditioner.steps,
    )


def _in_order(channels: Sequence[Series]) -> Iterator[Iterable[tuple[int, int, float]]]:
    """Readings in order of arrival, some at a time, since an hour of them would take 200 MB.

    Yields:
        Index of the channel, stamp [ns] and value; at equal times the first channel comes first.
    """
    at = [0] * len(channels)
    while any(k < c.log_ns.size for k, c in zip(at, channels, strict=True)):
        parts = _next_parts(channels, at)
        at = [part.stop for part in parts]
        taken = [
            (c.log_ns[p], c.stamp_ns[p], c.value[p]) for c, p in zip(channels, parts, strict=True)
        ]
        log, stamp, value = (np.concatenate(column) for column in zip(*taken, strict=True))
        order = np.argsort(log, kind="stable")
        source = np.repeat(np.arange(len(parts)), [part.stop - part.start for part in parts])
        yield zip(source[order].tolist(), stamp[order].tolist(), value[order].tolist(), strict=True)


def _next_parts(channels: Sequence[Series], at: Sequence[int]) -> list[slice]:
    """The next readings of every channel, about PIECE of the one with most, up to one time."""
    logs = [channel.log_ns for channel in channels]
    further = [log[k + PIECE] for log, k in zip(logs, at, strict=True) if k + PIECE < log.size]
    if not further:
        return [slice(k, log.size) for log, k in zip(logs, at, strict=True)]
    until = min(further)
    ends = [int(np.searchsorted(log, until)) for log in logs]
    if ends == list(at):  # as many readings arrived at the same time
        ends = [int(np.searchsorted(log, until, side="right")) for log in logs]
    return [slice(k, end) for k, end in zip(at, ends, strict=True)]


class _Segment:
    """Consecutive samples as plain numbers; an hour of ``Sample`` objects would take 4 GB."""

    def __init__(self, motor_count: int, joint_count: int) -> None:
        """Start without a sample."""
        self._counts = motor_count, joint_count
        self._stamps = array("q")
        self._motors = array("d")
        self._joints = array("d")
        self._rows = array("q")
        self._unseen = array("d")
        self._doubtful = array("q")

    def __len__(self) -> int:
        """Number of samples."""
        return len(self._stamps)

    def append(self, sample: Sample) -> None:
        """Add the next sample."""
        if sample.unseen.size:
            self._rows.append(len(self._stamps))
            self._unseen.frombytes(sample.unseen.tobytes())
        if sample.doubtful:
            self._doubtful.append(len(self._stamps))
        self._stamps.append(sample.stamp_ns)
        self._motors.frombytes(sample.motor_angle.tobytes())
        self._joints.frombytes(sample.joint_angle.tobytes())

    def samples(self) -> Samples:
        """All samples; their angles are views of this segment's memory."""
        n = len(self)
        motor_count, joint_count = self._counts
        unseen = ALL_SEEN_OVER_TIME
        if self._rows:
            unseen = np.zeros((n, 2, motor_count + joint_count))
            unseen[np.asarray(self._rows)] = np.asarray(self._unseen).reshape(-1, *unseen.shape[1:])
        doubtful = NO_DOUBTS
        if self._doubtful:
            doubtful = np.zeros(n, dtype=np.bool_)
            doubtful[np.asarray(self._doubtful)] = True
        return Samples(
            np.asarray(self._stamps),
            np.asarray(self._motors).reshape(n, motor_count),
            np.asarray(self._joints).reshape(n, joint_count),
            unseen,
            doubtful,
        )
