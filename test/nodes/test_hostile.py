"""Hostile messages: the node keeps running, counts all of them, and its estimates stay correct.

`make test` sends 12 500 messages from a fixed seed to the callbacks of a node in this process;
`make soak` sends CDRJ_HOSTILE messages.
"""

from __future__ import annotations

import gc
import os
import struct
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.estimators import Bench

from cdrj_ros.estimation.estimator import Estimate, Estimates, initial_state, run
from cdrj_ros.estimation.reading_limits import WHOLE
from cdrj_ros.estimation.whole_recording import condition
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    JOINT_STATE,
    NODAL_FORCES,
    MessageError,
)
from cdrj_ros.messages.cdr import read_layout as layout_of
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import Model
from cdrj_ros.model.state import UNSURE

MESSAGES = int(os.environ.get("CDRJ_HOSTILE", "12500"))
SEED = 20_240_607
BEGIN = 1_700_000_000 * 10**9
SECOND = 10**9
MILLISECOND = 1_000_000
NAMES = {"motors": "winch", "joints": "elbow"}
GROWTH_MB = 8.0
"""Most memory that 50 000 messages or more may add [MB]; fewer may add less in proportion."""
OF_MESSAGES = min(1.0, MESSAGES / 50_000)


@lru_cache(maxsize=64)
def template(names: tuple[str, ...]) -> Template:
    return Template(JOINT_STATE, names, ("position",))


def joint_state(stamp_ns: int, names: tuple[str, ...], positions: Any) -> bytes:
    return template(names).encode(stamp_ns, position=positions)


def angle(topic: str, stamp_ns: int) -> float:
    time = (stamp_ns - BEGIN) * 1e-9
    elbow = 0.3 * np.sin(0.9 * time)
    if topic == "motors":
        return float(8.0 * np.sin(elbow) + 0.02 * np.sin(7.0 * time))
    return float(elbow)


def valid(topic: str, stamp_ns: int) -> bytes:
    return joint_state(stamp_ns, (NAMES[topic],), [angle(topic, stamp_ns)])


def offline(model: Model, stamps: Mapping[str, Sequence[int]]) -> Estimates:
    """Estimates from the same valid messages without a node, from the initial state."""

    def readings(topic: str) -> dict[str, Series]:
        when = np.array(stamps[topic], dtype=np.int64)
        values = np.array([angle(topic, stamp) for stamp in stamps[topic]])
        return {NAMES[topic]: Series(when, when, values)}

    (samples,) = condition(model.robot, readings("motors"), readings("joints")).segments
    return run(model, initial_state(model), samples)[1]


class Heard:
    """Stores estimates in preallocated arrays, so that the test's own memory does not grow."""

    def __init__(self, model: Model, room: int) -> None:
        self._stamps = np.full(room, 1, dtype=np.int64)
        self._values = np.full((room, model.layout.size), 0.1)
        self.count = 0

    def append(self, estimate: Estimate) -> None:
        self._stamps[self.count] = estimate.stamp_ns
        self._values[self.count] = estimate.values
        self.count += 1

    def assert_same(self, model: Model, wanted: Estimates) -> None:
        assert self._stamps[: self.count].tolist() == wanted.stamp_ns.tolist()
        assert_equal(model, self._values[: self.count].copy(), wanted)


def assert_equal(model: Model, values: np.ndarray, wanted: Estimates) -> None:
    status = model.layout.status
    values[:, status] = values[:, status].astype(int) & ~UNSURE
    assert np.array_equal(values, wanted.values)


@pytest.fixture
def estimator(ros: None) -> Iterator[Any]:
    """An estimator in this process; its published estimates are stored in `answers`."""
    bench = Bench()
    estimator = bench.estimator(tension_sensors=True)
    yield estimator
    bench.close()


@dataclass
class Traffic:
    """Sends messages to the callbacks of one estimator and counts them."""

    estimator: Any
    whole: int = 0
    readings: int = 0
    sent: int = 0

    def __post_init__(self) -> None:
        self.callbacks = {"motors": self.estimator.motor, "joints": self.estimator.joint}

    def send(self, topic: str, payload: bytes) -> None:
        names = names_in(payload)
        if names:
            self.readings += names
        else:
            self.whole += 1
        self.sent += 1
        self.callbacks[topic](payload)

    def assert_counted(self) -> None:
        conditioner = self.estimator.live.conditioner
        refused = conditioner.refused
        assert sum(refused[cause] for cause in WHOLE) == self.whole
        by_reading = sum(count for cause, count in refused.items() if cause not in WHOLE)
        assert (
            conditioner.accepted + conditioner.elsewhere + conditioner.held + by_reading
            == self.readings
        )


def names_in(payload: bytes) -> int:
    """Number of readings in a message; 0 if the message is refused as a whole."""
    try:
        layout = layout_of(payload, JOINT_STATE.fields)
    except MessageError:
        return 0
    sec, nanosec = struct.unpack_from(layout.order + "iI", payload, 4)
    names = len(layout.texts["name"])
    if names != layout.numbers["position"].count or sec * SECOND + nanosec <= 0:
        return 0
    return names


def own_mb() -> float:
    """Anonymous memory of the process [MB], without libraries and shared memory."""
    gc.collect()
    (line,) = (
        line
        for line in Path("/proc/self/status").read_text().splitlines()
        if line.startswith("RssAnon:")
    )
    return int(line.split()[1]) * 1024e-6


HUGE = "x" * 50_000
MANY = tuple(f"n{k}" for k in range(500))


def refusable(kind: int, topic: str, last: int, rng: Any) -> tuple[bytes, str, int]:
    """A message that must be refused, the cause, and the number of readings it counts for.

    ``last`` is the newest stamp accepted on the topic.
    """
    name = (NAMES[topic],)
    good = valid(topic, last + MILLISECOND)
    outside = "out_of_range" if topic == "joints" else "implausible"
    table: tuple[Callable[[], tuple[bytes, str, int]], ...] = (
        lambda: (joint_state(last + 1, name, [np.nan]), "not_finite", 1),
        lambda: (joint_state(last + 1, name, [np.inf]), "not_finite", 1),
        lambda: (joint_state(last + 1, name, [-np.inf]), "not_finite", 1),
        lambda: (joint_state(last + 1, name, [1e308]), outside, 1),
        lambda: (joint_state(last + 1, name, [-1e308]), outside, 1),
        lambda: (joint_state(last, name, [5e-324]), "repeated", 1),
        lambda: (joint_state(last - 1, name, [-0.0]), "late", 1),
        lambda: (joint_state(last - 3600 * SECOND, name, [0.0]), "late", 1),
        lambda: (joint_state(1, name, [0.0]), "late", 1),
        lambda: (joint_state(last + 3600 * SECOND, name, [0.0]), "future", 1),
        lambda: (joint_state((2**31 - 1) * SECOND, name, [0.0]), "future", 1),
        lambda: (joint_state(0, name, [0.0]), "unstamped", 1),
        lambda: (joint_state(-(2**31) * SECOND, name, [0.0]), "unstamped", 1),
        lambda: (joint_state(last + 1, (), []), "empty", 1),
        lambda: (joint_state(last + 1, ("stranger", "", "Winch"), [0.0] * 3), "unknown_name", 3),
        lambda: (joint_state(last + 1, (HUGE,), [0.0]), "unknown_name", 1),
        lambda: (joint_state(last + 1, MANY, np.zeros(len(MANY))), "unknown_name", len(MANY)),
        lambda: (joint_state(last, name * 3, [0.0] * 3), "repeated", 3),
        lambda: (b"", "malformed", 1),
        lambda: (bytes(rng.integers(4, 256, 60, dtype=np.uint8)), "malformed", 1),
        lambda: (good[: int(rng.integers(0, len(good) - 1))], "malformed", 1),
        lambda: (good[:4] + bytes(rng.integers(0, 256, 80, dtype=np.uint8)), "", 0),
        lambda: (_claiming(good), "malformed", 1),
        lambda: (_one_position_less(last + 1, topic), "malformed", 1),
        lambda: (
            Template(CABLE_TENSIONS, name, ("tension", "status")).encode(
                last + 1, tension=[1.0], status=[0]
            ),
            "malformed",
            1,
        ),
        lambda: (
            Template(NODAL_FORCES, name, ("force_x",)).encode(last + 1, force_x=[1e9]),
            outside,  # its beginning can be decoded as a JointState
            1,
        ),
    )
    payload, cause, count = table[kind % len(table)]()
    if not cause:  # random bytes that form a valid message are replaced
        if names_in(payload):
            return b"\0", "malformed", 1
        cause, count = "malformed", 1
    return payload, cause, count


def _claiming(good: bytes) -> bytes:
    """A message that claims to contain 2^32 - 1 names."""
    return good[:20] + b"\xff\xff\xff\xff" + good[24:]


def _one_position_less(stamp: int, topic: str) -> bytes:
    """A message with two names and one position."""
    whole = joint_state(stamp, (NAMES[topic], "other"), [0.0, 0.0])
    at = layout_of(whole, JOINT_STATE.fields).numbers["position"].offset
    count = at - 4 if whole[at - 4 : at] == struct.pack("<I", 2) else at - 8
    payload = whole[:count] + struct.pack("<I", 1) + whole[count + 4 : at + 8] + bytes(8)
    assert layout_of(payload, JOINT_STATE.fields).numbers["position"].count == 1
    return payload


def test_hostile_messages_do_not_change_the_estimates(estimator: Any) -> None:
    rng = np.random.default_rng(SEED)
    model = estimator.live.model
    estimator.answers = Heard(model, MESSAGES // 2)
    traffic = Traffic(estimator)
    expected: Counter[str] = Counter()
    stamps = {"motors": array("q"), "joints": array("q")}  # a list would need more memory
    k = 0
    warm = 0.0
    while traffic.sent < MESSAGES:
        stamp = BEGIN + k * MILLISECOND
        for topic in ("joints", "motors") if k % 2 == 0 else ("motors",):
            traffic.send(topic, valid(topic, stamp))
            stamps[topic].append(stamp)
        for _ in range(int(rng.integers(2, 9))):  # fewer than five consistent in a row
            topic = "motors" if rng.integers(2) else "joints"
            kind = int(rng.integers(1000))
            payload, cause, count = refusable(kind, topic, stamps[topic][-1], rng)
            traffic.send(topic, payload)
            expected[cause] += count
        k += 1
        if k % 100 == 0:
            estimator.on_tensions(bytes(rng.integers(4, 256, 60, dtype=np.uint8)))
            traffic.whole += 1
            expected["malformed"] += 1
        if not warm and traffic.sent > MESSAGES // 3:
            warm = own_mb()
    grown = own_mb() - warm
    for topic in NAMES:  # decides on held readings
        traffic.send(topic, valid(topic, BEGIN + k * MILLISECOND))
        stamps[topic].append(BEGIN + k * MILLISECOND)

    wanted = offline(model, stamps)
    estimator.answers.assert_same(model, wanted)
    assert wanted.stamp_ns.size > MESSAGES // 10
    conditioner = estimator.live.conditioner
    assert {c: n for c, n in conditioner.refused.items() if n} == dict(expected)
    assert set(expected) == set(conditioner.refused)
    traffic.assert_counted()
    assert grown < GROWTH_MB * OF_MESSAGES
    refused = ", ".join(f"{count} {cause}" for cause, count in sorted(expected.items()))
    print(  # noqa: T201 for make soak
        f"\n{traffic.sent} messages, a good stream among them: {wanted.stamp_ns.size} estimates as "
        f"without them; refused {refused}; memory {grown:+.1f} MB"
    )
