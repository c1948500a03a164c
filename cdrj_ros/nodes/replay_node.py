"""The ROS node of the replay: its topics and its clients of the estimator's services."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from builtin_interfaces.msg import Time
from cdrj_msgs.msg import CableTensions, NodalForces
from rcl_interfaces.srv import GetParameters
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cdrj_ros.estimation.conditioner import MODES
from cdrj_ros.evaluation.answers import Run
from cdrj_ros.evaluation.replayed import NodeSettings
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.messages.templates import ESTIMATE_MESSAGES
from cdrj_ros.messages.topics import CLOCK, FEW, JOINT_STATES, MOTOR_STATES, NAMESPACE
from cdrj_ros.nodes.settings import default_profile, publishing_nodes
from cdrj_ros.recordings.recording import Topics

ANSWER_S: Final = 5.0
"""Maximum response time of the estimator's services [s]."""


class NoEstimatorError(CdrjError):
    """No estimator node answered."""


class ReplayNode(Node):
    """Publishes inputs, subscribes to the estimator's outputs and calls its services."""

    def __init__(self, topics: Topics, clock_hz: float = 0.0, **options: Any) -> None:
        """Create publishers, subscriptions and clients.

        Args:
            topics: those of the bags.
            clock_hz: rate of /clock [Hz]; 0: it is not published.
            options: of the node.
        """
        super().__init__("replay", namespace=NAMESPACE, **options)
        self.topics, self.clock_hz = topics, clock_hz
        qos = default_profile()
        self.motors = self.create_publisher(JointState, MOTOR_STATES, qos)
        self.joints = self.create_publisher(JointState, JOINT_STATES, qos)
        self.inputs = tuple({p.topic_name: p for p in (self.motors, self.joints)}.values())
        self.outputs = tuple(self.resolve_topic_name(one.topic) for one in ESTIMATE_MESSAGES)
        self._listeners: list[Callable[[bytes], None]] = []
        for number, message in enumerate((CableTensions, NodalForces, JointState)):
            hear = partial(self._hear, number)
            self.create_subscription(message, ESTIMATE_MESSAGES[number].topic, hear, qos, raw=True)
        self.clock = self.create_publisher(Clock, CLOCK, FEW) if clock_hz > 0 else None
        self.estimator = self.resolve_service_name("estimator")
        """Full name of the estimator's node, which is in the same namespace."""
        self._reset = self.create_client(Trigger, f"{self.estimator}/reset")
        self._ping = self.create_client(GetParameters, f"{self.estimator}/get_parameters")

    def _hear(self, number: int, payload: bytes) -> None:
        if self._listeners:
            self._listeners[number](payload)

    def listen(self, run: Run | None) -> None:
        """Pass the estimator's outputs to this run from now on; None: ignore them."""
        numbers = range(len(ESTIMATE_MESSAGES))
        self._listeners = [run.listener(number) for number in numbers] if run else []

    def missing(self) -> list[str]:
        """Descriptions of the missing parts of the estimator; empty if none is missing."""
        gaps = [
            f"no subscriber of {p.topic_name}"
            for p in self.inputs
            if not p.get_subscription_count()
        ]
        if gaps and self._reset.service_is_ready():
            gaps[-1] += "; inputs remapped for the estimator are remapped here, too: --ros-args -r"
        gaps += [f"no publisher of {t}" for t in self.outputs if not self.count_publishers(t)]
        for client in (self._reset, self._ping):
            if not client.service_is_ready():
                gaps.append(f"no service {client.srv_name}")
        return gaps

    def unconnected(self) -> list[str]:
        """Played topics with a discovered subscriber that is not connected yet."""
        return [
            p.topic_name
            for p in self.inputs
            if p.get_subscription_count() < self.count_subscribers(p.topic_name)
        ]

    def other_publishers(self) -> dict[str, list[str]]:
        """Nodes that publish an input of the estimator beside this one, by topic."""
        found = {}
        for topic, own in Counter(one.topic_name for one in (self.motors, self.joints)).items():
            names = publishing_nodes(self, topic)
            for _ in range(min(own, names.count(self.get_fully_qualified_name()))):
                names.remove(self.get_fully_qualified_name())
            if names:
                found[topic] = names
        return found

    def reset_estimator(self, executor: EventsExecutor) -> None:
        """Reset the estimator.

        Raises:
            NoEstimatorError: it does not respond, or refuses.
        """
        future = self._reset.call_async(Trigger.Request())
        executor.spin_until_future_complete(future, timeout_sec=ANSWER_S)
        if not future.done():
            raise NoEstimatorError(
                f"the estimator does not answer {self._reset.srv_name} within {ANSWER_S:g} s"
            )
        response = future.result()
        if not response.success:
            raise NoEstimatorError(f"the estimator refuses the reset: {response.message}")

    def is_through(self, executor: EventsExecutor) -> bool:
        """Whether the estimator responds to a request queued after all messages sent so far."""
        future = self._ping.call_async(GetParameters.Request(names=[]))
        executor.spin_until_future_complete(future, timeout_sec=ANSWER_S)
        return bool(future.done())

    def settings(self, executor: EventsExecutor) -> NodeSettings:
        """Read the estimator's parameters; returns the defaults if it does not respond."""
        names = ["conditioning", "preload", "max_rate"]
        future = self._ping.call_async(GetParameters.Request(names=names))
        executor.spin_until_future_complete(future, timeout_sec=ANSWER_S)
        values = future.result().values if future.done() else []
        if len(values) != len(names):
            return NodeSettings()
        mode, preload, rate = values
        return NodeSettings(
            next((one for one in MODES if one == mode.string_value), MODES[0]),
            tuple(preload.double_array_value),
            rate.double_value,
        )

    def publish_clock(self, time_ns: int) -> None:
        """Publish the time of the recording."""
        if self.clock is not None:
            sec, nanosec = divmod(max(time_ns, 0), 1_000_000_000)
            self.clock.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))
