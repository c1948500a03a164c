"""Gate of one channel, a motor or a joint: converts readings to angles, refuses impossible ones."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from math import hypot, sqrt
from typing import Final, Literal

from cdrj_ros.conditioning.angles import angle_of
from cdrj_ros.conditioning.motion import EVER_NS, LEAP_FLOOR, Leap, Motion
from cdrj_ros.conditioning.tracking import Vector, half_width, new_track, track
from cdrj_ros.robot.description import Robot, Sensor

MAX_GAP_NS: Final = 1_000_000_000
"""A stamp further than this from the last one needs confirmation by later readings [ns]."""

CONFIRMATIONS: Final = 5
"""A jump of the clock is accepted only after this many consistent readings."""

LATE_INTERVALS: Final = 3
"""A gap is longer than this many of the channel's usual intervals."""

REGULAR: Final = 2
"""Intervals are regular if they differ by less than this factor."""

UNSEEN_FLOOR: Final = 2e-5
"""Smallest standard deviation between readings that is reported for any sensor [rad]."""

LARGEST: Final = 1e12
"""Bound on the magnitude of any angle [rad]."""

RANGE_MARGIN: Final = 1e-9
"""Tolerance for rounding at the ends of a joint's range [rad]."""

SPEED_WINDOW_NS: Final = 20_000_000
"""The velocity is averaged over the readings within this time [ns]."""


Complaint = Literal["", "out_of_range", "implausible"]
"""Cause for refusing a reading as the next one of its channel; empty if it is acceptable."""


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
    """Converts readings to angles."""
    bandwidth: float = 0.0
    """Bandwidth of the tracking filter between counts [Hz]; 0 for no filter."""
    adaptive: bool = False
    """Whether that bandwidth rises with the motion."""
    start: float = 0.0
    """An ambiguous first reading stands for the possible angle nearest to this one [rad]."""
    plain: bool = field(init=False)
    """Whether a reading is the angle itself."""
    least: float = field(init=False)
    """Lower bound on plain readings [rad]."""
    most: float = field(init=False)
    """Upper bound on plain readings [rad]."""
    band: float = field(init=False)
    """Greatest difference of an angle and its reading [rad], see ``half_width``."""

    def __post_init__(self) -> None:
        """Determine what every reading is compared with."""
        sensor = self.sensor
        plain = (sensor.period, sensor.scale, sensor.offset) == (float("inf"), 1.0, 0.0)
        object.__setattr__(self, "plain", plain and not len(sensor.corrected_at))
        object.__setattr__(self, "least", max(self.lower - RANGE_MARGIN, -LARGEST))
        object.__setattr__(self, "most", min(self.upper + RANGE_MARGIN, LARGEST))
        object.__setattr__(self, "band", half_width(sensor))

    def first_turn(self, reading: float, near: float | None = None) -> int:
        """Number of periods to add to a first reading: angle in range and nearest to ``near``.

        Args:
            reading: of the sensor [rad].
            near: expected angle [rad]; None for ``start``.
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
    def negligible(self) -> float:
        """Standard deviation of the sensor's own error [rad], ``UNSEEN_FLOOR`` or more."""
        sensor = self.sensor
        count = sensor.resolution / sqrt(12.0)
        return max(abs(sensor.scale) * hypot(count, sensor.noise), UNSEEN_FLOOR)

    def motion(self) -> Motion:
        """Motion estimate of an axis before its first reading."""
        return Motion(self.band, self.negligible)


def limits_of(robot: Robot, tracking: float | None = None) -> tuple[Limits, ...]:
    """Limits of all motors, then all joints, in the robot's order.

    Args:
        robot: names, sensors and limits.
        tracking: fixed bandwidth [Hz] to use instead of the robot file's; 0 for no tracking.  A
            sensor without resolution and noise is not tracked.
    """

    def bandwidth(sensor: Sensor) -> float:
        if tracking is None or not half_width(sensor) > 0.0:
            return sensor.tracking_bandwidth
        return tracking

    def adaptive(sensor: Sensor) -> bool:
        return tracking is None and sensor.tracking == "adaptive"

    return (
        *(
            Limits(
                motor.name,
                max_speed=motor.max_speed,
                sensor=motor.sensor,
                bandwidth=bandwidth(motor.sensor),
                adaptive=adaptive(motor.sensor),
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
                adaptive(joint.sensor),
                joint.reference_angle,
            )
            for joint in robot.joints
        ),
    )


@dataclass
class Doubt:
    """Period in which the readings of a channel may come from a sensor that has stepped."""

    after_ns: int
    """Stamp of the last good reading before the period [ns]; -1 if there is none."""
    until_ns: int = EVER_NS
    """Stamp of the first good reading after the period [ns]."""


@dataclass
class Channel:
    """Gate of one channel, with the readings that wait for other channels."""

    limits: Limits
    last_stamp: int = -1
    last_value: float = 0.0
    readings: deque[tuple[int, float, float]] = field(default_factory=deque)
    """Accepted stamps [ns], angles [rad] and curvatures since the reading before [rad/ns^2].

    See ``Motion.curvature``.  The first reading is the newest at or before the last sample.
    """
    motion: Motion = field(init=False)
    """Estimates of the axis's speed and acceleration."""
    leap: Leap | None = None
    """A change of reading that may turn out to be a step of the sensor."""
    usual_ns: int = 0
    """Longest of the latest intervals between readings [ns]; 0 before the second reading."""
    held: list[tuple[int, float]] = field(default_factory=list)
    """Stamps [ns] and readings [rad] held after a possible jump of the clock."""
    last_reading: float | None = None
    """Last accepted reading, before unwrapping [rad]."""
    turns: int = 0
    """Number of periods that unwrapping adds to a reading."""
    near: float | None = None
    """Angle expected of the first reading [rad]."""
    resumed: float = 0.0
    """Curvature between the last sample of an earlier run and the first reading [rad/ns^2]."""
    before: Channel | None = None
    """The channel before a reset, until the first reading after it."""
    refused_stamp: int = -1
    """Stamp of the last reading refused as implausible [ns]."""
    refused_value: float = 0.0
    """Angle of that reading [rad]."""
    agreeing: int = 0
    """Number of consecutive implausible readings that are plausible relative to each other."""
    step: float = 0.0
    """Difference of the first of these readings and the last accepted one [rad]."""
    step_ns: int = -1
    """Stamp of the first of these readings [ns]."""
    displaced: float = 0.0
    """Sum of all steps of the sensor since the last reset [rad]."""
    stepped: bool = False
    """Whether the sensor has stepped since the last reset, even if the steps add up to 0."""
    doubt: Doubt | None = None
    """The current period of doubt; None outside one."""
    recent: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=1000))
    """Stamps [ns] and angles [rad] from which the velocity is computed."""
    memory: Vector = field(default_factory=new_track)
    """State of the tracking filter between counts."""
    left_behind: int = -1
    """Last stamp before the clock went back [ns]; -1 if it did not."""
    stragglers: int = 0
    """Number of readings from before this jump that arrived after it."""

    def __post_init__(self) -> None:
        """Start without an estimate of the motion."""
        self.motion = self.limits.motion()

    def take_over(self, earlier: Channel) -> None:
        """Take over what a change of the clock does not affect: the motion and the sensor's steps.

        Args:
            earlier: the channel before the change.
        """
        self.motion = earlier.motion.elsewhen()
        self.displaced, self.stepped = earlier.displaced, earlier.stepped

    @property
    def patience_ns(self) -> int:
        """Longest interval between readings that is not a gap [ns]."""
        return max(MAX_GAP_NS, LATE_INTERVALS * self.usual_ns)

    def follows(self, stamp: int) -> bool:
        """Whether a stamp continues the held readings."""
        before = self.held[-2][0] if len(self.held) > 1 else self.last_stamp
        interval = self.held[-1][0] - before
        longest = max(MAX_GAP_NS, REGULAR * interval) if interval > 0 else MAX_GAP_NS
        return 0 < stamp - self.held[-1][0] <= longest

    def is_regular(self) -> bool:
        """Whether the first accepted reading and the held ones have a regular rate."""
        if self.usual_ns or len(self.held) < 2:
            return False
        stamps = [self.last_stamp, *(stamp for stamp, _ in self.held)]
        intervals = [after - before for before, after in pairwise(stamps)]
        return 0 < max(intervals) < REGULAR * min(intervals)

    def turns_at(self, reading: float) -> int:
        """Number of periods to add to a reading if it is the next one."""
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
        return float(angle_of(sensor, reading))

    def complaint(self, stamp: int, reading: float) -> Complaint:
        """Cause for refusing a reading, a key of ``REFUSALS``; empty if it is acceptable."""
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

    def is_ordinary(self, stamp: int, reading: float) -> bool:
        """Whether a reading is acceptable and nothing is special about it or about the channel.

        For such a reading ``complaint``, ``note_plausible`` and ``note_doubt`` have no effect, and
        it takes half of the time that they do.  While there is a leap, or after a step, there is
        also a doubt; only the first reading begins the doubt about an earlier step, or has a
        channel ``before``.
        """
        limits, ahead = self.limits, stamp - self.last_stamp
        span, moved = ahead * 1e-9, reading - self.last_value
        return (
            limits.plain
            and 0 < ahead <= MAX_GAP_NS
            and self.last_stamp >= 0
            and limits.least <= reading <= limits.most
            and abs(moved) <= limits.max_speed * span
            and abs(moved - self.motion.velocity * span) <= LEAP_FLOOR
            and not (self.agreeing or self.held)
            and self.doubt is None
        )

    def is_settled_at(self, stamp: int) -> bool:
        """Whether the last reading has this stamp, and the next one can be ordinary."""
        return (
            self.last_stamp == stamp
            and not self.limits.sensor.corrected_at
            and not (self.agreeing or self.held)
            and self.doubt is None
        )

    def go_on_turning(self, stamp: int) -> None:
        """Keep the turns counted before a reset if the first reading follows within a second."""
        before, self.before = self.before, None
        if before is not None and 0 < stamp - before.last_stamp <= MAX_GAP_NS:
            self.turns, self.last_reading = before.turns, before.last_reading

    def note_implausible(self, stamp: int, reading: float) -> None:
        """Record a reading that the axis cannot have reached: a glitch or a step."""
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
        """Look for a step of the sensor before an accepted angle; True if one is confirmed.

        A step is confirmed if the angle continues the refused readings before it, or if an accepted
        reading was too far away for the interval (``Motion.leap``) and later readings stay there.
        """
        if self.last_stamp < 0:
            return False
        leap, stepped = self.leap, False
        if leap is not None:
            verdict = leap.judge(stamp, value)
            if verdict:
                self.leap = None
            if verdict == "step":
                self._step_by(leap.after - leap.before)
                stepped = True
        elif self.agreeing:
            beyond = abs(value - self.refused_value) < abs(value - self.last_value)
            least = self.motion.reach((stamp - self.last_stamp) * 1e-9)
            lasted = self.agreeing >= CONFIRMATIONS or abs(self.step) > least
            if beyond and lasted:
                self._step_by(self.step)
                stepped = True
        else:
            self.leap = self.motion.leap(self.last_stamp, self.last_value, stamp, value)
        self.agreeing = 0
        return stepped

    def _step_by(self, by: float) -> None:
        self.displaced += by
        self.stepped = True

    def note_doubt(self, stamp: int) -> Doubt | None:
        """Begin or end the doubt about an accepted reading; call before it becomes the last one.

        Returns:
            The doubt that begins with it, if any.
        """
        if self.leap is not None or self.stepped:
            if self.doubt is None:
                self.doubt = Doubt(self.last_stamp)
                return self.doubt
        elif self.doubt is not None:
            self.doubt.until_ns = stamp
            self.doubt = None
        return None

    @property
    def recent_ns(self) -> int:
        """Time over which the velocity is averaged [ns]."""
        return self.last_stamp - self.recent[0][0]

    def velocity(self) -> float:
        """Mean velocity over the last ``SPEED_WINDOW_NS`` [rad/s]; 0 with a single reading."""
        begin, first = self.recent[0]
        span = self.last_stamp - begin
        return (self.recent[-1][1] - first) / span * 1e9 if span > 0 else 0.0

    def between_counts(self, stamp: int, value: float) -> float:
        """Tracked angle at an accepted reading [rad]; call before it becomes the last one."""
        limits = self.limits
        since = stamp - self.last_stamp
        angle = track(self.memory, since, value, limits.bandwidth, limits.band, limits.adaptive)
        if limits.lower <= angle <= limits.upper:
            return angle
        return min(max(angle, limits.lower), limits.upper)
