"""The ``view`` command without ROS: show the estimates of a bag in a browser."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from cdrj_ros.commands.entry import CommandParser, run_command
from cdrj_ros.commands.shared import (
    add_channel_options,
    add_robot_option,
    channels_of,
)
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import ProgressBar, say
from cdrj_ros.model.prepared import load_model


def _parser() -> CommandParser:
    parser = CommandParser(
        prog="view",
        description="Show the estimates of a bag in a browser, with a time line: the robot in "
        "motion, its cables coloured by tension, and curves over time. The estimates are those of "
        "validate. With ROS and without a BAG, ros2 run cdrj_ros view --ros-args -p robot:=FILE "
        "shows a running estimator.",
        epilog="Exit code: 2 bad input, 130 ended by Ctrl-C. Needs the package viser (the extra "
        "view).",
    )
    parser.add_argument("bag", metavar="BAG", help="rosbag2 folder or file")
    add_robot_option(parser)
    add_channel_options(parser)
    parser.add_argument(
        "--host", default="localhost",
        help="address to listen on; 0.0.0.0 for the network (default %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--port", type=int, default=8080, metavar="N",
        help="TCP port, or the next free one; 0 for any (default %(default)s)",
    )  # fmt: skip
    return parser


def body(argv: Sequence[str]) -> int:
    """Show a bag until Ctrl-C.

    Raises:
        CdrjError: bad input, or viser is not installed.
    """
    arguments = _parser().parse_args(argv)
    if not 0 <= arguments.port <= 65535:
        raise UsageError(f"--port must be from 0 to 65535, got {arguments.port}")
    from cdrj_ros.view.server import load_viser

    load_viser()
    from cdrj_ros.view.page import PICTURE_HZ, Page
    from cdrj_ros.view.panels import TimeAxis
    from cdrj_ros.view.recorded import Player, recorded_estimates

    model = load_model(arguments.robot, arguments.preload)
    recording = read_inputs(arguments.bag, channels_of(arguments), model)
    for note in recording.notes:
        say(f"note: {arguments.bag}: {note}")
    conditioned = condition_recording(model, recording)
    with ProgressBar("estimating", 1.0) as report:
        estimates = recorded_estimates(model, recording, conditioned, report)
    axis = TimeAxis("time [s]", 0.0, max(estimates.duration_s, 1e-3))
    at = (arguments.host, arguments.port)
    page = Page(model, *at, f"cdrj_ros · {model.robot.name}", axis)
    try:
        player = Player(page, estimates, Path(arguments.bag).name)
        say(f"view: {page.address}", flush=True)
        while True:
            player.tick()
            time.sleep(1.0 / PICTURE_HZ)
    finally:
        page.close()


main = partial(run_command, "view", body)
"""Entry point; returns the exit code."""
