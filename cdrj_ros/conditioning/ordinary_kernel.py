"""The kernel that takes messages about which nothing is special, see ``ordinary``."""

from __future__ import annotations

from math import inf
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.gate import LARGEST, RANGE_MARGIN
from cdrj_ros.conditioning.motion import LEAP_FLOOR, WINDOW_NS, Moving, take_angle
from cdrj_ros.conditioning.refusals import END_OF_TIME_NS
from cdrj_ros.conditioning.tracking import MEMORY, Vector, track
from cdrj_ros.model.compiled import direct, lean, stage
from cdrj_ros.model.records import Rows, record_type

Words = NDArray[np.int64]

STAMP: Final = 1
"""Word of a message that holds its stamp: seconds, then nanoseconds, of 4 bytes each."""

NOT_ORDINARY: Final = -1
"""Result of ``take_ordinary``: nothing has been changed."""

NO_SAMPLE: Final = 0
"""Result of ``take_ordinary``: the readings wait for those of other channels."""


class ChannelRecord(Moving):
    """A channel while its readings are ordinary, with the fields of its ``Motion``."""

    clock_offset_ns: int
    period: float
    """See ``Sensor`` [rad]."""
    scale: float
    offset: float
    lower: float
    """Bounds on angles [rad]."""
    upper: float
    max_speed: float
    """[rad/s]."""
    bandwidth: float
    """Of the tracking filter [Hz]; 0 for none."""
    adaptive: int
    """Whether the bandwidth rises with the motion."""
    last_ns: int
    """Stamp of the last reading [ns]."""
    last_reading: float
    """Last reading, before unwrapping [rad]."""
    turns: int
    """Number of periods that unwrapping adds to it."""
    last: float
    """Its angle [rad]."""
    angle: float
    """The angle after tracking [rad]."""
    usual_ns: int
    """See ``Channel``."""
    sampled_ns: int
    """Stamp of the last sample [ns]."""
    sampled: float
    """Angle there [rad]."""
    curvature: float
    """Curvature between the last sample's reading and the one before it [rad/ns^2]."""
    waits: int
    """Whether the last reading is not in a sample yet."""


RECORD: Final = record_type(ChannelRecord)


class Message(NamedTuple):
    """A message, see ``Frame``; both arrays have the same memory."""

    words: Words
    numbers: Vector


class Pattern(NamedTuple):
    """Messages with the same names: which words all of them share, and where the positions are."""

    shared: Words
    """Values of the shared bits of every word; zero elsewhere."""
    mask: Words
    """Ones in every bit that is shared."""
    first: int
    """Word of the first position."""
    channels: Words
    """Channel of every position; -1 for names that are none."""


class Channels(NamedTuple):
    """All motors, then all joints."""

    rows: Rows[ChannelRecord]
    """Shape (channels,)."""
    spare: Rows[ChannelRecord]
    """Shape (1,)."""
    memories: NDArray[np.float64]
    """Of their tracking filters, shape (channels, MEMORY)."""


@stage
def _fits(words: Words, pattern: Pattern) -> bool:
    """Whether a message, which has the pattern's length, has its names too."""
    different = np.int64(0)
    for k in range(words.size):
        different |= (words[k] ^ pattern.shared[k]) & pattern.mask[k]
    return different == 0


@stage
def _turns_at(channel: ChannelRecord, reading: float) -> int:
    """``Channel.turns_at``."""
    if channel.period == inf:
        return 0
    return channel.turns + round((channel.last_reading - reading) / channel.period)


@stage
def _angle_at(channel: ChannelRecord, reading: float) -> float:
    """``Channel.angle_at``."""
    angle = reading
    if channel.period != inf:
        angle = reading + channel.period * _turns_at(channel, reading)
    if channel.scale != 1.0 or channel.offset != 0.0:
        angle = channel.scale * angle + channel.offset
    return angle


@stage
def _is_ordinary(channel: ChannelRecord, stamp: int, reading: float) -> bool:
    """``Channel.is_ordinary``, whatever the curvature of (C3)."""
    ahead = stamp - channel.last_ns
    if not (0 < ahead <= WINDOW_NS and stamp < END_OF_TIME_NS):
        return False
    if not -LARGEST <= reading <= LARGEST:
        return False
    angle, span = _angle_at(channel, reading), ahead * 1e-9
    moved = angle - channel.last
    return (
        channel.lower - RANGE_MARGIN <= angle <= channel.upper + RANGE_MARGIN
        and abs(moved) <= channel.max_speed * span
        and abs(moved - channel.velocity * span) <= LEAP_FLOOR
    )


@stage
def _is_straight(
    channel: ChannelRecord, spare: Rows[ChannelRecord], stamp: int, reading: float
) -> bool:
    """Whether ``Motion.curvature`` will be 0 between the last reading and an ordinary one.

    Args:
        channel: before the reading.
        spare: a copy of it, changed.
        stamp: of the reading [ns].
        reading: [rad].
    """
    take_angle(spare[0], stamp, _angle_at(channel, reading))
    return stamp - channel.last_ns <= spare[0].seen_ns


@stage
def _take(channel: ChannelRecord, memory: Vector, stamp: int, reading: float) -> None:
    """``TimeLine.take`` for an ordinary reading."""
    interval, value = stamp - channel.last_ns, _angle_at(channel, reading)
    channel.turns = _turns_at(channel, reading)
    channel.angle = value
    if channel.bandwidth > 0.0:
        adaptive = channel.adaptive != 0
        angle = track(memory, interval, value, channel.bandwidth, channel.band, adaptive)
        channel.angle = min(max(angle, channel.lower), channel.upper)
    take_angle(channel, stamp, value)
    channel.usual_ns = max(interval, channel.usual_ns // 2)
    channel.last_ns, channel.last, channel.last_reading = stamp, value, reading
    channel.waits = 1


@stage
def _complete(channels: Rows[ChannelRecord], motor: Vector, joint: Vector) -> bool:
    """Write the angles of the next sample, if every channel has a reading for it."""
    for k in range(len(channels)):
        if channels[k].waits == 0:
            return False
    motors = motor.size
    for k in range(len(channels)):
        channel = channels[k]
        channel.sampled_ns, channel.sampled = channel.last_ns, channel.angle
        channel.curvature, channel.waits = 0.0, 0
        if k < motors:
            motor[k] = channel.angle
        else:
            joint[k - motors] = channel.angle
    return True


@stage
def _common_stamp(message: Message, pattern: Pattern, channels: Channels) -> int:
    """Corrected stamp of the message and of all waiting readings [ns].

    -1 if it is not common to them, or if a reading of the message is not ordinary.
    """
    rows, common = channels.rows, -1
    for k in range(len(rows)):
        if rows[k].waits != 0:
            common = rows[k].last_ns
    word = message.words[STAMP]
    # a stamp before zero gives one that is far too late
    stamp = (word & 0xFFFFFFFF) * 1_000_000_000 + ((word >> 32) & 0xFFFFFFFF)
    for k in range(pattern.channels.size):
        c = pattern.channels[k]
        if c >= 0:
            reading, corrected = message.numbers[pattern.first + k], stamp + rows[c].clock_offset_ns
            if common < 0:
                common = corrected
            if corrected != common or not _is_ordinary(rows[c], corrected, reading):
                return -1
            channels.spare[0] = rows[c]
            if not _is_straight(rows[c], channels.spare, corrected, reading):
                return -1
    return common


@lean
def take_ordinary(
    message: Message, pattern: Pattern, channels: Channels, motor: Vector, joint: Vector
) -> int:
    """Take a message if it fits the pattern and all of its readings are ordinary.

    Args:
        message: as received, of the pattern's length.
        pattern: what messages with these names have in common.
        channels: changed.
        motor, joint: angles [rad], shapes (motors,) and (joints,), written with a sample.

    Returns:
        The stamp of the sample that the message completes [ns], ``NO_SAMPLE`` or ``NOT_ORDINARY``.
    """
    if not _fits(message.words, pattern):
        return NOT_ORDINARY
    common, rows = _common_stamp(message, pattern, channels), channels.rows
    if common < 0:
        return NOT_ORDINARY
    for k in range(pattern.channels.size):
        c = pattern.channels[k]
        if c >= 0:
            _take(rows[c], channels.memories[c], common, message.numbers[pattern.first + k])
    return common if _complete(rows, motor, joint) else NO_SAMPLE


def new_channels(count: int) -> Channels:
    """Records of channels about which nothing is known."""
    rows: Any = np.zeros(count, dtype=RECORD)
    spare: Any = np.zeros(1, dtype=RECORD)
    return Channels(rows, spare, np.zeros((count, MEMORY)))


def find_entry() -> Any:
    """Entry point of ``take_ordinary``, compiled or from the disk."""
    words, vector = np.zeros(0, dtype=np.int64), np.zeros(0)
    pattern = Pattern(words, words, 1, words)
    return direct(take_ordinary, Message(words, vector), pattern, new_channels(0), vector, vector)
