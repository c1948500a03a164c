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
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import Sample, Samples
from cdrj_ros.estimation.tracking import Vector, half_width, new_track, track, track_all
from cdrj_ros.model.errors import UsageError
from cdrj_ros.model.robot import Robot, Sensor

Stamps = NDArray[np.int64]

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

MAX_GAP_NS: Final = 1_000_000_000
"""A stamp further than this from the last one is believed only when others bear it out [ns]."""

CONFIRMATIONS: Final = 5
"""Consecutive readings that must agree before a channel follows a jump of the clock."""

LARGEST: Final = 1e12
"""No axis turns as far [rad]."""

WAITING: Final = 20_000
"""Readings of a channel that may wait for another one: 20 s at 1 kHz."""

RANGE_MARGIN: Final = 1e-9
"""Rounding allowed at the ends of a joint's range [rad]."""

STRAGGLERS: Final = 100
"""Readings from before a jump of the clock that a channel may still deliver after it."""

MODES: Final = ("wait", "predict")
"""What happens while a channel lags: wait for it, or carry it on with its velocity."""

HORIZON_NS: Final = 20_000_000
"""A channel is predicted at most this far beyond its last reading [ns]."""

SPEED_WINDOW_NS: Final = 20_000_000
"""The velocity is that over the last readings of this time [ns]."""


@dataclass(frozen=True)
class Limits:
    """What a channel's readings must satisfy."""

    name: str
    lower: float = float("-inf")
    """[rad]."""
    upper: float = float("inf")
    """[rad]."""
    max_speed: float = float("inf")
    """[rad/s]."""
    sensor: Sensor = field(default_factory=Sensor)
    """How readings become angles."""
    bandwidth: float = 0.0
    """Of the filter that finds the angle between counts [Hz]; 0 for none."""
    start: float = 0.0
    """Of the angles that a first reading may mean, the one nearest to this is taken [rad]."""

    def first_turn(self, reading: float, near: float | None = None) -> int:
        """How often a first reading has started again: the angle nearest to ``near``, in range.

        Args:
            reading: as the sensor gives it [rad].
            near: angle [rad]; None for ``start``.
        """
        sensor = self.sensor
        if sensor.period == float("inf"):
            return 0
        wanted = self.start if near is None else near
        turns = ((wanted - sensor.offset) / sensor.scale - reading) / sensor.period
        if not abs(turns) < LARGEST:
            return 0
        turn = round(turns)
        for candidate in (turn, turn - 1, turn + 1):
            angle = sensor.scale * (reading + sensor.period * candidate) + sensor.offset
            if self.lower - RANGE_MARGIN <= angle <= self.upper + RANGE_MARGIN:
                return candidate
        return turn

    @property
    def band(self) -> float:
        """How far that angle may be from the reading [rad]."""
        return half_width(self.sensor)


def limits_of(robot: Robot, tracking: float | None = None) -> tuple[Limits, ...]:
    """Limits of all motors, then all joints, in the robot's order.

    Args:
        robot: names, sensors and limits.
        tracking: bandwidth [Hz] instead of the robot file's, 0 for no tracking; a sensor without
            resolution and noise is not tracked.
    """

    def bandwidth(sensor: Sensor) -> float:
        if tracking is None or not half_width(sensor) > 0.0:
            return sensor.tracking_bandwidth
        return tracking

    return (
        *(
            Limits(
                motor.name,
                max_speed=motor.max_speed,
                sensor=motor.sensor,
                bandwidth=bandwidth(motor.sensor),
                start=motor.reference_angle,
            )
            for motor in robot.motors
        ),
        *(
            Limits(
                joint.name,
                joint.lower,
                joint.upper,
                joint.max_speed,
                joint.sensor,
                bandwidth(joint.sensor),
                joint.reference_angle,
            )
            for joint in robot.joints
        ),
    )


@dataclass
class _Channel:
    """One channel's gate and the readings that wait for the other channels."""

    limits: Limits
    last_stamp: int = -1
    last_value: float = 0.0
    readings: deque[tuple[int, float]] = field(default_factory=deque)
    """Accepted; the first one is the newest at or before the last sample that was given out."""
    held: list[tuple[int, float]] = field(default_factory=list)
    """Readings from a clock that may have jumped."""
    last_reading: float | None = None
    """As the sensor gave it, before its period was taken into account [rad]."""
    turns: int = 0
    """How often the reading has started again."""
    near: float | None = None
    """Where the axis is expected before its first reading [rad]."""
    before: _Channel | None = None
    """The channel before a reset, until a first reading has come."""
    refused_stamp: int = -1
    """Stamp [ns] and angle [rad] of the last reading that was refused as implausible."""
    refused_value: float = 0.0
    agreeing: int = 0
    """Readings refused as implausible one after the other that are plausible beside each other."""
    step: float = 0.0
    """From the last accepted reading to the first of these [rad]."""
    displaced: float = 0.0
    """Sum of the steps by which the readings have been displaced since the last reset [rad]."""
    recent: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=1000))
    """What the velocity is taken from."""
    memory: Vector = field(default_factory=new_track)
    """Of the filter between counts."""
    left_behind: int = -1
    """Last stamp before the clock went back, until a reading of the new time has come [ns]."""
    stragglers: int = 0

    def turns_at(self, reading: float) -> int:
        """How often the reading has started again if it is the next one."""
        period = self.limits.sensor.period
        if period == float("inf"):
            return 0
        if self.last_reading is None:
            return self.limits.first_turn(reading, self.near)
        return self.turns + round((self.last_reading - reading) / period)

    def angle_at(self, reading: float) -> float:
        """Angle [rad] of a reading if it is the next one."""
        sensor = self.limits.sensor
        if sensor.period != float("inf"):
            reading = reading + sensor.period * self.turns_at(reading)
        if sensor.scale != 1.0 or sensor.offset != 0.0:
            reading = sensor.scale * reading + sensor.offset
        if sensor.corrected_at:
            reading += float(np.interp(reading, sensor.corrected_at, sensor.correction))
        return reading

    def complaint(self, stamp: int, reading: float) -> str:
        """Why a reading cannot be the next one: a key of ``REFUSALS``; empty where it can."""
        limits = self.limits
        if not -LARGEST <= reading <= LARGEST:
            return "implausible" if limits.upper == float("inf") else "out_of_range"
        value = self.angle_at(reading)
        if not limits.lower - RANGE_MARGIN <= value <= limits.upper + RANGE_MARGIN:
            return "out_of_range"
        if self.last_stamp >= 0:
            ahead = stamp - self.last_stamp
            if ahead > 0 and abs(value - self.last_value) > limits.max_speed * (ahead * 1e-9):
                return "implausible"
        return ""

    def go_on_turning(self, stamp: int) -> None:
        """Count on from the turns before a reset if the first reading follows closely."""
        before, self.before = self.before, None
        if before is not None and 0 < stamp - before.last_stamp <= MAX_GAP_NS:
            self.turns, self.last_reading = before.turns, before.last_reading

    def note_implausible(self, stamp: int, reading: float) -> None:
        """A reading that is further away than the axis can be: a glitch, or a lasting step?"""
        if not abs(reading) <= LARGEST:
            self.agreeing = 0
            return
        value = self.angle_at(reading)
        since = (stamp - self.refused_stamp) * 1e-9
        near = abs(value - self.refused_value) <= self.limits.max_speed * since
        if not (self.agreeing and near):
            self.agreeing, self.step = 0, value - self.last_value
        self.agreeing += 1
        self.refused_stamp, self.refused_value = stamp, value

    def note_plausible(self, value: float) -> bool:
        """An angle that is accepted; True where it is the far side of a step that lasts."""
        stepped = self.agreeing >= CONFIRMATIONS and abs(value - self.refused_value) < abs(
            value - self.last_value
        )
        if stepped:
            self.displaced += self.step
        self.agreeing = 0
        return stepped

    def velocity(self) -> float:
        """Over the last ``SPEED_WINDOW_NS`` [rad/s]; 0 where there is one reading."""
        begin, first = self.recent[0]
        span = self.last_stamp - begin
        return (self.recent[-1][1] - first) / span * 1e9 if span > 0 else 0.0

    def between_counts(self, stamp: int, value: float) -> float:
        """The angle at a reading that has just passed [rad], before it becomes the last one."""
        limits = self.limits
        angle = track(self.memory, stamp - self.last_stamp, value, limits.bandwidth, limits.band)
        return min(max(angle, limits.lower), limits.upper)


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
        self._channels: list[_Channel] = []
        self.reset()

    @property
    def held(self) -> int:
        """Readings of which it is not decided yet whether a clock has jumped."""
        return sum(len(channel.held) for channel in self._channels)

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
        self._channels = [_Channel(limits) for limits in self._limits]
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
            if ahead > MAX_GAP_NS or ahead < -MAX_GAP_NS or (ahead < 0 and channel.held):
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

    def _is_straggler(self, channel: _Channel, stamp: int) -> bool:
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

    def _append(self, channel: _Channel, stamp: int, reading: float) -> None:
        value = angle = channel.angle_at(reading)
        if channel.agreeing:
            self.steps += channel.note_plausible(value)
        if channel.limits.bandwidth > 0.0:
            angle = channel.between_counts(stamp, value)
        channel.turns = channel.turns_at(reading)
        if channel.last_stamp < 0:
            self._missing -= 1
        channel.last_stamp = stamp
        channel.last_value = value
        channel.last_reading = reading
        readings = channel.readings
        readings.append((stamp, angle))
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

    def _drop_held(self, channel: _Channel) -> None:
        """The clock did not jump after all."""
        for stamp, _ in channel.held:
            self.refused["future" if stamp > channel.last_stamp else "late"] += 1
        channel.held.clear()

    def _hold(self, k: int, stamp: int, reading: float) -> bool:
        """Keep a reading of another time until enough others follow it."""
        channel = self._channels[k]
        held = channel.held
        if held and not 0 < stamp - held[-1][0] <= MAX_GAP_NS:
            self._drop_held(channel)
        held.append((stamp, reading))
        if len(held) < CONFIRMATIONS:
            return False
        confirmed = list(held)
        held.clear()
        if confirmed[0][0] < channel.last_stamp:
            self._jump_back()
            channel = self._channels[k]
        else:
            self.gaps += 1
            if self._given_out >= 0:  # nobody knows the way that the axis has come since
                self._given_out = max(self._given_out, confirmed[0][0] - 1)
        return self._append_held(channel, confirmed)

    def _append_held(self, channel: _Channel, confirmed: Sequence[tuple[int, float]]) -> bool:
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
        if given_out < 0:
            given_out = max(channel.readings[0][0] for channel in channels) - 1
        elif given_out >= until and not self._predict:
            return samples
        while given_out < until:
            stamp = until
            for channel in channels:
                for when, _ in channel.readings:
                    if when > given_out:
                        stamp = min(stamp, when)
                        break
            values = np.array([_value_at(channel.readings, stamp) for channel in channels])
            samples.append(Sample(stamp, values[:motors], values[motors:]))
            given_out = stamp
        newest = max(channel.last_stamp for channel in channels)
        if self._predict and given_out < newest <= until + self._horizon:
            values = np.array([_predicted(channel, newest) for channel in channels])
            samples.append(Sample(newest, values[:motors], values[motors:]))
            given_out = newest
            for channel in channels:  # nobody asks for what lies behind
                while len(channel.readings) > 1 and channel.readings[1][0] <= given_out:
                    channel.readings.popleft()
        self._given_out = given_out
        self.lag_ns = newest - given_out
        return samples


def _predicted(channel: _Channel, stamp: int) -> float:
    """A channel's angle at, or beyond, its last reading [rad], within its limits."""
    ahead = stamp - channel.last_stamp
    value = channel.recent[-1][1] + channel.velocity() * (ahead * 1e-9)
    return min(max(value, channel.limits.lower), channel.limits.upper)


def _value_at(readings: deque[tuple[int, float]], stamp: int) -> float:
    """Linear interpolation; drops readings that no later sample needs."""
    while len(readings) > 1 and readings[1][0] <= stamp:
        readings.popleft()
    before, value = readings[0]
    if before == stamp:
        return value
    after, following = readings[1]
    return value + (following - value) * ((stamp - before) / (after - before))


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
    if clean and mode == "wait" and all(readings.stamp_ns[0] > 0 for readings in known):
        refused = dict.fromkeys(REFUSALS, 0)
        refused["unknown_name"] = sum(readings.stamp_ns.size for readings in strangers)
        accepted = sum(readings.stamp_ns.size for readings in known)
        angles = list(map(_between_counts, angles, limits))
        return Conditioned((_merge(angles, len(robot.motors)),), refused, accepted, 0, 0)
    return _replay(robot, motors, joints, mode)


def _angles(readings: Readings, limits: Limits) -> Readings:
    """Readings as angles, as ``_Channel.angle_at`` makes them."""
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
    """As ``_Channel.between_counts``, for a clean channel."""
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


def _merge(channels: Sequence[Readings], motor_count: int) -> Samples:
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
    )


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
    return Samples(
        np.array([sample.stamp_ns for sample in samples], dtype=np.int64),
        np.array(list(chain.from_iterable(s.motor_angle for s in samples))).reshape(n, motors),
        np.array(list(chain.from_iterable(s.joint_angle for s in samples))).reshape(n, joints),
    )
