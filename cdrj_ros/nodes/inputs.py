"""The estimator's input topics: subscribed, and matched to publishers of either reliability."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from cdrj_ros.nodes.qos import default_profile
from cdrj_ros.nodes.words import TopicHeard


class InputTopic:
    """One subscription, reliable until a publisher turns out to be best-effort.

    A best-effort subscription would match both kinds at once, but with it a reliable publisher's
    messages are lost as well where the node cannot keep up for a moment.
    """

    def __init__(
        self,
        node: Node,
        message: Any,
        topic: str,
        callback: Callable[[bytes], None],
        heard: TopicHeard,
    ) -> None:
        """Subscribe.

        Args:
            node: the subscriber.
            message: class of the messages, which are received serialised.
            topic: relative name.
            callback: takes a message.
            heard: kept up to date by the callback; its publishers by ``look``.
        """
        self._node, self._message, self._topic, self._callback = node, message, topic, callback
        self.heard = heard
        self._subscription = self._subscribe(
            default_profile(), qos_overriding_options=QoSOverridingOptions.with_default_policies()
        )

    def _subscribe(self, profile: QoSProfile, **options: Any) -> Any:
        return self._node.create_subscription(
            self._message, self._topic, self._callback, profile, raw=True, **options
        )

    @property
    def reliability(self) -> ReliabilityPolicy:
        """What the subscription asks for at present."""
        return self._subscription.qos_profile.reliability

    def look(self) -> str:
        """Count the publishers and adapt to one that is best-effort; call while inputs are missing.

        Returns:
            What was found and done about it, for the log; empty if all publishers fit.
        """
        publishers = self._node.get_publishers_info_by_topic(self.heard.topic)
        self.heard.publishers = len(publishers)
        unreliable = {
            info.node_name
            for info in publishers
            if info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
        }
        if not unreliable or self.reliability != ReliabilityPolicy.RELIABLE:
            return ""
        name = f"qos_overrides.{self.heard.topic}.subscription.reliability"
        who = f"{self.heard.topic}: the publisher in {', '.join(sorted(unreliable))} is best-effort"
        if name in self._node._parameter_overrides:  # somebody has decided
            return (
                f"{who}, but the parameter {name} asks for reliable: nothing arrives. Set it to "
                "best_effort, or let the publisher be reliable"
            )
        profile = self._subscription.qos_profile
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._subscribe(profile)
        return (
            f"{who}: subscribed best-effort as well. Readings may be lost under load; let the "
            "publisher be reliable to avoid that"
        )
