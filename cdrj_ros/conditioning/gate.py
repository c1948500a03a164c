"""One motor's or joint's readings: how they become angles, and which cannot be true."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from math import hypot, sqrt
from typing import Final

import numpy as np

from cdrj_ros.conditioning.motion import Leap, Motion
from cdrj_ros.conditioning.tracking import Vector, half_width, new_track, track
from cdrj_ros.robot.description import Robot, Sensor

MAX_GAP_NS: Final = 1_000_000_000
"""A stamp further than this from the last one is believed only when others bear it out [ns]."""

CONFIRMATIONS: Final = 5
"""Consecutive readings that must agree before a channel follows a jump of the clock."""

LATE_INTERVALS: Final = 3
"""A reading may be late by this many of the channel's usual intervals."""

REGULAR: Final = 2
"""Intervals that differ by less than this factor make a rate."""

UNSEEN_FLOOR: Final = 2e-5
"""Deviations between readings below this are not reported, however fine the sensor [rad]."""

LARGEST: Final = 1e12
"""No axis turns as far [rad]."""

RANGE_MARGIN: Final = 1e-9
"""Rounding allowed at the ends of a joint's range [rad]."""

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

    @property
    def negligible(self) -> float:
        """What a reading may be off in any case [rad], as a standard deviation."""
        sensor = self.sensor
        count = sensor.resolution / sqrt(12.0)
        return max(abs(sensor.scale) * hypot(count, sensor.noise), UNSEEN_FLOOR)

    def motion(self) -> Motion:
        """Of an axis that nothing has been seen of."""
        return Motion(self.band, self.negligible)


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
class Channel:
    """One channel's gate and the readings that wait for the other channels."""

    limits: Limits
    last_stamp: int = -1
    last_value: float = 0.0
    readings: deque[tuple[int, float, float]] = field(default_factory=deque)
    """Accepted, with the curvature of the bridge from the reading before (``Motion.curvature``).

    The first one is the newest at or before the last sample that was given out.
    """
    motion: Motion = field(init=False)
    """What has been seen of the axis's speed and acceleration."""
    leap: Leap | None = None
    """A change of reading of which it is not known yet whether it is a step of the sensor."""
    usual_ns: int = 0
    """Longest of the latest intervals between readings [ns]; 0 before there is one."""
    held: list[tuple[int, float]] = field(default_factory=list)
    """Readings from a clock that may have jumped."""
    last_reading: float | None = None
    """As the sensor gave it, before its period was taken into account [rad]."""
    turns: int = 0
    """How often the reading has started again."""
    near: float | None = None
    """Where the axis is expected before its first reading [rad]."""
    before: Channel | None = None
    """The channel before a reset, until a first reading has come."""
    refused_stamp: int = -1
    """Stamp [ns] and angle [rad] of the last reading that was refused as implausible."""
    refused_value: float = 0.0
    agreeing: int = 0
    """Readings refused as implausible one after the other that are plausible beside each other."""
    step: float = 0.0
    """From the last accepted reading to the first of these [rad]."""
    step_ns: int = -1
    """Stamp of that first one [ns]."""
    displaced: float = 0.0
    """Sum of the steps by which the readings have been displaced since the last reset [rad]."""
    recent: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=1000))
    """What the velocity is taken from."""
    memory: Vector = field(default_factory=new_track)
    """Of the filter between counts."""
    left_behind: int = -1
    """Last stamp before the clock went back, until a reading of the new time has come [ns]."""
    stragglers: int = 0

    def __post_init__(self) -> None:
        """Begin without knowing how the axis moves."""
        self.motion = self.limits.motion()

    @property
    def patience_ns(self) -> int:
        """Readings at most this far apart follow each other [ns]."""
        return max(MAX_GAP_NS, LATE_INTERVALS * self.usual_ns)

    def follows(self, stamp: int) -> bool:
        """Whether a reading of another time follows those that are held."""
        before = self.held[-2][0] if len(self.held) > 1 else self.last_stamp
        interval = self.held[-1][0] - before
        longest = max(MAX_GAP_NS, REGULAR * interval) if interval > 0 else MAX_GAP_NS
        return 0 < stamp - self.held[-1][0] <= longest

    def is_regular(self) -> bool:
        """Whether the readings held go on in a rate that the first accepted one began."""
        if self.usual_ns or len(self.held) < 2:
            return False
        stamps = [self.last_stamp, *(stamp for stamp, _ in self.held)]
        intervals = [after - before for before, after in pairwise(stamps)]
        return 0 < max(intervals) < REGULAR * min(intervals)

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
        """Remember a reading that is further away than the axis can be: a glitch or a step."""
        if not abs(reading) <= LARGEST:
            self.agreeing = 0
            return
        value = self.angle_at(reading)
        since = (stamp - self.refused_stamp) * 1e-9
        near = abs(value - self.refused_value) <= self.limits.max_speed * since
        if not (self.agreeing and near):
            self.agreeing, self.step, self.step_ns = 0, value - self.last_value, stamp
        self.agreeing += 1
        self.refused_stamp, self.refused_value = stamp, value

    def note_plausible(self, stamp: int, value: float) -> bool:
        """Look for a step of the sensor before an accepted angle; True where one is confirmed.

        Either readings were refused before it and it goes on from them, or the reading before it
        was too close in time (``Motion.leap``) and later ones bear it out.
        """
        if self.last_stamp < 0:
            return False
        leap, stepped = self.leap, False
        if leap is not None:
            verdict = leap.judge(stamp, value)
            if verdict:
                self.leap = None
            if verdict == "step":
                self.displaced += leap.after - leap.before
                stepped = True
        elif self.agreeing:
            beyond = abs(value - self.refused_value) < abs(value - self.last_value)
            least = self.motion.reach((stamp - self.last_stamp) * 1e-9)
            lasted = self.agreeing >= CONFIRMATIONS or abs(self.step) > least
            if beyond and lasted:
                self.displaced += self.step
                stepped = True
        else:
            self.leap = self.motion.leap(self.last_stamp, self.last_value, stamp, value)
        self.agreeing = 0
        return stepped

    @property
    def recent_ns(self) -> int:
        """Time over which the velocity is taken [ns]."""
        return self.last_stamp - self.recent[0][0]

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
