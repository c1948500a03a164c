"""An estimator over DDS whose joint has no encoder: efforts in, angles out."""

from __future__ import annotations

from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from support.motor_alone import motion, truth_of, without_encoder

from cdrj_ros._core import JointStateDecoder
from cdrj_ros.estimation.encoderless import EncoderlessEstimator
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.loading import load_model

ROBOT = Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml"
COUNT = 120
PATIENCE_S = 120.0
TOLD = Template(JOINT_STATE, ("winch",), ("position", "effort"))
UNTOLD = Template(JOINT_STATE, ("winch",), ("position",))


def until(node: Any, condition: Any) -> bool:
    deadline = monotonic() + PATIENCE_S
    while not condition():
        if monotonic() > deadline:
            return False
        rclpy.spin_once(node, timeout_sec=0.01)
    return True


def test_angles_are_published_while_efforts_are_heard_and_diagnostics_say_when_none_is(
    node: Any, start_node: Any, tmp_path: Path
) -> None:
    robot = tmp_path / "alone.yaml"
    text = ROBOT.read_text(encoding="utf-8")
    robot.write_text(text.replace("  - name: elbow", "  - name: elbow\n    measured: false"))
    model = load_model(str(robot))
    samples = motion(without_encoder("prototype", "elbow"), COUNT)
    _, efforts = truth_of(without_encoder("prototype", "elbow"), samples)
    heard: dict[str, list[bytes]] = {"joint_angles": [], "joint_angles_stddev": []}
    for topic, into in heard.items():
        node.create_subscription(JointState, f"/alone/{topic}", into.append, 1000, raw=True)
    said: list[str] = []
    node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: said.extend(s.message for s in m.status), 10
    )
    motors = node.create_publisher(JointState, "/alone/motor_states", 1000)
    start_node(
        "estimator", "--ros-args", "-r", "__ns:=/alone", "-p", f"robot:={robot}",
        "-p", "timeout:=3600.0",
    )  # fmt: skip
    assert until(node, lambda: motors.get_subscription_count() == 1)
    assert until(node, lambda: node.count_publishers("/alone/joint_angles_stddev") == 1)
    for k in range(COUNT):
        stamp, angle = int(samples.stamp_ns[k]), samples.motor_angle[k]
        motors.publish(TOLD.encode(stamp, position=angle, effort=efforts[k]))
    assert until(node, lambda: min(map(len, heard.values())) == COUNT)
    read = type(samples)(samples.stamp_ns, samples.motor_angle, np.empty((COUNT, 0)))
    expected = EncoderlessEstimator(model).run(read, efforts).angles
    assert expected is not None
    for topic, values in (
        ("joint_angles", expected.value),
        ("joint_angles_stddev", expected.stddev),
    ):
        for k in (0, 1, COUNT - 1):
            message = JointStateDecoder()
            assert message.decode(heard[topic][k])
            assert message.stamp_ns == samples.stamp_ns[k]
            assert message.names == ("elbow",)
            assert message.positions[0] == values[k, 0]
    later = int(samples.stamp_ns[-1]) + 10**9
    for k in range(3):
        motors.publish(UNTOLD.encode(later + k * 10**6, position=samples.motor_angle[-1]))
    assert until(node, lambda: any("no effort of a motor" in message for message in said))
    assert len(heard["joint_angles"]) == COUNT
