"""The example controllers as nodes: what they command for which estimates, and one closed loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic
from typing import Any

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
PATIENCE_S = 60.0


class Bench:
    """A controller in this process, and a node that wishes, estimates and hears its commands."""

    def __init__(self, controller: Any, mode: str) -> None:
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node
        from std_msgs.msg import Float64MultiArray

        self.controller, self.user = controller, Node("user", namespace="cdrj")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(controller)
        self.executor.add_node(self.user)
        self.commands: list[list[float]] = []
        self.user.create_subscription(
            Float64MultiArray, f"commands/{mode}", lambda m: self.commands.append(list(m.data)), 10
        )
        self.wishes = self.user.create_publisher(Float64MultiArray, f"wished/{mode}", 10)
        self.publishers: dict[str, Any] = {}

    def wish(self, *values: float) -> None:
        from std_msgs.msg import Float64MultiArray

        self.wishes.publish(Float64MultiArray(data=list(values)))

    def publish(self, topic: str, message: Any) -> None:
        if topic not in self.publishers:
            self.publishers[topic] = self.user.create_publisher(type(message), topic, 10)
        message.header.stamp = self.user.get_clock().now().to_msg()
        self.publishers[topic].publish(message)

    def until(self, holds: Callable[[list[float]], bool], *again: Callable[[], None]) -> bool:
        """Repeat what is published until a command fulfils a condition."""
        deadline = monotonic() + PATIENCE_S
        self.commands.clear()
        while not any(holds(command) for command in self.commands):
            if monotonic() > deadline:
                return False
            for publish in again:
                publish()
            end = monotonic() + 0.02
            while (left := end - monotonic()) > 0.0:
                self.executor.spin_once(timeout_sec=left)
        return True

    def close(self) -> None:
        self.executor.shutdown()
        self.user.destroy_node()
        self.controller.destroy_node()


@pytest.fixture
def controller(ros: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Bench]]:
    """Create a controller of the examples by the names of its module and class."""
    import importlib

    monkeypatch.syspath_prepend(str(EXAMPLES))
    opened: list[Bench] = []

    def create(module: str, name: str, mode: str, **parameters: Any) -> Bench:
        from rclpy.parameter import Parameter

        made = getattr(importlib.import_module(module), name)
        overrides = [Parameter(key, value=value) for key, value in parameters.items()]
        opened.append(Bench(made(parameter_overrides=overrides), mode))
        return opened[-1]

    yield create
    for one in opened:
        one.close()


def tensions(upper: float, lower: float, status: int = 0) -> Any:
    from cdrj_msgs.msg import CableTensions

    names = [f"{cable}/{k}" for cable in ("upper", "lower") for k in range(1, 9)]
    return CableTensions(
        name=names, tension=[upper] * 8 + [lower] * 8, stddev=[0.5] * 16, status=[status] * 16
    )


def test_the_limiter_forwards_reduces_and_reverses_speeds(controller: Any) -> None:
    from cdrj_msgs.msg import CableTensions

    bench = controller("tension_limiter", "LimiterNode", "velocity", limit=60.0)

    def send(message: Any) -> tuple[Callable[[], None], Callable[[], None]]:
        return lambda: bench.wish(2.0), lambda: bench.publish("tensions", message)

    assert bench.until(lambda c: c == [2.0], *send(tensions(40.0, 30.0)))
    assert bench.until(lambda c: 0.0 < c[0] < 1.0, *send(tensions(57.0, 30.0)))
    assert bench.until(lambda c: c[0] < 0.0, *send(tensions(62.0, 30.0)))
    assert bench.until(lambda c: c == [2.0], *send(tensions(30.0, 58.0))), "this cable pays out"
    for flag in (CableTensions.UNSURE, CableTensions.STALE, CableTensions.INVALID):
        assert bench.until(lambda c: c == [2.0], *send(tensions(40.0, 30.0)))
        assert bench.until(lambda c: c == [0.0], *send(tensions(40.0, 30.0, flag)))


def test_the_motors_stop_without_commands_and_without_tensions(controller: Any) -> None:
    bench = controller("tension_limiter", "LimiterNode", "velocity", limit=60.0)
    feed = (lambda: bench.wish(2.0), lambda: bench.publish("tensions", tensions(40.0, 30.0)))
    assert bench.until(lambda c: c == [2.0], *feed)
    assert bench.until(lambda c: c == [0.0], feed[1]), "nobody wishes any more"
    assert bench.until(lambda c: c == [2.0], *feed)
    assert bench.until(lambda c: c == [0.0], feed[0]), "no tensions any more"


def _stop_feed(bench: Any, extra: float, stddev: float | None) -> list[Callable[[], None]]:
    """What the collision stop hears: a wished speed, the joint at rest, and its effort [N m]."""
    from sensor_msgs.msg import JointState

    held = bench.controller.observer.required(0.0)  # against the weight
    spread = JointState(name=["elbow"], effort=[] if stddev is None else [stddev])
    return [
        lambda: bench.wish(1.0),
        lambda: bench.publish("joint_states", JointState(name=["elbow"], position=[0.0])),
        lambda: bench.publish("efforts_stddev", spread),
        lambda: bench.publish("efforts", JointState(name=["elbow"], effort=[held - extra])),
    ]


def test_a_push_stops_the_motors_until_they_are_released(controller: Any) -> None:
    from std_srvs.srv import Trigger

    bench = controller("collision_stop", "CollisionNode", "velocity", threshold=0.5)
    calm, push = (_stop_feed(bench, extra, None) for extra in (0.0, 2.0))
    assert bench.until(lambda c: c == [1.0], *calm)
    assert bench.until(lambda c: c == [0.0], *push)
    assert "push" in bench.controller.reason
    client = bench.user.create_client(Trigger, "collision_stop/release")
    assert bench.until(lambda _: client.service_is_ready(), *calm)
    done = client.call_async(Trigger.Request())
    assert bench.until(lambda _: done.done(), *calm)
    assert "push" in done.result().message
    assert bench.until(lambda c: c == [1.0] and not bench.controller.reason, *calm)
