"""A node whose joint has no encoder: efforts in, angles out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from sensor_msgs.msg import JointState
from support.estimators import ROBOT, hear_diagnostics
from support.motor_alone import motion, truth_of, without_encoder

from cdrj_ros._core import JointStateDecoder
from cdrj_ros.estimation.encoderless import EncoderlessEstimator
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import load_model

COUNT = 120
TOLD = Template(JOINT_STATE, ("winch",), ("position", "effort"))
UNTOLD = Template(JOINT_STATE, ("winch",), ("position",))


def test_angles_are_published_while_efforts_are_heard_and_diagnostics_say_when_none_is(
    bench, tmp_path
):
    robot = tmp_path / "alone.yaml"
    text = Path(ROBOT).read_text(encoding="utf-8")
    robot.write_text(text.replace("  - name: elbow", "  - name: elbow\n    measured: false"))
    samples = motion(without_encoder("prototype", "elbow"), COUNT)
    _, efforts = truth_of(without_encoder("prototype", "elbow"), samples)
    heard = {"joint_angles": [], "joint_angles_stddev": []}
    for topic, into in heard.items():
        bench.node.create_subscription(JointState, f"/cdrj/{topic}", into.append, 1000, raw=True)
    said = []
    hear_diagnostics(bench, said)
    estimator = bench.estimator(robot=str(robot))
    count = bench.node.count_publishers
    assert bench.until(lambda: all(count(f"/cdrj/{topic}") == 1 for topic in heard))
    for k in range(COUNT):
        stamp, angle = int(samples.stamp_ns[k]), samples.motor_angle[k]
        estimator.motor(TOLD.encode(stamp, position=angle, effort=efforts[k]))
    assert bench.until(lambda: min(map(len, heard.values())) == COUNT)
    read = replace(samples, joint_angle=np.empty((COUNT, 0)))
    expected = EncoderlessEstimator(load_model(str(robot))).run(read, efforts).angles
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
        estimator.motor(UNTOLD.encode(later + k * 10**6, position=samples.motor_angle[-1]))
    assert bench.until(lambda: any("no effort of a motor" in one.message for one in said))
    assert len(heard["joint_angles"]) == COUNT
