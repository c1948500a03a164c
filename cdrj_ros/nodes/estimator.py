"""The estimator node, also as a lifecycle node, and its command line."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from cdrj_ros.commands.entry import run_command
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.messages.topics import NAMESPACE
from cdrj_ros.nodes.estimation import Estimation
from cdrj_ros.nodes.parameters import estimator_file, settings
from cdrj_ros.nodes.spinning import CheckedClock, run_node, starting

SUCCESS: Final = TransitionCallbackReturn.SUCCESS


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


class ManagedEstimator(CheckedClock, LifecycleNode):
    """A lifecycle node with an ``Estimation``, whose states are those of the node.

    - ``configure`` reads the parameters and the robot file and opens outputs and services.  If the
      robot file is invalid, the node logs why and stays unconfigured.
    - ``activate`` subscribes to the inputs: every sample is estimated and published.
    - ``deactivate`` publishes the last estimate as STALE and closes the inputs.  The next
      activation continues as a new process with the same state file does.
    - ``cleanup`` closes outputs and services and unloads the robot.  Every parameter may then be
      changed, and applies from the next ``configure``.
    - ``shutdown`` does both from any state.
    """

    def __init__(self, state_file: Path | None = None, **options: Any) -> None:
        """Start unconfigured; arguments as of ``EstimatorNode``."""
        super().__init__("estimator", namespace=NAMESPACE, **options)
        self.estimation = Estimation(self, state_file, managed=True)

    def on_configure(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Load the robot."""
        try:
            with starting():
                self.estimation.configure()
        except CdrjError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        return SUCCESS

    def on_activate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Start estimating."""
        self.estimation.activate()
        return SUCCESS

    def on_deactivate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Stop estimating."""
        self.estimation.deactivate()
        return SUCCESS

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Unload the robot."""
        self.estimation.clean_up()
        return SUCCESS

    def on_shutdown(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Stop estimating and unload the robot."""
        self.estimation.shut_down()
        return SUCCESS

    def on_error(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Return to unconfigured after an unexpected error in a transition."""
        self.get_logger().fatal("a transition failed unexpectedly: unconfigured")
        if self.estimation.configured:
            self.estimation.clean_up()
        return SUCCESS


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--managed", action="store_true",
        help="start as a lifecycle node, unconfigured: configure loads the robot, activate "
        "starts estimating",
    )  # fmt: skip
    parser.add_argument(
        "--state-file", type=Path, metavar="FILE",
        help="file to which the state is written every second; the next start continues from it",
    )  # fmt: skip


def _made(own: argparse.Namespace) -> tuple[Node, Callable[[], object]]:
    """The node, and what writes its state file."""
    node = (ManagedEstimator if own.managed else EstimatorNode)(own.state_file)
    return node, node.estimation.write_state


def _body(argv: Sequence[str]) -> int:
    return run_node(
        "estimator",
        settings(),
        "estimator [--managed] [--state-file FILE] [--supervised] --ros-args -p robot:=FILE "
        "[-p timeout:=S] [-r FROM:=TO] ...",
        "Tension of every cable element and force on every pulley from motor encoders and joint "
        "angles. Topics in the namespace /cdrj: in motor_states, joint_states, tension_sensors; "
        "out tensions, nodal_forces, efforts; /diagnostics. Services: ~/reset, ~/tare, "
        "~/set_preload.",
        _made,
        argv,
        add_options=_add_options,
        file=estimator_file,
    )


main = partial(run_command, "estimator", _body)
"""Entry point; returns the exit code."""
