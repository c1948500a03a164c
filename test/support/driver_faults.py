"""What drivers are known to send, for any robot: whole messages with faults, and the truth.

A message names all motors and joints, as joint_state_broadcaster sends it.  The truth is the rig of
``support.campaign``; the estimates are judged in the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.model.prepared import Model
from cdrj_ros.simulation.truth import simulate
from support.campaign import CELLS, MS, SMALLEST, START, Verdict

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


class Course(NamedTuple):
    """The truth at 1 kHz."""

    names: tuple[str, ...]
    """Of all motors, then all joints."""
    motors: int
    angle: Table
    """Of these [rad], shape (n, axes)."""
    tension: Table
    """Of all elements [N], shape (n, elements)."""


class Message(NamedTuple):
    """A JointState of all axes."""

    stamp_ns: int
    names: tuple[str, ...]
    positions: tuple[float, ...]


Fault = Callable[[list[Message]], list[Message]]


def course_of(model: Model, seconds: float, joint_angle: Callable[[Vector], Table]) -> Course:
    """What happens in the rig of the file while its joints move as given.

    Args:
        model: the robot.
        seconds: duration [s].
        joint_angle: from times [s] to angles of all joints [rad], shape (n, joints).
    """
    time = 0.001 * np.arange(round(1000 * seconds))
    truth = simulate(model.robot, time, joint_angle(time), cells=CELLS, allow_slack=True)
    names = tuple(axis.name for axis in model.robot.axes)
    angle = np.hstack([truth.motor_angle, truth.joint_angle])
    return Course(names, truth.motor_angle.shape[1], angle, truth.tension)


def messages_of(
    model: Model, course: Course, hertz: int, noise: Mapping[str, float] | None = None
) -> list[Message]:
    """What sensors of the file's resolution, and of such noise [rad], send."""
    rows = np.arange(0, len(course.angle), 1000 // hertz)
    angle = course.angle[rows]
    generator = np.random.default_rng(11)
    for k, axis in enumerate(model.robot.axes):
        if noise is not None and axis.name in noise:
            angle[:, k] += generator.normal(0.0, noise[axis.name], rows.size)
        if axis.sensor.resolution > 0.0:
            angle[:, k] = axis.sensor.resolution * np.round(angle[:, k] / axis.sensor.resolution)
    return [
        Message(START + int(row) * MS, course.names, tuple(positions))
        for row, positions in zip(rows, angle.tolist(), strict=True)
    ]


# --- what goes wrong ------------------------------------------------------------------------------


def frozen(begin_s: float, end_s: float = np.inf, axes: Iterable[str] | None = None) -> Fault:
    """The readings of some axes, of all by default, repeat while the stamps go on."""

    def spoil(messages: list[Message]) -> list[Message]:
        found: list[Message] = []
        last: Message | None = None
        for message in messages:
            since_s = (message.stamp_ns - START) * 1e-9
            if not begin_s <= since_s < end_s or last is None:
                last = message
                found.append(message)
                continue
            held = dict(zip(last.names, last.positions, strict=True))
            chosen = last.names if axes is None else tuple(axes)
            found.append(
                message._replace(
                    positions=tuple(
                        held[name] if name in chosen else value
                        for name, value in zip(message.names, message.positions, strict=True)
                    )
                )
            )
        return found

    return spoil


def second(
    value: float = 0.0, *, first: bool = True, every: int = 1, begin_s: float = 0.0
) -> Fault:
    """Another publisher sends one value for all axes, with the very same stamps."""

    def spoil(messages: list[Message]) -> list[Message]:
        found: list[Message] = []
        for k, message in enumerate(messages):
            other = message._replace(positions=(value,) * len(message.names))
            if k % every or (message.stamp_ns - START) * 1e-9 < begin_s:
                found.append(message)
            else:
                found += [other, message] if first else [message, other]
        return found

    return spoil


def twice(axis: str, value: float = 0.0, *, first: bool = True) -> Fault:
    """Every message has the name of one axis twice, once with another value."""

    def spoil(messages: list[Message]) -> list[Message]:
        if first:
            return [Message(m.stamp_ns, (axis, *m.names), (value, *m.positions)) for m in messages]
        return [Message(m.stamp_ns, (*m.names, axis), (*m.positions, value)) for m in messages]

    return spoil


def scaled(axes: Iterable[str], factor: float) -> Fault:
    """The angles of some axes are multiplied."""
    chosen = frozenset(axes)

    def spoil(messages: list[Message]) -> list[Message]:
        return [
            m._replace(
                positions=tuple(
                    factor * value if name in chosen else value
                    for name, value in zip(m.names, m.positions, strict=True)
                )
            )
            for m in messages
        ]

    return spoil


def in_degrees(axes: Iterable[str]) -> Fault:
    """The angles of some axes are in degrees."""
    return scaled(axes, 180.0 / np.pi)


def swapped(one: str, other: str) -> Fault:
    """Two axes have each other's name."""
    names = {one: other, other: one}
    return lambda messages: [
        m._replace(names=tuple(names.get(name, name) for name in m.names)) for m in messages
    ]


def older(axis: str, messages_ago: int) -> Fault:
    """The value of one axis is that of an earlier message."""

    def spoil(messages: list[Message]) -> list[Message]:
        place = messages[0].names.index(axis)
        found = []
        for k, message in enumerate(messages):
            positions = list(message.positions)
            positions[place] = messages[max(k - messages_ago, 0)].positions[place]
            found.append(message._replace(positions=tuple(positions)))
        return found

    return spoil


def late_stamps(deviation_s: float) -> Fault:
    """The stamps are times of publication, some time after that of the readings."""

    def spoil(messages: list[Message]) -> list[Message]:
        late = np.abs(np.random.default_rng(3).normal(0.0, 1e9 * deviation_s, len(messages)))
        return [
            m._replace(stamp_ns=m.stamp_ns + int(by)) for m, by in zip(messages, late, strict=True)
        ]

    return spoil


def repeated(times: int) -> Fault:
    """The sensors are read less often than they are published."""
    return lambda messages: [
        m._replace(positions=messages[k - k % times].positions) for k, m in enumerate(messages)
    ]


# --- runs -----------------------------------------------------------------------------------------


def run(
    model: Model,
    messages: Iterable[Message],
    options: Options | None = None,
    watch: Callable[[LiveEstimator, Message], object] | None = None,
) -> list[Estimate]:
    """Feed the messages; ``watch`` is called after each of them."""
    live, outputs = LiveEstimator(model, options or Options()), []
    for message in messages:
        outputs += live.feed("both", message.stamp_ns, message.names, message.positions)[1]
        if watch is not None:
            watch(live, message)
    return outputs


def judge(
    course: Course, outputs: list[Estimate], begin_s: float = 0.0, end_s: float = np.inf
) -> Verdict:
    """Judge the estimates whose stamps lie between two times since the start [s]."""
    inside = [o for o in outputs if begin_s <= (o.stamp_ns - START) * 1e-9 < end_s]
    if not inside:
        return Verdict(np.empty(0), 0.0, 0)
    time = np.array([o.stamp_ns - START for o in inside]) / MS
    grid = np.arange(len(course.tension))
    truth = np.column_stack([np.interp(time, grid, one) for one in course.tension.T])
    error = np.abs(np.array([o.tension for o in inside]) - truth)
    stddev = np.array([o.stddev[: truth.shape[1]] for o in inside if o.stddev is not None])
    good = np.array([o.status for o in inside]) == 0
    worst = float(error[good].max()) if good.any() else 0.0
    return Verdict((error / np.maximum(stddev, SMALLEST))[good], worst, error.size)
