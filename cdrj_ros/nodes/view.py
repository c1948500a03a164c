"""The ``view`` command: a page in the browser that shows the estimates live, or those of a bag."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from cdrj_ros.commands.entry import run_command
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.output import say
from cdrj_ros.messages import topics
from cdrj_ros.nodes.robot_description import ROBOT_SETTINGS, given_model
from cdrj_ros.nodes.settings import Setting, declare, values_of
from cdrj_ros.nodes.spinning import run_node
from cdrj_ros.nodes.view_inputs import Inputs
from cdrj_ros.nodes.view_link import (
    CAPTION,
    TRIGGERS,
    EstimatorLink,
    Heard,
    slider_ranges,
    words_of,
)
from cdrj_ros.view.history import History
from cdrj_ros.view.page import PICTURE_HZ, Page
from cdrj_ros.view.panels import Controls, TimeAxis
from cdrj_ros.view.server import load_viser

AXIS: Final = TimeAxis("s before now", -60.0, 0.0)
"""Of the curves; as long as the history at the highest rate of pictures."""

SETTINGS: Final = (
    *ROBOT_SETTINGS,
    Setting("host", "localhost", "Address to listen on; 0.0.0.0: the network"),
    Setting("port", 8080, "TCP port, or the next free one; 0: any", "", 0, 65535),
    Setting("rate", PICTURE_HZ, "Rate of pictures", "Hz", 0.1, PICTURE_HZ),
    Setting(
        "references",
        (f"{topics.TRUTH}/{topics.TENSIONS}", "reference/tensions", "/reference/tensions"),
        "Topics of true or measured tensions; the first that has an element counts",
    ),
)
"""The node's parameters."""


class ViewNode(Node):
    """Shows the last messages on a page; subscribes only while a browser shows it."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters and the robot file, then open the page.

        Raises:
            CdrjError: the robot file or a parameter is invalid, or viser is not installed.
        """
        super().__init__("view", namespace=topics.NAMESPACE, **options)
        declare(self, SETTINGS)
        values = values_of(self, SETTINGS)
        self.model = given_model(self, values["robot"])
        at = (values["host"], values["port"])
        self.page = Page(self.model, *at, f"cdrj_ros · {self.model.robot.name}", AXIS)
        self.link = EstimatorLink(self, self.model)
        self._add_controls()
        self.history = History()
        self.inputs = Inputs(self, self.model, values["references"])
        self._diagnostics: Any = None
        self.heard = Heard(self.resolve_topic_name(topics.TENSIONS), self.link.name)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / values["rate"], self._on_timer, clock=steady)
        self.get_logger().info(f"open {self.page.address} in a browser")

    def _add_controls(self) -> None:
        """Fill the folder of the estimator."""
        link, gui = self.link, self.page.gui
        with self.page.below:
            self.link.controls = Controls(
                gui,
                slider_ranges(self.model),
                link.change,
                {name: (hint, link.press(name)) for name, hint in TRIGGERS.items()},
            )
        self.page.below.visible = True

    def listen(self, wanted: bool) -> bool:
        """Subscribe while a browser shows the page; returns ``wanted``."""
        if wanted and self._diagnostics is None:
            self._diagnostics = self.create_subscription(
                DiagnosticArray, topics.DIAGNOSTICS, self._on_diagnostics, topics.FEW
            )
        elif not wanted and self._diagnostics is not None:
            self.destroy_subscription(self._diagnostics)
            self._diagnostics = None
            self.history.clear()
        return self.inputs.listen(wanted)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if "/" + status.name.lstrip("/") == self.link.name or status.name.endswith(CAPTION):
                self.heard.diagnose(status)

    def _on_timer(self) -> None:
        if not self.listen(self.page.watched):
            return
        there = self.link.poll()
        try:
            shown = self.inputs.snapshot()
            if self.inputs.fresh:
                self.history.add(shown)
            publishers = self.count_publishers(self.heard.topic)
            now_ns = self.get_clock().now().nanoseconds
            words = words_of(self.heard, self.inputs, shown, there, publishers, now_ns)
            table = self.history.table() if self.page.plot_is_due() else None
            self.page.show(shown, table, words)
        except CdrjError as error:
            self.get_logger().warning(f"nothing drawn: {error}", throttle_duration_sec=5.0)


def _made(_: argparse.Namespace) -> tuple[Node, Callable[[], object]]:
    """The node, and the end of its page."""
    load_viser()
    node = ViewNode()
    say(f"view: {node.page.address}", flush=True)
    return node, node.page.close


def _body(argv: Sequence[str]) -> int:
    own = remove_ros_args(["view", *argv])[1:]
    if any(not word.startswith("-") for word in own) or "--robot" in own:
        from cdrj_ros.commands.view import body

        return body(own)
    return run_node(
        "view",
        SETTINGS,
        "view [--supervised] --ros-args -p robot:=FILE [-p NAME:=VALUE] ...\n"
        "       view BAG --robot FILE [--help]",
        "The robot in a browser: cables coloured by tension, curves over time, sliders for "
        "friction and preload. Topics in the namespace /cdrj: tensions, nodal_forces, "
        "joint_states, truth/tensions; and /diagnostics. With a BAG: the estimates of a recording.",
        _made,
        argv,
    )


main = partial(run_command, "view", _body)
"""Entry point; returns the exit code."""
