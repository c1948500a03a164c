"""The ``watch`` command: show the estimator's tensions as a live table in the terminal."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Callable, Sequence
from time import monotonic
from types import FrameType
from typing import Any, Final, NoReturn, TextIO

from cdrj_msgs.msg import CableTensions, NodalForces
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.utilities import remove_ros_args
from rich.console import Console
from rich.live import Live

from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.messages import topics
from cdrj_ros.messages.cdr import CABLE_TENSIONS, NODAL_FORCES, MessageError
from cdrj_ros.nodes.feed import Feed
from cdrj_ros.nodes.settings import remapping
from cdrj_ros.nodes.spinning import RANGE, ros_context, starting
from cdrj_ros.report.live_table import View, live_table, plain_line

DRAW_S: Final = 0.125
"""Time between two updates of the table in a terminal [s]."""

LINE_S: Final = 1.0
"""Time between two lines if the output is not a terminal [s]."""

WAIT_S: Final = 10.0
"""How long ``--once`` waits for a message [s]."""

DEPTH: Final = 100
"""Queue depth of a topic [messages]: 0.1 s at 1 kHz."""


class NothingHeardError(CdrjError):
    """No message was received in time."""


class WatchNode(Node):
    """Stores the last message of every topic."""

    def __init__(self, forces: bool, pattern: str, **options: Any) -> None:
        """Subscribe best-effort, which matches every publisher; offer no parameter services."""
        super().__init__(
            "watch", namespace=topics.NAMESPACE, start_parameter_services=False, **options
        )
        self._pattern = pattern
        self._diagnosed: dict[str, DiagnosticStatus] = {}
        self._qos: dict[str, QoSProfile] = {}
        topic = self.resolve_topic_name(topics.TENSIONS)
        self.tensions = Feed(topic=topic, message=CABLE_TENSIONS, title="element", value="tension")
        self.feeds = [self.tensions]
        self._listen(CableTensions, self.tensions)
        if forces:
            topic = self.resolve_topic_name(topics.NODAL_FORCES)
            forces_on = Feed(topic=topic, message=NODAL_FORCES, title="pulley", value="magnitude")
            self.feeds.append(forces_on)
            self._listen(NodalForces, forces_on)
        self.create_subscription(
            DiagnosticArray, topics.DIAGNOSTICS, self._on_diagnostics, topics.FEW
        )

    def _listen(self, message: Any, feed: Feed) -> None:
        qos = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._qos[feed.topic] = qos  # rclpy applies the overrides to this object
        self.create_subscription(
            message, feed.topic, feed.hear, qos, raw=True,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )  # fmt: skip

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._diagnosed["/" + status.name.lstrip("/")] = status

    def heard_all(self) -> bool:
        """Whether every topic has received a message."""
        return all(feed.payload is not None for feed in self.feeds)

    def view(self) -> View:
        """The current content of the table."""
        sections, notes, age = [], [], None
        now_ns = self.get_clock().now().nanoseconds
        for feed in self.feeds:
            if feed.silent():
                notes.append(self.missing(feed))
            elif feed.payload is None:
                notes.append(f"waiting for {feed.topic}")
            if feed.payload is None:
                continue
            try:
                stamp_ns, section = feed.read(self._pattern)
            except MessageError as error:
                notes.append(f"{feed.topic}: {error}")
                continue
            sections.append(section)
            if not section.lines:
                notes.append(f"no {feed.title} matches {self._pattern!r}")
            if feed is self.tensions:
                age = (now_ns - stamp_ns) * 1e-9
        publishers = self._endpoints(self.tensions)
        if len(publishers) > 1:
            notes.append(
                f"{self.tensions.topic} has {len(publishers)} publishers: "
                + ", ".join(map(_full_name, publishers))
            )
        known = (self._diagnosed.get(_full_name(one)) for one in publishers)
        status = next(filter(None, known), None)
        if status is not None and status.level != DiagnosticStatus.OK:
            notes.append(f"{status.name}: {status.message}")
        return View(
            self.tensions.topic,
            tuple(sections),
            status.hardware_id if status is not None else "",
            self.tensions.rate_hz(),
            age,
            tuple(notes),
        )

    def _endpoints(self, feed: Feed) -> list[Any]:
        return list(self.get_publishers_info_by_topic(feed.topic))

    def missing(self, feed: Feed) -> str:
        """Explain why no message arrives on a topic."""
        there = self._endpoints(feed)
        if not there:
            return self._no_publisher(feed)
        fitting = [one for one in there if one.topic_type == feed.message.name]
        if not fitting:
            return (
                f"{feed.topic} is published by {_full_name(there[0])} as {there[0].topic_type}, "
                f"not as {feed.message.name}"
            )
        for one in fitting:
            fits, reason = qos_check_compatible(one.qos_profile, self._qos[feed.topic])
            if fits == QoSCompatibility.ERROR:
                return (
                    f"the QoS of {feed.topic} at {_full_name(one)} does not fit this "
                    f"subscription: {reason.removeprefix('ERROR: ').rstrip(';')}"
                )
        silent = f"{monotonic() - feed.heard_s:.0f} s"
        return f"nothing from {_full_name(fitting[0])} on {feed.topic} for {silent}"

    def _no_publisher(self, feed: Feed) -> str:
        domain = os.environ.get("ROS_DOMAIN_ID") or "0"
        reach = os.environ.get(RANGE) or "SUBNET"
        text = f"no publisher of {feed.topic} in ROS domain {domain}, {RANGE}={reach}"
        elsewhere = remapping(self, feed.topic, feed.message.name)
        return f"{text}; {elsewhere}" if elsewhere else text


def _full_name(endpoint: Any) -> str:
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"must be in (0, 1e9), got {text}")
    return value


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        prog="watch",
        description="Show the estimator's tensions, their 2 sigma and status as a live table; in a "
        "pipe, one line per second. Topics: "
        f"{topics.in_namespace(topics.TENSIONS)}, {topics.in_namespace(topics.NODAL_FORCES)}; "
        "remap them with "
        "--ros-args -r tensions:=/other/tensions.",
        epilog="Exit code: 0 done, 2 bad usage, or no message with --once, 130 ended by Ctrl-C.",
    )
    parser.add_argument(
        "--once", type=_positive, nargs="?", const=WAIT_S, metavar="S",
        help=f"print one table and end; wait at most S seconds for a message ({WAIT_S:g})",
    )  # fmt: skip
    parser.add_argument(
        "--forces", action="store_true", help="show the forces on the pulleys as well"
    )
    parser.add_argument(
        "--only", default="*", metavar="PATTERN",
        help="show the elements and pulleys of these names, for instance 'upper/*'",
    )  # fmt: skip
    return parser


def _never() -> bool:
    return False


def _spin(executor: EventsExecutor, seconds: float, until: Callable[[], bool] = _never) -> bool:
    """Run callbacks for a time, or until ``until()`` is true; returns its last value."""
    end = monotonic() + seconds
    while not until() and (left := end - monotonic()) > 0.0:
        executor.spin_once(timeout_sec=left)
    return until()


def _print_once(node: WatchNode, executor: EventsExecutor, wait_s: float, out: TextIO) -> None:
    if not _spin(executor, wait_s, node.heard_all):
        silent = next(feed for feed in node.feeds if feed.payload is None)
        raise NothingHeardError(node.missing(silent))
    console = Console(file=out)
    console.print(live_table(node.view()))


def _print_lines(node: WatchNode, executor: EventsExecutor, out: TextIO) -> None:
    while _is_read(out):
        _spin(executor, LINE_S)
        print(plain_line(node.view()), file=out, flush=True)


def _draw(node: WatchNode, executor: EventsExecutor, console: Console) -> None:
    with Live(console=console, auto_refresh=False) as live:
        while _is_read(console.file):
            live.update(live_table(node.view()), refresh=True)
            _spin(executor, DRAW_S)


def _is_read(stream: Any) -> bool:
    """Whether writing to the stream has not failed so far."""
    return getattr(stream, "failure", None) is None


def _end(number: int, _frame: FrameType | None) -> NoReturn:
    """Handle SIGTERM: exit through SystemExit, which restores the terminal."""
    sys.exit(128 + number)


def _body(argv: Sequence[str]) -> int:
    everything = ["watch", *argv]
    with starting():
        arguments = _parser().parse_args(remove_ros_args(everything)[1:])
    with ros_context(everything):
        signal.signal(signal.SIGTERM, _end)
        with starting():
            node = WatchNode(arguments.forces, arguments.only)
        executor = EventsExecutor()
        executor.add_node(node)
        try:
            console = Console()
            if arguments.once:
                _print_once(node, executor, arguments.once, sys.stdout)
            elif console.is_terminal and not console.is_dumb_terminal:
                _draw(node, executor, console)
            else:
                _print_lines(node, executor, sys.stdout)
        finally:
            executor.shutdown()
            node.destroy_node()
    return DONE


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("watch", _body, sys.argv[1:] if argv is None else argv)
