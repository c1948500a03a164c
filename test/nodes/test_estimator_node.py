"""The estimator in a separate process, tested over DDS."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.forked import Forked

from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, NODAL_FORCES, read_layout
from cdrj_ros.messages.estimate_encoder import FORCES
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.status import STALE, UNSURE
from cdrj_ros.recordings import Topics, read_messages

ROOT = Path(__file__).parents[2]
ROBOT = str(ROOT / "config" / "robots" / "prototype.yaml")
PATIENCE_S = 120.0
ASK_AGAIN_S = 5.0


TYPES = {"tension": CABLE_TENSIONS, "nodal_force": NODAL_FORCES, "effort": JOINT_STATE}


def stamp_of(payload: bytes) -> int:
    """Header stamp of a message [ns]."""
    sec = int.from_bytes(payload[4:8], "little", signed=True)
    return sec * 1_000_000_000 + int.from_bytes(payload[8:12], "little")


class Robot:
    """A node with the publishers of a robot's drivers and subscriptions to the estimates."""

    WINDOW = 64
    """Maximum number of messages in flight; less than any queue depth."""

    def __init__(self, remap: tuple[str, ...]) -> None:
        from cdrj_msgs.msg import CableTensions, NodalForces
        from rcl_interfaces.srv import GetParameters
        from rclpy.node import Node
        from rclpy.qos import QoSProfile
        from sensor_msgs.msg import JointState
        from std_srvs.srv import Trigger

        self.node = Node("robot", namespace="cdrj", cli_args=["--ros-args", *remap])
        self.answers: dict[str, list[bytes]] = {"tension": [], "nodal_force": [], "effort": []}
        qos = QoSProfile(depth=1000)
        self.motors = self.node.create_publisher(JointState, "motor_states", qos)
        self.joints = self.node.create_publisher(JointState, "joint_states", qos)
        self.inputs = {p.topic_name: p for p in (self.motors, self.joints)}
        for message, topic, kind in (
            (CableTensions, "tensions", "tension"),
            (NodalForces, "nodal_forces", "nodal_force"),
            (JointState, "efforts", "effort"),
        ):
            keep = self.answers[kind].append
            self.node.create_subscription(message, topic, keep, qos, raw=True)
        self.reset = self.node.create_client(Trigger, "estimator/reset")
        # created last: an estimator that responds to it has discovered all the others
        self.ping = self.node.create_client(GetParameters, "estimator/get_parameters")

    def ready(self) -> bool:
        """Whether the topics are connected in both directions."""
        return all(p.get_subscription_count() for p in self.inputs.values()) and all(
            self.node.count_publishers(f"/cdrj/{topic}")
            for topic in ("tensions", "nodal_forces", "efforts")
        )

    @property
    def answered_ns(self) -> int:
        """Latest stamp received on all three topics [ns]."""
        return min(stamp_of(heard[-1]) if heard else -1 for heard in self.answers.values())

    def forget(self) -> None:
        """Discard the received messages."""
        for heard in self.answers.values():
            heard.clear()


@dataclass
class Bench:
    """A robot in this process and an estimator in another one."""

    robot: Robot
    executor: Any
    process: subprocess.Popen[bytes]

    def spin_until(self, condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> bool:
        from time import monotonic

        deadline = monotonic() + patience_s
        while not condition():
            assert self.process.poll() is None
            if monotonic() > deadline:
                return False
            self.executor.spin_once(timeout_sec=0.05)
        return True

    def connect(self) -> None:
        """Wait for mutual discovery; a response to an undiscovered client would be dropped."""
        from rcl_interfaces.srv import GetParameters

        assert self.spin_until(self.robot.ready)
        ping = self.robot.ping
        assert self.spin_until(ping.service_is_ready)
        assert any(
            self.spin_until(ping.call_async(GetParameters.Request()).done, ASK_AGAIN_S)
            for _ in range(round(PATIENCE_S / ASK_AGAIN_S))
        )

    def reset(self) -> None:
        """Reset the estimator and discard the received messages."""
        from std_srvs.srv import Trigger

        assert self.spin_until(self.robot.reset.service_is_ready)
        future = self.robot.reset.call_async(Trigger.Request())
        assert self.spin_until(future.done)
        assert future.result().success
        self.robot.forget()

    def play(self, bag: str, last_ns: int) -> None:
        """Publish a bag's inputs, about WINDOW of them in flight; wait for the last estimate."""
        robot, topics = self.robot, Topics()
        publishers = {topics.motors: robot.motors, topics.joints: robot.joints}
        under_way: list[int] = []
        for message in read_messages(bag, list(publishers)):
            publishers[message.topic].publish(message.data)
            under_way.append(stamp_of(message.data))
            if len(under_way) % 16 == 0 and len(under_way) > robot.WINDOW:
                wanted = under_way[-robot.WINDOW]
                assert self.spin_until(lambda wanted=wanted: robot.answered_ns >= wanted)
        assert self.spin_until(lambda: robot.answered_ns >= last_ns)

    def arrays(self, kind: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        payloads = self.robot.answers[kind]
        columns: dict[str, list[np.ndarray]] = {}
        for payload in payloads:
            for name, span in read_layout(payload, TYPES[kind].fields).numbers.items():
                numbers = np.frombuffer(payload, span.dtype, span.count, span.offset)
                columns.setdefault(name, []).append(numbers.astype(np.float64))
        arrays = {
            name: np.array(rows) for name, rows in columns.items() if not name.startswith("header")
        }
        return np.array([stamp_of(payload) for payload in payloads], np.int64), arrays


@pytest.fixture
def bench(start_node: Any, start_executable: Any) -> Iterator[Callable[..., Bench]]:
    """Start an estimator with a given timeout, and connect the robot's topics to it.

    With ``options``, which may be empty, it is the installed executable.
    """
    from rclpy.experimental import EventsExecutor

    from cdrj_ros.nodes.spinning import ros_context

    with ros_context([]) as stop:
        opened: list[Bench] = []

        def open_bench(
            remap: tuple[str, ...] = (),
            timeout_s: float = 3600.0,
            options: tuple[str, ...] | None = None,
        ) -> Bench:
            start = start_node if options is None else start_executable
            process = start(
                "estimator", *(options or ()), "--ros-args", "-p", f"robot:={ROBOT}",
                "-p", f"timeout:={timeout_s}", *remap,
            )  # fmt: skip
            robot = Robot(remap)
            executor = EventsExecutor()
            executor.add_node(robot.node)
            beside = Bench(robot, executor, process)
            opened.append(beside)
            beside.connect()
            beside.reset()
            return beside

        yield open_bench
        assert not stop
        for one in opened:
            one.executor.shutdown()
            one.robot.node.destroy_node()


def _offline(bag: str) -> Any:
    model = load_model(ROBOT)
    recording = read_inputs(bag, Topics(), model)
    return estimate(model, condition_recording(model, recording))


def _assert_same_numbers(bench: Bench, offline: Any) -> None:
    layout = offline.layout
    stamps, tensions = bench.arrays("tension")
    assert np.array_equal(stamps, offline.stamp_ns)
    assert np.array_equal(tensions["tension"], offline.values[:, layout.tension])
    certain = tensions["status"].astype(int) & ~UNSURE
    assert np.array_equal(certain, offline.values[:, layout.status])
    stamps, forces = bench.arrays("nodal_force")
    assert np.array_equal(stamps, offline.stamp_ns)
    for name in (*FORCES, "status"):
        if name not in ("force_z", "status"):
            assert np.array_equal(forces[name], offline.values[:, getattr(layout, name)]), name
    stamps, efforts = bench.arrays("effort")
    assert np.array_equal(stamps, offline.stamp_ns)
    both = slice(layout.motor_effort.start, layout.joint_effort.stop)
    assert np.array_equal(efforts["effort"], offline.values[:, both])


def test_after_a_silence_the_last_estimate_is_published_as_stale(
    bench: Callable[..., Bench], short_bag: str
) -> None:
    offline = _offline(short_bag)
    beside = bench(timeout_s=0.2)
    beside.play(short_bag, int(offline.stamp_ns[-1]))
    heard = len(beside.robot.answers["tension"])

    assert beside.spin_until(lambda: len(beside.robot.answers["tension"]) > heard)

    stamps, tensions = beside.arrays("tension")
    assert stamps[-1] == offline.stamp_ns[-1]
    assert np.all(tensions["status"][-1].astype(int) & STALE)
    assert np.array_equal(tensions["tension"][-1], offline.values[-1, offline.layout.tension])


def test_every_published_number_equals_the_offline_path_bit_for_bit_also_after_a_reset(
    bench: Callable[..., Bench], short_bag: str
) -> None:
    offline = _offline(short_bag)
    assert offline.stamp_ns.size > 5000
    beside = bench()
    for _ in range(2):
        beside.reset()
        beside.play(short_bag, int(offline.stamp_ns[-1]))
        _assert_same_numbers(beside, offline)


def test_motors_and_joints_may_share_a_topic(bench: Callable[..., Bench], short_bag: str) -> None:
    offline = _offline(short_bag)
    beside = bench(("-r", "motor_states:=joint_states"))
    assert len(beside.robot.inputs) == 1

    beside.play(short_bag, int(offline.stamp_ns[-1]))

    _assert_same_numbers(beside, offline)


QOS = "qos_overrides./cdrj/tensions.publisher.reliability"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "robot is missing"),
        (["--ros-args", "-p", "robot:=/no/such.yaml"], "/no/such.yaml"),
        (["--ros-args", "-p", f"robot:={ROBOT}", "-p", "preload:=[1.0]"], "preload needs 2"),
        (["surplus"], "surplus"),
        (["--ros-args", "-p", "robot"], "'-p robot'"),
        (["--ros-args", "-p", "robot:=3"], "'robot' to '3' of type 'INTEGER'"),
        (["--ros-args", "-p", f"robot:={ROBOT}", "-p", "timeout:=-3.0"], "timeout out of range"),
        (["--ros-args", "--params-file", "/nowhere.yaml"], "/nowhere.yaml"),
        (["--ros-args", "-r", "__node:=1bad"], "__node:=1bad"),
        (["--ros-args", "-p", f"robot:={ROBOT}", "-p", f"{QOS}:=maybe"], "`maybe`"),
    ],
)
def test_a_wrong_start_is_one_clear_line_and_exit_code_2(
    arguments: list[str], words: str, tmp_path: Path
) -> None:
    with (tmp_path / "said").open("wb") as said:
        process = Forked("estimator", arguments, said.fileno())
    assert process.wait(PATIENCE_S) == 2
    errors = (tmp_path / "said").read_text("utf-8")
    assert words in errors
    assert len(lines_of_ours(errors)) == 1


def test_a_wrong_start_of_the_installed_executable_is_one_clear_line(start_executable: Any) -> None:
    process = start_executable("estimator", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    output, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert not output
    (line,) = lines_of_ours(errors.decode())
    assert "robot is missing" in line


def lines_of_ours(errors: str) -> list[str]:
    return [line for line in errors.strip().splitlines() if "[rcl]" not in line]


@pytest.mark.parametrize(
    ("options", "number", "code"),
    [((), signal.SIGINT, 130), (("--supervised",), signal.SIGINT, 0), ((), signal.SIGTERM, 0)],
)
def test_the_exit_code_of_a_running_node_tells_an_interrupt_unless_it_is_supervised(
    bench: Callable[..., Bench], options: tuple[str, ...], number: int, code: int
) -> None:
    """ros2 launch reports every code but 0 as a crash, even of a node that it has interrupted."""
    process = bench(options=options).process
    process.send_signal(number)
    assert process.wait(PATIENCE_S) == code
