"""The companion node: plays a bag's inputs to the estimator and judges its answers."""

from __future__ import annotations

import argparse
import sys
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import monotonic, perf_counter
from typing import Any

import numpy as np
from cdrj_msgs.msg import CableTensions, NodalForces
from numpy.typing import NDArray
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cdrj_ros.bag import Topics, read_messages
from cdrj_ros.commands.shared import (
    DONE,
    add_result_options,
    add_robot_option,
    add_topic_options,
    load_model,
    progress_bar,
    run_command,
    topics_of,
    write_results,
)
from cdrj_ros.conversions import AnswerReader
from cdrj_ros.estimation.comparison import BagComparison
from cdrj_ros.model.errors import CdrjError, UsageError
from cdrj_ros.model.mechanism import STALE
from cdrj_ros.model.plan import Layout, Model
from cdrj_ros.nodes.spinning import StopRequest, ros_context
from cdrj_ros.validation import (
    compare_with_references,
    condition_recording,
    read_inputs,
)

DEPTH = 1000
WINDOW = 64
"""Inputs under way at once: far fewer than any queue holds, so that none is lost."""

STALLED_S = 3.0
"""Without a new answer for so long, the inputs under way count as unanswered."""


class NoEstimatorError(CdrjError):
    """No estimator node answered."""


@dataclass
class Answers:
    """Raw messages of the estimator, in order of arrival."""

    tension: list[bytes] = field(default_factory=list)
    nodal_force: list[bytes] = field(default_factory=list)
    effort: list[bytes] = field(default_factory=list)

    def clear(self) -> None:
        """Forget all."""
        self.tension.clear()
        self.nodal_force.clear()
        self.effort.clear()


class ReplayNode(Node):
    """Publishes recorded inputs, unchanged, and keeps the estimator's answers."""

    def __init__(self, layout: Layout, **options: Any) -> None:
        """Open the topics beside an estimator's."""
        super().__init__("replay", namespace="cdrj", **options)
        self.reader = AnswerReader(layout)
        self.answers = Answers()
        self._newest = {"tension": -1, "nodal_force": -1, "effort": -1}
        qos = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)
        self.motors = self.create_publisher(JointState, "motor_states", qos)
        self.joints = self.create_publisher(JointState, "joint_states", qos)
        self.inputs = tuple({p.topic_name: p for p in (self.motors, self.joints)}.values())
        for message, topic, kind in (
            (CableTensions, "tensions", "tension"),
            (NodalForces, "nodal_forces", "nodal_force"),
            (JointState, "efforts", "effort"),
        ):
            self.create_subscription(message, topic, self._listener(kind), qos, raw=True)
        self.outputs = tuple(map(self.resolve_topic_name, ("tensions", "nodal_forces", "efforts")))

    def _listener(self, kind: str) -> Callable[[bytes], None]:
        keep = getattr(self.answers, kind).append
        newest, stamp = self._newest, self.reader.stamp

        def on_answer(payload: bytes) -> None:
            keep(payload)
            newest[kind] = stamp(payload)

        return on_answer

    @property
    def answered_ns(self) -> int:
        """Stamp up to which all three topics have been heard [ns]; -1 before the first answer."""
        return min(self._newest.values())

    def forget_answers(self) -> None:
        """Start listening anew."""
        self.answers.clear()
        for kind in self._newest:
            self._newest[kind] = -1

    def estimator_is_there(self) -> bool:
        """Whether both ways are open."""
        return all(topic.get_subscription_count() > 0 for topic in self.inputs) and all(
            self.count_publishers(topic) > 0 for topic in self.outputs
        )


@dataclass(frozen=True)
class Played:
    """What became of the inputs."""

    sent: int
    unanswered: int
    duration_s: float


def wait_for_estimator(
    node: ReplayNode, executor: EventsExecutor, stop: StopRequest, name: str, patience_s: float
) -> None:
    """Until the estimator listens, is heard, and has forgotten what was before.

    Raises:
        NoEstimatorError: after ``patience_s``.
    """
    client = node.create_client(Trigger, name + "/reset")
    deadline = monotonic() + patience_s
    while not (node.estimator_is_there() and client.service_is_ready()):
        executor.spin_once(timeout_sec=0.05)
        if stop:
            raise KeyboardInterrupt
        if monotonic() > deadline:
            raise NoEstimatorError(
                f"no estimator within {patience_s:g} s: start one with "
                "'ros2 run cdrj_ros estimator --ros-args -p robot:=FILE' in the same ROS domain"
            )
    future = client.call_async(Trigger.Request())
    executor.spin_until_future_complete(future, timeout_sec=max(deadline - monotonic(), 1.0))
    if not future.done():
        raise NoEstimatorError(f"the estimator does not answer {name}/reset")
    node.destroy_client(client)
    node.forget_answers()


def play(
    node: ReplayNode,
    executor: EventsExecutor,
    stop: StopRequest,
    path: str,
    topics: Topics,
    rate: float | None,
    last_answer_ns: int,
    progress: Callable[[float], None],
) -> Played:
    """Publish every input in order of log time, never more than the estimator keeps up with.

    Args:
        node: with an estimator beside it.
        executor: that spins the node.
        stop: ends the playing early; what was played is still judged.
        path: the bag.
        topics: its input topics.
        rate: times real time; None for as fast as the estimator keeps up.
        last_answer_ns: stamp after which no answer is to be expected [ns].
        progress: called with the log time reached [ns].
    """
    publishers: dict[str, dict[str, Any]] = {topics.motors: {}, topics.joints: {}}
    for topic, publisher in ((topics.motors, node.motors), (topics.joints, node.joints)):
        publishers[topic][publisher.topic_name] = publisher  # each message once on each topic
    under_way: deque[int] = deque()
    sent = unanswered = 0
    first_log = -1
    begin = perf_counter()
    for message in read_messages(path, list(publishers)):
        if first_log < 0:
            first_log = message.log_ns
        if rate is not None:
            due = begin + (message.log_ns - first_log) * 1e-9 / rate
            while perf_counter() < due and not stop:
                executor.spin_once(timeout_sec=max(min(due - perf_counter(), 0.01), 0.0))
        if stop:
            last_answer_ns = min(last_answer_ns, node.answered_ns)
            break
        for publisher in publishers[message.topic].values():
            publisher.publish(message.data)
        under_way.append(node.reader.stamp(message.data))
        sent += 1
        if sent % 16 == 0:
            unanswered += _let_answers_in(node, executor, under_way, WINDOW)
            progress(float(message.log_ns))
    while under_way and under_way[-1] > last_answer_ns:
        under_way.pop()  # beyond what every channel has reached: no estimate can be asked for
    unanswered += _let_answers_in(node, executor, under_way, 0)
    duration = perf_counter() - begin
    return Played(sent, unanswered, duration)


def _let_answers_in(
    node: ReplayNode, executor: EventsExecutor, under_way: deque[int], allowed: int
) -> int:
    """Spin until no more than ``allowed`` inputs wait; returns how many were given up."""
    deadline = monotonic() + STALLED_S
    newest = node.answered_ns
    executor.spin_once(timeout_sec=0.0)
    while True:
        while under_way and under_way[0] <= node.answered_ns:
            under_way.popleft()
        if len(under_way) <= allowed:
            return 0
        executor.spin_once(timeout_sec=0.05)
        if node.answered_ns != newest:
            newest = node.answered_ns
            deadline = monotonic() + STALLED_S
        elif monotonic() > deadline:
            lost = len(under_way)
            under_way.clear()
            return lost


def answers_as_channels(
    node: ReplayNode, layout: Layout
) -> tuple[NDArray[np.int64], dict[str, NDArray[np.float64]], int]:
    """Stamps and channels of the answers; an answer counts when all three topics have it."""
    stamps, tensions = node.reader.arrays("tension", node.answers.tension)
    fresh = (tensions["status"].astype(np.uint8) & STALE).max(axis=1, initial=0) == 0
    force_stamps, forces = node.reader.arrays("nodal_force", node.answers.nodal_force)
    effort_stamps, efforts = node.reader.arrays("effort", node.answers.effort)
    common = np.intersect1d(np.intersect1d(stamps[fresh], force_stamps), effort_stamps)
    incomplete = int(np.unique(stamps[fresh]).size - common.size)
    channels: dict[str, NDArray[np.float64]] = {}
    for prefix, names, own, values in (
        ("tension", layout.elements, stamps, tensions["tension"]),
        ("nodal_force", layout.pulleys, force_stamps, forces["magnitude"]),
        ("effort", layout.motors + layout.joints, effort_stamps, efforts["effort"]),
    ):
        _, first = np.unique(own, return_index=True)
        rows = first[np.searchsorted(own[first], common)]
        for k, name in enumerate(names):
            channels[f"{prefix}/{name}"] = values[rows, k]
    return common, channels, incomplete


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="replay",
        description="Play a bag's recorded inputs to a running estimator node, listen to its "
        "answers, compare them with the recorded references and report.",
    )
    parser.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 folder or .mcap file")
    add_robot_option(parser)
    parser.add_argument(
        "--rate", type=float, metavar="X",
        help="times real time (default: as fast as the estimator keeps up)",
    )  # fmt: skip
    parser.add_argument(
        "--estimator", default="/cdrj/estimator", metavar="NAME",
        help="full name of the estimator node (default %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--patience", type=float, default=120.0, metavar="S",
        help="how long to wait for the estimator [s] (default %(default)g)",
    )  # fmt: skip
    add_topic_options(parser)
    add_result_options(parser)
    return parser


def _judge_bag(
    node: ReplayNode,
    executor: EventsExecutor,
    stop: StopRequest,
    arguments: argparse.Namespace,
    model: Model,
    topics: Topics,
    path: str,
) -> BagComparison:
    """Play one bag to the estimator and compare its answers with the bag's references."""
    recording = read_inputs(path, topics, model)
    conditioned = condition_recording(model, recording)
    expected = sum(segment.stamp_ns.size for segment in conditioned.segments)
    last = max((int(s.stamp_ns[-1]) for s in conditioned.segments), default=-1)
    wait_for_estimator(node, executor, stop, arguments.estimator, arguments.patience)
    print(f"playing {path}", flush=True)
    span = float(recording.end_ns - recording.start_ns)
    with progress_bar("replaying", span) as report:
        played = play(
            node, executor, stop, path, topics, arguments.rate, last,
            lambda log_ns: report(log_ns - recording.start_ns),
        )  # fmt: skip
    stamps, channels, incomplete = answers_as_channels(node, model.layout)
    took = max(played.duration_s, 1e-9)
    facts = {
        "path": "estimator node in another process, over DDS",
        "inputs sent": f"{played.sent}",
        "estimates expected": f"{expected}",
        "estimates received": f"{stamps.size}",
        "rate achieved": f"{span * 1e-9 / took:.1f} x real time, {played.sent / took:.0f} inputs/s",
    }
    print(f"{played.sent} inputs in {played.duration_s:.2f} s ({facts['rate achieved']})")
    print(f"{stamps.size} of {expected} estimates received", flush=True)
    notes: tuple[str, ...] = ()
    missing = expected - stamps.size
    if missing or incomplete or played.unanswered:
        text = (
            f"{max(missing, 0)} expected estimates did not arrive on all three topics "
            f"({played.unanswered} inputs were given up after {STALLED_S:g} s without an answer)."
        )
        notes = (text,)
    return compare_with_references(
        model, path, recording, conditioned, stamps, channels, facts, notes
    )


def _replay(arguments: argparse.Namespace, model: Model, topics: Topics, stop: StopRequest) -> int:
    node = ReplayNode(model.layout)
    executor = EventsExecutor()
    executor.add_node(node)
    print(f"waiting for {arguments.estimator} ...", flush=True)
    comparisons = []
    for path in arguments.bags:
        comparisons.append(_judge_bag(node, executor, stop, arguments, model, topics, path))
        if stop:
            break
    title = f"{model.robot.name}: estimator node against reference"
    write_results(arguments, model, comparisons, title)
    return DONE


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(remove_ros_args(["replay", *argv])[1:])
    if arguments.rate is not None and not 0.0 < arguments.rate < 1e6:
        raise UsageError(f"--rate must be in (0, 1e6), got {arguments.rate}")
    model = load_model(arguments.robot, arguments.preload)
    topics = topics_of(arguments)
    with ros_context(["replay", *argv]) as stop:
        return _replay(arguments, model, topics, stop)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("replay", _body, sys.argv[1:] if argv is None else argv)
