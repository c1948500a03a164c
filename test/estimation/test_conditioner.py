"""The compiled core conditions any stream of messages as the plain reference does, bit for bit."""

from __future__ import annotations

from collections import Counter
from random import Random
from typing import Any

import numpy as np
import pytest
from support.reading_streams import Message, random_robot, random_stream
from support.reference_conditioning import Reference

from cdrj_ros import _core
from cdrj_ros.estimation.conditioner import HORIZON_NS, Conditioner
from cdrj_ros.estimation.reading_limits import REFUSALS
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.robot.description import Robot


def content(sample: Sample) -> tuple[object, ...]:
    return tuple(one.tobytes() if isinstance(one, np.ndarray) else one for one in sample)


class Pair:
    """The core and the reference, given the same."""

    def __init__(self, robot: Robot, mode: Any) -> None:
        self.robot = robot
        self.python, self.core = Reference(robot, mode), Conditioner(robot, mode)
        self.seen: Counter[str] = Counter()

    def feed(self, message: Message) -> None:
        stamp, names, positions = message.stamp_ns, message.names, message.positions
        found = self.core.take(message.topic, stamp, names, positions)
        wanted = self.python.feed(message.topic, stamp, names, positions)
        assert [content(one) for one in found] == [content(one) for one in wanted]
        for sample in wanted:
            self.seen["samples"] += 1
            for what in ("doubtful", "predicted", "silent"):
                self.seen[what] += getattr(sample, what)
            self.seen["offset"] += sample.offset.size > 0
            self.seen["late"] += bool(sample.offset[1:].any())
            self.seen["unseen"] += sample.unseen.size > 0
            self.seen["unknown"] += bool(np.isinf(sample.unseen).any())

    def compare(self) -> None:
        core, python = self.core, self.python
        names = ("accepted", "elsewhere", "clock_jumps", "gaps", "steps", "refused")
        for name in (*names, "crowded", "lag_ns"):
            assert getattr(core, name) == getattr(python, name)
        channels = {channel.axis.name: channel for channel in python.channels}
        assert core.held_of == {name: channel.held for name, channel in channels.items()}
        assert core.unheard == [name for name, channel in channels.items() if channel.last_ns < 0]
        steps = {name: one.steps for name, one in channels.items()}
        stepped = {n: one.displaced for n, one in steps.items() if one.stepped or one.displaced}
        assert core.displaced == stepped
        assert core.alternating == [name for name, one in steps.items() if one.alternates]
        for name, values in python.memory().items():
            assert core.memory()[name].tobytes() == values.tobytes()

    def disturb(self, random: Random) -> None:
        """Change both, as services do; or restart both, as from a state file."""
        deed, choice = random.random(), random.choice((None, 0.0, 30.0))
        memory = self.python.memory() if deed < 0.004 else {}
        angles = np.array([random.uniform(-0.5, 0.5) for _ in self.robot.axes])
        for one in (self.core, self.python):
            if deed < 0.002:
                one.reset(keep_turns=choice is None)
            elif deed < 0.003:
                one.set_tracking(choice)
            elif deed < 0.004:
                one.reset()
                one.recall(memory)
                one.expect(angles, 1_700_000_000_000_000_000)


def test_samples_counters_and_memory_are_those_of_the_reference() -> None:
    seen: Counter[str] = Counter()
    for seed in range(90):
        random = Random(seed)
        pair = Pair(random_robot(random), random.choice(("wait", "predict")))
        for message in random_stream(random, pair.robot, random.choice((200, 1000))):
            pair.feed(message)
            pair.disturb(random)
        pair.compare()
        seen += pair.seen + Counter(pair.core.refused)
        for what in ("clock_jumps", "gaps", "steps"):
            seen[what] += getattr(pair.core, what)
        seen["alternating"] += len(pair.core.alternating)
    assert set(seen) >= {*REFUSALS, "clock_jumps", "gaps", "steps", "alternating"}
    assert min(seen.values()) > 10, seen  # everything has happened


def test_a_message_of_one_topic_is_not_read_as_one_of_another() -> None:
    with pytest.raises(TypeError):
        _core.Conditioner([], 0, False, HORIZON_NS).feed(0, 1, ["a"], [0.0])  # type: ignore[arg-type]
