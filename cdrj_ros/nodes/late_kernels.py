"""Kernels that are still being compiled when a node begins to estimate."""

from __future__ import annotations

from typing import Final

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from cdrj_ros.commands.compilation import Compilation, missing
from cdrj_ros.estimation.session import LiveEstimator

PERIOD_S: Final = 0.1
"""Time between two looks whether the compilation is over [s]."""

CATCHING_UP_S: Final = 0.02
"""Longest time that a look takes for samples that the ensemble has missed [s]."""

UNTIL_THEN: Final = (
    "the kernels of standard deviations are still being compiled: tensions are UNSURE until then"
)
FROM_NOW_ON: Final = "standard deviations from now on"
STILL_MISSING: Final = (
    "some kernels could not be compiled or kept, and tensions may stay UNSURE; "
    "python3 -m cdrj_ros.commands.compile_ahead --missing says why"
)


class LateKernels:
    """Lets a node do without kernels until they are compiled, and use them from then on."""

    def __init__(self, node: Node, live: LiveEstimator, compilation: Compilation) -> None:
        """Let the estimator do without, and look regularly whether it still has to.

        Args:
            node: the node.
            live: its estimator, before the first sample.
            compilation: of "members" of ``parts.OF_EVERY_START``.
        """
        self._node, self._live = node, live
        self._compilation: Compilation | None = compilation
        live.postpone_spread()
        self._waits_for_spread = live.spread_is_late
        if self._waits_for_spread:
            node.get_logger().info(UNTIL_THEN)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._looks = node.create_timer(PERIOD_S, self._look, clock=steady)

    def _look(self) -> None:
        if self._compilation is not None:
            if self._compilation.runs():
                return
            parts = self._compilation.parts
            self.end()
            if missing(parts):  # compiled here, they would stop the estimates
                self._looks.cancel()
                self._node.get_logger().error(STILL_MISSING)
                return
        if self._live.add_spread(CATCHING_UP_S):
            self._looks.cancel()
            if self._waits_for_spread:
                self._node.get_logger().info(FROM_NOW_ON)

    def end(self) -> None:
        """End the compilation, if it is not over."""
        if self._compilation is not None:
            self._compilation.end()
            self._compilation = None
