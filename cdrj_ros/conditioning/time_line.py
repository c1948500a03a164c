"""What a raw reading must pass before ``step()`` sees it, and how several clocks become one line.

Every motor and joint is a channel of its own.  A channel's readings pass a gate; what passes is
brought to one time line: the union of all stamps, every channel interpolated linearly between its
own readings.  An estimate therefore waits until the slowest channel has been heard (holding the
last joint angle while the motor moves on would inject a sawtooth into the tensions).  The result
does not depend on the order in which different topics arrive.  Whoever cannot wait may have the
slower channels predicted.  docs/conditioning.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cdrj_ros.conditioning.gate import (
    CONFIRMATIONS,
    MAX_GAP_NS,
    SPEED_WINDOW_NS,
    Channel,
    limits_of,
)
from cdrj_ros.conditioning.samples import ALL_SEEN, Sample
from cdrj_ros.conditioning.tracking import Vector, new_track
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot.description import Robot

REFUSALS: Final[Mapping[str, str]] = {
    "malformed": "message refused whole: not as many positions as names, or not decodable",
    "empty": "message without a name",
    "unstamped": "message with a stamp that is not after zero",
    "unknown_name": "name that the robot file does not have",
    "not_finite": "NaN or infinite position",
    "repeated": "stamp equal to the last one accepted",
    "late": "stamp before the last one accepted, or before the clock's zero",
    "future": "stamp further ahead than any plausible gap, not borne out by others, or than any",
    "out_of_range": "joint angle outside its range",
    "implausible": "further from the last reading than the maximum speed allows, or than any angle",
}
"""Causes for which a reading is refused, and what they mean."""

WHOLE: Final = ("malformed", "empty", "unstamped")
"""Causes for which a message is refused whole, and counted once whatever it holds."""

END_OF_TIME_NS: Final = 2**31 * 1_000_000_000
"""Stamps of headers end before this [ns]."""

WAITING: Final = 20_000
"""Readings of a channel that may wait for another one: 20 s at 1 kHz."""

STRAGGLERS: Final = 100
"""Readings from before a jump of the clock that a channel may still deliver after it."""

MODES: Final = ("wait", "predict")
"""What happens while a channel lags: wait for it, or carry it on with its velocity."""

HORIZON_NS: Final = 20_000_000
"""A channel is predicted at most this far beyond its last reading [ns]."""


class Conditioner:
    """The gates and the time line of one robot; feed it messages, take samples."""

    def __init__(
        self,
        robot: Robot,
        mode: str = "wait",
        horizon_ns: int = HORIZON_NS,
        tracking: float | None = None,
    ) -> None:
        """Prepare the channels.

        Args:
            robot: names, sensors and limits.
            mode: one of ``MODES``.
            horizon_ns: how far to predict at most [ns].
            tracking: see ``limits_of``.
        """
        if mode not in MODES:
            raise UsageError(f"mode must be one of {', '.join(MODES)}, got {mode!r}")
        self._predict = mode == "predict"
        self._horizon = horizon_ns
        self._robot = robot
        self._limits = limits_of(robot, tracking)
        motors, joints = robot.motors, robot.joints
        self._motor_count = len(motors)
        self._motor_index = {motor.name: k for k, motor in enumerate(motors)}
        self._joint_index = {joint.name: len(motors) + k for k, joint in enumerate(joints)}
        self._both_index = {**self._motor_index, **self._joint_index}
        self.refused: dict[str, int] = dict.fromkeys(REFUSALS, 0)
        """Readings refused so far, by cause; of ``WHOLE`` causes, messages."""
        self.accepted = 0
        """Readings accepted so far."""
        self.elsewhere = 0
        """Readings of joints among motors, or of motors among joints: for another topic."""
        self.crowded = 0
        """Accepted readings given up because another channel kept them waiting for too long."""
        self.clock_jumps = 0
        """Times that the clock has gone back and everything was started anew."""
        self.gaps = 0
        """Times that a channel was silent for longer than ``MAX_GAP_NS``."""
        self.steps = 0
        """Times that a channel's readings stepped further than the axis can move, and stayed."""
        self.lag_ns = 0
        """How far the last samples lay behind the newest reading [ns]: the cost of waiting."""
        self._channels: list[Channel] = []
        self.reset()

    @property
    def held(self) -> int:
        """Readings of which it is not decided yet whether a clock has jumped."""
        return sum(len(channel.held) for channel in self._channels)

    @property
    def unheard(self) -> list[str]:
        """Motors and joints of which no reading has been accepted since the last reset."""
        return [c.limits.name for c in self._channels if c.last_stamp < 0]

    @property
    def suspected(self) -> bool:
        """Whether a reading has leapt, and whether to a step of the sensor is not decided yet."""
        return any(channel.leap is not None for channel in self._channels)

    @property
    def displaced(self) -> dict[str, float]:
        """By how much [rad] the readings of axes have stepped since the last reset, by name."""
        return {c.limits.name: c.displaced for c in self._channels if c.displaced}

    def reset(self, keep_turns: bool = False) -> None:
        """Forget all readings; the counters stay.

        Args:
            keep_turns: whether the turns of readings that start again after one are counted on
                however long the next reading takes; else only where it follows closely.
        """
        before = self._channels
        self._begin()
        for channel, old in zip(self._channels, before, strict=False):
            self._drop_held(old)
            if keep_turns:
                channel.turns, channel.last_reading = old.turns, old.last_reading
            elif old.last_stamp >= 0:
                channel.before = replace(old, readings=deque(), before=None)

    def _begin(self) -> None:
        self._channels = [Channel(limits) for limits in self._limits]
        self._given_out = -1
        self._missing = len(self._channels)

    def expect(self, angles: Vector) -> None:
        """Say where motors, then joints are [rad], before the first reading; shape (channels,)."""
        if angles.shape == (len(self._channels),) and np.all(np.isfinite(angles)):
            for channel, angle in zip(self._channels, angles.tolist(), strict=True):
                channel.near = angle

    def set_tracking(self, tracking: float | None) -> None:
        """Track with another bandwidth from now on, see ``limits_of``; no reading is lost."""
        self._limits = limits_of(self._robot, tracking)
        for channel, limits in zip(self._channels, self._limits, strict=True):
            channel.limits = limits
            channel.memory = new_track()

    def feed_motors(
        self, stamp_ns: int, names: Sequence[str], positions: Sequence[float] | Vector
    ) -> list[Sample]:
        """Take a message of motor angles [rad]; returns the samples that are now complete."""
        return self._feed(self._motor_index, stamp_ns, names, positions)

    def feed_joints(
        self, stamp_ns: int, names: Sequence[str], positions: Sequence[float] | Vector
    ) -> list[Sample]:
        """Take a message of joint angles [rad]; returns the samples that are now complete."""
        return self._feed(self._joint_index, stamp_ns, names, positions)

    def feed_both(
        self, stamp_ns: int, names: Sequence[str], positions: Sequence[float] | Vector
    ) -> list[Sample]:
        """Take a message of motors and joints alike; returns the samples that are complete."""
        return self._feed(self._both_index, stamp_ns, names, positions)

    def _feed(
        self,
        index: Mapping[str, int],
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float] | Vector,
    ) -> list[Sample]:
        if len(names) != len(positions):
            self.refused["malformed"] += 1
            return []
        if not names:
            self.refused["empty"] += 1
            return []
        if stamp_ns <= 0:
            self.refused["unstamped"] += 1
            return []
        news = False
        # plain numbers are several times faster to compare than NumPy's
        values = positions.tolist() if isinstance(positions, np.ndarray) else positions
        for name, position in zip(names, values):  # noqa: B905 as many of each, see above
            k = index.get(name)
            if k is None:
                if name in self._both_index:  # a joint among motors, say, is no stranger
                    self.elsewhere += 1
                else:
                    self.refused["unknown_name"] += 1
            elif self._admit(k, stamp_ns, float(position)):
                news = True
        return self._complete_samples() if news else []

    def _admit(self, k: int, stamp: int, reading: float) -> bool:
        """The gate; True where the reading, or ones held before it, joined the channel."""
        channel = self._channels[k]
        refused = self.refused
        if reading - reading != 0.0:  # NaN and both infinities
            refused["not_finite"] += 1
            return False
        stamp += channel.limits.sensor.clock_offset_ns
        if not 0 < stamp < END_OF_TIME_NS:
            refused["late" if stamp <= 0 else "future"] += 1
            return False
        if channel.before is not None:
            channel.go_on_turning(stamp)
        complaint = channel.complaint(stamp, reading)
        if complaint and complaint != "implausible":
            refused[complaint] += 1
            return False
        last = channel.last_stamp
        if last >= 0:
            ahead = stamp - last
            if ahead == 0:
                refused["repeated"] += 1
                return False
            if ahead > channel.patience_ns or ahead < -MAX_GAP_NS or (ahead < 0 and channel.held):
                return self._hold(k, stamp, reading)
            if ahead < 0:
                refused["late"] += 1
                return False
        elif channel.left_behind >= 0 and self._is_straggler(channel, stamp):
            refused["late"] += 1
            return False
        if complaint:
            refused[complaint] += 1
            channel.note_implausible(stamp, reading)
            return False
        if channel.held:
            self._drop_held(channel)
        self._append(channel, stamp, reading)
        return True

    def _is_straggler(self, channel: Channel, stamp: int) -> bool:
        """Whether a channel's first reading after a jump back is still one from before it.

        A topic's last messages may arrive after another topic has gone back already.
        """
        if abs(stamp - channel.left_behind) > MAX_GAP_NS or channel.stragglers >= STRAGGLERS:
            return False
        newest = max(other.last_stamp for other in self._channels)
        if stamp - newest <= MAX_GAP_NS:
            return False
        channel.stragglers += 1
        return True

    def _append(self, channel: Channel, stamp: int, reading: float) -> None:
        value = angle = channel.angle_at(reading)
        self.steps += channel.note_plausible(stamp, value)
        if channel.limits.bandwidth > 0.0:
            angle = channel.between_counts(stamp, value)
        channel.turns = channel.turns_at(reading)
        motion = channel.motion
        motion.take(stamp, value)
        curvature = 0.0
        if channel.last_stamp < 0:
            self._missing -= 1
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
        self.accepted += 1

    def _drop_held(self, channel: Channel) -> None:
        """The clock did not jump after all."""
        for stamp, _ in channel.held:
            self.refused["future" if stamp > channel.last_stamp else "late"] += 1
        channel.held.clear()

    def _hold(self, k: int, stamp: int, reading: float) -> bool:
        """Keep a reading of another time until enough others follow it."""
        channel = self._channels[k]
        held = channel.held
        if held and not channel.follows(stamp):
            self._drop_held(channel)
        held.append((stamp, reading))
        regular = channel.is_regular()
        if len(held) < CONFIRMATIONS and not regular:
            return False
        confirmed = list(held)
        held.clear()
        if regular:
            return self._append_held(channel, confirmed)
        if confirmed[0][0] < channel.last_stamp:
            self._jump_back()
            return self._append_held(self._channels[k], confirmed)
        self.gaps += 1
        if self._given_out >= 0:  # the way that the axis has come since is unknown
            self._given_out = max(self._given_out, confirmed[0][0] - 1)
        usual = channel.usual_ns
        used = self._append_held(channel, confirmed[:1])
        channel.usual_ns = usual  # a gap is no rate
        return self._append_held(channel, confirmed[1:]) or used

    def _append_held(self, channel: Channel, confirmed: Sequence[tuple[int, float]]) -> bool:
        """Use readings of another time, one after the other; True where one can be used."""
        before = self.accepted
        for stamp, reading in confirmed:
            if complaint := channel.complaint(stamp, reading):
                self.refused[complaint] += 1
                if complaint == "implausible":
                    channel.note_implausible(stamp, reading)
            else:
                self._append(channel, stamp, reading)
        return self.accepted > before

    def _jump_back(self) -> None:
        """Start anew; what other channels hold from the new time is theirs from now on."""
        self.clock_jumps += 1
        held = [
            channel.held if channel.held and channel.held[0][0] < channel.last_stamp else []
            for channel in self._channels
        ]
        for channel, kept in zip(self._channels, held, strict=True):
            if channel.held and not kept:
                self._drop_held(channel)
        confirmed = [list(kept) for kept in held]
        left_behind = [channel.last_stamp for channel in self._channels]
        for channel in self._channels:
            channel.held.clear()
        self._begin()
        for channel, kept, last in zip(self._channels, confirmed, left_behind, strict=True):
            channel.left_behind = last
            self._append_held(channel, kept)

    def _complete_samples(self) -> list[Sample]:
        """All stamps of all channels up to the one that every channel has reached."""
        if self._missing:
            return []
        channels = self._channels
        until = channels[0].last_stamp
        for channel in channels:
            until = min(until, channel.last_stamp)
        given_out = self._given_out
        motors = self._motor_count
        samples: list[Sample] = []
        began = given_out >= 0
        if not began:
            given_out = max(channel.readings[0][0] for channel in channels) - 1
        elif given_out >= until and not self._predict:
            return samples
        while given_out < until:
            stamp = until
            for channel in channels:
                for when, _, _ in channel.readings:
                    if when > given_out:
                        stamp = min(stamp, when)
                        break
            values = np.array([_value_at(channel.readings, stamp) for channel in channels])
            unseen = _unseen_at(channels, stamp, given_out if began else stamp)
            samples.append(Sample(stamp, values[:motors], values[motors:], unseen))
            given_out, began = stamp, True
        newest = max(channel.last_stamp for channel in channels)
        if self._predict and given_out < newest <= until + self._horizon:
            values = np.array([_predicted(channel, newest) for channel in channels])
            unseen = _unseen_ahead(channels, newest, given_out)
            samples.append(Sample(newest, values[:motors], values[motors:], unseen))
            given_out = newest
            for channel in channels:  # nobody asks for what lies behind
                while len(channel.readings) > 1 and channel.readings[1][0] <= given_out:
                    channel.readings.popleft()
        self._given_out = given_out
        self.lag_ns = newest - given_out
        return samples


def _predicted(channel: Channel, stamp: int) -> float:
    """A channel's angle at, or beyond, its last reading [rad], within its limits."""
    ahead = stamp - channel.last_stamp
    value = channel.recent[-1][1] + channel.velocity() * (ahead * 1e-9)
    return min(max(value, channel.limits.lower), channel.limits.upper)


def _value_at(readings: deque[tuple[int, float, float]], stamp: int) -> float:
    """Linear interpolation; drops readings that no later sample needs."""
    while len(readings) > 1 and readings[1][0] <= stamp:
        readings.popleft()
    before, value, _ = readings[0]
    if before == stamp:
        return value
    after, following, _ = readings[1]
    return value + (following - value) * ((stamp - before) / (after - before))


def _unseen_at(channels: Sequence[Channel], stamp: int, previous: int) -> Vector:
    """``Sample.unseen`` of an interpolated sample, (C3), after ``_value_at`` of every channel.

    Args:
        channels: all of them.
        stamp: the sample's [ns].
        previous: stamp of the sample before [ns]; the same where there is none.
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
            unseen[0, k] = curvature * (stamp - before) * (after - stamp)
            unseen[1, k] = way
    return ALL_SEEN if unseen is None else unseen


def _unseen_ahead(channels: Sequence[Channel], stamp: int, previous: int) -> Vector:
    """``Sample.unseen`` of a predicted sample, (C4)."""
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
    """Standard deviation midway between two samples [rad], (C3); 0 where negligible."""
    way = curvature * interval_ns * interval_ns * 0.25
    return way if way > negligible else 0.0
