"""Gates that check the readings, and the common time line of the samples for ``step()``.

Every motor and joint is a channel with a gate of its own.  Accepted readings are brought to one
time line: the union of all stamps, with every channel interpolated linearly between its own
readings.  An estimate therefore waits for the slowest channel: holding the last joint angle while
the motor moves on would add a sawtooth to the tensions.  The result does not depend on the order in
which different topics arrive.  Where waiting costs too much, ``predict`` gives further samples in
advance, for which the slower channels are extrapolated.  See docs/conditioning.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.gate import (
    CONFIRMATIONS,
    MAX_GAP_NS,
    SPEED_WINDOW_NS,
    Channel,
    Doubt,
    limits_of,
)
from cdrj_ros.conditioning.interpolation import (
    predicted,
    unseen_ahead,
    unseen_at,
    unseen_before,
    value_at,
)
from cdrj_ros.conditioning.motion import LASTING
from cdrj_ros.conditioning.samples import Sample
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
    "future": "stamp too far ahead and not confirmed by later readings, or never valid",
    "out_of_range": "joint angle outside its range",
    "implausible": "further from the last reading than max_speed allows, or than any angle",
}
"""Causes for which a reading is refused, and their meaning."""

WHOLE: Final = ("malformed", "empty", "unstamped")
"""Causes for which a message is refused whole and counted once, however many names it has."""

END_OF_TIME_NS: Final = 2**31 * 1_000_000_000
"""Every stamp of a message header is below this [ns]."""

WAITING: Final = 20_000
"""Greatest number of readings that a channel keeps for another channel: 20 s at 1 kHz."""

STRAGGLERS: Final = 100
"""Greatest number of readings from before a clock jump that a channel may deliver after it."""

Mode = Literal["wait", "predict"]
MODES: Final[tuple[Mode, ...]] = get_args(Mode)
"""How a lagging channel is handled: wait for it, or extrapolate it with its velocity meanwhile."""

HORIZON_NS: Final = 20_000_000
"""A channel is predicted at most this far beyond its last reading [ns]."""

Timing = Literal["", "repeated", "late", "another time"]
"""Result for a stamp: usable, a cause of refusal, or held until later readings confirm it."""


class Conditioner:
    """Gates and time line of one robot: takes messages, returns samples."""

    def __init__(
        self,
        robot: Robot,
        mode: Mode = "wait",
        horizon_ns: int = HORIZON_NS,
        tracking: float | None = None,
    ) -> None:
        """Prepare the channels.

        Args:
            robot: names, sensors and limits.
            mode: one of ``MODES``.
            horizon_ns: longest time to predict [ns].
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
        """Readings refused so far, by cause; for the causes of ``WHOLE``, messages."""
        self.accepted = 0
        """Readings accepted so far."""
        self.elsewhere = 0
        """Readings ignored so far: joints in a message of motors, or motors in one of joints."""
        self.crowded = 0
        """Accepted readings dropped because they had waited too long for another channel."""
        self.clock_jumps = 0
        """Number of times that the clock went back and conditioning restarted."""
        self.gaps = 0
        """Number of times that a channel was silent for longer than ``Channel.patience_ns``."""
        self.steps = 0
        """Number of steps of sensors: the readings moved further than the axis can, and stayed."""
        self.lag_ns = 0
        """Lag of the last sample behind the newest reading [ns]."""
        self._channels: list[Channel] = []
        self.reset()

    @property
    def held(self) -> int:
        """Number of readings held until it is known whether the clock has jumped."""
        return sum(len(channel.held) for channel in self._channels)

    @property
    def unheard(self) -> list[str]:
        """Motors and joints without an accepted reading since the last reset."""
        return [c.limits.name for c in self._channels if c.last_stamp < 0]

    @property
    def displaced(self) -> dict[str, float]:
        """Sum of the steps [rad] of every sensor that has stepped since the last reset, by name."""
        return {c.limits.name: c.displaced for c in self._channels if c.stepped}

    def reset(self, keep_turns: bool = False) -> None:
        """Forget all readings; the counters stay.

        Args:
            keep_turns: keep the motion estimates of the axes and the count of turns of every sensor
                with a ``period``.  Otherwise only the count is kept, and only if the next reading
                follows within ``MAX_GAP_NS``.
        """
        before = self._channels
        self._begin()
        for channel, old in zip(self._channels, before, strict=False):
            self._drop_held(old)
            if keep_turns:
                channel.turns, channel.last_reading = old.turns, old.last_reading
                channel.motion = old.motion.elsewhen()
            elif old.last_stamp >= 0:
                channel.before = replace(old, readings=deque(), before=None)

    def _begin(self) -> None:
        self._channels = [Channel(limits) for limits in self._limits]
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
        self._missing = len(self._channels)

    def memory(self) -> dict[str, NDArray[np.float64]]:
        """Values that outlast a restart, for ``recall``: ``LASTING`` and the sensors' steps."""
        rows = [
            (*(getattr(c.motion, name) for name in LASTING), c.displaced) for c in self._channels
        ]
        stepped = [float(channel.stepped) for channel in self._channels]
        return {"axes": np.array(rows), "stepped": np.array(stepped)}

    def recall(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore the values of ``memory``; ignore them if shapes or values are invalid."""
        rows, stepped = arrays.get("axes"), arrays.get("stepped")
        shape = (len(self._channels), len(LASTING) + 1)
        if rows is None or stepped is None or rows.shape != shape or stepped.shape != shape[:1]:
            return
        if not (np.all(np.isfinite(rows)) and np.all(rows[:, :-1] >= 0.0)):
            return
        for channel, row, step in zip(self._channels, rows.tolist(), stepped.tolist(), strict=True):
            known = dict(zip(LASTING, row, strict=False))
            channel.motion = replace(channel.limits.motion(), **known).elsewhen()
            channel.displaced, channel.stepped = row[-1], step != 0.0

    def expect(self, angles: Vector, stamp_ns: int) -> None:
        """Continue from the last sample of an earlier run.

        Args:
            angles: of motors, then joints [rad], shape (channels,).
            stamp_ns: of that sample [ns].
        """
        if angles.shape == (len(self._channels),) and np.all(np.isfinite(angles)):
            self._resumed = stamp_ns
            for channel, angle in zip(self._channels, angles.tolist(), strict=True):
                channel.near = angle
                channel.motion.take(stamp_ns, angle)

    def set_tracking(self, tracking: float | None) -> None:
        """Change the tracking bandwidth, see ``limits_of``; no reading is lost."""
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
        """Take a message of motors and joints; returns the samples that are now complete."""
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
        # Python's numbers compare several times faster than NumPy's
        values = positions.tolist() if isinstance(positions, np.ndarray) else positions
        for name, position in zip(names, values):  # noqa: B905 lengths are equal, see above
            k = index.get(name)
            if k is None:
                if name in self._both_index:  # a joint among motors, for example
                    self.elsewhere += 1
                else:
                    self.refused["unknown_name"] += 1
            elif self._admit(k, stamp_ns, float(position)):
                news = True
        return self._complete_samples() if news else []

    def _admit(self, k: int, stamp: int, reading: float) -> bool:
        """Apply the gate; True if the reading, or a held one before it, joined the channel."""
        channel = self._channels[k]
        stamp += channel.limits.sensor.clock_offset_ns
        if 0 < stamp < END_OF_TIME_NS and channel.is_ordinary(stamp, reading):
            self._keep(channel, stamp, reading, reading)
            return True
        cause: str = _unusable(stamp, reading)
        if not cause:
            if channel.before is not None:
                channel.go_on_turning(stamp)
            cause = channel.complaint(stamp, reading)
            if not cause or cause == "implausible":
                timing = self._timing(channel, stamp)
                if timing == "another time":
                    return self._hold(k, stamp, reading)
                cause = timing or cause
        if cause:
            self.refused[cause] += 1
            if cause == "implausible":
                channel.note_implausible(stamp, reading)
            return False
        if channel.held:
            self._drop_held(channel)
        self._append(channel, stamp, reading)
        return True

    def _timing(self, channel: Channel, stamp: int) -> Timing:
        """Compare a stamp with the last one accepted on the channel."""
        last = channel.last_stamp
        if last < 0:
            return "late" if channel.left_behind >= 0 and self._is_straggler(channel, stamp) else ""
        ahead = stamp - last
        if 0 < ahead <= MAX_GAP_NS or 0 < ahead <= channel.patience_ns:
            return ""
        if ahead == 0:
            return "repeated"
        if ahead > 0 or ahead < -MAX_GAP_NS or channel.held:
            return "another time"
        return "late"

    def _is_straggler(self, channel: Channel, stamp: int) -> bool:
        """Whether the first reading after the clock went back has a stamp from before the jump.

        The last messages of one topic may arrive after the first messages of another topic that
        carry the new time.
        """
        if abs(stamp - channel.left_behind) > MAX_GAP_NS or channel.stragglers >= STRAGGLERS:
            return False
        newest = max(other.last_stamp for other in self._channels)
        if stamp - newest <= MAX_GAP_NS:
            return False
        channel.stragglers += 1
        return True

    def _append(self, channel: Channel, stamp: int, reading: float) -> None:
        """Add an accepted reading to its channel."""
        value = channel.angle_at(reading)
        self.steps += channel.note_plausible(stamp, value)
        if doubt := channel.note_doubt(stamp):
            self._doubts.append(doubt)
        channel.turns = channel.turns_at(reading)
        self._keep(channel, stamp, reading, value)

    def _keep(self, channel: Channel, stamp: int, reading: float, value: float) -> None:
        """Store an accepted reading, whose angle is ``value`` [rad], for the samples."""
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
        self.accepted += 1

    def _drop_held(self, channel: Channel) -> None:
        """Refuse the held readings: the clock did not jump."""
        for stamp, _ in channel.held:
            self.refused["future" if stamp > channel.last_stamp else "late"] += 1
        channel.held.clear()

    def _hold(self, k: int, stamp: int, reading: float) -> bool:
        """Hold a reading with a distant stamp; use all held ones once enough have followed."""
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
        if self._given_out >= 0:  # the motion during the gap is unknown
            self._given_out = max(self._given_out, confirmed[0][0] - 1)
        usual = channel.usual_ns
        used = self._append_held(channel, confirmed[:1])
        channel.usual_ns = usual  # a gap is not the channel's rate
        if used and self._given_out >= 0:
            # an axis that stands where it stood is taken to have rested
            channel.readings[-1] = (*channel.readings[-1][:2], 0.0)
        return self._append_held(channel, confirmed[1:]) or used

    def _append_held(self, channel: Channel, confirmed: Sequence[tuple[int, float]]) -> bool:
        """Use confirmed readings one by one; True if at least one is accepted."""
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
        """Restart with the held readings of every channel that have the new time."""
        self.clock_jumps += 1
        held = [
            channel.held if channel.held and channel.held[0][0] < channel.last_stamp else []
            for channel in self._channels
        ]
        for channel, kept in zip(self._channels, held, strict=True):
            if channel.held and not kept:
                self._drop_held(channel)
        confirmed = [list(kept) for kept in held]
        before = self._channels
        for channel in before:
            channel.held.clear()
        self._begin()
        for channel, kept, old in zip(self._channels, confirmed, before, strict=True):
            channel.left_behind = old.last_stamp
            channel.take_over(old)
            self._append_held(channel, kept)

    def _complete_samples(self) -> list[Sample]:
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
            values = np.array([value_at(channel.readings, stamp) for channel in channels])
            if began:
                unseen = unseen_at(channels, stamp, given_out)
            else:
                unseen = unseen_before(channels, stamp, self._resumed)
            given_out = stamp
            if unseen.size and unseen[0].max() == inf:  # nothing is known of an axis here
                self._passed_over = stamp
                continue
            doubtful = self._is_doubtful(stamp) if self._doubts else False
            sample = Sample(stamp, values[:motors], values[motors:], unseen, doubtful)
            samples.append(sample if stamp > self._ahead else sample._replace(silent=True))
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


def _unusable(stamp: int, reading: float) -> Literal["", "not_finite", "late", "future"]:
    """Cause for refusing a reading on any channel; empty if there is none."""
    if reading - reading != 0.0:  # NaN and both infinities
        return "not_finite"
    if not 0 < stamp < END_OF_TIME_NS:
        return "late" if stamp <= 0 else "future"
    return ""
