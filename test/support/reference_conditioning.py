"""Conditioning of readings in plain Python, the reference of the compiled core.

It follows docs/estimation.md reading by reading and shares no code with the core: what both must
agree on bit for bit is written twice, and only here without regard to speed.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import ceil, copysign, exp, hypot, inf, isfinite, isinf, log, nan, pi, sqrt
from typing import Any

import numpy as np

from cdrj_ros.estimation.conditioner import pulls_of, worth_of
from cdrj_ros.estimation.estimator import ALL_SEEN, NONE_CHANGED, Sample
from cdrj_ros.estimation.refusals import REFUSALS
from cdrj_ros.robot.description import Joint, Motor, Robot, Sensor

END_NS = 2**31 * 10**9
GAP_NS, WINDOW_NS, HORIZON_NS = 10**9, 10**8, 2 * 10**7
LARGEST, MARGIN = 1e12, 1e-9
CONFIRMATIONS, WAITING, STRAGGLERS = 5, 20_000, 100
LASTING = ("speed", "acceleration", "fastest", "travelled", "windows")
OLDEST_NS = 20_000_000
"""By how much a value may be older than its stamp."""
LASTING_STEPS = ("bend", "unexplained", "displaced")


def error_of(sensor: Sensor) -> float:
    """Greatest error of a reading."""
    return abs(sensor.scale) * (0.5 * sensor.resolution + 3.0 * sensor.noise)


def faded(before: float, now: float, span: float) -> float:
    keep = exp(-span / 10.0)
    return sqrt(before * before * keep + now * now * (1.0 - keep))


@dataclass
class Motion:
    """(C2) to (C5)."""

    band: float
    negligible: float
    begin_ns: int = -1
    begin: float = 0.0
    part_ns: int = -1
    part: float = 0.0
    last_part: tuple[float, float] | None = None
    """Length and velocity."""
    span: float = 0.0
    velocity: float = 0.0
    speed: float = 0.0
    acceleration: float = 0.0
    fastest: float = 0.0
    travelled: float = 0.0
    windows: float = 0.0
    velocities: tuple[float, ...] = ()
    """Least and greatest over windows."""
    bend: float = 0.0

    def take(self, stamp: int, angle: float) -> None:
        if 0 <= self.begin_ns <= stamp:
            if stamp - self.part_ns >= 20_000_000:
                self._close_part((stamp - self.part_ns) * 1e-9, angle - self.part)
                self.part_ns, self.part = stamp, angle
            if stamp - self.begin_ns < WINDOW_NS:
                return
            self._close((stamp - self.begin_ns) * 1e-9, angle - self.begin)
        if self.part_ns != stamp:
            self.last_part = None
        self.begin_ns, self.begin = self.part_ns, self.part = stamp, angle

    def _close_part(self, span: float, moved: float) -> None:
        velocity = moved / span
        self.fastest = max(self.fastest, (abs(moved) - 2.0 * self.band) / span)
        if self.last_part is not None:
            length, before = self.last_part
            change = abs(velocity - before) - 2.0 * self.band * (1.0 / span + 1.0 / length)
            self.acceleration = max(self.acceleration, change / (0.5 * (span + length)))
        self.last_part = span, velocity

    def _close(self, span: float, moved: float) -> None:
        certain = max(abs(moved) - 2.0 * self.band, 0.0)
        velocity, speed, acceleration = moved / span, certain / span, 0.0
        slow = span > 2e-9 * WINDOW_NS
        if self.span > 0.0:
            change = max(abs(velocity - self.velocity) - 2.0 * self.band / span, 0.0)
            acceleration = change / (0.5 * (span + self.span))
        elif slow:
            acceleration = speed / span
        if slow:
            acceleration *= 1.5
        self.speed = max(speed, faded(self.speed, speed, span))
        self.acceleration = max(acceleration, faded(self.acceleration, acceleration, span))
        self.fastest = max(self.fastest, speed)
        seen = (*self.velocities, speed if moved > 0.0 else -speed)
        self.velocities = min(seen), max(seen)
        self.travelled, self.windows = self.travelled + certain, self.windows + 1.0
        self.span, self.velocity = span, velocity

    def seen_ns(self) -> float:
        """Between readings no further apart, deviations are negligible."""
        if not (self.speed > 0.0 and self.acceleration > 0.0):
            return inf
        slow = 3.0 * self.negligible / self.speed
        smooth = sqrt(8.0 * self.negligible / self.acceleration)
        resolved = self.acceleration * smooth <= self.speed
        return int(min(max(slow, smooth) if resolved else slow, 1e9) * 1e9)

    def without_window(self) -> Motion:
        return replace(self, begin_ns=-1, begin=0.0, span=0.0, velocity=0.0, last_part=None)

    def knows(self, span_ns: int) -> bool:
        if span_ns <= WINDOW_NS:
            return True
        return self.windows > 3 and (span_ns <= 10**9 or self.speed * span_ns * 1e-9 <= 0.01)

    def curvature(self, span_ns: int, least: tuple[float, float] = (0.0, 0.0)) -> float:
        """(C3), with speed and acceleration of at least ``least``, (C13)."""
        if not self.knows(span_ns):
            return inf
        if span_ns <= self.seen_ns() and least[1] == 0.0:
            return 0.0
        span, speed = span_ns * 1e-9, max(self.speed, least[0])
        bend = max(self.acceleration, least[1]) * span
        factor = max(bend / speed, 1.0) if speed > 0.0 else 1.0
        most = max(speed, bend) * span / 3.0
        sagitta = min(bend * span / 8.0 * factor * factor, most)
        return 4.0 * sagitta / (float(span_ns) * float(span_ns))

    def ahead(self, horizon_ns: int, window_ns: int) -> float:
        h, w = horizon_ns * 1e-9, window_ns * 1e-9
        arc = 0.5 * h * (h + w)
        known = self.acceleration
        least, greatest = self.velocities or (0.0, 0.0)
        if 2.0 * min(max(-least, 0.0), max(greatest, 0.0)) < self.speed:
            known = max(known, self.speed * 1e9 / WINDOW_NS)
        drift = max(min(known * arc, 2.0 * self.speed * h), self.bend * arc)
        noise = 0.8165 * self.band * h / w
        return sqrt(drift * drift + noise * noise)

    def miss(self, horizon_ns: int, window_ns: int, error: float) -> None:
        h, w = horizon_ns * 1e-9, window_ns * 1e-9
        now = max(abs(error) - 2.0 * self.band * (1.0 + h / w), 0.0) / (0.5 * h * (h + w))
        self.bend = max(now, faded(self.bend, now, h))

    def reach(self, span: float) -> float:
        return max(2.0 * self.band, 2.0 * self.fastest * span)


@dataclass
class Steps:
    """(C5) and (C7) to (C9)."""

    worth: float
    bend: float = 0.0
    unexplained: float = 0.0
    displaced: float = 0.0
    stepped: bool = False
    points: list[tuple[int, float]] = field(default_factory=list)
    sudden: float = 0.0
    side: float = 0.0
    share: float = 0.0
    alternates: bool = False
    latest: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=97))
    equal: int = 0
    count: float = inf
    """Least change from one reading to the next."""
    compared: bool = False
    repeats: bool = False
    repeated_since: int = -1

    @staticmethod
    def between(one: tuple[int, float], other: tuple[int, float]) -> tuple[float, float]:
        """Time and velocity."""
        seconds = (other[0] - one[0]) * 1e-9
        return seconds, (other[1] - one[1]) / seconds

    def judged(self, point: tuple[int, float]) -> bool:
        stamps = [stamp for stamp, _ in (*self.points[-2:], point)]
        return len(stamps) == 3 and max(b - a for a, b in pairwise(stamps)) <= 10**8

    def bent(self, point: tuple[int, float]) -> float:
        (first, start), (second, middle), (third, end) = *self.points[-2:], point
        ratio = ((third - second) * 1e-9) / ((second - first) * 1e-9)
        by_time = ((end - middle) - (middle - start) * ratio) / (1.0 + ratio)
        return lesser(by_time, 0.5 * ((end - middle) - (middle - start)))

    def plain(self, motion: Motion, point: tuple[int, float]) -> bool:
        dense = point[0] - self.points[-1][0] <= 30_000_000
        return dense and motion.band > 0.0 and abs(self.bent(point)) > 10.0 * motion.band

    def is_off(self, motion: Motion, point: tuple[int, float]) -> bool:
        if not self.judged(point):
            return False
        if motion.travelled >= 1.0:
            return abs(self.bent(point)) > max(2.0 * motion.band, 2.5 * self.bend)
        return self.plain(motion, point)

    def returns(self, off: tuple[int, float], point: tuple[int, float]) -> bool:
        rate = self.between(self.points[-2], self.points[-1])[1]
        first, second = (
            one[1] - self.points[-1][1] - rate * self.between(self.points[-1], one)[0]
            for one in (off, point)
        )
        return abs(second) < 0.5 * abs(first)

    def take(self, motion: Motion, point: tuple[int, float], off: bool) -> bool:
        if self.points and point[0] - self.points[-1][0] > 10**8:
            self.restart()
        self.follow(motion, point)
        found = len(self.points) == 3 and not self.alternates and self.has_stepped(motion, point)
        side = 0.0
        if self.judged(point):
            size = self.bent(point)
            if not (off or found):
                self.bend = max(self.bend, abs(size))
            changed = point[1] != self.points[-1][1]
            side = size if changed and self.plain(motion, point) else 0.0
        self.alternate(side * self.side < 0.0)
        self.side = side
        if motion.windows > 0.0:
            self.sudden = 0.0
        elif self.points:
            many = len(self.points) > 1
            sudden = self.bent(point) if many else point[1] - self.points[-1][1]
            self.sudden = max(self.sudden, abs(sudden))
        self.points = [*self.points[-2:], point]
        return found

    def restart(self) -> None:
        self.points, self.equal, self.compared, self.repeats = [], 0, False, False
        self.latest.clear()

    @staticmethod
    def differ(motion: Motion, one: float, other: float) -> bool:
        return abs(one - other) > max(2.0 * motion.band, motion.negligible)

    def contradicts(self, motion: Motion, stamp: int, angle: float) -> bool:
        """Whether an earlier reading is off the accepted ones around it."""
        same = [value for at, value in self.latest if at == stamp]
        if same:
            return self.differ(motion, angle, same[-1])
        around = [two for two in pairwise(self.latest) if two[0][0] < stamp < two[1][0]]
        if not around or around[0][1][0] - around[0][0][0] > 10**8:
            return False
        before, after = around[0]
        line = before[1] + self.between(before, after)[1] * ((stamp - before[0]) * 1e-9)
        return self.differ(motion, angle, line) and abs(angle - line) > 2.5 * self.bend

    def note_contradiction(self) -> None:
        self.share, self.alternates = max(self.share, 0.1), True

    def follow(self, motion: Motion, point: tuple[int, float]) -> None:
        change = abs(point[1] - self.latest[-1][1]) if self.latest else 0.0
        if change > 0.0:
            self.count = min(self.count, change)
        repeated = bool(self.latest) and change == 0.0
        self.equal = self.equal + 1 if repeated else 0
        self.compared, self.repeats = self.compared and repeated, self.repeats and repeated
        self.latest.append(point)
        n = self.equal
        if self.compared or not 0 < n <= 32 or len(self.latest) <= 3 * n:
            return
        last, still, before, first = (self.latest[-1 - k] for k in (n + 1, n, 2 * n, 3 * n))
        rate, earlier = self.between(before, still)[1], self.between(first, before)[1]
        missed = abs(rate) * self.between(still, point)[0]
        least = max(10.0 * motion.band, 10.0 * self.count, 1.5 * abs(still[1] - last[1]))
        self.compared = missed > least
        late = self.between(self.latest[-1 - n - (n + 1) // 2], still)[1]
        fastest, slowest = max(earlier * rate, rate * rate), min(rate * rate, late * rate)
        self.repeats = self.compared and 0.7 * fastest <= slowest
        if self.repeats:
            self.repeated_since = still[0]

    def has_stepped(self, motion: Motion, point: tuple[int, float]) -> bool:
        spans = [(b[0] - a[0]) * 1e-9 for a, b in pairwise([*self.points, point])]
        first, moved, last = (b[1] - a[1] for a, b in pairwise([*self.points, point]))
        before, after = (spans[1] / spans[k] for k in (0, 2))
        by = moved - 0.5 * (first * before + last * after)
        fastest = max(abs(first) * before, abs(last) * after)
        size = abs(
            lesser(
                jump(first * before, moved, last * after) * (4.0 / (2.0 + before + after)),
                jump(first, moved, last),
            )
        )
        least = max(4.0 * motion.band, 2.5 * self.unexplained)
        if motion.travelled >= 1.0 and size > least and abs(by) > fastest:
            self.step_by(by)
            return True
        self.unexplained = max(self.unexplained, size)
        return False

    def step_by(self, by: float) -> None:
        self.displaced += by
        if abs(self.displaced) > self.worth:
            self.stepped = True

    def alternate(self, does: bool) -> None:
        self.share += (does - self.share) / 64.0
        self.alternates = self.share > 0.1 or (self.alternates and self.share >= 0.02)

    def offset(self, motion: Motion) -> float:
        hidden = 0.35 * max(self.unexplained, self.sudden, 2.0 * motion.band)
        return hypot(hidden, self.displaced)


def jump(before: float, moved: float, after: float) -> float:
    by = moved - 0.5 * (before + after)
    return copysign(max(abs(by) - 0.5 * abs(after - before), 0.0), by)


def lesser(one: float, other: float) -> float:
    return 0.0 if one * other <= 0.0 else min(one, other, key=abs)


def level(value: float) -> float:
    return exp(0.22 * ceil(log(value) / 0.22)) if value > 0.0 else 0.0


@dataclass
class Lag:
    """By how much an axis's clock may be behind, (C10)."""

    last: int | None = None
    newest: dict[int, int] = field(default_factory=dict)
    """The newest stamp of every other axis."""
    new: set[int] = field(default_factory=set)
    """Axes whose newest reading has arrived since the last own one."""
    ahead: dict[int, list[int]] = field(default_factory=dict)
    """By how much the stamps of every other axis in this window are ahead of the last own one."""
    shared: Counter[int] = field(default_factory=Counter)
    """Own readings in this window with the newest stamp of another axis, which has just arrived."""
    count: int = 0
    begin_ns: int = -1
    is_first: bool = True
    most_ns: int = 0
    apart: bool = False
    """Whether another axis is in other messages."""

    def meet(self, axis: int, stamp: int) -> None:
        ahead, self.newest[axis] = self.ahead.setdefault(axis, []), stamp
        self.new.add(axis)
        if self.last is not None:
            ahead.append(max(stamp - self.last, 0))
            self.shared[axis] += stamp == self.last

    def take(self, stamp: int) -> None:
        self.last, self.count = stamp, self.count + 1
        if not self.newest:
            return
        self.shared.update(axis for axis in self.new if self.newest[axis] == stamp)
        self.new.clear()
        if self.begin_ns < 0:
            self.begin_ns = stamp
        is_over = self.count >= 8 and stamp - self.begin_ns >= 500_000_000
        if self.is_first or is_over:
            one_clock = {axis for axis in self.ahead if 2 * self.shared[axis] >= self.count}
            self.apart = self.ahead.keys() != one_clock
            self.most_ns = max(
                0 if axis in one_clock else min(ahead, default=self.most_ns)
                for axis, ahead in self.ahead.items()
            )
        if is_over:
            self.begin_ns, self.count, self.is_first = stamp, 0, False
            self.ahead, self.shared = {axis: [] for axis in self.ahead}, Counter()


@dataclass
class Arrivals:
    """(C14)."""

    last: int | None = None
    interval: int | None = None
    uneven: float = 0.0

    def take(self, arrival: int) -> None:
        last, self.last = self.last, arrival
        if last is None or not 0 <= arrival - last <= GAP_NS:
            return
        before, self.interval = self.interval, arrival - last
        if before is not None:
            kept = self.uneven * exp(-self.interval * 1e-9 / 10.0)
            self.uneven = max(abs(self.interval - before) * 1e-9, kept)

    @property
    def stddev(self) -> float:
        return 0.0 if self.last is None else hypot(1e-3, 0.35 * self.uneven)


@dataclass
class Track:
    """(C1) and (C6)."""

    n: float = 0.0
    angle: float = 0.0
    speed: float = 0.0
    acceleration: float = 0.0
    begun: float = 0.0
    since: float = 0.0
    chord: float = 0.0
    length: float = 0.0
    fastest: float = 0.0
    hardest: float = 0.0
    moves: bool = False

    def at(self, dt: float, reading: float, bandwidth: float, band: float, adaptive: bool) -> float:
        angle = self.angle + self.speed * dt + 0.5 * self.acceleration * dt * dt
        if self.n == 0.0 or dt * bandwidth > 1.0 or not abs(angle) < 1e15:
            self.n, self.angle, self.begun = 1.0, reading, reading
            self.speed = self.acceleration = self.since = self.length = 0.0
            return reading
        if adaptive and band > 0.0:
            bandwidth = self.adapted(dt, reading, bandwidth, band)
        n = self.n + 1.0
        self.n = min(n, 1e6)
        theta = exp(-2.0 * pi * bandwidth * dt)
        fresh, many = 1.0 - theta, n * (n + 1.0) * (n + 2.0)
        g = max(1.0 - theta * theta * theta, 3.0 * (3.0 * n * n - 3.0 * n + 2.0) / many)
        h = max(1.5 * (fresh * fresh) * (1.0 + theta), 18.0 * (2.0 * n - 1.0) / many)
        k = max(fresh * fresh * fresh, 60.0 / many)
        if n < 3.0:
            h, k = 1.0, 0.0
        off = reading - angle
        self.speed = self.speed + self.acceleration * dt + h * off / dt
        self.acceleration = self.acceleration + k * off / (dt * dt)
        angle += min(g, 1.0) * off
        self.angle = min(max(angle, reading - band), reading + band)
        return self.angle

    def adapted(self, dt: float, reading: float, bandwidth: float, band: float) -> float:
        self.since += dt
        length, turned = self.since, reading - self.begun
        moved = max(abs(turned) - 2.0 * band, 0.0)
        self.moves = self.moves or moved > 0.0
        if length >= 0.03:
            kept, chord = exp(-length / 2.0), turned / length
            if self.length > 0.0:
                change = max(abs(chord - self.chord) - 4.0 * band / length, 0.0)
                self.hardest = max(2.0 * change / (length + self.length), self.hardest * kept)
            self.fastest = max(moved / length, self.fastest * kept)
            self.moves, self.chord, self.length = moved > 0.0, chord, length
            self.begun, self.since = reading, 0.0
        if not self.moves or self.fastest == 0.0:
            return bandwidth
        jerk = self.hardest * self.hardest / self.fastest
        spread = band * band / 3.0 * dt
        best = (6.0 / 2.0625 * (jerk * jerk) / spread) ** (1.0 / 7.0) / (2.0 * pi)
        return max(bandwidth, min(best, 0.077 / dt))


@dataclass
class Doubt:
    after_ns: int
    until_ns: float = inf


@dataclass
class Channel:
    axis: Motor | Joint
    bandwidth: float
    adaptive: bool
    steps: Steps
    motion: Motion = field(init=False)
    track: Track = field(default_factory=Track)
    last_ns: int = -1
    last: float = 0.0
    readings: deque[tuple[int, float, float, tuple[float, ...]]] = field(default_factory=deque)
    recent: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=1000))
    tested: deque[tuple[int, int, float, float]] = field(default_factory=deque)
    reading: float | None = None
    turns: int = 0
    near: float | None = None
    before: tuple[int, float | None, int] | None = None
    usual_ns: int = 0
    held: list[tuple[int, float]] = field(default_factory=list)
    resumed: float = 0.0
    lost_way: bool = False
    """Whether the motion up to the next reading is unknown."""
    off: tuple[int, float] | None = None
    agreeing: int = 0
    refused: tuple[int, float] = (-1, 0.0)
    step: float = 0.0
    doubt: Doubt | None = None
    lag: Lag = field(default_factory=Lag)
    arrivals: Arrivals = field(default_factory=Arrivals)
    left_behind_ns: int = -1
    stragglers: int = 0
    clock_stddev: float = 0.0
    pull: list[float] = field(default_factory=list)
    first: float | None = None
    furthest: float = 0.0
    fits: bool = False
    counted: bool = False
    misfits: bool = False
    alone: bool = False

    def __post_init__(self) -> None:
        sensor = self.axis.sensor
        own = abs(sensor.scale) * hypot(sensor.resolution / sqrt(12.0), sensor.noise)
        worth = self.steps.worth
        self.negligible = max(own, 2e-5, 0.002 * worth if isfinite(worth) else 0.0)
        self.motion = Motion(error_of(sensor), self.negligible)
        joint = isinstance(self.axis, Joint)
        self.lower, self.upper = (self.axis.lower, self.axis.upper) if joint else (-inf, inf)  # type: ignore[union-attr]

    def in_range(self, angle: float) -> bool:
        return self.lower - MARGIN <= angle <= self.upper + MARGIN

    def turns_at(self, reading: float) -> int:
        sensor = self.axis.sensor
        if sensor.period == inf:
            return 0
        if self.reading is not None:
            return self.turns + round((self.reading - reading) / sensor.period)
        wanted = self.axis.reference_angle if self.near is None else self.near
        turns = ((wanted - sensor.offset) / sensor.scale - reading) / sensor.period
        if not abs(turns) < LARGEST:
            return 0
        turn = round(turns)
        for one in (turn, turn - 1, turn + 1):
            if self.in_range(sensor.scale * (reading + sensor.period * one) + sensor.offset):
                return one
        return turn

    def angle_at(self, reading: float) -> float:
        sensor = self.axis.sensor
        if sensor.period != inf:
            reading = reading + sensor.period * self.turns_at(reading)
        if sensor.scale != 1.0 or sensor.offset != 0.0:
            reading = sensor.scale * reading + sensor.offset
        if sensor.corrected_at:
            reading += float(np.interp(reading, sensor.corrected_at, sensor.correction))
        return reading

    def complaint(self, stamp: int, reading: float) -> str:
        if not -LARGEST <= reading <= LARGEST:
            return "implausible" if self.upper == inf else "out_of_range"
        known = self.steps.repeated_since if self.steps.repeats else self.last_ns
        angle, ahead = self.angle_at(reading), stamp - known
        if not self.in_range(angle):
            return "out_of_range"
        fast = abs(angle - self.last) > self.axis.max_speed * (ahead * 1e-9)
        return "implausible" if self.last_ns >= 0 and ahead > 0 and fast else ""

    def timing(self, stamp: int, reading: float, newest_ns: int) -> str:
        ahead = stamp - self.last_ns
        if self.last_ns < 0:
            straggles = self.left_behind_ns >= 0 and abs(stamp - self.left_behind_ns) <= GAP_NS
            if not straggles or self.stragglers >= STRAGGLERS or stamp - newest_ns <= GAP_NS:
                return ""
            self.stragglers += 1
            return "late"
        longest = max(GAP_NS, 3 * self.usual_ns)
        angle = self.angle_at(reading) if abs(reading) <= LARGEST else nan
        if self.off is not None and stamp == self.off[0] and 0 < ahead <= longest:
            differ = self.steps.differ(self.motion, angle, self.angle_at(self.off[1]))
            return "contradictory" if differ else "repeated"
        newest = self.last_ns if self.off is None else self.off[0]
        if newest < stamp and ahead <= longest:
            return ""
        if ahead > longest or ahead < -GAP_NS or (ahead < 0 and self.held):
            return "another time"
        contradicts = self.steps.contradicts(self.motion, stamp, angle)
        return "contradictory" if contradicts else "late" if ahead else "repeated"

    def follows(self, stamp: int) -> bool:
        before = self.held[-2][0] if len(self.held) > 1 else self.last_ns
        interval = self.held[-1][0] - before
        return 0 < stamp - self.held[-1][0] <= max(GAP_NS, 2 * interval)

    def is_regular(self) -> bool:
        if self.usual_ns or len(self.held) < 2:
            return False
        stamps = [self.last_ns, *(stamp for stamp, _ in self.held)]
        intervals = [after - before for before, after in pairwise(stamps)]
        return 0 < max(intervals) < 2 * min(intervals)

    def note_implausible(self, stamp: int, reading: float) -> None:
        if not abs(reading) <= LARGEST:
            self.agreeing = 0
            return
        angle, (at, before) = self.angle_at(reading), self.refused
        near = abs(angle - before) <= self.axis.max_speed * ((stamp - at) * 1e-9)
        if near and 0 <= at < self.last_ns:
            self.steps.alternate(True)
        if not (self.agreeing and near):
            self.agreeing, self.step = 0, angle - self.last
        self.agreeing += 1
        self.refused = stamp, angle

    def moved(self) -> float:
        return 0.0 if self.first is None or self.last_ns < 0 else self.last - self.first

    def is_counted(self, reading: float) -> bool:
        """Whether a reading has not changed by whole counts in degrees, (C15)."""
        count = self.axis.sensor.resolution
        if count == 0.0:
            return True
        if self.reading is None or reading == self.reading:
            return False
        counts = abs(reading - self.reading) / (180.0 / pi * count)
        return abs(counts - max(round(counts), 1.0)) > 0.1

    def offset(self) -> tuple[float, ...]:
        """(C9) and (C10), with (C15)."""
        least = 0 if self.clock_stddev > 0.0 else OLDEST_NS
        oldest = max(self.lag.most_ns, least) * 1e-9
        clock = hypot(0.35 * oldest, self.clock_stddev)
        if self.lag.apart:
            clock = hypot(clock, self.arrivals.stddev)
        known = self.fits and self.counted
        unit = 0.0 if known or not self.pull else abs(self.moved())
        return level(hypot(self.steps.offset(self.motion), unit)), level(clock)

    def has_stepped(self, stamp: int, angle: float, off: bool) -> bool:
        """Whether an accepted angle shows a step."""
        found = False
        if self.agreeing and self.last_ns >= 0:
            beyond = abs(angle - self.refused[1]) < abs(angle - self.last)
            least = self.motion.reach((stamp - self.last_ns) * 1e-9)
            found = beyond and (self.agreeing >= CONFIRMATIONS or abs(self.step) > least)
        self.agreeing = 0
        if found:
            self.steps.step_by(self.step)
            self.steps.restart()
        return self.steps.take(self.motion, (stamp, angle), off) or found


class Reference:
    """As ``Conditioner``, for the same robot."""

    def __init__(self, robot: Robot, mode: str = "wait") -> None:
        self.robot, self.predicts, self.tracking = robot, mode == "predict", None
        self.refused = dict.fromkeys(REFUSALS, 0)
        self.accepted = self.elsewhere = self.clock_jumps = self.gaps = self.steps = 0
        self.crowded = self.lag_ns = 0
        names = [axis.name for axis in (*robot.motors, *robot.joints)]
        self.worth = dict(zip(names, worth_of(robot), strict=True))
        self.pulls = dict(zip(names, pulls_of(robot), strict=True))
        self._begin()

    def _begin(self) -> None:
        self.channels = [self._channel(axis) for axis in (*self.robot.motors, *self.robot.joints)]
        self.doubts: list[Doubt] = []
        self.resumed_ns = self.passed_over_ns = self.given_out_ns = -1
        self.ahead_ns = self.ahead_from_ns = -1
        self.told: list[tuple[float, ...]] = []

    def _channel(self, axis: Motor | Joint) -> Channel:
        sensor, tracking = axis.sensor, self.tracking
        chosen = tracking is not None and error_of(sensor) > 0.0
        bandwidth = tracking if chosen else sensor.tracking_bandwidth
        adaptive = tracking is None and sensor.tracking == "adaptive"
        kind = "joints" if isinstance(axis, Joint) else "motors"
        known = {} if self.robot.uncertainty is None else self.robot.uncertainty.stddev
        stated = known.get(f"{kind}.{axis.name}.clock_offset", 0.0)
        steps = Steps(self.worth[axis.name])
        pull = self.pulls[axis.name]
        return Channel(axis, bandwidth, adaptive, steps, clock_stddev=stated, pull=pull)  # type: ignore[arg-type]

    # --- what is kept -----------------------------------------------------------------------------

    def reset(self, keep_turns: bool = False) -> None:
        before = self.channels
        self._begin()
        for channel, old in zip(self.channels, before, strict=True):
            self._drop_held(old)
            self._drop_off(old)
            if keep_turns:
                channel.turns, channel.reading = old.turns, old.reading
                channel.motion = old.motion.without_window()
                channel.steps.bend = old.steps.bend
                channel.steps.unexplained = old.steps.unexplained
            elif old.last_ns >= 0:
                channel.before = old.last_ns, old.reading, old.turns

    def memory(self) -> dict[str, np.ndarray]:
        rows = [
            [getattr(c.motion, name) for name in LASTING]
            + [getattr(c.steps, name) for name in LASTING_STEPS]
            for c in self.channels
        ]
        stepped = [float(channel.steps.stepped) for channel in self.channels]
        return {"axes": np.array(rows), "stepped": np.array(stepped)}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        for channel, row, stepped in zip(
            self.channels, memory["axes"].tolist(), memory["stepped"].tolist(), strict=True
        ):
            for name, value in zip(LASTING, row, strict=False):
                setattr(channel.motion, name, value)
            channel.motion = channel.motion.without_window()
            for name, value in zip(LASTING_STEPS, row[len(LASTING) :], strict=True):
                setattr(channel.steps, name, value)
            channel.steps.stepped = stepped != 0.0

    def expect(self, angles: np.ndarray, stamp: int) -> None:
        self.resumed_ns = stamp
        for channel, angle in zip(self.channels, angles.tolist(), strict=True):
            channel.near = angle
            channel.motion.take(stamp, angle)

    def set_tracking(self, tracking: float | None) -> None:
        self.tracking = tracking  # type: ignore[assignment]
        for channel in self.channels:
            fresh = self._channel(channel.axis)
            channel.bandwidth, channel.adaptive = fresh.bandwidth, fresh.adaptive
            channel.track = Track()

    # --- gates ------------------------------------------------------------------------------------

    def feed(
        self,
        topic: str,
        stamp: int,
        names: Sequence[str],
        positions: Sequence[float],
        by_arrival: bool = False,
    ) -> list[Sample]:
        if len(names) != len(positions) or not names or stamp <= 0:
            whole = "malformed" if len(names) != len(positions) else "unstamped"
            self.refused["empty" if not (names or positions) else whole] += 1
            return []
        motors = len(self.robot.motors)
        index = {channel.axis.name: k for k, channel in enumerate(self.channels)}
        news = False
        for name, position in zip(names, positions, strict=True):
            k = index.get(name)
            if k is None:
                self.refused["unknown_name"] += 1
            elif topic != "both" and (k < motors) != (topic == "motors"):
                self.elsewhere += 1
            elif self._admit(k, stamp, position, by_arrival):
                news = True
        return self._samples() if news else []

    def _admit(self, k: int, stamp: int, reading: float, by_arrival: bool) -> bool:
        channel = self.channels[k]
        stamp += channel.axis.sensor.clock_offset_ns
        if not isfinite(reading):
            cause = "not_finite"
        elif not 0 < stamp < END_NS:
            cause = "late" if stamp <= 0 else "future"
        else:
            before, channel.before = channel.before, None
            if before is not None and 0 < stamp - before[0] <= GAP_NS:
                _, channel.reading, channel.turns = before
            cause = channel.complaint(stamp, reading)
            if cause != "out_of_range":
                newest = max(one.last_ns for one in self.channels)
                timing = channel.timing(stamp, reading, newest)
                if timing == "another time":
                    return self._hold(k, stamp, reading)
                cause = timing or cause
        if cause:
            self._refuse(channel, cause, stamp, reading)
            if cause == "out_of_range":
                channel.steps.alternate(True)
            return False
        self._drop_held(channel)
        for other in self.channels:
            if other is not channel:
                other.lag.meet(k, stamp)
        channel.lag.take(stamp)
        if by_arrival:
            channel.arrivals.take(stamp)
        return self._judge(channel, stamp, reading)

    def _judge(self, channel: Channel, stamp: int, reading: float) -> bool:
        point = stamp, channel.angle_at(reading)
        if channel.steps.repeats and point[1] != channel.last:
            channel.lost_way = 0.0 < channel.steps.worth < abs(point[1] - channel.last)
            channel.steps.restart()
            channel.motion = channel.motion.without_window()
        if channel.off is not None:
            off, channel.off = channel.off, None
            if not channel.steps.returns((off[0], channel.angle_at(off[1])), point):
                before = channel.last_ns
                self._append(channel, *off, before, off=True)
                self._append(channel, stamp, reading, before)
                channel.readings[-2] = (*channel.readings[-2][:3], channel.readings[-1][3])
                return True
            self.refused["implausible"] += 1
            channel.steps.alternate(True)
        if channel.steps.is_off(channel.motion, point):
            channel.off = stamp, reading
            return False
        self._append(channel, stamp, reading, channel.last_ns)
        return True

    def _drop_off(self, channel: Channel) -> None:
        self.refused["implausible"] += channel.off is not None
        channel.off = None

    def _refuse(self, channel: Channel, cause: str, stamp: int, reading: float) -> None:
        self.refused[cause] += 1
        if cause == "implausible":
            channel.note_implausible(stamp, reading)
        elif cause == "contradictory":
            self._note_contradiction(channel, stamp)

    def _note_contradiction(self, channel: Channel, stamp: int) -> None:
        channel.steps.note_contradiction()
        before = [at for at, *_ in channel.readings if at < stamp]
        self._tell_doubt(channel, before[-1] if before else stamp - 1, stamp)

    def _tell_doubt(self, channel: Channel, since: int, stamp: int) -> None:
        steps = channel.steps
        unit = channel.misfits or channel.alone
        if steps.stepped or steps.alternates or steps.repeats or unit:
            if channel.doubt is None:
                channel.doubt = Doubt(since)
                self.doubts.append(channel.doubt)
        elif channel.doubt is not None:
            channel.doubt.until_ns, channel.doubt = stamp, None

    def _drop_held(self, channel: Channel) -> None:
        for stamp, _ in channel.held:
            self.refused["future" if stamp > channel.last_ns else "late"] += 1
        channel.held = []

    def _hold(self, k: int, stamp: int, reading: float) -> bool:
        channel = self.channels[k]
        if channel.held and stamp == channel.held[-1][0]:
            equal = reading == channel.held[-1][1]
            self._refuse(channel, "repeated" if equal else "contradictory", stamp, reading)
            return False
        if channel.held and not channel.follows(stamp):
            self._drop_held(channel)
        channel.held.append((stamp, reading))
        regular = channel.is_regular()
        if len(channel.held) < CONFIRMATIONS and not regular:
            return False
        self._drop_off(channel)
        confirmed, channel.held = channel.held, []
        if regular:
            return self._append_all(channel, confirmed)
        if confirmed[0][0] < channel.last_ns:
            self._jump_back()
            return self._append_all(self.channels[k], confirmed)
        self.gaps += 1
        if self.given_out_ns >= 0:
            self.given_out_ns = max(self.given_out_ns, confirmed[0][0] - 1)
        usual = channel.usual_ns
        used = self._append_all(channel, confirmed[:1])
        channel.usual_ns = usual
        if used and self.given_out_ns >= 0:
            channel.readings[-1] = (*channel.readings[-1][:2], 0.0, channel.readings[-1][3])
        return self._append_all(channel, confirmed[1:]) or used

    def _jump_back(self) -> None:
        self.clock_jumps += 1
        before = self.channels
        for old in before:
            self._drop_off(old)
            if old.held and old.held[0][0] >= old.last_ns:
                self._drop_held(old)
        self._begin()
        for channel, old in zip(self.channels, before, strict=True):
            channel.left_behind_ns, channel.motion = old.last_ns, old.motion.without_window()
            for name in (*LASTING_STEPS, "stepped"):
                setattr(channel.steps, name, getattr(old.steps, name))
            self._append_all(channel, old.held)

    def _append_all(self, channel: Channel, readings: Sequence[tuple[int, float]]) -> bool:
        before = self.accepted
        for stamp, reading in readings:
            if cause := channel.complaint(stamp, reading):
                self._refuse(channel, cause, stamp, reading)
            else:
                self._append(channel, stamp, reading, channel.last_ns)
        return self.accepted > before

    def _has_fitted(self, channel: Channel) -> bool:
        """Whether it is at its furthest, and moved together with others of a cable, (C15)."""
        if abs(channel.moved()) < channel.furthest:
            return False
        channel.furthest = abs(channel.moved())
        motors = len(self.robot.motors)
        kinds = self.channels[:motors], self.channels[motors:]
        others = kinds[any(channel is one for one in kinds[0])]
        for cable, pull in enumerate(channel.pull):
            own = abs(pull * channel.moved())
            effect = 0.0
            for one in others:
                effect += one.pull[cable] * one.moved() if one.pull else 0.0
            if own > 1.0 and abs(effect) > 0.3 * own:
                return True
        return False

    def _shown_by_others(self, channel: Channel, stamp: int) -> tuple[float, float]:
        """Speed and acceleration that the motion of other axes suggests, (C13)."""
        span = stamp - channel.last_ns
        if channel.last_ns < 0 or span <= WINDOW_NS or isinf(channel.steps.worth):
            return 0.0, 0.0
        shown = [(0.0, 0.0)]
        for other in self.channels:
            v, a = other.motion.speed, other.motion.acceleration
            if other is channel or other.steps.worth == 0.0 or a * (span * 1e-9) <= v:
                continue
            if a * (other.usual_ns * 1e-9) <= v:
                ratio = channel.steps.worth / other.steps.worth
                shown.append((ratio * v, ratio * a))
        return max(v for v, _ in shown), max(a for _, a in shown)

    def _append(
        self, channel: Channel, stamp: int, reading: float, since_ns: int, off: bool = False
    ) -> None:
        value, turns = channel.angle_at(reading), channel.turns_at(reading)
        alternated = channel.steps.alternates
        self.steps += channel.has_stepped(stamp, value, off)
        if alternated and not channel.steps.alternates:
            channel.lost_way = True
        repeats = channel.steps.repeats
        channel.alone = channel.first is None
        channel.first = value if channel.first is None else channel.first
        channel.fits = channel.fits or self._has_fitted(channel)
        channel.counted = channel.counted or channel.is_counted(reading)
        known = (channel.fits and channel.counted) or not channel.pull
        too_far = abs(channel.moved()) > channel.steps.worth
        channel.misfits = not known and (channel.misfits or too_far)
        self._tell_doubt(channel, channel.steps.repeated_since if repeats else since_ns, stamp)
        least = self._shown_by_others(channel, stamp)
        since, angle, motion = stamp - channel.last_ns, value, channel.motion
        if channel.bandwidth > 0.0:
            band = error_of(channel.axis.sensor)
            numbers = since * 1e-9, value, channel.bandwidth, band, channel.adaptive
            angle = min(max(channel.track.at(*numbers), channel.lower), channel.upper)
        motion.take(stamp, value)
        curvature = 0.0
        if channel.last_ns >= 0:
            curvature = motion.curvature(since, least)
            if channel.lost_way:
                curvature, channel.lost_way = inf, False
            channel.usual_ns = max(since, channel.usual_ns // 2)
        elif 0 <= self.resumed_ns < stamp:
            channel.resumed = motion.curvature(stamp - self.resumed_ns)
        channel.last_ns, channel.last = stamp, value
        channel.reading, channel.turns = reading, turns
        channel.readings.append((stamp, angle, curvature, channel.offset()))
        if len(channel.readings) > WAITING:
            channel.readings.popleft()
            self.crowded += 1
            if self.given_out_ns >= 0:
                self.given_out_ns = max(self.given_out_ns, channel.readings[0][0])
        self._extrapolate(channel, stamp, angle)
        self.accepted += 1

    @staticmethod
    def _extrapolate(channel: Channel, stamp: int, angle: float) -> None:
        recent, tested = channel.recent, channel.tested
        recent.append((stamp, angle))
        while (
            stamp - recent[0][0] > 20_000_000
            and len(recent) > 2
            and stamp - recent[1][0] >= 10_000_000
        ):
            recent.popleft()
        while tested and 2 * (stamp - tested[0][0]) >= HORIZON_NS:
            begin, window, first, velocity = tested.popleft()
            since = stamp - begin
            channel.motion.miss(since, window, angle - first - velocity * (since * 1e-9))
        window = stamp - recent[0][0]
        if window > 0:
            tested.append((stamp, window, angle, (angle - recent[0][1]) / window * 1e9))

    # --- time line --------------------------------------------------------------------------------

    def _samples(self) -> list[Sample]:
        stamps = [channel.last_ns for channel in self.channels]
        until, newest = min(stamps), max(stamps)
        if until < 0 or (until <= self.given_out_ns and not self.predicts):
            return []
        samples = self._interpolated(until)
        if self.predicts and max(self.given_out_ns, self.ahead_ns) < newest <= until + HORIZON_NS:
            lagging = [channel for channel in self.channels if channel.last_ns < newest]
            known = all(
                c.last_ns != c.recent[0][0] and c.motion.windows > 0 and c.motion.knows(c.usual_ns)
                for c in lagging
            )
            if known and self.given_out_ns >= 0:
                samples.append(self._predicted(newest))
        self.lag_ns = newest - max(self.given_out_ns, self.ahead_ns)
        return samples

    def _interpolated(self, until: int) -> list[Sample]:
        began, samples = self.given_out_ns >= 0, []
        last = max(self.given_out_ns, self.passed_over_ns)
        if not began:
            last = max(last, *(channel.readings[0][0] - 1 for channel in self.channels))
        while last < until:
            stamp = min(
                next(at for at, *_ in channel.readings if at > last) for channel in self.channels
            )
            angles, offsets, unseen = [], [], np.zeros((2, len(self.channels)))
            for k, channel in enumerate(self.channels):
                readings = channel.readings
                while len(readings) > 1 and readings[1][0] <= stamp:
                    readings.popleft()
                before, angle, curvature, offset = readings[0]
                if before != stamp:
                    after, following, curvature, offset = readings[1]
                    angle += (following - angle) * ((stamp - before) / (after - before))
                    if curvature != 0.0:
                        unseen[0, k] = curvature * (stamp - before) * (after - stamp)
                angles.append(angle)
                offsets.append(offset)
                if began:
                    unseen[1, k] = self._way(channel, curvature, stamp - last)
                elif 0 <= self.resumed_ns < stamp:
                    unseen[1, k] = self._way(channel, channel.resumed, stamp - self.resumed_ns)
            last = stamp
            if unseen[0].max() == inf:
                self.passed_over_ns = stamp
                continue
            began = True
            self.doubts = [doubt for doubt in self.doubts if doubt.until_ns > stamp]
            doubtful = any(doubt.after_ns < stamp for doubt in self.doubts)
            changed = NONE_CHANGED if offsets == self.told else np.array(offsets).T
            self.told = offsets
            silent = stamp <= self.ahead_ns
            samples.append(
                self._sample(stamp, angles, unseen, doubtful, offset=changed, silent=silent)
            )
        if samples:
            self.given_out_ns = self.ahead_from_ns = last
        return samples

    @staticmethod
    def _way(channel: Channel, curvature: float, interval_ns: int) -> float:
        """Standard deviation midway between two samples, (C3)."""
        way = curvature * interval_ns * interval_ns * 0.25
        return way if way > channel.negligible else 0.0

    def _predicted(self, stamp: int) -> Sample:
        angles, unseen = [], np.zeros((2, len(self.channels)))
        for k, channel in enumerate(self.channels):
            (begin, first), (_, angle) = channel.recent[0], channel.recent[-1]
            span, horizon = channel.last_ns - begin, stamp - channel.last_ns
            velocity = (angle - first) / span * 1e9 if span > 0 else 0.0
            there = angle + velocity * (horizon * 1e-9)
            angles.append(min(max(there, channel.lower), channel.upper))
            if horizon == 0:
                curvature = channel.readings[-1][2]
                unseen[1, k] = self._way(channel, curvature, stamp - self.ahead_from_ns)
            else:
                deviation = channel.motion.ahead(horizon, span)
                unseen[0, k] = deviation if deviation > channel.negligible else 0.0
        self.ahead_ns = self.ahead_from_ns = stamp
        doubtful = any(doubt.after_ns < stamp < doubt.until_ns for doubt in self.doubts)
        doubtful = doubtful or any(channel.off is not None for channel in self.channels)
        return self._sample(stamp, angles, unseen, doubtful, predicted=True)

    def _sample(
        self, stamp: int, angles: list[float], unseen: np.ndarray, doubtful: bool, **how: Any
    ) -> Sample:
        values, motors = np.array(angles), len(self.robot.motors)
        seen = not unseen.any()
        return Sample(
            stamp, values[:motors], values[motors:], ALL_SEEN if seen else unseen,
            doubtful=doubtful, **how,
        )  # fmt: skip
