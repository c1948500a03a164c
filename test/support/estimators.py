"""Estimator nodes in this process, and the messages sent to them."""

from types import SimpleNamespace

import numpy as np

from cdrj_ros.estimation.conditioner import Conditioner
from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot
from support.places import ROBOT
from support.reading_streams import take

SECOND = 10**9
MILLISECOND = 1_000_000
BEGIN = 1_700_000_000 * SECOND
PATIENCE_S = 60.0
INPUTS = ("motor_states", "joint_states")
MOTOR = Template(JOINT_STATE, ("winch",), ("position",))
JOINT = Template(JOINT_STATE, ("elbow",), ("position",))


def sample_at(k, begin=BEGIN):
    time = 1e-3 * k
    elbow = 0.3 * np.sin(3.0 * time)
    winch = 8.0 * np.sin(elbow) + 0.02 * np.sin(40.0 * time)  # 0.12 m per radian / 15 mm
    return Sample(begin + k * MILLISECOND, np.array([winch]), np.array([elbow]))


class Bench:
    """Nodes in this process and a node that communicates with them."""

    def __init__(self, namespace=""):
        from rclpy.experimental import EventsExecutor
        from rclpy.node import Node

        self.executor = EventsExecutor()
        self.node = Node("bench", namespace=namespace)
        self.executor.add_node(self.node)
        self.nodes = []
        self.publishers = {}

    def add(self, node):
        self.executor.add_node(node)
        self.nodes.append(node)
        return node

    def listen(self, kind, topic):
        """The messages of a topic from now on."""
        heard = []
        self.node.create_subscription(kind, topic, heard.append, 1000)
        return heard

    def publish(self, topic, message):
        """Publish a message once, after somebody has subscribed."""
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(type(message), topic, 10)
            assert self.until(lambda: self.publishers[topic].get_subscription_count() > 0)
        self.publishers[topic].publish(message)

    def estimator(self, *arguments, state_file=None, **given):
        """The estimation of a new node, with what it publishes in ``answers``, see ``feed``."""
        from rclpy.parameter import Parameter

        from cdrj_ros.nodes.estimator import EstimatorNode

        given = {"robot": ROBOT, "timeout": 3600.0, **given}
        node = EstimatorNode(
            state_file,
            parameter_overrides=[Parameter(key, value=value) for key, value in given.items()],
            cli_args=["--ros-args", *arguments],
        )
        self.add(node)
        listen(node.estimation)
        return node.estimation

    def until(self, condition, patience_s=PATIENCE_S):
        from time import monotonic

        deadline = monotonic() + patience_s
        while not condition():
            if monotonic() > deadline:
                return False
            self.executor.spin_once(timeout_sec=0.01)
        return True

    def call(self, kind, name, request):
        client = self.node.create_client(kind, name)
        assert self.until(client.service_is_ready)
        answer = client.call_async(request)
        assert self.until(answer.done)
        self.node.destroy_client(client)
        return answer.result()

    def close(self):
        self.executor.shutdown()
        for node in (*self.nodes, self.node):
            node.destroy_node()


def listen(estimation):
    """Let ``motor`` and ``joint`` take payloads as the subscriptions do; record what is published.

    ``test_estimator_node.py`` shows that subscriptions lead to the same callbacks.
    """
    if not hasattr(estimation, "answers"):
        estimation.answers = []
        publish = estimation.outputs.publish

        def remember(output):
            estimation.answers.append(output)
            publish(output)

        estimation.outputs.publish = remember
    for kind, topic in zip(("motor", "joint"), estimation.inputs, strict=False):
        setattr(estimation, kind, estimation.angle_callback(f"{kind}s", topic))


def feed(estimator, first, last, begin=BEGIN):
    for k in range(first, last):
        sample = sample_at(k, begin)
        estimator.joint(JOINT.encode(sample.stamp_ns, position=sample.joint_angle))
        estimator.motor(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))


def hold(estimator, k, since=0):
    """Repeat the readings of one sample, ``since`` ms ago, until the robot counts as at rest."""
    sample = sample_at(k)
    for ahead in range(since + 1, since + 320):
        stamp = sample.stamp_ns + ahead * MILLISECOND
        estimator.joint(JOINT.encode(stamp, position=sample.joint_angle))
        estimator.motor(MOTOR.encode(stamp, position=sample.motor_angle))


def tensions(estimator):
    return np.array([output.tension for output in estimator.answers])


def expected(models, pieces, begin=BEGIN):
    """Tensions of one continuous run, of which each piece has its own model [N]."""
    state = initial_state(models[0])
    gate = Conditioner(models[0].robot)
    found = []
    for one, piece in zip(models, pieces, strict=True):
        for k in piece:
            sent = sample_at(k, begin)
            take(gate, "joints", sent.stamp_ns, ("elbow",), sent.joint_angle)
            (sample,) = take(gate, "motors", sent.stamp_ns, ("winch",), sent.motor_angle)
            state, estimate = step(one, state, sample)
            found.append(estimate.tension.copy())
    return np.array(found)


def changed(model, **friction):
    values = {f"friction.{key}": value for key, value in friction.items()}
    return prepare(build_robot(with_numbers(dict(model.robot.document), values), "changed"))


def own_parameters(estimator):
    """Names of the node's parameters, without those of ROS itself."""
    every = estimator.node.get_parameters_by_prefix("")
    of_ros = ("qos_overrides.", "use_sim_time", "start_type_description_service")
    return {name for name in every if not name.startswith(of_ros)}


def hear_diagnostics(bench, said):
    from diagnostic_msgs.msg import DiagnosticArray

    def on_message(message):
        said.extend(message.status)

    bench.node.create_subscription(DiagnosticArray, "/diagnostics", on_message, 10)


def diagnosed(estimation):
    """The statuses that a node publishes now, as if a second had passed since the last ones."""
    kept = []
    estimation.diagnostics = SimpleNamespace(publish=kept.append)
    estimation.watch.looked_s -= 1.0
    estimation.diagnose()
    return list(kept[0].status)


def values_of(status):
    return {value.key: value.value for value in status.values}


class Clock:
    """Publishes /clock and waits until the estimator has received it."""

    def __init__(self, bench, estimator):
        from rclpy.qos import QoSProfile
        from rosgraph_msgs.msg import Clock as Message

        self.bench, self.message, self.estimator = bench, Message(), estimator
        self.publisher = bench.node.create_publisher(Message, "/clock", QoSProfile(depth=100))
        assert bench.until(lambda: self.publisher.get_subscription_count() > 0)

    def set(self, ns):
        self.message.clock.sec, self.message.clock.nanosec = divmod(ns, SECOND)
        self.publisher.publish(self.message)
        assert self.bench.until(lambda: self.estimator.now_ns() == ns)
