"""What drivers are known to send, for any robot: whole messages with faults, and the truth.

A message names all motors and joints, as joint_state_broadcaster sends it.  Truth and verdict are
those of ``support.campaign``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cdrj_ros.estimation.session import LiveEstimator, Options
from support.campaign import MS, START


class Message(NamedTuple):
    """A JointState of all axes."""

    stamp_ns: int
    names: tuple[str, ...]
    positions: tuple[float, ...]


def messages_of(model, course, hertz):
    """What sensors of the file's resolution send."""
    rows = np.arange(0, len(course.angle), 1000 // hertz)
    angle = course.angle[rows]
    for k, axis in enumerate(model.robot.axes):
        if axis.sensor.resolution > 0.0:
            angle[:, k] = axis.sensor.resolution * np.round(angle[:, k] / axis.sensor.resolution)
    return [
        Message(START + int(row) * MS, course.names, tuple(positions))
        for row, positions in zip(rows, angle.tolist(), strict=True)
    ]


# --- what goes wrong ------------------------------------------------------------------------------


def frozen(begin_s, end_s=np.inf, axes=None, noise=0.0):
    """The readings of some axes, of all by default, repeat but for noise; the stamps go on."""
    generator = np.random.default_rng(5)

    def spoil(messages):
        found = []
        last = None
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
                        held[name] + noise * generator.normal() if name in chosen else value
                        for name, value in zip(message.names, message.positions, strict=True)
                    )
                )
            )
        return found

    return spoil


def zeroed(axes, begin_s, gap_s):
    """A driver starts anew: nothing for a while, then some axes count from where they are."""
    chosen = frozenset(axes)

    def spoil(messages):
        since_s = [(m.stamp_ns - START) * 1e-9 for m in messages]
        before = [m for m, t in zip(messages, since_s, strict=True) if t < begin_s]
        after = [m for m, t in zip(messages, since_s, strict=True) if t >= begin_s + gap_s]
        zero = np.array(after[0].positions) * [name in chosen for name in after[0].names]
        counted = [m._replace(positions=tuple(np.array(m.positions) - zero)) for m in after]
        return before + counted

    return spoil


def second(value=0.0, *, first=True, begin_s=0.0):
    """Another publisher sends one value for all axes, with the very same stamps."""

    def spoil(messages):
        found = []
        for message in messages:
            other = message._replace(positions=(value,) * len(message.names))
            if (message.stamp_ns - START) * 1e-9 < begin_s:
                found.append(message)
            else:
                found += [other, message] if first else [message, other]
        return found

    return spoil


def twice(axis, value=0.0, *, first=True):
    """Every message has the name of one axis twice, once with another value."""

    def spoil(messages):
        if first:
            return [Message(m.stamp_ns, (axis, *m.names), (value, *m.positions)) for m in messages]
        return [Message(m.stamp_ns, (*m.names, axis), (*m.positions, value)) for m in messages]

    return spoil


def scaled(axes, factor):
    """The angles of some axes are multiplied."""
    chosen = frozenset(axes)

    def spoil(messages):
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


def in_degrees(axes):
    """The angles of some axes are in degrees."""
    return scaled(axes, 180.0 / np.pi)


def swapped(one, other):
    """Two axes have each other's name."""
    names = {one: other, other: one}
    return lambda messages: [
        m._replace(names=tuple(names.get(name, name) for name in m.names)) for m in messages
    ]


def older(axis, messages_ago):
    """The value of one axis is that of an earlier message."""

    def spoil(messages):
        place = messages[0].names.index(axis)
        found = []
        for k, message in enumerate(messages):
            positions = list(message.positions)
            positions[place] = messages[max(k - messages_ago, 0)].positions[place]
            found.append(message._replace(positions=tuple(positions)))
        return found

    return spoil


def late_stamps(deviation_s):
    """The stamps are times of publication, some time after that of the readings."""

    def spoil(messages):
        late = np.abs(np.random.default_rng(3).normal(0.0, 1e9 * deviation_s, len(messages)))
        return [
            m._replace(stamp_ns=m.stamp_ns + int(by)) for m, by in zip(messages, late, strict=True)
        ]

    return spoil


def bunched(interval_s):
    """Messages wait for each other and have the stamps of their arrival, 30 us apart."""
    interval = round(1e9 * interval_s)

    def spoil(messages):
        found = []
        last = 0
        for message in messages:
            last = max(message.stamp_ns + -message.stamp_ns % interval, last + 30_000)
            found.append(message._replace(stamp_ns=last))
        return found

    return spoil


def slipping(axis, begin_s, by, lasting_s):
    """The readings of an axis move away by so much [rad], evenly, and stay there."""

    def spoil(messages):
        place = messages[0].names.index(axis)
        found = []
        for message in messages:
            share = ((message.stamp_ns - START) * 1e-9 - begin_s) / lasting_s
            positions = list(message.positions)
            positions[place] += by * min(max(share, 0.0), 1.0)
            found.append(message._replace(positions=tuple(positions)))
        return found

    return spoil


def repeated(times):
    """The sensors are read less often than they are published."""
    return lambda messages: [
        m._replace(positions=messages[k - k % times].positions) for k, m in enumerate(messages)
    ]


# --- runs -----------------------------------------------------------------------------------------


def feed(model, messages, options=None, watch=None):
    """Feed the messages; ``watch`` is called after each of them."""
    live, outputs = LiveEstimator(model, options or Options()), []
    for message in messages:
        outputs += live.feed("both", message.stamp_ns, message.names, message.positions)[1]
        if watch is not None:
            watch(live, message)
    return outputs
