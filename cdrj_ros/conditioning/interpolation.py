"""A channel's angle between its readings or shortly after the last one, and its uncertainty.

Equations (C3) and (C4) of docs/conditioning.md.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cdrj_ros.conditioning.gate import Channel
from cdrj_ros.conditioning.samples import ALL_SEEN
from cdrj_ros.conditioning.tracking import Vector


def values_at(channels: Sequence[Channel], stamp: int) -> tuple[Vector, bool]:
    """Interpolate every channel linearly; drop the readings that no later sample needs.

    Args:
        channels: of all motors and joints, each with a reading at the stamp or after it.
        stamp: [ns], not before the first reading of any channel.

    Returns:
        The angles [rad], shape (channels,), and whether a curvature there is not 0, see
        ``Channel.readings``.
    """
    angles, curved = [], False
    for channel in channels:
        readings = channel.readings
        while len(readings) > 1 and readings[1][0] <= stamp:
            readings.popleft()
        before, value, curvature = readings[0]
        if before != stamp:
            after, following, curvature = readings[1]
            value += (following - value) * ((stamp - before) / (after - before))
        angles.append(value)
        if curvature != 0.0:
            curved = True
    return np.array(angles), curved


def predicted(channel: Channel, stamp: int) -> float:
    """A channel's angle at or after its last reading [rad], clipped to its limits."""
    ahead = stamp - channel.last_stamp
    value = channel.recent[-1][1] + channel.velocity() * (ahead * 1e-9)
    return min(max(value, channel.limits.lower), channel.limits.upper)


def unseen_at(channels: Sequence[Channel], stamp: int, previous: int) -> Vector:
    """``Sample.unseen`` of an interpolated sample, (C3); call ``values_at`` first.

    Infinite where nothing is known of an axis; such a sample is of no use.

    Args:
        channels: of all motors and joints.
        stamp: of the sample [ns].
        previous: stamp of the sample before [ns].
    """
    unseen: Vector | None = None
    for k, channel in enumerate(channels):
        readings = channel.readings
        before, _, curvature = readings[0]
        after = before
        if before != stamp:
            after, _, curvature = readings[1]
        if curvature == 0.0:
            continue
        way = way_between(curvature, stamp - previous, channel.limits.negligible)
        if before != stamp or way > 0.0:
            if unseen is None:
                unseen = np.zeros((2, len(channels)))
            if before != stamp:
                unseen[0, k] = curvature * (stamp - before) * (after - stamp)
            unseen[1, k] = way
    return ALL_SEEN if unseen is None else unseen


def unseen_before(channels: Sequence[Channel], stamp: int, resumed: int) -> Vector:
    """``Sample.unseen`` of the first sample, which may continue an earlier run.

    Args:
        channels: of all motors and joints.
        stamp: of the sample [ns].
        resumed: stamp of the last sample of the earlier run [ns]; -1 where there is none.
    """
    unseen = unseen_at(channels, stamp, stamp)
    if not 0 <= resumed < stamp:
        return unseen
    ways = [
        way_between(channel.resumed, stamp - resumed, channel.limits.negligible)
        for channel in channels
    ]
    if not any(ways):
        return unseen
    return np.array([unseen[0] if unseen.size else np.zeros(len(channels)), ways])


def unseen_ahead(channels: Sequence[Channel], stamp: int, previous: int) -> Vector:
    """``Sample.unseen`` of a predicted sample, (C4); arguments as of ``unseen_at``."""
    unseen: Vector | None = None
    for k, channel in enumerate(channels):
        horizon = stamp - channel.last_stamp
        deviation = channel.motion.ahead(horizon, channel.recent_ns) if horizon > 0 else 0.0
        way = 0.0
        if horizon == 0:
            curvature = channel.readings[-1][2]
            way = way_between(curvature, stamp - previous, channel.limits.negligible)
        if deviation > channel.limits.negligible or way > 0.0:
            if unseen is None:
                unseen = np.zeros((2, len(channels)))
            unseen[0, k] = deviation
            unseen[1, k] = way
    return ALL_SEEN if unseen is None else unseen


def way_between(curvature: float, interval_ns: int, negligible: float) -> float:
    """Standard deviation midway between two samples [rad], (C3); 0 where negligible.

    Infinite where the motion between them is unknown.
    """
    way = curvature * interval_ns * interval_ns * 0.25
    return way if way > negligible else 0.0
