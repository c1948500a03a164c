"""Start, spin and shut down nodes; Ctrl-C ends them cleanly, even during a callback."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Final, NoReturn

import rclpy
from rclpy.exceptions import InvalidHandle, NameValidationException, ParameterException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock

from cdrj_ros.commands.entry import DONE
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.foundation.interruption import INTERRUPTED, announce_interruption
from cdrj_ros.foundation.output import say
from cdrj_ros.nodes.settings import RANGE, Setting, parameter_file, refuse_unknown_parameters

STOP_POLL_S: Final = 0.1
"""Maximum time until a stop request is noticed [s]."""

SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
"""Signals that ask a node to stop."""

REACH: Final = (
    RANGE,
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "CYCLONEDDS_URI",
)
"""Environment variables that determine with which computers nodes communicate."""

LOG_FOLDERS: Final[Mapping[str, str]] = {"ROS_LOG_DIR": "", "ROS_HOME": "log", "HOME": ".ros/log"}
"""Environment variables that determine where ROS keeps log files, the first that is set, and the
folder in it."""


class RosError(CdrjError):
    """ROS cannot start because of its arguments, its middleware or its security settings."""


class OneLineParser(argparse.ArgumentParser):
    """Reports a usage error in one line, without the usage text."""

    def error(self, message: str) -> NoReturn:
        """Raise the message.

        Raises:
            UsageError: always.
        """
        raise UsageError(f"{message}; see --help")


class StopRequest:
    """True once the process has been asked to stop."""

    def __init__(self) -> None:
        self._number = 0

    def __bool__(self) -> bool:
        """Whether to stop."""
        return self._number != 0

    @property
    def interrupted(self) -> bool:
        """Whether it was Ctrl-C that asked."""
        return self._number == signal.SIGINT

    def ask(self, number: int, _frame: FrameType | None) -> None:
        """Handle a signal."""
        self._number = self._number or number

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Make SIGINT and SIGTERM only set this request; the caller polls it and ends cleanly.

        rclpy's own handlers would shut the context down during a running callback, which could
        then no longer publish.  On exit, both signals are ignored until the context is shut
        down, so that a second Ctrl-C does not interrupt the shutdown.
        """
        for number in SIGNALS:
            signal.signal(number, self.ask)
        try:
            yield
        finally:
            for number in SIGNALS:
                signal.signal(number, signal.SIG_IGN)


def stay_on_this_machine(environment: MutableMapping[str, str]) -> bool:
    """Limit discovery to this machine, unless a variable of ``REACH`` is set.

    Returns:
        Whether it was limited.
    """
    if any(environment.get(name) for name in REACH):
        return False
    environment[RANGE] = "LOCALHOST"
    return True


class CheckedClock(Node):
    """A node that drops invalid times on /clock, which would make rclpy end it."""

    clock_refused = 0
    """Number of invalid times received."""

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, *a: Any, **k: Any
    ) -> Any:
        """As in rclpy, which itself subscribes to /clock by it."""
        if msg_type is not Clock:
            return super().create_subscription(msg_type, topic, callback, *a, **k)

        def on_clock(message: Clock) -> None:
            if message.clock.sec >= 0 and message.clock.nanosec < 1_000_000_000:
                callback(message)
            else:
                self.clock_refused += 1

        return super().create_subscription(msg_type, topic, on_clock, *a, **k)


@contextmanager
def starting() -> Iterator[None]:
    """Convert errors of ROS during the creation of a context or node into one line.

    Raises:
        RosError: an argument, parameter, name, QoS or middleware is invalid.
    """
    try:
        yield
    except (RuntimeError, ParameterException, NameValidationException) as error:
        words = str(error).strip().splitlines()[0]
        raise RosError(words.split(", at /")[0].removesuffix(".")) from error


def _no_log_files(environment: Mapping[str, str]) -> str:
    """Why ROS cannot keep log files; empty if it can."""
    given = [(name, environment[name]) for name in LOG_FOLDERS if environment.get(name)]
    if not given:
        return f"none of {', '.join(LOG_FOLDERS)} is set"
    name, value = given[0]
    folder = Path(value).expanduser() / LOG_FOLDERS[name]
    there = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    usable = there.is_dir() and os.access(there, os.W_OK | os.X_OK)
    return "" if usable else f"{there} is not a folder that can be written to"


@contextmanager
def ros_context(arguments: Sequence[str]) -> Iterator[StopRequest]:
    """Initialise rclpy and shut it down on exit; yields the request to stop.

    Discovery is limited to this computer unless the environment says otherwise.  Until
    ``StopRequest.listening`` is entered, a signal ends the process as it ends any command.

    Raises:
        RosError: ROS cannot start.
    """
    stay_on_this_machine(os.environ)
    try:
        with starting():
            if reason := _no_log_files(os.environ):
                say(f"no log file: {reason}; ROS_LOG_DIR names another folder", file=sys.stderr)
                arguments = [*arguments, "--ros-args", "--disable-external-lib-logs"]
            rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
        yield StopRequest()
    finally:
        before = [signal.signal(number, signal.SIG_IGN) for number in SIGNALS]
        rclpy.try_shutdown()
        for number, handler in zip(SIGNALS, before, strict=True):
            signal.signal(number, handler)


@contextmanager
def serving(node: Node) -> Iterator[EventsExecutor]:
    """An executor of the node's callbacks; on exit, the node is destroyed after its executor.

    The executor is rclpy's ``EventsExecutor``: with the ``SingleThreadedExecutor``, the estimator
    takes more than twice the processor time at 1 kHz.
    """
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        yield executor
    finally:  # in this order: the executor must not serve a destroyed node
        executor.shutdown()
        node.destroy_node()


def exit_code(name: str, stop: StopRequest, *, supervised: bool) -> int:
    """Exit code of a node that has been asked to stop; prints the line of an interruption."""
    if supervised or not stop.interrupted:
        return DONE
    announce_interruption(name)
    return INTERRUPTED


def spin_until_stopped(
    node: Node, stop: StopRequest, before_end: Callable[[], object] | None = None
) -> None:
    """Run a node's callbacks until ``stop`` is set, then destroy the node.

    A request for a transition that the present state of a lifecycle node does not have is logged:
    rclpy raises where such a request gives the transition's number, and does not answer.

    Args:
        node: the node; it logs first if discovery is limited to this machine.
        stop: the request yielded by ``ros_context``.
        before_end: called after the last callback, even if a callback has raised.
    """
    if os.environ.get(RANGE) == "LOCALHOST":
        node.get_logger().info(
            f"reachable from this machine only; {RANGE}=SUBNET opens the network"
        )
    with stop.listening(), serving(node) as executor:
        try:
            while not stop:
                try:
                    executor.spin_once(timeout_sec=STOP_POLL_S)
                except InvalidHandle:  # an event of a topic that a callback has closed meanwhile
                    continue
                except RuntimeError as error:
                    if "Transition is not registered" not in str(error):
                        raise
                    node.get_logger().error(str(error))
        finally:
            if before_end is not None:
                before_end()


def run_node(
    name: str,
    settings: Sequence[Setting],
    usage: str,
    description: str,
    make: Callable[[argparse.Namespace], tuple[Node, Callable[[], object] | None]],
    argv: Sequence[str],
    *,
    add_options: Callable[[argparse.ArgumentParser], None] = lambda _: None,
    file: Callable[[], str] | None = None,
) -> int:
    """Parse the command line of a node, make it and run it until it is asked to stop.

    Args:
        name: of the node.
        settings: its parameters.
        usage: line of the help.
        description: sentences of the help; the names of the parameters are added.
        make: makes the node and what is called before its end.
        argv: the command line without the program.
        add_options: adds further options, which ``make`` takes.
        file: its parameter file; None: that of ``parameter_file``.

    Returns:
        The exit code.

    Raises:
        CdrjError: an argument, a parameter or the robot file is invalid.
    """
    arguments = [name, *argv]
    parameters = ", ".join(one.name for one in settings)
    parser = OneLineParser(
        prog=name, usage=usage, description=f"{description} Parameters: {parameters}."
    )
    add_options(parser)
    parser.add_argument(
        "--print-parameters", action="store_true",
        help="print a parameter file with every parameter, its default, unit and range, and exit",
    )  # fmt: skip
    parser.add_argument(
        "--supervised", action="store_true",
        help="exit with code 0 on SIGINT, which ros2 launch and systemd take for a clean end; "
        f"otherwise with {INTERRUPTED}",
    )  # fmt: skip
    with starting():
        own = parser.parse_args(remove_ros_args(arguments)[1:])
    if own.print_parameters:
        print(file() if file else parameter_file(name, settings), end="")
        return DONE
    refuse_unknown_parameters(arguments, settings)
    with ros_context(arguments) as stop:
        with starting():
            node, before_end = make(own)
        spin_until_stopped(node, stop, before_end)
    return exit_code(name, stop, supervised=own.supervised)
