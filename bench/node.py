"""A bare node that the estimator is compared with: ``node.py FOLDER``.

It answers every motor message with three prepared messages of the sizes that the estimator sends.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Any

import rclpy
from cdrj_msgs.msg import CableTensions, NodalForces
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)


def relay(folder: Path) -> Node:
    """Create a node with the estimator's topics that publishes the messages in a folder."""
    node = Node("relay", namespace="relay")
    tensions, forces, efforts = (
        node.create_publisher(kind, topic, QOS)
        for kind, topic in (
            (CableTensions, "tensions"),
            (NodalForces, "nodal_forces"),
            (JointState, "efforts"),
        )
    )
    prepared = [(folder / name).read_bytes() for name in ("tensions", "nodal_forces", "efforts")]

    def on_motor(_payload: bytes) -> None:
        tensions.publish(prepared[0])
        forces.publish(prepared[1])
        efforts.publish(prepared[2])

    def on_joint(_payload: bytes) -> None:
        """Send nothing: the estimator, too, answers only the motor message that follows."""

    node.create_subscription(JointState, "motor_states", on_motor, QOS, raw=True)
    node.create_subscription(JointState, "joint_states", on_joint, QOS, raw=True)
    return node


def main() -> None:
    """Spin as the estimator does until SIGINT or SIGTERM."""
    stop = list[int]()

    def ask(number: int, _frame: Any) -> None:
        stop.append(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, ask)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node, executor = relay(Path(sys.argv[1])), EventsExecutor()
    executor.add_node(node)
    while not stop:
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
