"""``commission`` where ROS is: measurements may be recorded from the running robot.

What stands in a bag is what ``ros2 bag record`` would write, which not every installation has.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from select import select
from time import monotonic, time_ns
from typing import Any, Final

from cdrj_msgs.msg import CableTensions
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from cdrj_ros.commands.commission import body
from cdrj_ros.commands.entry import run_command
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.output import ProgressBar
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE
from cdrj_ros.messages.topics import NAMESPACE, TENSION_SENSORS, in_namespace
from cdrj_ros.nodes.settings import DEPTH, remapping
from cdrj_ros.nodes.spinning import ros_context, starting
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter

PATIENCE_S: Final = 5.0
"""Time within which every angle must have been read [s]."""


def record(path: Path, topics: Topics, duration_s: float, on: bool) -> None:
    """Record the angles, and load cells where there are any, into a new bag.

    Args:
        path: folder of the bag.
        topics: those of motors and joints.
        duration_s: how long [s].
        on: whether to go on until Enter.

    Raises:
        CdrjError: ROS cannot start, nobody publishes the angles, or the bag cannot be written.
    """
    angles = dict.fromkeys((topics.motors, topics.joints))
    with BagWriter(path) as bag, ros_context(["commission"]):
        with starting():
            node = Node("commission", namespace=NAMESPACE)
        heard: dict[str, list[tuple[int, bytes]]] = {topic: [] for topic in angles}
        for topic in angles:
            _listen(node, JointState, topic, heard[topic])
        cells = node.resolve_topic_name(in_namespace(TENSION_SENSORS))
        _listen(node, CableTensions, cells, heard.setdefault(cells, []))
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            _hear(node, executor, {topic: heard[topic] for topic in angles}, duration_s, on)
        finally:
            executor.shutdown()
            node.destroy_node()
        for topic, messages in heard.items():
            kind = CABLE_TENSIONS if topic == cells else JOINT_STATE
            if messages:
                bag.write_messages(topic, kind.name, messages)


def _hear(
    node: Node, executor: Executor, angles: Mapping[str, list[Any]], duration_s: float, on: bool
) -> None:
    """Receive messages until all angles have been heard for a while; with ``on``, on until Enter.

    Raises:
        BagError: nobody publishes the angles.
    """
    asked_s, begin_s = monotonic(), float("inf")
    with ProgressBar(f"recording {', '.join(angles)}", duration_s) as report:
        while monotonic() - begin_s < duration_s or (on and not _entered()):
            executor.spin_once(timeout_sec=0.1)
            if silent := [topic for topic, heard in angles.items() if not heard]:
                if monotonic() - asked_s > PATIENCE_S:
                    there = remapping(node, silent[0], JOINT_STATE.name).split(":")[0]
                    raise BagError(f"no message on {silent[0]}; {there}")
                continue
            begin_s = min(begin_s, monotonic())
            report(monotonic() - begin_s)


def _entered() -> bool:
    """Whether there was an Enter, or the end of the input."""
    if not select([sys.stdin], [], [], 0.0)[0]:
        return False
    sys.stdin.readline()
    return True


def _listen(node: Node, kind: Any, topic: str, into: list[tuple[int, bytes]]) -> None:
    """Keep the messages of a topic, reliable or not, with the times at which they arrive [ns]."""
    profile = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)

    def hear(payload: bytes) -> None:
        into.append((time_ns(), payload))

    node.create_subscription(kind, topic, hear, profile, raw=True)


main = partial(run_command, "commission", lambda words: body(words, record))
"""Entry point; returns the exit code."""
