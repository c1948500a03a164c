"""What the estimator does with the messages of one input topic.  Does not depend on ROS."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from cdrj_ros._core import JointStateDecoder
from cdrj_ros.conditioning.conditioner import Kind
from cdrj_ros.estimation.session import LiveEstimator, Output
from cdrj_ros.nodes.health import HealthWatch
from cdrj_ros.nodes.thinning import Thinning
from cdrj_ros.nodes.words import TopicHeard


class Listener:
    """Takes serialised JointState messages, and gives the estimates that they lead to."""

    def __init__(
        self,
        kind: Kind,
        live: LiveEstimator,
        thinning: Thinning,
        health: HealthWatch | None,
        *,
        heard: TopicHeard,
        publish: Callable[[list[Output], float], None],
        warn: Callable[[str], None],
    ) -> None:
        """Start without a message.

        Args:
            kind: what the topic carries.
            live: the estimator.
            thinning: takes the stamps of motor readings.
            health: takes the efforts of motors; None: not wanted.
            heard: updated with every message.
            publish: called with the estimates that a message leads to, if there are any, and the
                time that each has taken [s].
            warn: called if the clock of the messages goes back.
        """
        of_motors = kind != "joints"
        self._kind, self._live = kind, live
        self._publish, self._warn, self._heard = publish, warn, heard
        self._health = health if of_motors else None
        self._thinning = thinning if of_motors and thinning.active else None
        with_efforts = live.options.track_preload or live.encoderless is not None
        self._with_efforts = with_efforts and of_motors
        self._message = JointStateDecoder(efforts=self._with_efforts)

    def on_message(self, payload: bytes) -> None:
        """Process a message; a malformed one is counted."""
        begin, message, heard = perf_counter(), self._message, self._heard
        if not message.decode(payload):
            self._live.conditioner.refuse("malformed")
            return
        heard.messages += 1
        self._take_aside(message)
        jumped, outputs = self._live.feed_message(self._kind, message)
        if jumped:
            self._warn("the clock of the inputs went back: estimate restarted")
        if outputs:
            self._publish(outputs, (perf_counter() - begin) / len(outputs))
        else:  # which may need an explanation
            heard.names, heard.positions = message.names, message.positions

    def _take_aside(self, message: JointStateDecoder) -> None:
        """Use what a message says besides the positions: its stamp and its efforts."""
        if self._thinning is not None:
            self._thinning.note(message.stamp_ns, message.names)
        fed = self._with_efforts and self._live.wants_efforts(message.stamp_ns)
        watched = self._health is not None and self._health.wants_efforts(message.stamp_ns)
        if fed:
            self._live.feed_efforts(message.stamp_ns, message.names, message.efforts)
        if self._health is not None and watched:
            self._health.read_efforts(message.stamp_ns, message.names, message.efforts)
