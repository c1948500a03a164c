"""Hostile messages: a node takes from any bytes what its estimator takes from their readings.

What the estimator makes of hostile readings is tested without a node.  `make test` sends 6000
messages from a fixed seed to the callbacks of a node in this process; `make soak` sends
CDRJ_HOSTILE messages.
"""

import gc
import os
import struct
from pathlib import Path
from random import Random

import numpy as np
import pytest
from support.foreign_bags import joint_state
from support.reading_streams import END_OF_TIME_NS, random_stream

from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    JOINT_STATE,
    NODAL_FORCES,
    MessageError,
    cable_tensions,
    read_layout,
)
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.packing import STALE

MESSAGES = int(os.environ.get("CDRJ_HOSTILE", "6000"))
CHUNK = 500
GROWTH_MB = 8.0
"""Most memory that 50 000 messages or more may add [MB]; fewer may add less in proportion."""
HUGE = "x" * 50_000
MANY = tuple(f"n{k}" for k in range(500))


def payload_of(random, message):
    """A serialised message, now and then one that no publisher of JointState sends."""
    names, positions, stamp = message.names, message.positions, message.stamp_ns
    kind = random.random()
    if kind < 0.004:
        names = random.choice((MANY, (HUGE,), ("", "Winch")))
        positions = (0.0,) * len(names)
    payload = joint_state(stamp, names, positions)
    if kind < 0.9:
        return payload
    if kind < 0.91:
        return Template(CABLE_TENSIONS, ("winch",), ("tension", "status")).encode(
            stamp, tension=[1.0], status=[0]
        )
    if kind < 0.92:
        return Template(NODAL_FORCES, ("elbow",), ("force_x",)).encode(stamp, force_x=[1e9])
    if kind < 0.93:
        return payload[:20] + b"\xff\xff\xff\xff" + payload[24:]  # so many names
    if kind < 0.96:
        return payload[: random.randrange(len(payload))]
    spoilt = bytearray(payload)
    for _ in range(random.choice((1, 2, 4, 100))):
        spoilt[random.randrange(len(spoilt))] = random.randrange(256)
    return bytes(spoilt)


def cells(random, stamp_ns):
    """A message of load cells."""
    names = (random.choice(("upper/8", "lower/3", "upper/99", "")),) * random.randrange(3)
    said = (30.0, np.nan, np.inf, 1e308, -1e308, 5e-324, 0.0, -5.0)
    payload = Template(CABLE_TENSIONS, names, ("tension", "stddev")).encode(
        stamp_ns, tension=random.choices(said, k=len(names)),
        stddev=random.choices((0.5, np.nan, 1e-300, 1e300, -1.0, 0.0), k=len(names)),
    )  # fmt: skip
    return payload if random.random() < 0.8 else payload[: random.randrange(len(payload))]


def readings_in(payload):
    """Stamp [ns], names and positions; None if the message is malformed."""
    try:
        layout = read_layout(payload, JOINT_STATE.fields)
    except MessageError:
        return None
    names, span = layout.texts["name"], layout.numbers["position"]
    if span.count not in (0, len(names)):
        return None
    sec, nanosec = struct.unpack_from(layout.order + "iI", payload, 4)
    positions = np.frombuffer(payload, span.dtype, span.count, span.offset)
    return sec * 10**9 + nanosec, names, positions.astype(float)


def own_mb():
    """Anonymous memory of the process [MB], without libraries and shared memory."""
    gc.collect()
    (line,) = (
        line
        for line in Path("/proc/self/status").read_text().splitlines()
        if line.startswith("RssAnon:")
    )
    return int(line.split()[1]) * 1024e-6


@pytest.mark.usefixtures("few_members")
def test_from_any_bytes_a_node_takes_what_its_estimator_takes_from_the_readings_in_them(bench):
    node = bench.estimator()
    node.now_ns = lambda: 0  # a stamp of zero has no time of arrival either
    beside = LiveEstimator(node.live.model, node.live.options)
    kinds = ("motors", "joints", "both")
    hear = {kind: node.angle_callback(kind, node.inputs[0]) for kind in kinds}
    ours, its = node.live.conditioner, beside.conditioner
    sent, estimates, warm = 0, 0, 0.0
    for seed in range(MESSAGES // CHUNK):
        random = Random(seed)
        for message in random_stream(random, node.live.model.robot, CHUNK):
            if not -END_OF_TIME_NS <= message.stamp_ns < END_OF_TIME_NS:
                continue
            payload = payload_of(random, message)
            hear[message.topic](payload)
            if (found := readings_in(payload)) is None:
                its.refuse("malformed")
                expected = []
            elif len(found[1]) > len(found[2]):  # efforts alone
                expected = []
            else:
                expected = beside.feed(message.topic, *found)[1]
            for one, other in zip(node.answers, expected, strict=True):
                values = one.values.copy()
                flags = values[one.layout.status].astype(int) & ~STALE
                values[one.layout.status] = flags
                assert np.array_equal(values, other.values)
                assert np.array_equal(one.stddev, other.stddev)
            node.answers.clear()
            sent, estimates = sent + 1, estimates + len(expected)
            if sent % 5 == 0:
                payload = cells(random, max(message.stamp_ns, 0))
                node.on_tensions(payload)
                try:
                    beside.feed_tensions(*cable_tensions(payload))
                except MessageError:
                    its.refuse("malformed")
        for name in ("refused", "accepted", "elsewhere", "held", "clock_jumps"):
            assert getattr(ours, name) == getattr(its, name)
        node.live.reset()
        beside.reset()
        if not warm and seed > MESSAGES // CHUNK // 3:
            warm = own_mb()
    grown = own_mb() - warm
    assert min(ours.refused.values()) > 0, ours.refused
    assert estimates > sent // 5
    assert grown < GROWTH_MB * min(1.0, MESSAGES / 50_000)
    print(  # noqa: T201 for make soak
        f"\n{sent} messages: {estimates} estimates, {ours.clock_jumps} jumps of the clock, refused "
        + ", ".join(f"{count} {cause}" for cause, count in sorted(ours.refused.items()))
        + f"; memory {grown:+.1f} MB"
    )
