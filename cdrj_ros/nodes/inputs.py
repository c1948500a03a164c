"""Subscriptions to the estimator's input topics that adapt to the publishers' reliability."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from cdrj_ros.nodes.qos import default_profile
from cdrj_ros.nodes.words import TopicHeard


def reliability_parameter(topic: str) -> str:
    """Name of the parameter by which the user may choose the reliability of a subscription."""
    return f"qos_overrides.{topic}.subscription.reliability"


class InputTopic:
    """One subscription, which is reliable until a best-effort publisher is found.

    A best-effort subscription would match both kinds of publishers at once, but it would also lose
    messages of a reliable publisher whenever the node cannot keep up for a moment.
    """

    def __init__(
        self,
        node: Node,
        message: Any,
        topic: str,
        callback: Callable[[bytes], None],
        heard: TopicHeard,
        *,
        chosen: bool,
    ) -> None:
        """Subscribe.

        Args:
            node: the node that subscribes.
            message: class of the messages; they are received serialised.
            topic: relative name.
            callback: called with every serialised message.
            heard: updated by the callback; ``look`` updates its number of publishers.
            chosen: whether the user has chosen the reliability, with ``reliability_parameter``.
        """
        self._node, self._message, self._topic, self._callback = node, message, topic, callback
        self.heard, self._chosen = heard, chosen
        self._subscription = self._subscribe(
            default_profile(), qos_overriding_options=QoSOverridingOptions.with_default_policies()
        )

    def _subscribe(self, profile: QoSProfile, **options: Any) -> Any:
        return self._node.create_subscription(
            self._message, self._topic, self._callback, profile, raw=True, **options
        )

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)

    @property
    def reliability(self) -> ReliabilityPolicy:
        """Reliability that the subscription currently requests."""
        return self._subscription.qos_profile.reliability

    def look(self) -> str:
        """Count the publishers and adapt to best-effort ones; call while inputs are missing.

        Returns:
            A log message about what was found and done; empty if all publishers are compatible.
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
        name = reliability_parameter(self.heard.topic)
        who = f"{self.heard.topic}: the publisher in {', '.join(sorted(unreliable))} is best-effort"
        if self._chosen:
            return (
                f"{who}, but the parameter {name} requires reliable, so no messages arrive. Set "
                "it to best_effort, or make the publisher reliable"
            )
        profile = self._subscription.qos_profile
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._subscribe(profile)
        return (
            f"{who}: subscribed best-effort as well. Readings may be lost under load; a "
            "reliable publisher avoids this"
        )
