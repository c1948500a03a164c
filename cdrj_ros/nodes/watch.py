"""The ``watch`` command: show the estimator's tensions as a live table in the terminal."""

from __future__ import annotations

import signal
import sys
from collections import Counter
from collections.abc import Sequence
from functools import partial
from time import monotonic
from typing import Any, Final

from cdrj_msgs.msg import CableTensions
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.time import Time
from rclpy.utilities import remove_ros_args
from rich.console import Console
from rich.live import Live
from rich.table import Column, Table
from rich.text import Text

from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.foundation.output import printable
from cdrj_ros.messages import topics
from cdrj_ros.messages.cdr import CABLE_TENSIONS
from cdrj_ros.model.packing import INVALID, STALE
from cdrj_ros.nodes.feed import LastMessage, Rate
from cdrj_ros.nodes.settings import publishing_nodes, remapping
from cdrj_ros.nodes.spinning import RosError, ros_context, serving, starting
from cdrj_ros.report.status import SIGMAS, age_words, status_words

DRAW_S: Final = 0.125
"""Time between two updates of the table in a terminal [s]."""

LINE_S: Final = 1.0
"""Time between two lines if the output is not a terminal [s]."""

WAIT_S: Final = 10.0
"""How long ``--once`` waits for a message [s]."""


class WatchNode(Node):
    """Stores the last message, undecoded."""

    def __init__(self, **options: Any) -> None:
        """Subscribe best-effort, which matches every publisher; offer no parameter services."""
        super().__init__(
            "watch", namespace=topics.NAMESPACE, start_parameter_services=False, **options
        )
        self.topic = self.resolve_topic_name(topics.TENSIONS)
        self.last, self._rate = LastMessage(), Rate()
        qos = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)  # 0.1 s at 1 kHz
        self.create_subscription(CableTensions, topics.TENSIONS, self.last.hear, qos, raw=True)

    def head(self) -> str:
        """Topic, rate once it is known, and age of the last message, or why there is none."""
        if self.last.payload is None or self.last.silent():
            return self.missing()
        stamp = Time.from_msg(deserialize_message(self.last.payload, CableTensions).header.stamp)
        age_s = (self.get_clock().now() - stamp).nanoseconds * 1e-9
        hz = self._rate.hz(self.last.count)
        return ", ".join([self.topic, *([] if hz is None else [f"{hz:.0f} Hz"]), age_words(age_s)])

    def missing(self) -> str:
        """Why no message arrives."""
        if others := publishing_nodes(self, self.topic):
            return f"nothing from {', '.join(others)} on {self.topic}"
        there = remapping(self, topics.TENSIONS, CABLE_TENSIONS.name)
        return f"no publisher of {self.topic}; {there}"

    def rows(self) -> list[tuple[str, float, float, int]]:
        """Name, tension [N], two standard deviations [N] and status of all elements."""
        if self.last.payload is None:
            return []
        said = deserialize_message(self.last.payload, CableTensions)
        sigma = said.stddev or [float("nan")] * len(said.name)
        if not len(said.name) == len(said.tension) == len(said.status) == len(sigma):
            return [("arrays of different lengths", float("nan"), float("nan"), INVALID)]
        status = (int(flags) | STALE * self.last.silent() for flags in said.status)
        return list(zip(said.name, said.tension, (SIGMAS * s for s in sigma), status, strict=True))

    def table(self) -> Table:
        """All elements."""
        numbers = [Column(heading, justify="right") for heading in ("N", "±2σ")]
        title = Text(printable(self.head()))
        table = Table("element", *numbers, "status", title=title, title_justify="left")
        for name, value, spread, flags in self.rows():
            words = Text(" ").join(Text(word, style=style) for word, style in status_words(flags))
            shown = ("-", "-") if flags & INVALID else (f"{value:.2f}", f"{spread:.2f}")
            table.add_row(Text(printable(name)), *shown, words)
        return table

    def line(self) -> str:
        """The number of elements by their status, for a pipe or a log."""
        counts = Counter(word for *_, flags in self.rows() for word, _ in status_words(flags))
        said = (f"{count} {word}" for word, count in sorted(counts.items()))
        return printable("; ".join([self.head(), *said]))


def _show(node: WatchNode, executor: Executor, once: bool) -> None:
    """Print one table, or draw tables or print lines until the output is closed."""

    def spin(seconds: float) -> bool:
        end = monotonic() + seconds
        while (left := end - monotonic()) > 0.0 and not (once and node.last.payload):
            executor.spin_once(timeout_sec=left)
        return getattr(sys.stdout, "failure", None) is None

    console = Console()
    if once:
        spin(WAIT_S)
        if node.last.payload is None:
            raise RosError(node.missing())
        console.print(node.table())
    elif console.is_terminal and not console.is_dumb_terminal:
        with Live(console=console, auto_refresh=False) as live:
            while spin(DRAW_S):
                live.update(node.table(), refresh=True)
    else:
        while spin(LINE_S):
            print(node.line(), flush=True)


def _body(argv: Sequence[str]) -> int:
    parser = CommandParser(
        prog="watch",
        description="Show tensions, 2 sigma and status as a live table; in a pipe, one line per "
        "second. Another topic: --ros-args -r tensions:=/other/tensions.",
        epilog="Exit code: 0 done, 2 bad usage, or no message with --once, 130 ended by Ctrl-C.",
    )
    parser.add_argument("--once", action="store_true", help="print one table and end")
    with starting():
        once = parser.parse_args(remove_ros_args(["watch", *argv])[1:]).once
    with ros_context(["watch", *argv]):
        signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
        with starting():
            node = WatchNode()
        with serving(node) as executor:
            _show(node, executor, once)
    return DONE


main = partial(run_command, "watch", _body)
"""Entry point; returns the exit code."""
