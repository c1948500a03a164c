"""One topic of joint_state_broadcaster through the estimator node, by configuration alone."""

import re

import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from support.estimators import JOINT as ELBOW
from support.estimators import MOTOR as WINCH
from support.estimators import diagnosed, sample_at
from support.published import (
    EFFORT_SCALE,
    MOTOR,
    NAMES,
    PLAIN,
    PUBLISHED,
    SCALE,
    efforts,
    positions,
)

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

ONE_TOPIC = ("-r", "motor_states:=/joint_states", "-r", "joint_states:=/joint_states")
EVERY = 2
"""Milliseconds between messages."""


def untracked(text):
    """Without the filter between counts, whose state depends on every reading."""
    return re.sub(r"(?m)^ *tracking.*\n", "", text)


def recorded(count):
    """Samples at 500 Hz, tensions [N] and the torque of the winch [N m] there."""
    sent = [sample_at(EVERY * k) for k in range(count)]
    samples = Samples(
        np.array([one.stamp_ns for one in sent]), np.array([one.motor_angle for one in sent]),
        np.array([one.joint_angle for one in sent]),
    )  # fmt: skip
    model = prepare(parse_robot(untracked(PLAIN), "plain"))
    values = run(model, initial_state(model), samples)[1].values
    return samples, values[:, model.layout.tension], values[:, model.layout.motor_effort.start]


def stack(folder, text=PUBLISHED):
    path = folder / "robot.yaml"
    path.write_text(untracked(text))
    return str(path)


def test_tensions_from_one_stream_at_500_hz_of_several_robots(bench, tmp_path):
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = bench.node.create_publisher(JointState, "/joint_states", best_effort)
    estimation = bench.estimator(*ONE_TOPIC, robot=stack(tmp_path))
    topic, _ = estimation.inputs
    assert bench.until(lambda: bool(topic.adapt()))
    assert bench.until(lambda: publisher.get_subscription_count() > 0)
    samples, tension, torque = recorded(300)
    for k, stamp in enumerate(samples.stamp_ns.tolist()):
        message = JointState(name=NAMES)
        message.header.frame_id = "base_link"
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        message.position = positions(*samples.motor_angle[k], *samples.joint_angle[k])
        message.velocity = [float("nan")] * len(NAMES)
        message.effort = efforts(float(torque[k]))
        publisher.publish(message)
        assert bench.until(lambda: topic.messages == k + 1)  # noqa: B023
    assert len(estimation.answers) == len(tension)
    found = np.array([one.tension for one in estimation.answers])
    np.testing.assert_allclose(found, tension, atol=1e-6)
    refused = {cause for cause, n in estimation.live.conditioner.refused.items() if n}
    assert refused == {"unknown_name"}


def played(estimation, count):
    """The statuses after a stream, with one diagnosis for every quarter of a second of it."""
    samples, _, torque = recorded(count)
    hear = estimation.angle_callback("both", estimation.inputs[0])
    message = Template(JOINT_STATE, NAMES, ("position", "effort"))
    statuses = []
    for k, stamp in enumerate(samples.stamp_ns.tolist()):
        position = positions(*samples.motor_angle[k], *samples.joint_angle[k])
        hear(message.encode(stamp, position=position, effort=efforts(float(torque[k]))))
        if k % 125 == 124:
            statuses = diagnosed(estimation)
    return statuses


def test_the_node_asks_for_the_gear_and_names_the_scale_that_fits(bench, tmp_path):
    fits = played(bench.estimator(*ONE_TOPIC, robot=stack(tmp_path)), 1500)
    assert "gear ratio" not in fits[0].message
    without = PUBLISHED.replace(f"scale: {SCALE!r}", f"scale: {-50.0 * SCALE!r}")
    wrong = bench.estimator(*ONE_TOPIC, robot=stack(tmp_path, without))
    status = played(wrong, 3000)[0]
    assert status.level == status.ERROR
    assert f"arm1_{MOTOR} turns 5" in status.message
    assert "the other way: gear ratio, unit or sign?" in status.message
    value = float(status.message.partition("scale: ")[2].split()[0])
    assert value == pytest.approx(SCALE, rel=0.03)


def test_a_current_as_effort_is_answered_with_its_effort_scale(bench, tmp_path):
    right = bench.estimator(*ONE_TOPIC, robot=stack(tmp_path))
    assert played(right, 5000)[1].message == "agrees with the robot file"
    text = PUBLISHED.replace(f"    effort_scale: {EFFORT_SCALE!r}", "")
    status = played(bench.estimator(*ONE_TOPIC, robot=stack(tmp_path, text)), 5000)[1]
    assert status.level == status.WARN
    value = float(status.message.partition("effort_scale: ")[2].split()[0])
    assert value == pytest.approx(EFFORT_SCALE, rel=0.03)


def test_names_without_the_prefix_and_topics_without_publisher_are_answered_with_what_mends_them(
    bench, tmp_path
):
    truth = bench.node.create_publisher(JointState, "/cdrj/truth/states", 10)
    estimation = bench.estimator(robot=stack(tmp_path))
    assert bench.until(lambda: estimation.node.count_publishers("/cdrj/truth/states") > 0)
    diagnosed(estimation)
    nobody = estimation.inputs[0].remapping
    assert nobody.startswith("no other JointState in ROS_DOMAIN_ID "), "the truth is no robot's"
    publisher = bench.node.create_publisher(JointState, "/joint_states", 10)
    assert bench.until(
        lambda: bool(diagnosed(estimation)) and estimation.inputs[0].remapping != nobody
    )
    assert "--ros-args -r motor_states:=/joint_states" in diagnosed(estimation)[0].message
    states = bench.node.create_publisher(JointState, "/cdrj/motor_states", 10)
    wrong = bench.estimator("-r", "motor_states:=/cdrj/truth/state", robot=stack(tmp_path))
    expected = "--ros-args -r motor_states:=/cdrj/motor_states"
    assert bench.until(lambda: expected in diagnosed(wrong)[0].message)
    publisher.destroy()
    states.destroy()
    truth.destroy()
    text = PUBLISHED.replace("prefix: arm1_\n", "")
    without = bench.estimator(*ONE_TOPIC, robot=stack(tmp_path, text))
    other = stack(tmp_path, PUBLISHED.replace("prefix: arm1_", "prefix: arm7_"))
    as_given = bench.estimator(*ONE_TOPIC, robot=other, prefix="arm1_")
    assert as_given.live.model.layout.motors == (f"arm1_{MOTOR}",)
    played(without, 10)
    degrees = bench.estimator()
    degrees.joint(Template(JOINT_STATE, ("elbow",), ("position",)).encode(1, position=[20.0]))
    assert "joint elbow at 20, its range is -0.6981 to 0.6981: in degrees? scale_deg: 1" in (
        diagnosed(degrees)[0].message
    )
    assert "prefix: arm1_ in the robot file would fit" in diagnosed(without)[0].message
    cut_short = bench.estimator(*ONE_TOPIC, robot=other, prefix="arm")
    played(cut_short, 10)
    assert "prefix: arm1_ in the robot file would fit" in diagnosed(cut_short)[0].message


@pytest.mark.parametrize("share", [1.0, 0.2])
def test_degrees_are_named_where_a_part_or_all_of_the_motion_fits_the_range(bench, share):
    """Up to 17 or 3.4 degrees, which the range of 0.7 rad cuts off; one look every 0.6 s."""
    estimation = bench.estimator()
    for k in range(0, 7200, 4):
        sample = sample_at(k)
        elbow = np.degrees(share * sample.joint_angle)
        estimation.joint(ELBOW.encode(sample.stamp_ns, position=elbow))
        estimation.motor(WINCH.encode(sample.stamp_ns, position=share * sample.motor_angle))
        if k % 600 == 0:
            status = diagnosed(estimation)[0]
    assert status.level == status.ERROR
    assert status.message.startswith("the joints seem to be in degrees: give scale as scale_deg")
