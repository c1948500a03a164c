"""The estimator node and its command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rclpy.utilities import remove_ros_args

from cdrj_ros.commands.running import DONE, run_command
from cdrj_ros.messages.topics import NAMESPACE
from cdrj_ros.nodes.estimation import Estimation
from cdrj_ros.nodes.parameters import estimator_file
from cdrj_ros.nodes.spinning import (
    CheckedClock,
    OneLineParser,
    add_node_options,
    exit_code,
    ros_context,
    spin_until_stopped,
    starting,
)


class EstimatorNode(CheckedClock):
    """Computes tensions, nodal forces and efforts from encoder readings, from its start on."""

    def __init__(self, state_file: Path | None = None, **options: Any) -> None:
        """Read the parameters and start.

        Args:
            state_file: see ``Estimation``.
            options: passed to rclpy's Node.

        Raises:
            CdrjError: a parameter or the robot file is missing or invalid.
        """
        super().__init__("estimator", namespace=NAMESPACE, **options)
        self.estimation = Estimation(self, state_file)
        self.estimation.configure()
        self.estimation.activate()


def _arguments(arguments: list[str]) -> argparse.Namespace:
    parser = OneLineParser(
        prog="estimator",
        usage="estimator [--managed] [--state-file FILE] [--supervised] --ros-args -p robot:=FILE "
        "[-p timeout:=S] [-r FROM:=TO] ...",
        description="Tension of every cable element and force on every pulley from motor encoders "
        "and joint angles. Topics in the namespace /cdrj: in motor_states, joint_states, "
        "tension_sensors; out tensions, nodal_forces, efforts; /diagnostics. Services: ~/reset, "
        "~/tare, ~/set_preload.",
    )
    parser.add_argument(
        "--managed", action="store_true",
        help="start as a lifecycle node, unconfigured: configure loads the robot, activate "
        "starts estimating",
    )  # fmt: skip
    parser.add_argument(
        "--state-file", type=Path, metavar="FILE",
        help="file to which the state is written every second; the next start continues from it",
    )  # fmt: skip
    add_node_options(parser)
    return parser.parse_args(arguments)


def _body(argv: Sequence[str]) -> int:
    arguments = ["estimator", *argv]
    with starting():
        own = _arguments(remove_ros_args(arguments)[1:])
    if own.print_parameters:
        print(estimator_file(), end="")
        return DONE
    with ros_context(arguments) as stop:
        if own.managed:
            from cdrj_ros.nodes.managed import spin_managed

            spin_managed(own.state_file, stop)
        else:
            with starting():
                node = EstimatorNode(own.state_file)
            spin_until_stopped(node, stop, node.estimation.write_state)
    return exit_code("estimator", stop, supervised=own.supervised)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("estimator", _body, sys.argv[1:] if argv is None else argv)
