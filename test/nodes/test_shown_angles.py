"""What ``markers`` and ``view`` show of joint angles and of the age of tensions."""

from math import pi

import numpy as np
from cdrj_msgs.msg import CableTensions
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from support.reading_streams import take

from cdrj_ros.estimation.conditioner import Conditioner
from cdrj_ros.messages import topics
from cdrj_ros.model.packing import INVALID, SLACK, STALE
from cdrj_ros.nodes.markers import MarkersNode
from cdrj_ros.robot.reader import parse_robot

TEXT = """\
name: turning
motors: [{name: m}]
joints:
  - name: q
    range: [-0.2, 6.0]
    scale: -1
    offset: 0.3
    period: 6.283185307179586
    correction: {angle: [0, 2, 4], value: [0.05, -0.02, 0.1]}
cables:
  - name: c
    axial_stiffness: 1000
    preload: 5
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.01}
      - {type: anchor}
    spans: [{joint: q, offset: 0.4, slope: -0.02}]
"""

STEPS = 200
TURNED = 2.75 + 2.7 * np.cos(np.linspace(0.0, 2.0 * pi, STEPS))
"""Angle before the correction: from 5.45, nearer to -0.83 than to the reference pose, to 0.05."""

READING = np.remainder(0.3 - TURNED, 2.0 * pi)


def test_a_shown_angle_is_the_estimators_to_the_bit(ros, tmp_path):
    """``markers`` and ``view`` hear by the same ``Inputs``, which pass over what is no angle."""
    path = tmp_path / "turning.yaml"
    path.write_text(TEXT, encoding="utf-8")
    node = MarkersNode(parameter_overrides=[Parameter("robot", value=str(path))])
    shown = []
    for reading in READING.tolist():
        for name, position in ("q", [reading]), ("unknown", [1.0]), ("q", [np.nan]), ("q", []):
            message = JointState(name=[name], position=position)
            node.inputs.hear(topics.JOINT_STATES, serialize_message(message))
            angle = node.inputs.snapshot().angle[0]
        shown.append(angle)
    node.destroy_node()
    conditioner = Conditioner(parse_robot(TEXT))
    samples = []
    for k, reading in enumerate(READING.tolist(), start=1):
        stamp = k * 10_000_000
        samples += take(conditioner, "motors", stamp, ["m"], [0.0])
        samples += take(conditioner, "joints", stamp, ["q"], [reading])
    np.testing.assert_array_equal(shown, [sample.joint_angle[0] for sample in samples])


def test_tensions_are_shown_as_stale_unless_they_are_heard(ros, tmp_path):
    path = tmp_path / "turning.yaml"
    path.write_text(TEXT, encoding="utf-8")
    node = MarkersNode(parameter_overrides=[Parameter("robot", value=str(path))])
    assert node.inputs.snapshot().status.tolist() == [INVALID | STALE]
    message = CableTensions(name=["c/1"], tension=[0.0], status=[SLACK])
    node.inputs.hear(topics.TENSIONS, serialize_message(message))
    shown = node.inputs.snapshot()
    node.destroy_node()
    assert shown.status.tolist() == [SLACK]
