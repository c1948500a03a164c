"""How the nodes start, spin and end: cleanly on Ctrl-C, also in the middle of a callback."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, MutableMapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Final

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.signals import SignalHandlerOptions

from cdrj_ros.foundation.errors import CdrjError

STOP_POLL_S = 0.1
"""A request to stop is seen within this time [s]."""

RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"

REACH: Final = (
    RANGE,
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "CYCLONEDDS_URI",
)
"""Variables that say with whom nodes speak."""


class RosError(CdrjError):
    """ROS cannot start: its arguments, its middleware or its security do not allow it."""


class StopRequest:
    """True once the process has been asked to end."""

    def __init__(self) -> None:
        self._asked = False

    def __bool__(self) -> bool:
        """Whether to stop."""
        return self._asked

    def ask(self, _number: int, _frame: FrameType | None) -> None:
        """A signal handler."""
        self._asked = True


def stay_on_this_machine(environment: MutableMapping[str, str]) -> bool:
    """Let nodes find others on this machine only, unless something in the environment says whom.

    Returns:
        Whether that was left to us.
    """
    if any(environment.get(name) for name in REACH):
        return False
    environment[RANGE] = "LOCALHOST"
    return True


@contextmanager
def starting() -> Iterator[None]:
    """Around the making of a context or a node: what ROS objects to, in one line.

    Raises:
        RosError: an argument, a parameter, a name, a QoS or a middleware that cannot be.
    """
    try:
        yield
    except (RuntimeError, ParameterException, NameValidationException) as error:
        words = str(error).strip().splitlines()[0]
        raise RosError(words.split(", at /")[0].removesuffix(".")) from error


@contextmanager
def ros_context(arguments: Sequence[str]) -> Iterator[StopRequest]:
    """Initialise rclpy; yields what says when to stop; shuts down in the end.

    Who says nothing of the network in the environment speaks to this machine only.

    rclpy's own handlers would end the context under a running callback, whose publishing then
    fails; here a signal only asks, and a second one does not disturb the ending.

    Raises:
        RosError: what ROS says where it cannot start.
    """
    stay_on_this_machine(os.environ)
    stop = StopRequest()
    signals = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, stop.ask) for number in signals]
    try:
        with starting():
            rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
        yield stop
    finally:
        for number in signals:
            signal.signal(number, signal.SIG_IGN)
        rclpy.try_shutdown()
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler)
