"""The compiled core conditions any stream as a conditioner in plain Python does, bit for bit."""

from __future__ import annotations

from collections import Counter
from random import Random
from typing import Any

import numpy as np
import pytest
from support.reading_streams import Message, random_robot, random_stream

from cdrj_ros import _core
from cdrj_ros.conditioning.conditioner import Conditioner
from cdrj_ros.conditioning.limits import axes_of
from cdrj_ros.conditioning.refusals import REFUSALS
from cdrj_ros.conditioning.time_line import HORIZON_NS
from cdrj_ros.robot.description import Robot

TOPICS = {
    "motors": _core.Topic.MOTORS,
    "joints": _core.Topic.JOINTS,
    "both": _core.Topic.BOTH,
}
Content = tuple[object, ...]


def content(sample: tuple[Any, ...]) -> Content:
    return tuple(
        b"" if one is None else one.tobytes() if isinstance(one, np.ndarray) else one
        for one in sample
    )


class Pair:
    """The core and the Python conditioner, given the same."""

    def __init__(self, robot: Robot, mode: Any) -> None:
        self.robot = robot
        self.python = Conditioner(robot, mode)
        self.core = _core.Conditioner(
            axes_of(robot), len(robot.motors), mode == "predict", HORIZON_NS
        )
        self.seen: Counter[str] = Counter()

    def feed(self, message: Message) -> None:
        stamp, names, positions = message.stamp_ns, message.names, message.positions
        found = self.core.feed(TOPICS[message.topic], stamp, names, positions)
        wanted = getattr(self.python, f"feed_{message.topic}")(stamp, names, positions)
        assert [content(one) for one in found] == [content(one) for one in wanted]
        for sample in wanted:
            self.seen["samples"] += 1
            for what in ("doubtful", "predicted", "silent"):
                self.seen[what] += getattr(sample, what)
            self.seen["unseen"] += sample.unseen.size > 0
            self.seen["unknown"] += bool(np.isinf(sample.unseen).any())

    def compare(self) -> None:
        core, python = self.core, self.python
        names = ("accepted", "elsewhere", "clock_jumps", "gaps", "steps", "refused", "held")
        for name in (*names, "unheard", "displaced"):
            assert getattr(core, name) == getattr(python, name)
        line = python.time_line
        assert (core.lag_ns, core.crowded) == (line.lag_ns, line.crowded)
        memory = python.memory()
        found = core.remembered()
        assert [one.tobytes() for one in found] == [one.tobytes() for one in memory.values()]

    def disturb(self, random: Random) -> None:
        """Change both, as services do; or restart both, as from a state file."""
        deed = random.random()
        if deed < 0.002:
            keep = random.random() < 0.5
            self.python.reset(keep)
            self.core.reset(keep)
        elif deed < 0.003:
            tracking = random.choice((None, 0.0, 30.0))
            self.python.set_tracking(tracking)
            self.core.use_tracking_of(axes_of(self.robot, tracking))
        elif deed < 0.004:
            memory = self.python.memory()
            angles = np.array([random.uniform(-0.5, 0.5) for _ in self.robot.axes])
            stamp = 1_700_000_000_000_000_000
            self.python.reset()
            self.python.recall(memory)
            self.python.expect(angles, stamp)
            self.core.reset()
            self.core.remember(*memory.values())
            self.core.continue_from(angles, stamp)


def test_samples_counters_and_memory_are_those_of_the_reference() -> None:
    seen: Counter[str] = Counter()
    for seed in range(60):
        random = Random(seed)
        pair = Pair(random_robot(random), random.choice(("wait", "predict")))
        for message in random_stream(random, pair.robot, random.choice((200, 1000))):
            pair.feed(message)
            pair.disturb(random)
        pair.compare()
        seen += pair.seen + Counter(pair.core.refused)
        for what in ("clock_jumps", "gaps", "steps"):
            seen[what] += getattr(pair.core, what)
    assert set(seen) >= {*REFUSALS, "clock_jumps", "gaps", "steps"}
    assert min(seen.values()) > 10, seen  # everything has happened


def test_a_message_of_one_topic_is_not_read_as_one_of_another() -> None:
    with pytest.raises(TypeError):
        _core.Conditioner([], 0, False, HORIZON_NS).feed(0, 1, ["a"], [0.0])  # type: ignore[arg-type]
