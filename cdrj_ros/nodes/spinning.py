"""How the nodes start, spin and end: cleanly on Ctrl-C, also in the middle of a callback."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.signals import SignalHandlerOptions

from cdrj_ros.model.errors import CdrjError

STOP_POLL_S = 0.1
"""A request to stop is seen within this time [s]."""


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

    rclpy's own handlers would end the context under a running callback, whose publishing then
    fails; here a signal only asks, and a second one does not disturb the ending.

    Raises:
        RosError: what ROS says where it cannot start.
    """
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
