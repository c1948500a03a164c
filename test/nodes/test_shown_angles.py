"""``markers`` and ``view`` show the joint angles that the estimator computes with."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from cdrj_ros.estimation.conditioner import Conditioner
from cdrj_ros.messages import topics
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


@pytest.fixture(params=["markers", "view"])
def shown(
    request: pytest.FixtureRequest, ros: None, tmp_path: Path
) -> Iterator[NDArray[np.float64]]:
    """Angles that a node draws after each reading, given one at a time."""
    path = tmp_path / "turning.yaml"
    path.write_text(TEXT, encoding="utf-8")
    given: dict[str, Any] = {"robot": str(path)}
    messages = [JointState(name=["q"], position=[reading]) for reading in READING.tolist()]
    if request.param == "markers":
        from cdrj_ros.nodes.markers import MarkersNode as ShowingNode
    else:
        pytest.importorskip("viser")
        from cdrj_ros.nodes.view import ViewNode as ShowingNode  # type: ignore[assignment]

        given["port"] = 0
    node = ShowingNode(parameter_overrides=[Parameter(k, value=v) for k, v in given.items()])
    angles = []
    for message in messages:
        node.inputs.hear(topics.JOINT_STATES, serialize_message(message))
        angles.append(node.inputs.snapshot().angle[0])
    if request.param == "view":
        node.page.close()  # type: ignore[attr-defined]
    try:
        yield np.array(angles)
    finally:
        node.destroy_node()


def test_a_shown_angle_is_the_estimators_to_the_bit(shown: NDArray[np.float64]) -> None:
    conditioner = Conditioner(parse_robot(TEXT))
    samples = []
    for k, reading in enumerate(READING.tolist(), start=1):
        stamp = k * 10_000_000
        samples += conditioner.feed_motors(stamp, ["m"], [0.0])
        samples += conditioner.feed_joints(stamp, ["q"], [reading])
    np.testing.assert_array_equal(shown, [sample.joint_angle[0] for sample in samples])
