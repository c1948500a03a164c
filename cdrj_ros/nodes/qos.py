"""Quality of service, that of all nodes or a chosen one, and who publishes on which topic."""

from __future__ import annotations

from typing import Final

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from cdrj_ros.nodes.settings import given_parameter

DEPTH: Final = 1000
"""Queue depth of a topic [messages]."""


def default_profile(*, latched: bool = False) -> QoSProfile:
    """A reliable profile whose queue holds all messages in flight."""
    durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE, durability=durability)


def remapping(node: Node, topic: str, msgtype: str) -> str:
    """The remapping to another topic of the same type that has publishers; empty if none has.

    Args:
        node: the node without a publisher on its topic; what it publishes itself is no other topic.
        topic: resolved name.
        msgtype: ``sensor_msgs/msg/JointState``.
    """
    name = topic.rpartition("/")[2]
    others = [one for one, types in node.get_topic_names_and_types() if msgtype in types]
    for other in sorted(others, key=lambda one: one.rpartition("/")[2] != name):
        there = {one.node_name for one in node.get_publishers_info_by_topic(other)}
        if other != topic and there - {node.get_name()}:
            return f"there is {other}: --ros-args -r {name}:={other}"
    return ""


def reliability_parameter(topic: str) -> str:
    """Name of the parameter by which the user may choose the reliability of a subscription."""
    return f"qos_overrides.{topic}.subscription.reliability"


def has_chosen(node: Node, topic: str) -> bool:
    """Whether the user has chosen a reliability; ask before the first subscription, which declares.

    Args:
        node: the node.
        topic: relative name.
    """
    name = reliability_parameter(node.resolve_topic_name(topic))
    return given_parameter(node, name).type_ != Parameter.Type.NOT_SET


def publishing_nodes(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish on a topic, one per publisher."""
    publishers = node.get_publishers_info_by_topic(topic)
    return sorted(f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in publishers)
