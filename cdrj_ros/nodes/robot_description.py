"""The URDF of the robot, for robot files with ``frames: {urdf: robot_description}``.

It comes from the node's parameter ``robot_description`` or, if that is empty, from the topic of the
same name, on which robot_state_publisher keeps it for late subscribers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_msgs.msg import String

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.nodes.settings import Setting
from cdrj_ros.robot.names import PREFIX, given
from cdrj_ros.robot.urdf import DESCRIPTION, PUBLISHED

TOPIC: Final = f"/{DESCRIPTION}"

ROBOT_SETTINGS: Final = (
    Setting("robot", "", "Robot file (YAML), or the name of an installed one; required"),
    Setting(
        DESCRIPTION,
        "",
        f"URDF for a robot file whose frames name {DESCRIPTION}; empty: from the topic {TOPIC}",
    ),
    Setting(
        "prefix",
        "",
        "Text before all names of motors and joints in messages, and of the URDF; empty: prefix of "
        "the robot file",
    ),
)
"""The parameters of every node that needs a robot."""

WAIT_S: Final = 10.0
"""Longest wait for the topic [s]."""

KEPT: Final = QoSProfile(
    depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE
)
"""Quality of service with which robot_state_publisher offers the topic."""


def given_model(node: Node, robot: str, preload: Sequence[float] | None = None) -> Model:
    """Read the robot file of a node; its URDF comes from the parameter or the topic.

    Raises:
        CdrjError: the robot file is missing or invalid, or its URDF did not arrive.
    """
    if not robot:
        raise UsageError("the parameter robot is missing: --ros-args -p robot:=FILE")
    prefix = str(node.get_parameter("prefix").value)
    with given(PUBLISHED, lambda: robot_description(node)), given(PREFIX, prefix):
        return load_model(robot, preload)


def listener_of(node: Node, tell: Callable[[str], object]) -> Node:
    """A node that does nothing but pass the topic's texts on; ``node`` gives it its name."""
    listener = Node(
        f"{node.get_name()}_{DESCRIPTION}", context=node.context, namespace=node.get_namespace(),
        enable_rosout=False, start_parameter_services=False,
    )  # fmt: skip
    listener.create_subscription(String, TOPIC, lambda message: tell(message.data), KEPT)
    return listener


def robot_description(node: Node, wait_s: float = WAIT_S) -> str:
    """Text of the robot's URDF.

    A node of its own listens, so that the call works while ``node`` is being made and within its
    callbacks.

    Args:
        node: its parameter and its context are used.
        wait_s: longest wait for the topic [s].

    Raises:
        UsageError: no URDF arrived in time.
    """
    if node.has_parameter(DESCRIPTION):
        given = str(node.get_parameter(DESCRIPTION).value or "")
        if given:
            return given
    heard: Future[str] = Future()
    listener = listener_of(node, lambda text: heard.done() or heard.set_result(text))
    topic = next(listener.subscriptions).topic_name
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(listener)
    try:
        node.get_logger().info(f"waiting for the URDF on {topic}")
        executor.spin_until_future_complete(heard, timeout_sec=wait_s)
    finally:
        executor.shutdown()
        listener.destroy_node()
    if not heard.done():
        raise UsageError(
            f"no URDF on {topic} within {wait_s:g} s: is robot_state_publisher running? Otherwise "
            f"set the parameter {DESCRIPTION}"
        )
    return str(heard.result())
