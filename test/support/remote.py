"""An estimator in a process of its own, with the test's ends of its topics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from time import monotonic
from typing import Any

import numpy as np

from cdrj_ros.messages.cdr import cable_tensions
from support.places import ROBOT

PATIENCE_S = 120.0
INPUTS = ("motor_states", "joint_states")


class Remote:
    """An estimator process in its own namespace; ``start`` starts it."""

    def __init__(
        self, node: Any, start_node: Any, side: str, others: Mapping[str, Any] | None = None
    ) -> None:
        """Open the topics.

        Args:
            node: the test's own.
            start_node: the fixture.
            side: the namespace.
            others: further topics to hear, by their types.
        """
        from cdrj_msgs.msg import CableTensions
        from rcl_interfaces.msg import Log
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from sensor_msgs.msg import JointState

        self.node, self.side = node, side
        self._start_node = start_node
        self.answers: list[bytes] = []
        self.inputs = {
            topic: node.create_publisher(JointState, f"/{side}/{topic}", 2000) for topic in INPUTS
        }
        self.cells = node.create_publisher(CableTensions, f"/{side}/tension_sensors", 2000)
        node.create_subscription(
            CableTensions, f"/{side}/tensions", self.answers.append, 2000, raw=True
        )
        self.others: dict[str, list[bytes]] = {topic: [] for topic in others or ()}
        for topic, kind in (others or {}).items():
            keep = self.others[topic].append
            node.create_subscription(kind, f"/{side}/{topic}", keep, 2000, raw=True)
        # announced after that for the tensions: who publishes to it knows both
        self.logged = 0
        kept = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(Log, "/rosout", self._on_log, kept)

    def _on_log(self, message: Any) -> None:
        self.logged += message.name == f"{self.side}.estimator"

    def start(self, *own: str, **parameters: Any) -> None:
        """Start a process and wait until it is connected; a killed one's endpoints remain."""
        before, logged = self._ends(), self.logged
        given = {"robot": ROBOT, "timeout": 3600.0, **parameters}
        self.process = self._start_node(
            "estimator", *own, "--ros-args", "-r", f"__ns:=/{self.side}",
            *(part for key, value in given.items() for part in ("-p", f"{key}:={value}")),
        )  # fmt: skip

        def connected() -> bool:
            now = self._ends()
            return (
                self.logged > logged  # so that it sends its first tensions here, too
                and all(new - old for new, old in zip(now, before, strict=True))
                and all(
                    publisher.get_subscription_count() == len(found)
                    for publisher, found in zip(self.inputs.values(), now, strict=False)
                )
            )

        assert self.until(connected)

    def _ends(self) -> list[set[bytes]]:
        infos = [
            *(self.node.get_subscriptions_info_by_topic(f"/{self.side}/{t}") for t in INPUTS),
            self.node.get_publishers_info_by_topic(f"/{self.side}/tensions"),
        ]
        return [{bytes(info.endpoint_gid) for info in one} for one in infos]

    def until(self, condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> bool:
        deadline = monotonic() + patience_s
        while not condition():
            if monotonic() > deadline:
                return False
            self.node.spin_once(timeout_sec=0.01)
        return True

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Call a service of the estimator; returns its response."""
        client = self.node.create_client(kind, f"/{self.side}/estimator/{name}")
        assert self.until(client.service_is_ready)
        answer = client.call_async(request)
        assert self.until(answer.done)
        return answer.result()

    def heard(self) -> tuple[np.ndarray, np.ndarray]:
        """Tensions and standard deviations of all estimates [N], shapes (n, elements)."""
        got = [cable_tensions(one) for one in self.answers]
        tension, stddev = (np.array([one[k] for one in got]) for k in (2, 3))
        return tension, stddev

    def kill(self) -> None:
        """Kill the process by SIGKILL."""
        self.process.kill()
        self.process.wait()
        self.answers.clear()
