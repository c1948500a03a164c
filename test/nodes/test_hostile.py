"""Hostile messages: the node keeps running, counts all of them, and estimates afterwards.

`make test` sends 8000 messages from a fixed seed to the callbacks of a node in this process;
`make soak` sends CDRJ_HOSTILE messages.
"""

from __future__ import annotations

import gc
import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.estimators import Bench

from cdrj_ros.estimation.estimator import Estimates, initial_state, run
from cdrj_ros.estimation.reading_limits import WHOLE
from cdrj_ros.estimation.whole_recording import condition
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    JOINT_STATE,
    MessageError,
)
from cdrj_ros.messages.cdr import read_layout as layout_of
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import Model
from cdrj_ros.model.state import UNSURE

MESSAGES = int(os.environ.get("CDRJ_HOSTILE", "8000"))
SEED = 20_240_607
BEGIN = 1_700_000_000 * 10**9
SECOND = 10**9
MILLISECOND = 1_000_000
NAMES = {"motors": "winch", "joints": "elbow"}
GROWTH_MB = 8.0
"""Most memory that the second half of the messages may add [MB]."""


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


def wild(rng: Any, now: int) -> Iterator[tuple[str, bytes]]:
    """One message, or a burst that a channel may interpret as a clock jump."""
    topic = "motors" if rng.integers(2) else "joints"
    chance = rng.integers(10)
    name = ("winch", "elbow", "stranger", "")[rng.integers(4)]
    names = (name,) * int(rng.choice((0, 1, 1, 1, 1, 2, 5)))
    special = (0.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 1e11, -1e12, 1e9)
    value = float(rng.normal()) if rng.integers(2) else special[rng.integers(len(special))]
    far = (0, 1, 10**6, SECOND, 3 * SECOND, 3600 * SECOND, 4 * 10**8 * SECOND)[rng.integers(7)]
    stamp = now + int(rng.choice((-1, 1))) * far + int(rng.integers(5))
    if chance < 5:
        yield topic, valid(topic, now)
    elif chance < 7:
        yield topic, joint_state(stamp, names, [value] * len(names))
    elif chance < 8:
        payload = bytearray(valid(topic, stamp))
        for _ in range(int(rng.integers(1, 4))):
            payload[int(rng.integers(len(payload)))] = int(rng.integers(256))
        yield topic, bytes(payload[: int(rng.integers(len(payload) // 2, len(payload) + 1))])
    elif chance < 9:
        yield topic, bytes(rng.integers(0, 256, int(rng.integers(80)), dtype=np.uint8))
    else:
        step = int(rng.choice((1, MILLISECOND, SECOND // 2)))
        own = NAMES[topic] if rng.integers(4) else name
        for k in range(int(rng.integers(2, 12))):
            yield topic, joint_state(stamp + k * step, (own,), [value if k % 3 else 0.1])


def wild_tensions(rng: Any, now: int) -> bytes:
    values = (30.0, np.nan, np.inf, 1e308, -1e308, 5e-324, 0.0, -5.0)
    name = ("upper/8", "lower/3", "upper/99", "")[rng.integers(4)]
    names = (name,) * int(rng.integers(3))
    payload = Template(CABLE_TENSIONS, names, ("tension", "stddev")).encode(
        now + int(rng.choice((-SECOND, -10 * MILLISECOND, 0, SECOND // 3, 10**4 * SECOND))),
        tension=[values[rng.integers(len(values))]] * len(names),
        stddev=[(0.5, np.nan, 1e-300, 1e300, -1.0, 0.0)[rng.integers(6)]] * len(names),
    )
    if rng.integers(5) == 0:
        return payload[: int(rng.integers(len(payload)))]
    return payload


def is_tensions(payload: bytes) -> bool:
    try:
        layout_of(payload, CABLE_TENSIONS.fields)
    except MessageError:
        return False
    return True


def test_whatever_arrives_is_counted_and_after_a_reset_the_estimates_are_right(
    estimator: Any,
) -> None:
    rng = np.random.default_rng(SEED)
    traffic, now, warm = Traffic(estimator), BEGIN, 0.0
    while traffic.sent < MESSAGES:
        now += MILLISECOND
        for topic, payload in wild(rng, now):
            traffic.send(topic, payload)
        tensions = wild_tensions(rng, now)
        estimator.on_tensions(tensions)
        traffic.whole += not is_tensions(tensions)
        estimator.answers.clear()
        if not warm and traffic.sent > MESSAGES // 2:
            warm = own_mb()
    traffic.assert_counted()
    assert own_mb() - warm < GROWTH_MB
    estimator.live.reset()
    later = now + 10**6 * SECOND
    stamps: dict[str, list[int]] = {"motors": [], "joints": []}
    for k in range(300):
        for topic in ("joints", "motors"):
            stamps[topic].append(later + k * MILLISECOND)
            traffic.send(topic, valid(topic, stamps[topic][-1]))
    model = estimator.live.model
    wanted = offline(model, stamps)
    assert [one.stamp_ns for one in estimator.answers] == wanted.stamp_ns.tolist()
    status = model.layout.status
    got = np.array([one.values for one in estimator.answers])
    got[:, status] = got[:, status].astype(int) & ~UNSURE
    assert np.array_equal(got, wanted.values)
