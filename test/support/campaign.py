"""Faults of the inputs of a simulated rig: what its sensors say, and estimates beside the truth.

The truth is the rig with contact cells that are fixed to the surfaces of its pulleys, of a robot
whose numbers differ from the file's as the file's standard deviations allow.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from cdrj_ros.estimation.changes import with_other_numbers
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.estimation.state_file import read_state, write_state
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot.parameters import number_at
from cdrj_ros.simulation import motion
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.truth import simulate

How = Literal["freezes", "is stuck", "is off", "is wild", "drifts", "scales"]
Axis = Literal["winch", "elbow"]
Mode = Literal["wait", "predict"]

START = 1_700_000_000 * 10**9
MS = 1_000_000
SECOND = 1_000_000_000
CELLS = 16
"""Contact cells of every pulley of the rig."""
CELL = "upper/8"
EFFORT = "winch"
NOISE = {CELL: 0.05, EFFORT: 0.005}
"""Standard deviations of the readings of the cell [N] and of the effort [N m]."""
SMALLEST = 1e-3
"""Lower bound of standard deviations; smaller ones are rounding errors [N]."""
WINCH_SPEED = 10.0
"""Greatest speed of a winch that balances a load [rad/s]."""
FASTEST = 2.5
"""Greatest speed of the joint [rad/s]."""


class Course(NamedTuple):
    """The truth at 1 kHz."""

    names: tuple[str, ...]
    """Of all motors, then all joints."""
    angle: Table
    """Of these [rad], shape (n, axes)."""
    tension: Table
    """Of all elements [N], shape (n, elements)."""
    effort: Table
    """Of the motors [N m], shape (n, motors)."""

    @property
    def duration_ns(self):
        return len(self.angle) * MS

    def until(self, end_ns):
        return Course(self.names, *(values[: end_ns // MS] for values in self[1:]))


def at(stamps, values):
    """A column of the truth at stamps [ns] since the start."""
    return np.interp(stamps, MS * np.arange(len(values)), values)


class Lie(NamedTuple):
    """What is wrong with a sensor that was good until then."""

    how: How
    since_ns: int
    size: float = 0.0
    """Where it "is stuck", by how much it "is off" or "drifts" in a second [N] or [N m], or by
    which share it "scales" too much [-]."""


@dataclass
class Faults:
    """Faults of the inputs of one run; none by default."""

    period_ns: dict[str, int] = field(default_factory=lambda: {"winch": MS, "elbow": 2 * MS})
    phase_ns: int = 0
    """Of the first reading of every axis."""
    older_ns: dict[str, int] = field(default_factory=dict)
    """By how much the values of an axis are older than their stamps [ns]."""
    gaps: list[tuple[str, int, int]] = field(default_factory=list)
    """Axis, begin and end [ns]."""
    lost: dict[str, float] = field(default_factory=dict)
    """Share of the readings that are lost, by axis."""
    late_ns: dict[str, int] = field(default_factory=dict)
    """Delay of the messages by axis or sensor [ns]."""
    slips: list[tuple[str, int, float]] = field(default_factory=list)
    """Axis, time [ns] and size [rad] of slips of an encoder."""
    wrong: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Share of the readings that are wrong, and by how much [rad], by axis."""
    second: dict[str, float] = field(default_factory=dict)
    """By how much [rad] every other reading of an axis differs: that of a second publisher."""
    clocks: dict[str, tuple[int, float]] = field(default_factory=dict)
    """Offset [ns] and relative drift of the clock of an axis."""
    wrap: bool = False
    """Whether the winch's encoder wraps after a turn although the robot file gives no wrapping."""
    restart_ns: int | None = None
    """Time at which the estimator stops, to be restarted from its state file [ns]."""
    stop_ns: int = 0
    """Duration of that stop [ns]."""
    clock_ns: tuple[int, int] | None = None
    """Time and size of a jump of the clock of all inputs [ns]."""
    tare_ns: int | None = None
    """Time of a call of tare [ns]."""
    sensors: tuple[str, ...] = ()
    """``CELL`` and ``EFFORT``, if they are used."""
    lies: dict[str, Lie] = field(default_factory=dict)
    """Of sensors, by name."""
    cell_ns: int = 10 * MS
    """Interval of the readings of the load cell and of the effort [ns]."""
    mode: Mode = "wait"

    def words(self):
        """Description of the faults for the message of a failed test."""
        return ", ".join(f"{k}={v}" for k, v in vars(self).items() if v != getattr(Faults(), k))


def quarter_rate():
    """Periods of readings at 250 Hz [ns], for laws that hold at any rate, in less time."""
    return {"winch": 4 * MS, "elbow": 4 * MS}


# --- the truth ------------------------------------------------------------------------------------


def sine(hertz, amplitude=0.6):
    """A sinusoid of the joint within its speed."""
    return motion.sine(min(amplitude, FASTEST / (2.0 * np.pi * hertz)), hertz)


def course_of(model, seconds, moves, *, load=0.0, seed=None):
    """What happens in the rig.

    Args:
        model: the robot of the file.
        seconds: duration [s].
        moves: from times [s] to angles of all joints [rad], shape (n, joints), or (n,) of one.
        load: mass that the joint carries [kg], which the winch balances; 0: the winch follows the
            lengths of the cables.
        seed: of the numbers of the robot, which differ from the file's; None: they are the file's.
    """
    time = 0.001 * np.arange(round(1000 * seconds))
    joints = moves(time)
    robot = model.robot if seed is None else _other(model, seed).robot
    loaded = make_load("rolling", load)
    torque = loaded.torque(*motion.differences(time, joints)) if load > 0.0 else None
    return recorded(
        model, simulate(robot, time, joints, torque, WINCH_SPEED, CELLS, allow_slack=True)
    )


def recorded(model, truth):
    """A simulation at 1 kHz as a course."""
    names = tuple(axis.name for axis in model.robot.axes)
    angle = np.hstack([truth.motor_angle, truth.joint_angle])
    return Course(names, angle, truth.tension, truth.motor_effort)


def _other(model, seed):
    """A robot whose numbers differ from the file's as its standard deviations allow."""
    known, document = model.robot.uncertainty, dict(model.robot.document)
    generator = np.random.default_rng([seed, 1])
    paths = known.parameters[: known.stated]
    stddev = np.sqrt(np.diag(known.covariance))
    return with_other_numbers(
        model,
        {
            path: number_at(document, path) + float(one * np.clip(generator.normal(), -2.0, 2.0))
            for path, one in zip(paths, stddev, strict=False)
        },
    )


# --- what the sensors say -------------------------------------------------------------------------


class Message(NamedTuple):
    """A reading on its way to the estimator."""

    arrival_ns: int
    order: int
    name: str
    stamp_ns: int
    value: float


def _stamps_of(course, faults, name, generator):
    """Times of the readings that arrive [ns]."""
    period = faults.period_ns.get(name, faults.cell_ns)
    first = faults.phase_ns % period if name in faults.period_ns else 0
    stamps = np.arange(first, course.duration_ns, period, dtype=np.int64)
    for axis, begin, end in faults.gaps:
        if axis == name:
            stamps = stamps[(stamps < begin) | (stamps > end)]
    if faults.restart_ns is not None:
        begin, end = faults.restart_ns, faults.restart_ns + faults.stop_ns
        stamps = stamps[(stamps < begin) | (stamps > end)]
    if name in faults.lost:
        stamps = stamps[generator.random(stamps.size) >= faults.lost[name]]
    return stamps


def _angles(
    model, course, faults, name, stamps,
    generator
):  # fmt: skip
    """Readings of an axis [rad]."""
    older = stamps - faults.older_ns.get(name, 0)
    values = at(older, course.angle[:, course.names.index(name)])
    for axis, since, size in faults.slips:
        if axis == name:
            values = values + size * (stamps >= since)
    if name in faults.second:
        values[1::2] += faults.second[name]
    if name in faults.wrong:
        share, size = faults.wrong[name]
        values = values + size * (generator.random(stamps.size) < share)
    count = next(axis.sensor.resolution for axis in model.robot.axes if axis.name == name)
    values = count * np.round(values / count)
    if faults.wrap and name == "winch":
        values = np.mod(values + np.pi, 2.0 * np.pi) - np.pi
    return values


def _measured(course, faults, name, stamps, generator):
    """Readings of a load cell [N] or of an effort [N m]."""
    true = at(stamps, course.effort[:, 0] if name == EFFORT else course.tension[:, 7])
    values = true + generator.normal(0.0, NOISE[name], stamps.size)
    if name not in faults.lies:
        return values
    how, since, size = faults.lies[name]
    lying = stamps >= since
    if not lying.any():
        return values
    said = {
        "freezes": np.full(stamps.size, values[np.argmax(lying)]),
        "is stuck": values - true + size,
        "is off": values + size,
        "is wild": values + size * (np.arange(stamps.size) % 3 == 0),
        "drifts": values + size * (stamps - since) / SECOND,
        "scales": values * (1.0 + size),
    }[how]
    return np.where(lying, said, values)


def _messages(model, course, faults):
    """All messages in the order of their arrival."""
    generator = np.random.default_rng(7)
    messages = []
    for order, name in enumerate((*faults.sensors, "winch", "elbow")):
        is_sensor = order < len(faults.sensors)
        stamps = _stamps_of(course, faults, "" if is_sensor else name, generator)
        if is_sensor:
            values = _measured(course, faults, name, stamps, generator)
        else:
            values = _angles(model, course, faults, name, stamps, generator)
        late = faults.late_ns.get(name, 0)
        offset, creep = (0, 0.0) if is_sensor else faults.clocks.get(name, (0, 0.0))
        said = stamps + offset + (creep * stamps).astype(np.int64)
        if faults.clock_ns is not None:
            said = said + faults.clock_ns[1] * (stamps >= faults.clock_ns[0])
        what = EFFORT + " effort" if is_sensor and name == EFFORT else name
        messages += [
            Message(arrival, order, what, stamp, value)
            for arrival, stamp, value in zip(
                (stamps + late).tolist(), said.tolist(), values.tolist(), strict=True
            )
        ]
    return sorted(messages)


# --- runs -----------------------------------------------------------------------------------------


def run(model, course, faults, options=None, scratch=None, watch=None):
    """Feed the readings of the course with their faults.

    Args:
        model: the robot.
        course: the truth.
        faults: the faults of the inputs.
        options: options of the estimator; None: those that the faults ask for.
        scratch: a folder for the state file of a restart.
        watch: called with the estimator at the end.

    Returns:
        The estimates; their stamps are on the clock of the course.
    """
    options = options or Options(conditioning=faults.mode)
    live, outputs = LiveEstimator(model, options), []
    restart_ns, tare_ns = faults.restart_ns, faults.tare_ns
    for message in _messages(model, course, faults):
        if restart_ns is not None and message.arrival_ns > restart_ns and scratch is not None:
            restart_ns = None
            write_state(live, scratch / "state")
            live = LiveEstimator(model, options)
            read_state(live, scratch / "state")
        if tare_ns is not None and message.arrival_ns > tare_ns:
            tare_ns = None
            with suppress(UsageError):
                live.tare()
        made = _feed(live, message)
        by = 0
        if faults.clock_ns is not None and message.arrival_ns >= faults.clock_ns[0]:
            by = faults.clock_ns[1]
        outputs += [_moved(output, by) for output in made] if by else made
    if watch is not None:
        watch(live)
    return outputs


def _feed(live, message):
    stamp, value = START + message.stamp_ns, (message.value,)
    if message.name == CELL:
        live.feed_tensions(stamp, (CELL,), value, (NOISE[CELL],))
        return []
    if message.name == EFFORT + " effort":
        live.feed_efforts(stamp, (EFFORT,), value)
        return []
    kind = "motors" if message.name == "winch" else "joints"
    return live.feed(kind, stamp, (message.name,), value)[1]


def _moved(output, by):
    """The output with its stamp converted back to the course's clock."""
    return replace(output, stamp_ns=output.stamp_ns - by)


@dataclass(frozen=True)
class Verdict:
    """Errors of the estimates with status 0, over all elements and samples."""

    ratio: Vector
    """|error| / standard deviation of all estimates with status 0 [-]."""
    worst: float
    """Largest of these errors [N]."""
    judged: int
    """Number of elements times samples of any status."""

    def beyond(self, sigmas):
        """Share of the estimates with status 0 whose error exceeds ``sigmas`` deviations [-]."""
        return float(np.mean(self.ratio > sigmas)) if self.ratio.size else 0.0


def judge(course, outputs, begin_ns=0, end_ns=None):
    """Judge the estimates whose stamps lie between two times since the start [ns]."""
    end = START + (course.duration_ns if end_ns is None else end_ns)
    inside = [o for o in outputs if START + begin_ns <= o.stamp_ns < end]
    if not inside:
        return Verdict(np.empty(0), 0.0, 0)
    since = np.array([o.stamp_ns - START for o in inside])
    truth = np.column_stack([at(since, one) for one in course.tension.T])
    error = np.abs(np.array([o.tension for o in inside]) - truth)
    stddev = np.array([o.stddev[: truth.shape[1]] for o in inside if o.stddev is not None])
    good = np.array([o.status for o in inside]) == 0
    ratio = error / np.maximum(stddev, SMALLEST)
    worst = float(error[good].max()) if good.any() else 0.0
    return Verdict(ratio[good], worst, error.size)
