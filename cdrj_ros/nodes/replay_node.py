"""The ROS node of the replay: its topics and its clients of the estimator's services."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from time import monotonic
from typing import Any, Final

from builtin_interfaces.msg import Time
from cdrj_msgs.msg import CableTensions, NodalForces
from rcl_interfaces.srv import GetParameters
from rclpy.duration import Duration
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cdrj_ros.bag import Topics
from cdrj_ros.conditioning.conditioner import MODES
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.messages.topics import CLOCK, FEW, JOINT_STATES, MOTOR_STATES, NAMESPACE, in_namespace
from cdrj_ros.nodes.qos import default_profile
from cdrj_ros.replay.agreement import NodeSettings
from cdrj_ros.replay.answers import Run
from cdrj_ros.replay.line import KINDS

ANSWER_S: Final = 5.0
"""Maximum response time of the estimator's services [s]."""


class NoEstimatorError(CdrjError):
    """No estimator node answered."""


@dataclass(frozen=True)
class Extra:
    """A topic that is played although the estimator does not subscribe to it."""

    topic: str
    msgtype: str
    latched: bool = False


@dataclass(frozen=True)
class Wiring:
    """Topics, names and quality of service of a replay."""

    topics: Topics = field(default_factory=Topics)
    extras: tuple[Extra, ...] = ()
    remap: Mapping[str, str] = field(default_factory=dict)
    """Names under which topics are published, by name in the bag."""
    overrides: Mapping[str, QoSProfile] = field(default_factory=dict)
    """QoS by name in the bag, or for the estimator's outputs by the name subscribed to."""
    clock_hz: float = 0.0
    clock_topics: frozenset[str] = frozenset()
    """Topics before whose messages the time is published on /clock."""
    estimator: str = in_namespace("estimator")


class ReplayNode(Node):
    """Publishes inputs, subscribes to the estimator's outputs and calls its services."""

    def __init__(self, wiring: Wiring, **options: Any) -> None:
        """Create publishers, subscriptions and clients.

        Raises:
            UsageError: the type of an extra topic is not installed, or an extra topic has the name
                of an output of the estimator.
        """
        super().__init__("replay", namespace=NAMESPACE, **options)
        self.wiring = wiring
        topics, qos = wiring.topics, default_profile()

        def publisher(message: Any, topic: str, default: str, other: QoSProfile = qos) -> Any:
            name = wiring.remap.get(topic, default)
            return self.create_publisher(message, name, wiring.overrides.get(topic, other))

        self.motors = publisher(JointState, topics.motors, MOTOR_STATES)
        self.joints = publisher(JointState, topics.joints, JOINT_STATES)
        self.inputs = tuple({p.topic_name: p for p in (self.motors, self.joints)}.values())
        self.outputs = tuple(self.resolve_topic_name(kind.topic) for kind in KINDS)
        self._ears: list[Callable[[bytes], None]] = [_ignore] * len(KINDS)
        for number, message in enumerate((CableTensions, NodalForces, JointState)):
            self.create_subscription(
                message, KINDS[number].topic, self._listener(number),
                wiring.overrides.get(self.outputs[number], qos), raw=True,
            )  # fmt: skip
        self.extras: dict[str, Any] = {}
        for extra in wiring.extras:
            name = self.resolve_topic_name(wiring.remap.get(extra.topic, extra.topic))
            if name in self.outputs:
                raise UsageError(
                    f"the estimator publishes on {extra.topic}: give the recorded topic another "
                    f"name with --remap {extra.topic}:=/recorded{extra.topic}"
                )
            self.extras[extra.topic] = publisher(
                message_class(extra.msgtype), extra.topic, extra.topic,
                default_profile(latched=extra.latched),
            )  # fmt: skip
        wants_clock = wiring.clock_hz > 0 or wiring.clock_topics
        self.clock = self.create_publisher(Clock, CLOCK, FEW) if wants_clock else None
        self._reset = self.create_client(Trigger, wiring.estimator + "/reset")
        self._ping = self.create_client(GetParameters, wiring.estimator + "/get_parameters")

    def _listener(self, number: int) -> Callable[[bytes], None]:
        ears = self._ears

        def on_answer(payload: bytes) -> None:
            ears[number](payload)

        return on_answer

    def listen(self, run: Run | None) -> None:
        """Pass the estimator's outputs to this run from now on."""
        for number in range(len(KINDS)):
            self._ears[number] = run.listener(number) if run else _ignore

    def missing(self) -> list[str]:
        """Descriptions of the missing parts of the estimator; empty if none is missing."""
        gaps = [f"no subscriber of {p.topic_name}" for p in self.inputs if not _matched(p)]
        gaps += [f"no publisher of {t}" for t in self.outputs if not self.count_publishers(t)]
        for client in (self._reset, self._ping):
            if not client.service_is_ready():
                gaps.append(f"no service {client.srv_name}")
        return gaps

    def unconnected(self) -> list[str]:
        """Played topics with a discovered subscriber that is not connected yet."""
        return [
            p.topic_name
            for p in (*self.inputs, *self.extras.values())
            if p.get_subscription_count() < self.count_subscribers(p.topic_name)
        ]

    def rivals(self) -> list[str]:
        """Output topics of the estimator with more than one publisher."""
        return [topic for topic in self.outputs if self.count_publishers(topic) > 1]

    def reset_estimator(self, executor: EventsExecutor) -> str:
        """Reset the estimator; returns the message of its response.

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
        return str(response.message)

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

    def wait_for_acknowledgements(self, timeout_s: float) -> list[str]:
        """Wait for acknowledgements; returns the topics with a missing one after ``timeout_s``."""
        deadline = monotonic() + timeout_s
        slow = []
        for publisher in (*self.inputs, *self.extras.values()):
            left = max(deadline - monotonic(), 0.0)
            if not publisher.wait_for_all_acked(Duration(seconds=left)):
                slow.append(str(publisher.topic_name))
        return slow


def _ignore(_payload: bytes) -> None:
    """Ignore an output received while no run is active."""


def _matched(publisher: Any) -> bool:
    return bool(publisher.get_subscription_count())


def message_class(msgtype: str) -> Any:
    """The Python class of a message type such as ``sensor_msgs/msg/Imu``.

    Raises:
        UsageError: the type is not installed.
    """
    package, _, name = msgtype.replace("/msg/", "/").partition("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError, ValueError):
        raise UsageError(f"messages of type {msgtype or '(none)'} are not installed here") from None


def wiring_of(
    topics: Topics,
    extras: Sequence[Extra],
    remap: Mapping[str, str],
    overrides: Mapping[str, QoSProfile],
    *,
    clock_hz: float,
    clock_topics: Sequence[str] | None,
    estimator: str,
) -> Wiring:
    """Check the options against the topics that are played.

    Args:
        topics, extras, remap, overrides, clock_hz, estimator: see ``Wiring``.
        clock_topics: None for every topic that is played.

    Raises:
        UsageError: an option names a topic that is not played.
    """
    played = {topics.motors, topics.joints, *(extra.topic for extra in extras)}
    stamped = played if clock_topics is None else frozenset(clock_topics)
    for option, named in (("--remap", remap), ("--clock-topics", stamped)):
        if unknown := sorted(set(named) - played):
            raise UsageError(
                f"{option}: {', '.join(unknown)} is not played, only {', '.join(sorted(played))}"
            )
    return Wiring(
        topics, tuple(extras), dict(remap), dict(overrides), clock_hz, frozenset(stamped), estimator
    )
