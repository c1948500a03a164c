"""Monitors the inputs for silence, refusals and missing axes, for the log and diagnostics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import monotonic
from typing import Final

from rclpy.node import Node

from cdrj_ros.estimation.session import LiveEstimator, Output
from cdrj_ros.nodes.diagnostics import Health
from cdrj_ros.nodes.inputs import InputTopic
from cdrj_ros.nodes.silence import Silence, StampClock
from cdrj_ros.nodes.words import missing_inputs, refusal_rate

PATIENCE_S: Final = 3.0
"""Time without an estimate after which the reason is logged [s]."""

AGAIN_S: Final = 10.0
"""Minimum time between two equal warnings [s]."""


class InputWatch:
    """Detects when estimates begin, stop and resume, and why there is none."""

    def __init__(
        self,
        node: Node,
        live: LiveEstimator,
        inputs: Sequence[InputTopic],
        silence: Silence,
        now_ns: Callable[[], int],
        stamps: StampClock,
    ) -> None:
        """Start without an estimate.

        Args:
            node: provides the log.
            live: provides the counters.
            inputs: the subscribed topics; those that carry axes are named in the log.
            silence: measures the time since the last estimate.
            now_ns: returns the time of the node's clock [ns].
            stamps: knows how late the stamps of the inputs are.
        """
        self._node, self._live, self._inputs = node, live, inputs
        self._silence, self._now_ns, self._stamps = silence, now_ns, stamps
        self._refused: dict[str, int] = {}
        self.looked_s = self.estimated_s = monotonic()
        """Steady times of the last call of ``health`` and of the last estimate [s]."""
        self._first = True
        """Whether there has been no estimate since the start."""
        self._quiet = True
        """Whether there has been no estimate since the start or, as logged, for the timeout."""

    def silence_s(self) -> float:
        """Time since the last estimate [s]; infinite before the first."""
        return self._silence.seconds(self._now_ns(), monotonic())

    def note(self) -> None:
        """Record an estimate; log the first one, and the first one after a silence."""
        now_s = monotonic()
        self._silence.note(self._now_ns(), now_s)
        if self._quiet:
            since_s = now_s - self.estimated_s
            self._node.get_logger().info(
                f"first estimate, {since_s:.1f} s after the start"
                if self._first
                else f"inputs are back after {since_s:.1f} s"
            )
            self._first = self._quiet = False
        self.estimated_s = now_s

    def lost(self) -> bool:
        """Whether the inputs have been silent for the timeout; logged once."""
        silence_s = self.silence_s()
        if silence_s <= self._silence.timeout_s:
            return False
        if not self._quiet:
            self._quiet = True
            self._node.get_logger().warning(
                f"inputs lost: no estimate for {silence_s:.2g} s; outputs are STALE"
            )
        return True

    def health(self, output: Output | None, rate_hz: float, clock_refused: int) -> Health:
        """State of the inputs and outputs; call once a second."""
        conditioner = self._live.conditioner
        silence_s = self.silence_s()
        now_s = monotonic()
        refused = conditioner.refused
        _, refusing = refusal_rate(refused, self._refused, now_s - self.looked_s)
        self._refused, self.looked_s = refused, now_s
        for one in self._inputs:
            one.heard.look(now_s)
        age = float("inf")
        if output is not None:
            lag_s = conditioner.lag_ns * 1e-9
            age = self._stamps.age_s(output.estimate.stamp_ns, self._now_ns(), lag_s, silence_s)
        waiting = ""
        if self._quiet or output is None:
            self._adapt()
            waiting = missing_inputs(
                [one.heard for one in self._inputs if one.heard.axes],
                conditioner.unheard,
                refused,
                self._live.model.robot,
            )
        timeout_s = self._silence.timeout_s
        return Health(timeout_s, silence_s, age, rate_hz, waiting, refusing, clock_refused)

    def _adapt(self) -> None:
        """Subscribe best-effort to topics with best-effort publishers, and log it."""
        for one in self._inputs:
            if words := one.look():
                self._node.get_logger().warning(words, throttle_duration_sec=AGAIN_S)

    def warn(self, health: Health) -> None:
        """Log why there is no estimate or why many readings are refused, at most every AGAIN_S."""
        words = ""
        if health.waiting and monotonic() - self.estimated_s > PATIENCE_S:
            self._quiet = True
            words = f"no estimate: {health.waiting}"
        elif health.refusing and not self._quiet:
            words = health.refusing
        if words:
            self._node.get_logger().warning(words, throttle_duration_sec=AGAIN_S)
