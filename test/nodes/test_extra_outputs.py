"""Outputs on request: tensions as JointState, and forces on pulleys as WrenchStamped."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.estimators import Bench, feed

from cdrj_ros.messages.conversions import marked_stale

PLACED = str(Path(__file__).parents[2] / "config" / "robots" / "prototype_positions.yaml")


@pytest.fixture
def bench(ros: None) -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def topics(bench: Bench) -> set[str]:
    return {name for name, _ in bench.node.get_topic_names_and_types() if "/cdrj/" in name}


def test_they_exist_only_on_request(bench: Bench) -> None:
    node = bench.estimator()
    assert bench.until(lambda: "/cdrj/tensions" in topics(bench))
    assert not any("wrenches" in name or "tension_states" in name for name in topics(bench))
    assert node.topics.extra is None


def test_they_hold_the_tensions_by_name_and_the_forces_of_the_estimate(bench: Bench) -> None:
    from geometry_msgs.msg import WrenchStamped
    from sensor_msgs.msg import JointState

    node = bench.estimator(tension_states=True, wrenches=True, robot=PLACED, frame_id="arm")
    states: list[Any] = []
    wrenches: list[Any] = []
    bench.node.create_subscription(JointState, "/cdrj/tension_states", states.append, 10)
    bench.node.create_subscription(WrenchStamped, "/cdrj/wrenches/upper_3", wrenches.append, 10)
    assert bench.until(lambda: bool(node.topics.extra._wanted and node.topics.extra._states_wanted))
    feed(node, 0, 5)
    assert bench.until(lambda: len(states) == len(wrenches) == 5)
    layout, estimate = node.live.model.layout, node.output.estimate
    state, wrench = states[-1], wrenches[-1]
    assert tuple(state.name) == layout.elements
    assert np.array_equal(state.effort, estimate.tension)
    assert not len(state.velocity)
    assert not len(state.position)
    k = layout.pulleys.index("upper/3")
    force = wrench.wrench.force
    wanted = [estimate.values[getattr(layout, f"force_{axis}")][k] for axis in "xyz"]
    assert [force.x, force.y, force.z] == wanted
    assert np.hypot(force.x, force.y) > 1.0
    assert wrench.header.frame_id == "arm"
    assert wrench.header.stamp.sec * 10**9 + wrench.header.stamp.nanosec == estimate.stamp_ns


def test_cables_without_positions_have_forces_in_the_frame_of_each_pulley(bench: Bench) -> None:
    node = bench.estimator(wrenches=True)
    frames = [message.header.frame_id for _, _, message in node.topics.extra._on_wrenches]
    assert frames == [name.replace("/", "_") for name in node.live.model.layout.pulleys]


def test_nothing_is_computed_while_nobody_subscribes_or_while_nothing_is_known(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sensor_msgs.msg import JointState

    node = bench.estimator(tension_states=True, wrenches=True)
    made: list[Any] = []
    encode = node.topics.extra._states.encode
    monkeypatch.setattr(
        node.topics.extra._states, "encode", lambda *a, **k: made.append(1) or encode(*a, **k)
    )
    feed(node, 0, 10)
    assert not made
    bench.node.create_subscription(JointState, "/cdrj/tension_states", lambda _: None, 10)
    assert bench.until(lambda: bool(node.topics.extra._states_wanted))
    feed(node, 10, 12)
    assert len(made) == 2
    known = node.output.estimate
    for unknown in (marked_stale(known), known._replace(solved=False)):
        node.topics.extra.publish(unknown)
    assert len(made) == 2
    node.topics.extra.publish(known)
    assert len(made) == 3
