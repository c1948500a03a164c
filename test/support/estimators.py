"""Estimator nodes in this process, and the messages sent to them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from cdrj_ros.estimation.conditioner import Conditioner
from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import Model, prepare
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


def sample_at(k: int, begin: int = BEGIN) -> Sample:
    time = 1e-3 * k
    elbow = 0.3 * np.sin(3.0 * time)
    winch = 8.0 * np.sin(elbow) + 0.02 * np.sin(40.0 * time)  # 0.12 m per radian / 15 mm
    return Sample(begin + k * MILLISECOND, np.array([winch]), np.array([elbow]))


class Bench:
    """Nodes in this process and a node that communicates with them."""

    def __init__(self, namespace: str = "") -> None:
        from rclpy.experimental import EventsExecutor
        from rclpy.node import Node

        self.executor = EventsExecutor()
        self.node = Node("bench", namespace=namespace)
        self.executor.add_node(self.node)
        self.nodes: list[Any] = []
        self.publishers: dict[str, Any] = {}

    def add(self, node: Any) -> Any:
        self.executor.add_node(node)
        self.nodes.append(node)
        return node

    def listen(self, kind: Any, topic: str) -> list[Any]:
        """The messages of a topic from now on."""
        heard: list[Any] = []
        self.node.create_subscription(kind, topic, heard.append, 1000)
        return heard

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message once, after somebody has subscribed."""
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(type(message), topic, 10)
            assert self.until(lambda: self.publishers[topic].get_subscription_count() > 0)
        self.publishers[topic].publish(message)

    def estimator(self, *arguments: str, state_file: Path | None = None, **given: Any) -> Any:
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

    def until(self, condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> bool:
        from time import monotonic

        deadline = monotonic() + patience_s
        while not condition():
            if monotonic() > deadline:
                return False
            self.executor.spin_once(timeout_sec=0.01)
        return True

    def call(self, kind: Any, name: str, request: Any) -> Any:
        client = self.node.create_client(kind, name)
        assert self.until(client.service_is_ready)
        answer = client.call_async(request)
        assert self.until(answer.done)
        self.node.destroy_client(client)
        return answer.result()

    def close(self) -> None:
        self.executor.shutdown()
        for node in (*self.nodes, self.node):
            node.destroy_node()


def listen(estimation: Any) -> None:
    """Let ``motor`` and ``joint`` take payloads as the subscriptions do; record what is published.

    ``test_estimator_node.py`` shows that subscriptions lead to the same callbacks.
    """
    if not hasattr(estimation, "answers"):
        estimation.answers = []
        publish = estimation.outputs.publish

        def remember(output: Any) -> None:
            estimation.answers.append(output)
            publish(output)

        estimation.outputs.publish = remember
    for kind, topic in zip(("motor", "joint"), estimation.inputs, strict=False):
        setattr(estimation, kind, estimation.angle_callback(f"{kind}s", topic))


def feed(estimator: Any, first: int, last: int, begin: int = BEGIN) -> None:
    for k in range(first, last):
        sample = sample_at(k, begin)
        estimator.joint(JOINT.encode(sample.stamp_ns, position=sample.joint_angle))
        estimator.motor(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))


def hold(estimator: Any, k: int, since: int = 0) -> None:
    """Repeat the readings of one sample, ``since`` ms ago, until the robot counts as at rest."""
    sample = sample_at(k)
    for ahead in range(since + 1, since + 320):
        stamp = sample.stamp_ns + ahead * MILLISECOND
        estimator.joint(JOINT.encode(stamp, position=sample.joint_angle))
        estimator.motor(MOTOR.encode(stamp, position=sample.motor_angle))


def tensions(estimator: Any) -> np.ndarray:
    return np.array([output.tension for output in estimator.answers])


def expected(models: Sequence[Model], pieces: Sequence[range], begin: int = BEGIN) -> np.ndarray:
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


def changed(model: Model, **friction: float) -> Model:
    values = {f"friction.{key}": value for key, value in friction.items()}
    return prepare(build_robot(with_numbers(dict(model.robot.document), values), "changed"))


def own_parameters(estimator: Any) -> set[str]:
    """Names of the node's parameters, without those of ROS itself."""
    every = estimator.node.get_parameters_by_prefix("")
    of_ros = ("qos_overrides.", "use_sim_time", "start_type_description_service")
    return {name for name in every if not name.startswith(of_ros)}


def hear_diagnostics(bench: Bench, said: list[Any]) -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    def on_message(message: DiagnosticArray) -> None:
        said.extend(message.status)

    bench.node.create_subscription(DiagnosticArray, "/diagnostics", on_message, 10)


def diagnosed(estimation: Any) -> list[Any]:
    """The statuses that a node publishes now, as if a second had passed since the last ones."""
    kept: list[Any] = []
    estimation.diagnostics = SimpleNamespace(publish=kept.append)
    estimation.watch.looked_s -= 1.0
    estimation.diagnose()
    return list(kept[0].status)


def values_of(status: Any) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


class Clock:
    """Publishes /clock and waits until the estimator has received it."""

    def __init__(self, bench: Bench, estimator: Any) -> None:
        from rclpy.qos import QoSProfile
        from rosgraph_msgs.msg import Clock as Message

        self.bench, self.message, self.estimator = bench, Message(), estimator
        self.publisher = bench.node.create_publisher(Message, "/clock", QoSProfile(depth=100))
        assert bench.until(lambda: self.publisher.get_subscription_count() > 0)

    def set(self, ns: int) -> None:
        self.message.clock.sec, self.message.clock.nanosec = divmod(ns, SECOND)
        self.publisher.publish(self.message)
        assert self.bench.until(lambda: self.estimator.now_ns() == ns)
