"""Messages about which nothing is special, taken in compiled code.

Where all axes are read at the same times, nearly every message only changes the last reading of its
channels, or completes a sample.  Such messages are taken here, with what the gates and the time
line know of the channels in records.  Every other message is left to ``Conditioner``, which first
takes the channels back, see ``OrdinaryReadings.store``.  Both give the same samples, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from cdrj_ros.conditioning.gate import Channel
from cdrj_ros.conditioning.motion import Moving
from cdrj_ros.conditioning.ordinary_kernel import (
    RECORD,
    ChannelRecord,
    Message,
    Pattern,
    find_entry,
    new_channels,
)
from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.conditioning.time_line import TimeLine

MOVING: Final = tuple(Moving.__annotations__)
"""Fields of ``Motion``."""

WORTH: Final = 16
"""Number of ordinary readings that are worth loading the channels."""

LONGEST: Final = 1024
"""Maximum number of samples until loading is tried again, where it was not worth it."""


class OrdinaryReadings:
    """Channels of a robot in records, while they are loaded."""

    def __init__(self, motors: int, joints: int) -> None:
        """Prepare the records; nothing is loaded.

        Args:
            motors: number of motors.
            joints: number of joints.
        """
        self.loaded = False
        """Whether the records, and not the channels, hold the last readings."""
        self._channels = new_channels(motors + joints)
        self._motor, self._joint = np.zeros(motors), np.zeros(joints)
        self._entry: Any = None
        self._postponed = False
        self._samples, self._pause, self._accepted = 0, 1, 0

    def postpone(self) -> None:
        """Load no channels until ``prepare`` is called, because the kernel is being compiled."""
        self._postponed = True

    def prepare(self) -> None:
        """Compile or load the kernel, if this has not been done."""
        self._postponed = False
        if self._entry is None:
            self._entry = find_entry()

    def take(self, message: Message, pattern: Pattern) -> int:
        """``take_ordinary``, while loaded; ``sample`` gives the sample that is completed."""
        stamp: int = self._entry(message, pattern, self._channels, self._motor, self._joint)
        return stamp

    def sample(self, stamp_ns: int) -> Sample:
        """The sample that ``take`` has completed, at the stamp that it has returned [ns]."""
        return Sample(stamp_ns, self._motor.copy(), self._joint.copy())

    def load(self, channels: Sequence[Channel], time_line: TimeLine, accepted: int) -> None:
        """Load the channels if nothing is special about them and none waits for another.

        Where few readings were ordinary after the last times, as those of topics with different
        rates, it is tried at ever fewer samples, since it takes as long as some ten messages.

        Args:
            channels: of all motors, then all joints.
            time_line: theirs.
            accepted: readings accepted so far.
        """
        self._samples += 1
        if self._samples < self._pause:
            return
        self._samples, self._accepted = 0, accepted
        stamp = time_line.last_exact_ns
        if self._postponed or stamp < 0:
            return
        if not all(channel.is_settled_at(stamp) for channel in channels):
            return
        self.prepare()
        for k, channel in enumerate(channels):
            self._channels.rows[k] = _record_of(channel)
            self._channels.memories[k] = channel.memory
        self.loaded = True

    def store(self, channels: Sequence[Channel], time_line: TimeLine, accepted: int) -> None:
        """Give the channels back with all that has changed since ``load``; arguments as there."""
        self.loaded = False
        was_worth_it = accepted - self._accepted >= WORTH
        self._pause = 1 if was_worth_it else min(2 * self._pause, LONGEST)
        rows, _, memories = self._channels
        for k, channel in enumerate(channels):
            _store(rows[k], channel)
            channel.memory[:] = memories[k]
        time_line.go_on_from(int(rows[0].sampled_ns))


def _record_of(channel: Channel) -> tuple[Any, ...]:
    """The fields of ``ChannelRecord``, in their order."""
    limits = channel.limits
    stamp, angle, curvature = channel.readings[-1]
    record = {
        "clock_offset_ns": limits.sensor.clock_offset_ns,
        "period": limits.sensor.period,
        "scale": limits.sensor.scale,
        "offset": limits.sensor.offset,
        "lower": limits.lower,
        "upper": limits.upper,
        "max_speed": limits.max_speed,
        "bandwidth": limits.bandwidth,
        "adaptive": int(limits.adaptive),
        **vars(channel.motion),
        "last_ns": channel.last_stamp,
        "last_reading": channel.last_reading,
        "turns": channel.turns,
        "last": channel.last_value,
        "angle": angle,
        "usual_ns": channel.usual_ns,
        "sampled_ns": stamp,
        "sampled": angle,
        "curvature": curvature,
        "waits": 0,
    }
    return tuple(record[name] for name in RECORD.names)


def _store(row: ChannelRecord, channel: Channel) -> None:
    """The reverse of ``_record_of``."""
    channel.last_stamp, channel.usual_ns = int(row.last_ns), int(row.usual_ns)
    channel.last_value, channel.last_reading = float(row.last), float(row.last_reading)
    channel.turns = int(row.turns)
    for name in MOVING:
        setattr(channel.motion, name, getattr(row, name).item())
    channel.readings.clear()
    channel.readings.append((int(row.sampled_ns), float(row.sampled), float(row.curvature)))
    if row.waits:
        channel.readings.append((channel.last_stamp, float(row.angle), 0.0))
