"""Bare nodes that the estimator is compared with, each in its own process.

``node.py relay FOLDER`` answers every motor message with three prepared messages of the sizes that
the estimator sends.  ``node.py busy FOLDER`` does so too, after keeping its processor busy for as
long as the estimator's callbacks.  ``node.py bare`` has one publisher and one subscription.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)

WORK_US = (6.0, 24.0)
"""Time that the estimator's callbacks for a joint and a motor message take in a loop on the faster
machine of docs/speed.md, without the publications [us]."""


def _be_busy(for_us: float) -> None:
    until = perf_counter() + 1e-6 * for_us
    while perf_counter() < until:
        pass


def relay(name: str, folder: Path, joint_us: float = 0.0, motor_us: float = 0.0) -> Node:
    """Create a node with the estimator's topics that publishes prepared messages.

    Args:
        name: of the node and its namespace.
        folder: of the messages.
        joint_us: time for which a joint message keeps the node busy [us].
        motor_us: time for which a motor message keeps it busy before the answers [us].
    """
    from cdrj_msgs.msg import CableTensions, NodalForces

    node = Node(name, namespace=name)
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
        if motor_us:
            _be_busy(motor_us)
        tensions.publish(prepared[0])
        forces.publish(prepared[1])
        efforts.publish(prepared[2])

    def on_joint(_payload: bytes) -> None:
        """Send nothing: the estimator, too, answers only the motor message that follows."""
        if joint_us:
            _be_busy(joint_us)

    node.create_subscription(JointState, "motor_states", on_motor, QOS, raw=True)
    node.create_subscription(JointState, "joint_states", on_joint, QOS, raw=True)
    return node


def bare() -> Node:
    """Create a minimal node: one publisher, one subscription."""
    node = Node("bare", namespace="bare")
    publisher = node.create_publisher(JointState, "out", QOS)
    node.create_subscription(JointState, "in", publisher.publish, QOS, raw=True)
    return node


def main() -> None:
    """Spin as the estimator does until SIGINT or SIGTERM."""
    kind, stop = sys.argv[1], list[int]()

    def ask(number: int, _frame: Any) -> None:
        stop.append(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, ask)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    work = WORK_US if kind == "busy" else ()
    node = bare() if kind == "bare" else relay(kind, Path(sys.argv[2]), *work)
    executor = EventsExecutor()
    executor.add_node(node)
    if kind == "bare":
        node.get_logger().info("listening")
    while not stop:
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
