"""Round trip through the estimator node in a process of its own: of the prototype and of a hand."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, perf_counter

import numpy as np

from bench.figures import ROBOT, alone, there_and_back
from bench.hand import fingers, hand_text, motion
from bench.update import recorded_motion
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import load_model

BLOCKS = 16
"""Measured blocks, after one warm-up block; the p99 of one rests on four trips."""
TRIPS = 400
"""Round trips per block."""
PERIOD_NS = 1_000_000
"""Of the prototype's samples [ns]."""
FINGERS = 5
RATES = {500: 40, 100: 12}
"""Samples of the fingers per second, and the most of a processor that they may take [%]."""
HELD_S = 0.05
"""Longest wait for an answer [s]: where the recording is thrown back its speed leaps, and the
estimator holds a reading until the next one."""

PATIENCE_S = 60.0
"""Longest wait for a node [s]."""

Process = subprocess.Popen[bytes]
Messages = Iterator[tuple[bytes, bytes]]
"""Joint and motor message of one sample."""
Turns = tuple[np.ndarray, np.ndarray]
"""Times of all trips [s], shape (BLOCKS, TRIPS), and share of a processor that the node used."""


def isolate():
    """Give this process and its children a ROS domain of their own on this machine."""
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


def estimator_command(robot):
    """Command line of the installed estimator; its timeout is long, so it never turns stale."""
    from ament_index_python.packages import get_package_prefix

    executable = Path(get_package_prefix("cdrj_ros"), "lib", "cdrj_ros", "estimator")
    parameters = [f"robot:={robot}", "timeout:=3600.0"]
    options = [option for one in parameters for option in ("-p", one)]
    return [str(executable), "--ros-args", "--log-level", "warn", *options]


@contextmanager
def running(*command):
    """Run a node while the body runs, then interrupt it; kill it only if it does not end."""
    process = subprocess.Popen(command)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def listening(name):
    """Create a node in this process and the executor that spins it."""
    import rclpy
    from rclpy.experimental import EventsExecutor
    from rclpy.node import Node

    rclpy.init(args=[])
    node = Node(name)
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def spin_until(executor, condition, process):
    """Spin until a condition holds.

    Raises:
        RuntimeError: it does not hold within ``PATIENCE_S``, or the process has ended.
    """
    deadline = monotonic() + PATIENCE_S
    while not condition():
        executor.spin_once(timeout_sec=0.002)
        if process.poll() is not None:
            raise RuntimeError(f"a node ended early, exit code {process.returncode}")
        if monotonic() > deadline:
            raise RuntimeError(f"a node did not answer within {PATIENCE_S:g} s")


class Caller:
    """Publishes one sample at a time and times the answers."""

    def __init__(self, node, executor):
        """Subscribe to the answers of the estimator."""
        from cdrj_msgs.msg import CableTensions, NodalForces
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import JointState

        self.executor, self.answers, self._answered_s = executor, 0, 0.0
        self.last_ns = self.backwards = 0
        qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
        self._joints, self._motors = (
            node.create_publisher(JointState, f"/cdrj/{topic}", qos)
            for topic in ("joint_states", "motor_states")
        )

        def on_tensions(payload):
            self._answered_s = perf_counter()
            self.answers += 1
            seconds, part_ns = (int.from_bytes(payload[k : k + 4], "little") for k in (4, 8))
            stamp_ns = seconds * 10**9 + part_ns
            self.backwards += stamp_ns <= self.last_ns
            self.last_ns = stamp_ns

        def on_others(_payload):
            """Only take them, as a user would."""

        topics = {"tensions": on_tensions, "nodal_forces": on_others, "efforts": on_others}
        kinds = (CableTensions, NodalForces, JointState)
        for (topic, callback), kind in zip(topics.items(), kinds, strict=True):
            node.create_subscription(kind, f"/cdrj/{topic}", callback, qos, raw=True)
        self._publishers = lambda: [node.count_publishers(f"/cdrj/{t}") for t in topics]

    def is_connected(self):
        """Whether publishers and subscriptions are matched in both directions."""
        told = (one.get_subscription_count() for one in (self._joints, self._motors))
        return all(told) and all(self._publishers())

    def trip(self, joint, motor):
        """Seconds from publishing a sample to its tensions."""
        awaited = self.answers + 1
        begin = self._answered_s = perf_counter()
        self._joints.publish(joint)
        self._motors.publish(motor)
        while self.answers < awaited and perf_counter() - begin < HELD_S:
            self.executor.spin_once(timeout_sec=HELD_S)
        return self._answered_s - begin


@dataclass(frozen=True)
class Called:
    """A node in a process of its own, with its caller."""

    caller: Caller
    messages: Messages
    process: Process

    def turn(self, period_s):
        """Times of ``TRIPS`` trips, one per period [s], and the node's processor time [s]."""
        before, due, times = processor_time(self.process.pid), perf_counter(), []
        for _ in range(TRIPS):
            joint, motor = next(self.messages)
            due += period_s
            while (left := due - perf_counter()) > 0.0:
                self.caller.executor.spin_once(timeout_sec=left)
            times.append(self.caller.trip(joint, motor))
        return times, processor_time(self.process.pid) - before


def processor_time(process):
    """Time that the threads of a process have run [s]; an error if it has ended."""
    tasks = Path(f"/proc/{process}/task").iterdir()
    return sum(1e-9 * int((task / "schedstat").read_text().split()[0]) for task in tasks)


def _messages(layout, motors, joints, period_ns):
    """Readings played again and again."""
    joint = Template(JOINT_STATE, layout.joints, ("position",))
    motor = Template(JOINT_STATE, layout.motors, ("position",))
    for k, (turned, moved) in enumerate(cycle(zip(motors, joints, strict=True)), start=1):
        stamp = k * period_ns
        yield joint.encode(stamp, position=moved), motor.encode(stamp, position=turned)


@contextmanager
def called(robot, model, motors, joints, period_ns):
    """An estimator with a caller that is connected to it and has readings for every period."""
    with listening("caller") as (node, executor), running(*estimator_command(robot)) as process:
        caller = Caller(node, executor)
        spin_until(executor, caller.is_connected, process)
        yield Called(caller, _messages(model.layout, motors, joints, period_ns), process)


def _turns(robot, model, motors, joints, period_ns):
    """Play readings to an estimator, one sample per period."""
    with called(robot, model, motors, joints, period_ns) as node:
        gc.collect()
        gc.disable()
        turns = [node.turn(period_ns * 1e-9) for _ in range(BLOCKS + 1)][1:]
        gc.enable()
    trips, used = zip(*turns, strict=True)
    return np.array(trips), np.array(used) / (TRIPS * period_ns * 1e-9)


def _of_prototype():
    """The sample recording at 1 kHz."""
    model = load_model(str(ROBOT))
    read = recorded_motion(model)
    played = there_and_back(read.motor_angle), there_and_back(read.joint_angle)
    trips, used = _turns(ROBOT, model, *played, PERIOD_NS)
    middle, late = (np.percentile(trips, percent, axis=1) * 1e3 for percent in (50, 99))
    return [
        alone("prototype, 1 kHz, until tensions, p50", "ms", middle, "≤ 0.5"),
        alone("prototype, 1 kHz, until tensions, p99", "ms", late, ""),
        alone("prototype, 1 kHz, processor of the node", "%", used * 100.0, "≤ 40"),
    ]


def _of_hand(folder):
    """Five fingers, joints at 1 Hz."""
    robot, model, rows = folder / "hand.yaml", fingers(FINGERS), []
    robot.write_text(hand_text(FINGERS), encoding="utf-8")
    for rate, most in RATES.items():
        read = motion(model, rate)
        trips, used = _turns(robot, model, read.motor_angle, read.joint_angle, 10**9 // rate)
        what, middle = f"five fingers, {rate} Hz", np.median(trips, axis=1) * 1e3
        rows += [
            alone(f"{what}, until tensions, p50", "ms", middle, "≤ 3"),
            alone(f"{what}, processor of the node", "%", used * 100.0, f"≤ {most}"),
        ]
    return rows


def measure():
    """Round trips and processor time of the node."""
    with TemporaryDirectory() as folder:
        return [*_of_prototype(), *_of_hand(Path(folder))]
