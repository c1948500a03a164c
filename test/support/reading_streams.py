"""Random robots, and streams of messages as their sensors, networks and clocks spoil them."""

from dataclasses import dataclass

import numpy as np

from cdrj_ros.estimation.conditioner import TOPICS, Kind
from cdrj_ros.estimation.estimator import Sample
from support.wound import robot_of

MS = 1_000_000
SECOND = 1_000_000_000
END_OF_TIME_NS = 2**31 * SECOND
LAST = 2**63 - 1
WRONG = (0.2, 3.0, 1e13, 1e12, 1e308, np.nan, np.inf, -np.inf)


@dataclass(frozen=True)
class Message:
    """A message of one topic."""

    topic: Kind
    stamp_ns: int
    names: tuple[str, ...]
    positions: tuple[float, ...]


def take(conditioner, kind, stamp_ns, names, positions, by_arrival=False):
    """The samples that a message of angles [rad] completes, which has arrived at its stamp."""
    arrival_ns = stamp_ns if by_arrival else -1
    found = conditioner.feed(
        TOPICS[kind], stamp_ns, names, np.asarray(positions), arrival_ns, by_arrival
    )
    return [Sample(*one) for one in found]


def random_robot(random):
    """Up to three motors and joints, each with sensor and limits of its own."""
    motors = ", ".join(_axis(random, f"m{k}", []) for k in range(random.randint(1, 3)))
    joints = ", ".join(
        _axis(random, f"j{k}", [f"range: {random.choice(('[-1, 1]', '[-0.5, 0.52]', '[-3, 3]'))}"])
        for k in range(random.randint(1, 3))
    )
    paths = "motors.m0.clock_offset, joints.j0.clock_offset"
    block = f"uncertainty: {{others: exact, parameters: [{paths}], stddev: [0.003, 0.01]}}\n"
    stated = random.choice(("", block))
    span = random.choice(("1", "[1, {joint: j0, slope: 0.02}]"))
    return robot_of(f"name: any\n{stated}motors: [{motors}]\njoints: [{joints}]\n", "m0", span)


def _axis(random, name, keys):
    for share, key, values in (
        (0.5, "max_speed", (2, 8, 50)),
        (0.4, "period", (0.015, 0.5, 3.1, 6.283185307179586)),
        (0.4, "scale", (-2, 0.25, -0.5, 1.5)),
        (0.3, "offset", (0.1, -0.3)),
        (0.3, "clock_offset", (0.002, -0.25, 0.001)),
        (0.3, "correction", ("{angle: [-1, 0.2, 1], value: [0.01, 0.003, -0.01]}",)),
        (0.3, "noise", (0.001,)),
    ):
        if random.random() < share:
            keys.append(f"{key}: {random.choice(values)}")
    if random.random() < 0.5:
        keys.append(f"resolution: {random.choice((4e-4, 0.01, 0.05))}")
        keys.append(f"tracking_bandwidth: {random.choice((1, 5, 12, 100))}")
        keys.append(f"tracking: {random.choice(('fixed', 'adaptive'))}")
    return f"{{name: {name}, {', '.join(keys)}}}"


def _topics(random, robot):
    motors, joints = ([axis.name for axis in axes] for axes in (robot.motors, robot.joints))
    alone = [("motors", [name]) for name in motors] + [("joints", [name]) for name in joints]
    return random.choice(
        ([("both", motors + joints)], alone, [("motors", motors), ("joints", joints)])
    )


class Sender:
    """Sends what the sensors of moving axes read."""

    def __init__(self, random, robot):
        self.random, self.robot = random, robot
        self.topics = _topics(random, robot)
        self.begin = random.choice((1, SECOND, 1_700_000_000 * SECOND))
        self.at_once = random.random() < 0.4
        """Whether all topics are sent at the same times."""
        base = random.choice((1, 2, 5, 20, 60, 130, 400, 1500)) * MS
        rates = [1.0 if self.at_once else random.choice((0.3, 0.5, 1.0, 2.0, 7.0, 60.0))
                 for _ in self.topics]  # fmt: skip
        self.periods = [max(int(base * rate), 1) for rate in rates]
        self.due = [self.begin] * len(rates)
        self.speed = random.choice((0.0, 0.1, 0.5, 2.0, 6.0, 20.0))
        self.amplitude = random.choice((0.01, 0.3, 0.6))
        self.shift = 0
        """By which the clock has been set [ns]."""
        self.shift_of = [0] * len(rates)
        """The same for the messages of each topic, some of which are still under way."""
        self.silent_until = [-1] * len(rates)
        self.steps = {}
        self.second = random.choice((*4 * (0.0,), 0.02, 0.3))
        """By how much the readings of a second publisher differ."""

    def next(self):
        """The next message; None if its topic is silent."""
        random = self.random
        which = min(range(len(self.due)), key=lambda k: self.due[k])
        time = self.due[which]
        stretch = random.choice((*20 * (1.0,), 0.5, 2.0, 15.0, 40.0))
        stretch *= 1.0 if self.at_once else random.uniform(0.7, 1.3)
        self.due[which] += max(int(self.periods[which] * stretch), 1)
        event = random.random()
        if event < 0.002:
            self.shift += random.choice((-10, -2, 5, 3600)) * SECOND - random.choice(
                (0, SECOND // 2)
            )
        if event > 0.998:
            self.silent_until[which] = time + random.choice((30, 300, 3000, 30_000)) * MS
        if self.silent_until[which] > time:
            return None
        topic, names = self.topics[which]
        positions = tuple(self._reading(name, time) for name in names)
        if random.random() < 0.2:
            self.shift_of[which] = self.shift
        stamp = max(time + self.shift_of[which], -5)
        return self._spoiled(topic, stamp, list(names), list(positions))

    def _reading(self, name, time):
        random = self.random
        (sensor,) = (axis.sensor for axis in self.robot.axes if axis.name == name)
        value = self.amplitude * np.sin(self.speed * (time - self.begin) * 1e-9) / sensor.scale
        if random.random() < 0.002:
            self.steps[name] = random.choice((0.0, 0.3, random.uniform(-0.1, 0.1)))
        value += self.steps.get(name, 0.0)
        if random.random() < 0.05:
            value += random.choice((1e-3, 0.012))
        if random.random() < 0.3:
            value += self.second
        if random.random() < 0.01:
            value += random.choice(WRONG)
        elif sensor.period != np.inf:
            value = np.remainder(value, sensor.period)
        return float(value)

    def _spoiled(self, topic, stamp, names, positions):
        """A message, now and then with other names, numbers or times."""
        random, fault = self.random, self.random.random()
        if fault < 0.004:
            names, positions = [*names, "stranger"], [*positions, 1.0]
        elif fault < 0.008:
            positions = positions[:-1]
        elif fault < 0.01:
            names, positions = [], []
        elif fault < 0.02:
            names, positions = [*names, names[0]], [*positions, positions[0]]
        elif fault < 0.03:
            names[0] = random.choice([axis.name for axis in self.robot.axes])
        elif fault < 0.04:
            stamp += random.choice((-5 * MS, -1, 1, 6 * SECOND, -6 * SECOND))
        elif fault < 0.045:
            stamp = random.choice((0, -SECOND, END_OF_TIME_NS - 1, END_OF_TIME_NS + 5, 1, LAST))
        elif fault < 0.05:
            topic = random.choice(("motors", "joints", "both"))
        return Message(topic, stamp, tuple(names), tuple(positions))


def random_stream(random, robot, count):
    """Some ``count`` messages in order of arrival; some arrive twice or late."""
    sender, sent = Sender(random, robot), []
    for _ in range(count):
        message = sender.next()
        if message is None:
            continue
        sent.append(message)
        if random.random() < 0.02:
            sent.append(message)
        if random.random() < 0.02 and len(sent) > 5:
            sent.append(sent.pop(random.randrange(-5, 0)))
    return sent
