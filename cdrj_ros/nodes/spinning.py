"""Starts and ends nodes: cleanly on Ctrl-C, also in the middle of a callback."""

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
from cdrj_ros.foundation.interruption import deferring

STOP_POLL_S: Final = 0.1
"""A request to stop is seen within this time [s]."""

SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
"""Signals that ask a node to stop."""

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
"""Variables that choose the computers that nodes talk to."""


class RosError(CdrjError):
    """ROS cannot start: its arguments, its middleware or its security do not allow it."""


class StopRequest:
    """True once the process has been asked to stop."""

    def __init__(self) -> None:
        self._asked = False

    def __bool__(self) -> bool:
        """Whether to stop."""
        return self._asked

    def ask(self, _number: int, _frame: FrameType | None) -> None:
        """Handle a signal."""
        self._asked = True

    @contextmanager
    def listening(self) -> Iterator[None]:
        """While inside, SIGINT and SIGTERM only ask; the caller looks and ends cleanly.

        rclpy's own handlers would shut the context down below a running callback, whose
        publishing would then fail.  On leaving, both signals are ignored until the context is
        shut down, so that a second Ctrl-C does not disturb the ending.
        """
        with deferring():
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


@contextmanager
def starting() -> Iterator[None]:
    """Turn what ROS objects to while a context or a node is made into one line.

    Raises:
        RosError: an argument, a parameter, a name, a QoS or a middleware that is not possible.
    """
    try:
        yield
    except (RuntimeError, ParameterException, NameValidationException) as error:
        words = str(error).strip().splitlines()[0]
        raise RosError(words.split(", at /")[0].removesuffix(".")) from error


@contextmanager
def ros_context(arguments: Sequence[str]) -> Iterator[StopRequest]:
    """Initialise rclpy and shut it down in the end; yields the request to stop.

    If the environment does not say which computers to talk to, it is this one only.  Until
    ``StopRequest.listening`` a signal ends the process as it would end any command.

    Raises:
        RosError: what ROS says if it cannot start.
    """
    stay_on_this_machine(os.environ)
    try:
        with starting():
            rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
        yield StopRequest()
    finally:
        before = [signal.signal(number, signal.SIG_IGN) for number in SIGNALS]
        rclpy.try_shutdown()
        for number, handler in zip(SIGNALS, before, strict=True):
            signal.signal(number, handler)
