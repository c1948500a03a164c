"""Quality of service, the default of all nodes, and where else a topic may be found."""

from __future__ import annotations

from typing import Final

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

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
