"""Round trip through the estimator node compared with a relay that does no work."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from bench.figures import ROBOT, Row, compared
from bench.processes import (
    Process,
    estimator_command,
    listening,
    node_command,
    running,
    spin_until,
)
from bench.update import recorded_motion
from cdrj_ros.estimation.ensemble import stddev_columns
from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import EstimateEncoder, Template
from cdrj_ros.model.prepared import Model, load_model

BLOCKS = 16
"""Measured blocks per node, after one warm-up block; the p99 of one rests on four trips."""
TRIPS = 400
"""Round trips per block."""
PERIOD_S = 1e-3
HELD_S = 0.05
"""Longest wait for an answer [s]: where the recording is thrown back its speed leaps, and the
estimator holds a reading until the next one."""

Messages = Iterator[tuple[bytes, bytes]]
"""Joint and motor message of one sample."""


@dataclass
class Caller:
    """Publishes one sample at a time and times the answers."""

    node: Any
    executor: Any
    namespace: str
    heard: dict[str, int] = field(default_factory=dict)
    tensions_at: float = 0.0

    def __post_init__(self) -> None:
        from cdrj_msgs.msg import CableTensions, NodalForces
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import JointState

        qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
        self.joints, self.motors = (
            self.node.create_publisher(JointState, f"/{self.namespace}/{topic}", qos)
            for topic in ("joint_states", "motor_states")
        )
        for kind, topic in (
            (CableTensions, "tensions"),
            (NodalForces, "nodal_forces"),
            (JointState, "efforts"),
        ):
            self.heard[topic] = 0
            self.node.create_subscription(
                kind, f"/{self.namespace}/{topic}", self._listener(topic), qos, raw=True
            )

    def _listener(self, topic: str) -> Any:
        heard = self.heard

        def on_answer(_payload: bytes) -> None:
            heard[topic] += 1

        def on_tensions(_payload: bytes) -> None:
            self.tensions_at = perf_counter()
            heard[topic] += 1

        return on_tensions if topic == "tensions" else on_answer

    def is_connected(self) -> bool:
        """Whether publishers and subscriptions are matched in both directions."""
        return all(
            publisher.get_subscription_count() > 0 for publisher in (self.joints, self.motors)
        ) and all(
            self.node.count_publishers(f"/{self.namespace}/{topic}") > 0 for topic in self.heard
        )

    def trip(self, joint: bytes, motor: bytes, process: Process) -> tuple[float, float]:
        """Seconds from publishing a sample to its tensions, and to all three answers."""
        heard, spin = self.heard, self.executor.spin_once
        awaited = heard["tensions"] + 1
        begin = self.tensions_at = perf_counter()
        self.joints.publish(joint)
        self.motors.publish(motor)
        while heard["efforts"] < awaited or min(heard.values()) < awaited:
            spin(timeout_sec=HELD_S)
            if perf_counter() - begin > HELD_S:
                if process.poll() is not None:
                    raise RuntimeError(f"/{self.namespace} has ended, code {process.poll()}")
                break
        return self.tensions_at - begin, perf_counter() - begin

    def turn(self, messages: Messages, process: Process, period_s: float) -> np.ndarray:
        """Time ``TRIPS`` trips [s], shape (TRIPS, 2), one per ``period_s`` or back to back."""
        times = np.empty((TRIPS, 2))
        due = perf_counter()
        for k in range(TRIPS):
            joint, motor = next(messages)
            due += period_s
            while perf_counter() < due:
                self.executor.spin_once(timeout_sec=max(due - perf_counter(), 0.0))
            times[k] = self.trip(joint, motor, process)
        return times


@dataclass(frozen=True)
class Called:
    """A node in a process of its own, with its caller."""

    caller: Caller
    messages: Messages
    process: Process

    def turn(self, period_s: float) -> np.ndarray:
        """Time one block of trips."""
        return self.caller.turn(self.messages, self.process, period_s)


def processor_time(process: int) -> float:
    """Time that the threads of a process have run [s]."""
    tasks = Path(f"/proc/{process}/task").iterdir()
    return sum(1e-9 * int((task / "schedstat").read_text().split()[0]) for task in tasks)


def _messages(model: Model) -> Messages:
    """Readings of the sample recording at 1 kHz, played forwards and backwards endlessly."""
    motion = recorded_motion(model)
    layout = model.layout
    joint = Template(JOINT_STATE, layout.joints, ("position",))
    motor = Template(JOINT_STATE, layout.motors, ("position",))
    last = motion.stamp_ns.size - 1
    for k in count():
        sample = abs((k + last) % (2 * last) - last)
        stamp = (k + 1) * 1_000_000
        yield (
            joint.encode(stamp, position=motion.joint_angle[sample]),
            motor.encode(stamp, position=motion.motor_angle[sample]),
        )


def _write_answers(model: Model, folder: Path) -> None:
    """Write one estimate as the three messages that the relay sends."""
    robot = model.robot
    reference = Sample(
        1,
        robot.reference_motors,
        robot.reference_pose,
    )
    _, estimate = step(model, initial_state(model), reference)
    encoder = EstimateEncoder(model.layout, uncertain=True)
    estimate = replace(estimate, stddev=np.zeros(stddev_columns(model.layout).size))
    for name, message in encoder.encode(estimate)._asdict().items():
        (folder / name).write_bytes(message)


AIMS = {
    ("1 kHz", "tensions", 50): "≤ 1.06",
    ("1 kHz", "tensions", 99): "≤ 1.12",
}


def _rows(name: str, ours: np.ndarray, theirs: np.ndarray) -> list[Row]:
    """Rows of one pace; trips [s] have the shape (BLOCKS, TRIPS, 2)."""
    rows = []
    for column, answer in enumerate(("tensions", "all three answers")):
        for percent in (50, 99):
            mine, other = (
                list(np.percentile(trips[:, :, column], percent, axis=1) * 1e6)
                for trips in (ours, theirs)
            )
            aimed = AIMS.get((name, answer, percent), "")
            what = f"{name}, until {answer}, p{percent}"
            rows.append(compared(what, "µs", mine, "bare relay", other, aimed))
    return rows


@contextmanager
def callers() -> Iterator[list[Called]]:
    """Estimator and relay, each with a caller that is connected to it."""
    model = load_model(str(ROBOT))
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        node, executor = stack.enter_context(listening("caller"))
        _write_answers(model, folder)
        commands = {
            "cdrj": estimator_command(),
            "relay": node_command("relay", folder),
        }
        processes = {name: stack.enter_context(running(*one)) for name, one in commands.items()}
        nodes = [
            Called(Caller(node, executor, name), _messages(model), process)
            for name, process in processes.items()
        ]
        for called in nodes:
            spin_until(executor, called.caller.is_connected, called.process)
        gc.collect()
        gc.disable()
        yield nodes
        gc.enable()


def _turns(nodes: Sequence[Called], period_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Trips [s], shape (nodes, BLOCKS, TRIPS, 2), and processor time [s], shape (nodes, BLOCKS).

    The nodes take turns, block by block, after a block of warm-up.
    """
    trips: list[list[np.ndarray]] = [[] for _ in nodes]
    used: list[list[float]] = [[] for _ in nodes]
    for _ in range(BLOCKS + 1):
        for taken, work, called in zip(trips, used, nodes, strict=True):
            before = processor_time(called.process.pid)
            taken.append(called.turn(period_s))
            work.append(processor_time(called.process.pid) - before)
    return np.array(trips)[:, 1:], np.array(used)[:, 1:]


def _processor_row(used: np.ndarray) -> Row:
    """Processor time per sample of the estimator beside the relay's.

    Args:
        used: of a block [s], shape (2, BLOCKS).
    """
    ours, theirs = used / TRIPS * 1e6
    what = "processor time of the node per sample, 1 kHz"
    return compared(what, "µs", ours, "bare relay", theirs, "≤ 1.08")


def measure() -> list[Row]:
    """Round trip [µs]: paced at 1 kHz, then back to back; processor time of the former [µs]."""
    with callers() as nodes:
        trips, used = _turns(nodes, PERIOD_S)
        rows = [*_rows("1 kHz", *trips), _processor_row(used)]
        trips, _ = _turns(nodes, 0.0)
        return rows + _rows("back to back", *trips)
