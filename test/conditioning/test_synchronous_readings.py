"""Readings of all axes at the same times: samples are made without interpolation."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from support.wound import robot_of

from cdrj_ros.conditioning.conditioner import Conditioner
from cdrj_ros.conditioning.samples import Sample

ROBOT = robot_of("""
name: plain
motors: [{name: a, max_speed: 50}, {name: b, resolution: 0.001, tracking_bandwidth: 20}]
joints: [{name: p, range: [-1, 1], max_speed: 20}]
""")
BEGIN_NS = 10**18
INTERVALS_MS = (*30 * (1,), 4, 4, 15, 60, 130, 400, 900)

Message = tuple[str, int, list[str], list[float]]


def stream(random: Random, count: int) -> list[Message]:
    """Messages of both topics, nearly all with the same stamps, of axes that sometimes leap."""
    found: list[Message] = []
    stamp, leap, speed = BEGIN_NS, 0.0, random.choice((0.1, 0.5, 2.0, 6.0))
    for k in range(count):
        stamp += (400 if k < 3 else random.choice(INTERVALS_MS)) * 1_000_000
        if random.random() < 0.01:
            leap = random.choice((0.0, 0.3))
        angle = 0.6 * np.sin(speed * (stamp - BEGIN_NS) * 1e-9)
        pair: list[Message] = [
            ("motors", stamp, ["a", "b"], [10.0 * angle, 3.0 * angle + leap]),
            ("joints", stamp, ["p"], [angle]),
        ]
        if random.random() < 0.3:
            pair.reverse()
        if k < 2:  # nothing is known of the motion between the first readings
            pair.pop(k)
        elif random.random() < 0.1:
            pair.pop(random.randrange(2))
        if random.random() < 0.03:
            del pair[0][2][1:], pair[0][3][1:]
        found += pair
    return found


def content(sample: Sample) -> tuple[object, ...]:
    return tuple(one.tobytes() if isinstance(one, np.ndarray) else one for one in sample)


@pytest.mark.parametrize("mode", ["wait", "predict"])
@pytest.mark.parametrize("resumes", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_samples_are_those_of_the_interpolation(
    mode: str, resumes: bool, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    quick, plain = Conditioner(ROBOT, mode), Conditioner(ROBOT, mode)
    together = []
    method = quick.time_line._together

    def counted(stamp: int) -> list[Sample]:
        together.append(bool(found := method(stamp)))
        return found

    monkeypatch.setattr(quick.time_line, "_together", counted)
    monkeypatch.setattr(plain.time_line, "_together", lambda _: [])
    if resumes:
        for one in (quick, plain):
            one.expect(np.zeros(3), BEGIN_NS - 250_000_000)
    for topic, *message in stream(Random(seed), 1500):
        ours, theirs = (getattr(one, f"feed_{topic}")(*message) for one in (quick, plain))
        assert [content(one) for one in ours] == [content(one) for one in theirs]
        assert quick.time_line.lag_ns == plain.time_line.lag_ns
    assert sum(together) > 20
