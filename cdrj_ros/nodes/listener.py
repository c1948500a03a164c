"""What the estimator does with the messages of one input topic.  Does not depend on ROS."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from cdrj_ros.estimation.output import Output
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.messages.cdr import MessageError
from cdrj_ros.messages.decoders import JointStateDecoder, KnownJointState
from cdrj_ros.nodes.health import HealthWatch
from cdrj_ros.nodes.thinning import Thinning
from cdrj_ros.nodes.words import TopicHeard


class Listener:
    """Takes serialised JointState messages, and gives the estimates that they lead to."""

    def __init__(
        self,
        kind: str,
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
            kind: ``motors``, ``joints`` or ``both``.
            live: the estimator.
            thinning: takes the stamps of motor readings.
            health: takes the efforts of motors; None: not wanted.
            heard: updated with every message.
            publish: called with the estimates that a message leads to, if there are any, and the
                time that each has taken [s].
            warn: called if the clock of the messages goes back.
        """
        of_motors = kind != "joints"
        self._kind, self._live, self._conditioner = kind, live, live.conditioner
        self._publish, self._warn, self._heard = publish, warn, heard
        self._health = health if of_motors else None
        self._thinning = thinning if of_motors and thinning.active else None
        with_efforts = live.options.track_preload or live.alone is not None
        self._with_efforts = with_efforts and of_motors
        self._efforts = self._with_efforts or self._health is not None
        """Whether anything may want efforts."""
        self._decode = JointStateDecoder(self._with_efforts)

    def on_message(self, payload: bytes) -> None:
        """Process a message."""
        begin = perf_counter()
        outputs = self._outputs_of(payload)
        if outputs:
            self._publish(outputs, (perf_counter() - begin) / len(outputs))

    def _outputs_of(self, payload: bytes) -> list[Output]:
        """The estimates that a message leads to; a malformed one is counted."""
        try:
            stamp, names, position = self._decode(payload)
        except MessageError:
            self._conditioner.refuse("malformed")
            return []
        known, heard = self._decode.last, self._heard
        assert known is not None
        heard.messages += 1
        heard.names, heard.positions = names, position
        self._take_aside(stamp, known, payload)
        jumped, outputs = self._live.feed(self._kind, stamp, names, position)
        if jumped:
            self._warn("the clock of the inputs went back: estimate restarted")
        return outputs

    def _take_aside(self, stamp: int, known: KnownJointState, payload: bytes) -> None:
        """Use what a message says besides the positions: its stamp and its efforts."""
        if self._thinning is not None:
            self._thinning.note(stamp, known.names)
        fed = self._with_efforts and self._live.wants_efforts(stamp)
        watched = self._health is not None and self._health.wants_efforts(stamp)
        if not (fed or watched):
            return
        efforts = known.efforts(payload)
        if fed:
            self._live.feed_efforts(stamp, known.names, efforts)
        if self._health is not None and watched:
            self._health.read_efforts(stamp, known.names, efforts)
