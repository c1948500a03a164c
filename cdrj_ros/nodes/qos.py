"""Quality of service: the default of all nodes."""

from __future__ import annotations

from typing import Final

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

DEPTH: Final = 1000
"""Queue depth of a topic [messages]."""


def default_profile(*, latched: bool = False) -> QoSProfile:
    """A reliable profile whose queue holds all messages in flight."""
    durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE, durability=durability)
