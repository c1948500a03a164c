"""Conditioning of one robot's messages: gates that check the readings, then the common time line.

Every motor and joint is a channel with a gate of its own.  Messages of the robot are taken here;
readings that pass their gates go on to the time line, which makes samples of them.  See
docs/conditioning.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.gate import CONFIRMATIONS, Channel, limits_of
from cdrj_ros.conditioning.motion import LASTING
from cdrj_ros.conditioning.ordinary import OrdinaryReadings
from cdrj_ros.conditioning.refusals import END_OF_TIME_NS, REFUSALS, unusable
from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.conditioning.stamps import timing_of
from cdrj_ros.conditioning.time_line import HORIZON_NS, MODES, Mode, TimeLine
from cdrj_ros.conditioning.tracking import Vector, new_track
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot.description import Robot


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
        self._robot = robot
        self._limits = limits_of(robot, tracking)
        motors, joints = robot.motors, robot.joints
        self._motor_index = {motor.name: k for k, motor in enumerate(motors)}
        self._joint_index = {joint.name: len(motors) + k for k, joint in enumerate(joints)}
        self._both_index = {**self._motor_index, **self._joint_index}
        self.refused: dict[str, int] = dict.fromkeys(REFUSALS, 0)
        """Readings refused so far, by cause; for the causes of ``WHOLE``, messages."""
        self.accepted = 0
        """Readings accepted so far."""
        self.elsewhere = 0
        """Readings ignored so far: joints in a message of motors, or motors in one of joints."""
        self.clock_jumps = 0
        """Number of times that the clock went back and conditioning restarted."""
        self.gaps = 0
        """Number of times that a channel was silent for longer than ``Channel.patience_ns``."""
        self.steps = 0
        """Number of steps of sensors: the readings moved further than the axis can, and stayed."""
        self.time_line = TimeLine(len(motors), mode, horizon_ns)
        self.ordinary = OrdinaryReadings(len(motors), len(joints))
        """Takes ordinary messages while it is loaded, see ``begin_ordinary``."""
        self._stored_channels: list[Channel] = []
        self.reset()

    @property
    def _channels(self) -> list[Channel]:
        """The channels; ordinary messages are not taken from now on."""
        if self.ordinary.loaded:
            self.ordinary.store(self._stored_channels, self.time_line, self.accepted)
        return self._stored_channels

    def begin_ordinary(self) -> None:
        """Let ``ordinary`` take messages if nothing is special; call after every sample."""
        if not self.ordinary.loaded:
            self.ordinary.load(self._stored_channels, self.time_line, self.accepted)

    def index_of(self, kind: str) -> Mapping[str, int]:
        """Channels by name in messages of one kind: ``motors``, ``joints`` or ``both``."""
        return {"motors": self._motor_index, "joints": self._joint_index}.get(
            kind, self._both_index
        )

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
        self._stored_channels = [Channel(limits) for limits in self._limits]
        self.time_line.begin(self._stored_channels)

    def memory(self) -> dict[str, NDArray[np.float64]]:
        """Values that outlast a restart, for ``recall``: ``LASTING`` and the sensors' steps."""
        rows = [
            (*(getattr(c.motion, name) for name in LASTING), c.displaced) for c in self._channels
        ]
        stepped = [float(channel.stepped) for channel in self._channels]
        return {"axes": np.array(rows), "stepped": np.array(stepped)}

    def recall(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore the values of ``memory`` before the first reading; ignore invalid ones."""
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
            self.time_line.resume(stamp_ns)
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
        return self.time_line.samples() if news else []

    def _admit(self, k: int, stamp: int, reading: float) -> bool:
        """Apply the gate; True if the reading, or a held one before it, joined the channel."""
        channel = self._channels[k]
        stamp += channel.limits.sensor.clock_offset_ns
        if 0 < stamp < END_OF_TIME_NS and channel.is_ordinary(stamp, reading):
            self.time_line.take(channel, stamp, reading, reading)
            self.accepted += 1
            return True
        cause: str = unusable(stamp, reading)
        if not cause:
            if channel.before is not None:
                channel.go_on_turning(stamp)
            cause = channel.complaint(stamp, reading)
            if not cause or cause == "implausible":
                timing = timing_of(channel, stamp, self._channels)
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

    def _append(self, channel: Channel, stamp: int, reading: float) -> None:
        """Add an accepted reading to its channel."""
        value = channel.angle_at(reading)
        self.steps += channel.note_plausible(stamp, value)
        if doubt := channel.note_doubt(stamp):
            self.time_line.note_doubt(doubt)
        channel.turns = channel.turns_at(reading)
        self.time_line.take(channel, stamp, reading, value)
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
        self.time_line.skip_to(confirmed[0][0])  # the motion during the gap is unknown
        usual = channel.usual_ns
        used = self._append_held(channel, confirmed[:1])
        channel.usual_ns = usual  # a gap is not the channel's rate
        if used and self.time_line.has_begun:
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
