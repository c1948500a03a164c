"""The estimator with missing, refused, best-effort, silent or late inputs, and thinned outputs."""

import re

import numpy as np
import pytest
from cdrj_msgs.msg import CableTensions
from cdrj_msgs.srv import SetPreload
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from support.estimators import (
    BEGIN,
    JOINT,
    MILLISECOND,
    MOTOR,
    ROBOT,
    SECOND,
    diagnosed,
    feed,
    own_parameters,
    sample_at,
    values_of,
)
from support.places import ROOT

from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import load_model
from cdrj_ros.nodes.inputs import PATIENCE_S
from cdrj_ros.nodes.parameters import estimator_file, settings


@pytest.fixture
def log(bench):
    """Severity and text of the estimators' log messages from now on."""
    lines = []
    bench.node.create_subscription(Log, "/rosout", lambda m: lines.append((m.level, m.msg)), 1000)
    return lines


def logged(bench, lines, level, words):
    severity = getattr(Log, level)
    return bench.until(lambda: any(one == severity and words in text for one, text in lines))


def test_a_lost_preload_is_named_where_efforts_are_published_and_logged_once(bench, log):
    estimator = bench.estimator()
    assert bench.until(lambda: bench.node.count_publishers("/rosout") >= 2)
    true = load_model(ROBOT, "29,26.26")
    both = Template(JOINT_STATE, ("winch",), ("position", "effort"))
    state = initial_state(true)
    for k in range(0, 9000, 5):
        sample = sample_at(k)
        state, estimate = step(true, state, sample)
        estimator.joint(JOINT.encode(sample.stamp_ns, position=sample.joint_angle))
        estimator.motor(both.encode(sample.stamp_ns, position=sample.motor_angle,
                               effort=estimate.motor_effort))  # fmt: skip
    status = diagnosed(estimator)[1]
    assert status.name.endswith(": health")
    assert status.level == status.WARN
    assert status.message.startswith("preload of upper has lost 7.")
    error = np.abs(estimator.latest.tension - estimate.tension)
    assert np.all(error < 5.0 * estimator.latest.tension_stddev), "the efforts are heard"
    named = {pair.key: pair.value for pair in status.values}["elements marked UNSURE"]
    assert named == "none", "the standard deviations contain what is open"
    for _ in range(3):
        diagnosed(estimator)
    estimator.node.get_logger().warning("the last line")
    assert logged(bench, log, "WARN", "the last line")
    assert len([text for _, text in log if status.message == text]) == 1
    quiet = bench.estimator(ignored_sensors="*")
    quiet.motor(both.encode(BEGIN, position=[0.0], effort=[0.0]))
    assert len(diagnosed(quiet)) == 1


# missing and refused ---------------------------------------------------------------------------


def test_a_missing_name_is_reported_with_the_names_that_arrived(bench, log):
    estimator = bench.estimator()
    assert bench.until(lambda: bench.node.count_publishers("/rosout") >= 2)
    other = Template(JOINT_STATE, ("winch_motor",), ("position",))
    for k in range(20):
        estimator.motor(other.encode(BEGIN + k * MILLISECOND, position=[0.0]))
        estimator.joint(JOINT.encode(BEGIN, position=[np.nan]))
    words = (
        "no reading of winch, elbow accepted. /cdrj/motor_states: 20 messages, the last names "
        "winch_motor, not winch. /cdrj/joint_states: 20 messages. refused: 20 unknown_name (name "
        "that the robot file does not have); 20 not_finite (NaN or infinite position): elbow, "
        "publish only axes that have a reading"
    )
    estimator.watch.estimated_s -= PATIENCE_S
    status = diagnosed(estimator)[0]
    assert status.level == status.WARN
    assert words in status.message
    assert logged(bench, log, "WARN", "the last names winch_motor, not winch")


def test_topics_that_have_fallen_silent_are_named(bench, log):
    estimator = bench.estimator(timeout=0.05)
    assert bench.until(lambda: bench.node.count_publishers("/rosout") >= 2)

    def two_seconds_pass():
        for one in estimator.inputs:
            one.heard_s -= 2.0

    feed(estimator, 0, 10)
    assert bench.until(estimator.watch.lost)
    diagnosed(estimator)
    assert not any(one.silent(1.0) for one in estimator.inputs)
    two_seconds_pass()
    last = sample_at(9)
    estimator.motor(MOTOR.encode(BEGIN + 10 * MILLISECOND, position=last.motor_angle))
    estimator.watch.estimated_s -= PATIENCE_S
    diagnosed(estimator)
    words = "no estimate: no further message on /cdrj/joint_states. /cdrj/motor_states: 11 messages"
    assert logged(bench, log, "WARN", words)

    two_seconds_pass()
    health = estimator.watch.health(estimator.latest, 0.0, 0)
    assert health.waiting.startswith(
        "no further message on /cdrj/motor_states, /cdrj/joint_states. "
    )
    estimator.joint(JOINT.encode(BEGIN + 10 * MILLISECOND, position=last.joint_angle))
    estimator.motor(MOTOR.encode(BEGIN + 11 * MILLISECOND, position=last.motor_angle))
    assert estimator.watch.health(estimator.latest, 0.0, 0).waiting == ""


def test_estimates_that_begin_stop_and_resume_are_logged(bench, log):
    estimator = bench.estimator(timeout=0.2)
    assert bench.until(lambda: bench.node.count_publishers("/rosout") >= 2)
    feed(estimator, 0, 10)
    assert logged(bench, log, "INFO", "first estimate, ")
    assert logged(bench, log, "WARN", "inputs lost: no estimate for 0.")
    feed(estimator, 10, 20)
    assert logged(bench, log, "INFO", "inputs are back after ")


def test_many_refused_readings_are_a_warning_with_the_cause(bench):
    estimator = bench.estimator()
    estimator.live.set_unsure_share(10.0)
    feed(estimator, 0, 20)
    diagnosed(estimator)
    for count, level in ((4, b"\0"), (20, b"\1")):
        for k in range(count):
            estimator.joint(JOINT.encode(sample_at(20).stamp_ns + k, position=[3.0]))
        feed(estimator, 20 + count, 21 + count)
        status = diagnosed(estimator)[0]
        assert status.level == level, status.message
    assert "elbow" in status.message
    assert estimator.live.conditioner.refused["out_of_range"] == 24


@pytest.mark.parametrize(
    ("every_ms", "behind_ms", "said"),
    [(200, 0, "unsure: winch, elbow read at .* Hz: too sparse for this motion"),
     (1, 20, "readings lag: elbow by 20 ms, which grows by 0 ppm; ")],
)  # fmt: skip
def test_readings_too_sparse_or_of_another_clock_are_a_warning(every_ms, behind_ms, said, bench):
    estimator = bench.estimator()
    for k in range(0, 6000 if behind_ms == 0 else 2500, every_ms):
        sample = sample_at(k)
        estimator.motor(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))
        behind_ns = behind_ms * MILLISECOND  # of the clock that stamps the joint
        estimator.joint(JOINT.encode(sample.stamp_ns - behind_ns, position=sample.joint_angle))
    status = diagnosed(estimator)[0]
    assert status.level == status.WARN
    assert re.match(said, status.message)


@pytest.mark.parametrize(
    ("names", "words"),
    [(("front", "rear"), "/drives/front, /drives/rear"),
     (("front",), "/drives/front: is resolution or noise in the robot file too small?")],
)  # fmt: skip
def test_readings_that_alternate_are_a_warning_that_names_who_publishes_them(names, words, bench):
    estimator = bench.estimator()
    others = [Node(name, namespace="/drives") for name in names]
    try:
        for one in others:
            one.create_publisher(JointState, "/cdrj/joint_states", 10)
        assert bench.until(lambda: bench.node.count_publishers("/cdrj/joint_states") == len(names))
        for k in range(40):
            sample = sample_at(k)
            position = sample.joint_angle + 0.005 * (k % 2)
            estimator.joint(JOINT.encode(sample.stamp_ns, position=position))
            estimator.motor(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))
        status = diagnosed(estimator)[0]
    finally:
        for one in others:
            one.destroy_node()
    assert status.level == status.WARN
    motions = "readings contradict each other or alternate between motions: elbow, published by"
    assert status.message == f"{motions} {words}"
    assert values_of(status)["readings alternating"] == "elbow"


def test_several_estimators_or_several_stamps_are_a_warning_that_names_the_nodes(bench):
    estimator = bench.estimator()
    other = Node("estimator_2", namespace="/cdrj")
    try:
        feed(estimator, 0, 20)
        diagnosed(estimator)
        for _ in range(2):
            other.create_publisher(JointState, "/cdrj/joint_states", 10)
        assert bench.until(lambda: bench.node.count_publishers("/cdrj/joint_states") == 2)
        for _ in range(20):
            again = sample_at(3)
            estimator.joint(JOINT.encode(again.stamp_ns, position=again.joint_angle))
        words = "/cdrj/joint_states is published by /cdrj/estimator_2, /cdrj/estimator_2"
        assert words in diagnosed(estimator)[0].message
        other.create_publisher(CableTensions, "/cdrj/tensions", 10)
        assert bench.until(lambda: bench.node.count_publishers("/cdrj/tensions") == 2)
        status = diagnosed(estimator)[0]
    finally:
        other.destroy_node()
    assert status.level == status.WARN
    assert "several estimators: /cdrj/tensions is published by /cdrj/estimator" in status.message


# quality of service ----------------------------------------------------------------------------


def test_a_best_effort_publisher_is_received_and_the_cost_is_logged(bench, log):
    estimator = bench.estimator()
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    motors = bench.node.create_publisher(JointState, "/cdrj/motor_states", best_effort)
    joints = bench.node.create_publisher(JointState, "/cdrj/joint_states", 10)
    k = 0

    def answered():
        nonlocal k
        sample = sample_at(k)
        joints.publish(JOINT.encode(sample.stamp_ns, position=sample.joint_angle))
        motors.publish(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))
        k += 1
        return estimator.latest is not None

    assert bench.until(answered)
    assert logged(bench, log, "WARN", "subscribed best-effort as well. Readings may be lost")
    motors_heard, joints_heard, _ = estimator.inputs
    assert motors_heard.reliability == ReliabilityPolicy.BEST_EFFORT
    assert joints_heard.reliability == ReliabilityPolicy.RELIABLE


# parameters ------------------------------------------------------------------------------------


def test_parameters_show_the_values_in_force(bench):
    estimator = bench.estimator(**{"friction.rho": 0.35})

    def shown(name):
        return estimator.node.get_parameter(name).value

    assert list(shown("preload")) == [36.85, 26.26]
    assert (shown("friction.rho"), shown("friction.mu_c")) == (0.35, 0.15)
    request = SetPreload.Request(cable=["upper"], preload=[20.0])
    answer = bench.call(SetPreload, "/cdrj/estimator/set_preload", request)
    assert answer.success
    assert list(shown("preload")) == [20.0, 26.26]
    before = estimator.live.model
    assert [cable.preload for cable in before.robot.cables] == [20.0, 26.26]

    (result,) = estimator.node.set_parameters([Parameter("friction.rho", value=-1.0)])
    assert result.successful
    assert shown("friction.rho") == 0.2  # the robot file's
    (result,) = estimator.node.set_parameters([Parameter("unsure_share", value=1)])
    assert result.successful
    assert (shown("unsure_share"), estimator.live.options.unsure_share) == (1.0, 1.0)
    (result,) = estimator.node.set_parameters([Parameter("tracking_bandwidth", value=0.0)])
    assert result.successful
    feed(estimator, 0, 200)
    assert estimator.live.sample.motor_angle == sample_at(199).motor_angle, "no filter any more"


def test_the_parameter_file_is_what_the_node_declares(bench):
    path = ROOT / "config" / "estimator.params.yaml"
    assert path.read_text(encoding="utf-8") == estimator_file()
    estimator = bench.estimator("--params-file", str(path), timeout=0.5)
    assert own_parameters(estimator) == {setting.name for setting in settings()}


# time ------------------------------------------------------------------------------------------


def test_an_impossible_clock_is_refused_and_counted(bench):
    estimator = bench.estimator(use_sim_time=True)
    publisher = bench.node.create_publisher(Clock, "/clock", QoSProfile(depth=10))
    assert bench.until(lambda: publisher.get_subscription_count() > 0)
    message = Clock()
    for count, (sec, nanosec) in enumerate(((-1, 0), (-(2**31), 5), (5, 2**32 - 1)), start=1):
        message.clock.sec, message.clock.nanosec = sec, nanosec
        publisher.publish(message)
        assert bench.until(lambda: estimator.node.clock_refused == count)  # noqa: B023
    for sec, nanosec in ((2**31 - 1, 0), (7, 5)):
        message.clock.sec, message.clock.nanosec = sec, nanosec
        publisher.publish(message)
        assert bench.until(lambda: estimator.now_ns() == sec * SECOND + nanosec)  # noqa: B023
    assert values_of(diagnosed(estimator)[0])["impossible times on /clock"] == "3"


def test_an_explicit_reliability_is_kept_and_the_remedy_is_logged(bench, log):
    name = "qos_overrides./cdrj/motor_states.subscription.reliability"
    estimator = bench.estimator(**{name: "reliable"})
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    bench.node.create_publisher(JointState, "/cdrj/motor_states", best_effort)
    assert logged(bench, log, "WARN", "Set it to best_effort")
    assert estimator.inputs[0].reliability == ReliabilityPolicy.RELIABLE


def test_an_axis_without_which_nothing_is_known_is_named_with_the_time_of_its_silence(bench):
    estimator = bench.estimator(timeout=0.01)
    feed(estimator, 0, 500)
    for k in range(500, 1500):
        sample = sample_at(k)
        estimator.motor(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))
    assert bench.until(estimator.watch.lost)
    found, *_ = diagnosed(estimator)
    assert "no further reading of elbow for 1.0 s accepted" in found.message
    assert values_of(found)["axes not read"] == "elbow for 1.0 s"
