"""The common time line of the samples for ``step()``.

Accepted readings are brought to one time line: the union of all stamps, with every channel
interpolated linearly between its own readings.  An estimate therefore waits for the slowest
channel: holding the last joint angle while the motor moves on would add a sawtooth to the tensions.
The result does not depend on the order in which different topics arrive.  Where waiting costs too
much, ``predict`` gives further samples in advance, for which the slower channels are extrapolated.
See docs/conditioning.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Final, Literal, get_args

import numpy as np

from cdrj_ros.conditioning.gate import SPEED_WINDOW_NS, Channel, Doubt
from cdrj_ros.conditioning.interpolation import (
    predicted,
    unseen_ahead,
    unseen_at,
    unseen_before,
    values_at,
)
from cdrj_ros.conditioning.samples import ALL_SEEN, Sample

WAITING: Final = 20_000
"""Greatest number of readings that a channel keeps for another channel: 20 s at 1 kHz."""

Mode = Literal["wait", "predict"]
MODES: Final[tuple[Mode, ...]] = get_args(Mode)
"""How a lagging channel is handled: wait for it, or extrapolate it with its velocity meanwhile."""

HORIZON_NS: Final = 20_000_000
"""A channel is predicted at most this far beyond its last reading [ns]."""


class TimeLine:
    """Samples of all channels at common times."""

    def __init__(self, motors: int, mode: Mode, horizon_ns: int) -> None:
        """Prepare; ``begin`` gives the channels.

        Args:
            motors: how many of the channels are motors.
            mode: one of ``MODES``.
            horizon_ns: longest time to predict [ns].
        """
        self._motor_count = motors
        self._predict = mode == "predict"
        self._horizon = horizon_ns
        self.crowded = 0
        """Accepted readings dropped because they had waited too long for another channel."""
        self.lag_ns = 0
        """Lag of the last sample behind the newest reading [ns]."""
        self.begin([])

    def begin(self, channels: Sequence[Channel]) -> None:
        """Begin without readings; ``channels`` are those of all motors, then all joints."""
        self._channels = channels
        self._doubts: list[Doubt] = []
        self._resumed = -1
        self._passed_over = -1
        """Stamp of the last sample that was not given because an axis was unknown [ns]."""
        self._given_out = -1
        """Stamp of the last sample that is not predicted [ns]; -1 before the first one."""
        self._ahead = -1
        """Stamp of the last predicted sample [ns]."""
        self._ahead_from = -1
        """Stamp of the sample that a predicted one continues, predicted or not [ns]."""
        self._missing = len(channels)

    @property
    def has_begun(self) -> bool:
        """Whether there has been a sample that is not predicted."""
        return self._given_out >= 0

    @property
    def last_exact_ns(self) -> int:
        """Stamp of the last sample [ns]; -1 before the first, or if samples are predicted."""
        return -1 if self._predict else self._given_out

    def go_on_from(self, stamp_ns: int) -> None:
        """Note that the samples up to this stamp [ns] have been made elsewhere."""
        self._given_out = self._ahead_from = stamp_ns

    def resume(self, stamp_ns: int) -> None:
        """Continue an earlier run, whose last sample had this stamp [ns]."""
        self._resumed = stamp_ns

    def skip_to(self, stamp_ns: int) -> None:
        """Give no sample before this stamp [ns], because the motion until then is unknown."""
        if self._given_out >= 0:
            self._given_out = max(self._given_out, stamp_ns - 1)

    def note_doubt(self, doubt: Doubt) -> None:
        """Mark samples within a period as doubtful; its end may be set later."""
        self._doubts.append(doubt)

    def take(self, channel: Channel, stamp: int, reading: float, value: float) -> None:
        """Store an accepted reading for the samples.

        Args:
            channel: one of those given to ``begin``.
            stamp: [ns].
            reading: of the sensor [rad].
            value: its angle [rad].
        """
        angle = value
        if channel.limits.bandwidth > 0.0:
            angle = channel.between_counts(stamp, value)
        motion = channel.motion
        motion.take(stamp, value)
        curvature = 0.0
        if channel.last_stamp < 0:
            self._missing -= 1
            if 0 <= self._resumed < stamp:
                channel.resumed = motion.curvature(stamp - self._resumed)
        else:
            interval = stamp - channel.last_stamp
            curvature = motion.curvature(interval)
            channel.usual_ns = max(interval, channel.usual_ns // 2)
        channel.last_stamp = stamp
        channel.last_value = value
        channel.last_reading = reading
        readings = channel.readings
        readings.append((stamp, angle, curvature))
        if len(readings) > WAITING:
            readings.popleft()
            self.crowded += 1
            if self._given_out >= 0:
                self._given_out = max(self._given_out, readings[0][0])
        if self._predict:
            recent = channel.recent
            recent.append((stamp, angle))
            while stamp - recent[0][0] > SPEED_WINDOW_NS and len(recent) > 2:
                recent.popleft()

    def samples(self) -> list[Sample]:
        """Samples at all stamps that every channel has reached, then a predicted one if enabled."""
        if self._missing:
            return []
        until = newest = self._channels[0].last_stamp
        for channel in self._channels:
            last = channel.last_stamp
            if last < until:
                until = last
            elif last > newest:
                newest = last
        if until <= self._given_out and not self._predict:
            return []
        samples = self._interpolated(until)
        if self._predict and self._is_predictable(newest, until):
            samples.append(self._predicted(newest))
        self.lag_ns = newest - max(self._given_out, self._ahead)
        return samples

    def _is_predictable(self, newest: int, until: int) -> bool:
        """Whether to give a sample at the newest stamp; all channels have reached ``until``."""
        if not max(self._given_out, self._ahead) < newest <= until + self._horizon:
            return False
        lagging = (channel for channel in self._channels if channel.last_stamp < newest)
        known = all(c.recent_ns and c.motion.knows(c.usual_ns) for c in lagging)
        return known and self._given_out >= 0

    def _interpolated(self, until: int) -> list[Sample]:
        """The next samples, up to the stamp ``until`` that every channel has reached."""
        channels = self._channels
        motors = self._motor_count
        began = self._given_out >= 0
        given_out = max(self._given_out, self._passed_over)
        if not began:
            first = max(channel.readings[0][0] for channel in channels) - 1
            given_out = max(first, self._passed_over)
        samples: list[Sample] = []
        while given_out < until:
            stamp = until
            for channel in channels:
                for when, _, _ in channel.readings:
                    if when > given_out:
                        stamp = min(stamp, when)
                        break
            values, curved = values_at(channels, stamp)
            unseen = ALL_SEEN
            if not began:
                unseen = unseen_before(channels, stamp, self._resumed)
            elif curved:
                unseen = unseen_at(channels, stamp, given_out)
            given_out = stamp
            if unseen.size and unseen[0].max() == inf:  # nothing is known of an axis here
                self._passed_over = stamp
                continue
            doubtful = self._is_doubtful(stamp) if self._doubts else False
            silent = stamp <= self._ahead
            samples.append(
                Sample(stamp, values[:motors], values[motors:], unseen, doubtful, silent=silent)
            )
            began = True
        if samples:
            self._given_out = self._ahead_from = given_out
        return samples

    def _predicted(self, stamp: int) -> Sample:
        """The sample at the newest stamp, with lagging channels extrapolated."""
        channels = self._channels
        motors = self._motor_count
        values = np.array([predicted(channel, stamp) for channel in channels])
        unseen = unseen_ahead(channels, stamp, self._ahead_from)
        self._ahead = self._ahead_from = stamp
        doubtful = any(doubt.after_ns < stamp < doubt.until_ns for doubt in self._doubts)
        return Sample(stamp, values[:motors], values[motors:], unseen, doubtful, predicted=True)

    def _is_doubtful(self, stamp: int) -> bool:
        """Whether some sensor may have stepped before a sample; drops doubts that have ended."""
        self._doubts = [doubt for doubt in self._doubts if doubt.until_ns > stamp]
        return any(doubt.after_ns < stamp for doubt in self._doubts)
