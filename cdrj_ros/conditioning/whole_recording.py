"""A whole recording through the gates at once: the same samples as message by message."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.gate import LARGEST, MAX_GAP_NS, RANGE_MARGIN, Limits, limits_of
from cdrj_ros.conditioning.motion import curvatures
from cdrj_ros.conditioning.samples import ALL_SEEN_OVER_TIME, Sample, Samples
from cdrj_ros.conditioning.time_line import REFUSALS, Conditioner
from cdrj_ros.conditioning.tracking import Vector, track_all
from cdrj_ros.robot.description import Robot

Stamps = NDArray[np.int64]


@dataclass(frozen=True)
class Readings:
    """Everything that one channel received, in order of arrival."""

    stamp_ns: Stamps
    """[ns], shape (n,)."""
    arrival_ns: Stamps
    """When it was recorded [ns], shape (n,)."""
    value: Vector
    """[rad], shape (n,)."""


@dataclass(frozen=True)
class Conditioned:
    """A whole recording after the gates."""

    segments: tuple[Samples, ...]
    """One, or several where the clock went back in between."""
    refused: Mapping[str, int]
    accepted: int
    clock_jumps: int
    gaps: int
    steps: int = 0


def condition(
    robot: Robot,
    motors: Mapping[str, Readings],
    joints: Mapping[str, Readings],
    mode: str = "wait",
) -> Conditioned:
    """Condition a recording; the same samples, bit for bit, as feeding it message by message.

    Args:
        robot: names, sensors and limits of the channels.
        motors, joints: readings by name; every name of the robot must be there.
        mode: one of ``MODES``.

    Returns:
        The samples and what was refused.
    """
    known = [motors[motor.name] for motor in robot.motors]
    known += [joints[joint.name] for joint in robot.joints]
    limits = limits_of(robot)
    names = {*(motor.name for motor in robot.motors), *(joint.name for joint in robot.joints)}
    strangers = [
        r for channels in (motors, joints) for name, r in channels.items() if name not in names
    ]
    clean = all(bool(np.all(np.abs(readings.value) <= LARGEST)) for readings in known)
    if clean:
        angles = [_angles(readings, limit) for readings, limit in zip(known, limits, strict=True)]
        clean = all(map(_is_clean, angles, limits))
    clean = clean and mode == "wait" and all(readings.stamp_ns[0] > 0 for readings in known)
    bridges = [
        curvatures(limit.motion(), readings.stamp_ns, readings.value) if clean else None
        for readings, limit in zip(angles if clean else known, limits, strict=True)
    ]
    curved = [bridge for bridge in bridges if bridge is not None]
    if clean and len(curved) == len(known):
        refused = dict.fromkeys(REFUSALS, 0)
        refused["unknown_name"] = sum(readings.stamp_ns.size for readings in strangers)
        accepted = sum(readings.stamp_ns.size for readings in known)
        angles = list(map(_between_counts, angles, limits))
        samples = _merge(angles, curved, limits, len(robot.motors))
        return Conditioned((samples,), refused, accepted, 0, 0)
    return _replay(robot, motors, joints, mode)


def _angles(readings: Readings, limits: Limits) -> Readings:
    """Readings as angles, as ``Channel.angle_at`` makes them."""
    stamps, value, sensor = readings.stamp_ns, readings.value, limits.sensor
    if sensor.clock_offset_ns:
        stamps = stamps + sensor.clock_offset_ns
    if sensor.period != float("inf") and value.size:
        turns = limits.first_turn(float(value[0])) + np.cumsum(
            np.rint(-np.diff(value, prepend=value[:1]) / sensor.period)
        )
        value = value + sensor.period * turns
    if sensor.scale != 1.0 or sensor.offset != 0.0:
        value = sensor.scale * value + sensor.offset
    if sensor.corrected_at:
        value = value + np.interp(value, sensor.corrected_at, sensor.correction)
    return Readings(stamps, readings.arrival_ns, value)


def _between_counts(readings: Readings, limits: Limits) -> Readings:
    """As ``Channel.between_counts``, for a clean channel."""
    if not limits.bandwidth > 0.0:
        return readings
    angle = np.empty_like(readings.value)
    track_all(readings.stamp_ns, readings.value, limits.bandwidth, limits.band, angle)
    return Readings(
        readings.stamp_ns, readings.arrival_ns, np.clip(angle, limits.lower, limits.upper)
    )


def _is_clean(readings: Readings, limits: Limits) -> bool:
    """Whether the gate would accept every reading of the channel."""
    stamps, value = readings.stamp_ns, readings.value
    if stamps.size == 0 or stamps[0] <= 0 or not np.all(np.isfinite(value)):
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
    channels: Sequence[Readings],
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
            stamps = np.union1d(stamps, readings.stamp_ns)
    stamps = stamps[(stamps >= begin) & (stamps <= until)]
    values = np.empty((stamps.size, len(channels)))
    for k, readings in enumerate(channels):
        values[:, k] = _values_at(readings, stamps)
    return Samples(
        np.ascontiguousarray(stamps),
        np.ascontiguousarray(values[:, :motor_count]),
        np.ascontiguousarray(values[:, motor_count:]),
        _unseen(channels, curved, limits, stamps),
    )


def _unseen(
    channels: Sequence[Readings],
    curved: Sequence[Vector],
    limits: Sequence[Limits],
    stamps: Stamps,
) -> NDArray[np.float64]:
    """``Samples.unseen``, in the arithmetic of the time line."""
    if not any(np.any(curvature) for curvature in curved):
        return ALL_SEEN_OVER_TIME
    unseen = np.zeros((stamps.size, 2, len(channels)))
    passed = np.diff(stamps, prepend=stamps[:1])
    for k, (readings, curvature, limit) in enumerate(zip(channels, curved, limits, strict=True)):
        own = readings.stamp_ns
        after = np.searchsorted(own, stamps, side="left")
        before = np.where(own[after] == stamps, after, after - 1)
        bridge = curvature[after]
        unseen[:, 0, k] = bridge * (stamps - own[before]) * (own[after] - stamps)
        way = bridge * passed * passed * 0.25
        unseen[:, 1, k] = np.where(way > limit.negligible, way, 0.0)
    return unseen if np.any(unseen) else ALL_SEEN_OVER_TIME


def _values_at(readings: Readings, stamps: Stamps) -> Vector:
    """``_value_at`` for many stamps, in the same arithmetic."""
    own, value = readings.stamp_ns, readings.value
    at = np.searchsorted(own, stamps, side="right") - 1
    after = np.minimum(at + 1, own.size - 1)
    exact = own[at] == stamps
    span = np.where(exact, 1, own[after] - own[at])
    between = value[at] + (value[after] - value[at]) * ((stamps - own[at]) / span)
    return np.where(exact, value[at], between)


def _replay(
    robot: Robot, motors: Mapping[str, Readings], joints: Mapping[str, Readings], mode: str
) -> Conditioned:
    """Reading by reading, in order of arrival."""
    conditioner = Conditioner(robot, mode)
    feeds = [(conditioner.feed_motors, name, r) for name, r in motors.items()]
    feeds += [(conditioner.feed_joints, name, r) for name, r in joints.items()]
    arrival = np.concatenate([readings.arrival_ns for _, _, readings in feeds])
    source = np.repeat(np.arange(len(feeds)), [r.stamp_ns.size for _, _, r in feeds])
    place = np.concatenate([np.arange(r.stamp_ns.size) for _, _, r in feeds])
    order = np.lexsort((source, arrival))
    columns = [(feed, (name,), r.stamp_ns.tolist(), r.value.tolist()) for feed, name, r in feeds]
    segments: list[list[Sample]] = [[]]
    jumps = 0
    for k, n in zip(source[order].tolist(), place[order].tolist(), strict=True):
        feed, name, stamps, values = columns[k]
        samples = feed(stamps[n], name, (values[n],))
        if conditioner.clock_jumps != jumps:
            jumps = conditioner.clock_jumps
            segments.append([])
        segments[-1].extend(samples)
    motor_count, joint_count = len(robot.motors), len(robot.joints)
    return Conditioned(
        tuple(_stacked(segment, motor_count, joint_count) for segment in segments if segment),
        conditioner.refused,
        conditioner.accepted,
        conditioner.clock_jumps,
        conditioner.gaps,
        conditioner.steps,
    )


def _stacked(samples: Sequence[Sample], motors: int, joints: int) -> Samples:
    n = len(samples)
    unseen = ALL_SEEN_OVER_TIME
    if any(sample.unseen.size for sample in samples):
        unseen = np.zeros((n, 2, motors + joints))
        for k, sample in enumerate(samples):
            if sample.unseen.size:
                unseen[k] = sample.unseen
    return Samples(
        np.array([sample.stamp_ns for sample in samples], dtype=np.int64),
        np.array(list(chain.from_iterable(s.motor_angle for s in samples))).reshape(n, motors),
        np.array(list(chain.from_iterable(s.joint_angle for s in samples))).reshape(n, joints),
        unseen,
    )
