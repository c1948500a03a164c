"""Most readings pass the gate by a shortcut, which has no effect on samples and counters."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from support.wound import robot_of

from cdrj_ros.conditioning.conditioner import Conditioner
from cdrj_ros.conditioning.gate import Channel
from cdrj_ros.conditioning.samples import Sample

ROBOT = robot_of(
    """
name: gated
motors: [{name: free}, {name: slow, max_speed: 0.5}, {name: geared, scale: 0.25, offset: 0.01}]
joints: [{name: p, range: [-0.5, 0.5]}]
""",
    "free",
)
MS = 1_000_000
MOTORS = ("free", "slow", "geared")
INTERVALS_MS = (*60 * (1,), *20 * (20,), 300, 1500, 4000)

Message = tuple[str, int, str, float]
Outcome = tuple[object, ...]


def stream(random: Random, begin_ns: int, count: int) -> list[Message]:
    """Readings of moving axes with glitches, steps, gaps, repetitions and changes of the clock."""
    found: list[Message] = []
    stamp, moving, step = begin_ns, 0.0, 0.0
    speed = random.choice((0.5, 2.0, 6.0))
    for _ in range(count):
        interval = random.choice(INTERVALS_MS) * MS
        stamp += interval
        moving += min(interval, 20 * MS) * 1e-9  # the axes rest during gaps
        if random.random() < 0.005:
            step += random.choice((-0.3, 0.1, 0.3))
        if random.random() < 0.003:
            stamp = begin_ns
        angle = float(np.sin(speed * moving))
        values = {
            "free": 3.0 * angle + step,
            "slow": 0.4 / speed * angle + random.choice((0.0, 0.0, 0.0, 0.003)),
            "geared": angle,
            "p": 0.502 * angle,
        }
        for name, value in values.items():
            wrong = random.random()
            glitch = 0.2 * (wrong < 0.01)
            ahead = 5_000 * MS * (wrong > 0.99) - 30 * MS * (0.98 < wrong < 0.985)
            feed = "motors" if name in MOTORS else "joints"
            message = (feed, max(stamp + ahead, 1), name, value + glitch)
            found += [message] * (2 if 0.5 < wrong < 0.52 else 1)
    return found


def content(sample: Sample) -> Outcome:
    return tuple(one.tobytes() if isinstance(one, np.ndarray) else one for one in sample)


def outcomes(messages: list[Message], *, stepped: bool) -> list[Outcome]:
    """Samples and counters after every message."""
    conditioner = Conditioner(ROBOT)
    if stepped:
        conditioner.recall(conditioner.memory() | {"stepped": np.eye(4)[0]})
    found: list[Outcome] = []
    for feed, stamp, name, value in messages:
        samples = getattr(conditioner, f"feed_{feed}")(stamp, [name], [value])
        counters = (
            *conditioner.refused.values(),
            conditioner.accepted,
            conditioner.clock_jumps,
            conditioner.gaps,
            conditioner.steps,
            conditioner.held,
        )
        found.append((counters, *map(content, samples)))
    return found


@pytest.mark.parametrize("begin_ns", [1, 10**18])
@pytest.mark.parametrize("stepped", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_the_shortcut_has_no_effect(
    begin_ns: int, stepped: bool, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages = stream(Random(seed), begin_ns, 1000)
    quick = outcomes(messages, stepped=stepped)
    monkeypatch.setattr(Channel, "is_ordinary", lambda *_: False)
    assert quick == outcomes(messages, stepped=stepped)
