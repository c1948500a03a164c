"""Plays recordings to an estimator node and collects its answers."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import monotonic, perf_counter
from typing import Any, Final

from rclpy.experimental import EventsExecutor

from cdrj_ros.estimation.conditioner import Kind
from cdrj_ros.evaluation.answers import Answers, Run, Tally
from cdrj_ros.evaluation.replayed import NodeSettings, require_every_sample
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import ProgressBar
from cdrj_ros.messages.cdr import stamped
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.replay_node import NoEstimatorError, ReplayNode
from cdrj_ros.nodes.spinning import StopRequest
from cdrj_ros.recordings.source import Playback, RawMessage, rate_in_words

Routes = dict[str, list[tuple[Any, Callable[[bytes, int], None]]]]
"""By topic in the bag: functions that publish a message, each with one to predict the answers."""

WINDOW: Final = 64
"""Maximum number of estimates in flight; far below any queue depth, so that none is lost."""

BATCH: Final = 16
"""Maximum number of messages sent before answers are processed."""

UNANSWERABLE: Final = 256
"""Number of consecutive inputs without an expected estimate (because a channel is slow or late)
after which the replay waits until the estimator has processed them."""

UPDATE_S: Final = 0.02
"""Time between two updates of the clock and the display [s]."""

PRESENCE_S: Final = 0.5
"""Time between two checks that the estimator is still there [s]."""

PATIENCE_S: Final = 120.0
"""Time after which a replay without an estimator is given up [s]."""

NEWS_S: Final = 3.0
"""Time between two messages that list what is still missing [s]."""

SETTLE_S: Final = 2.0
"""Maximum time to wait for other subscribers, so that they do not miss messages [s]."""

ANSWERS_S: Final = 0.5
"""Maximum time to wait for answers in flight after a signal [s]."""


class Ending(enum.Enum):
    """Reason for the end of a pass."""

    END = "at the end"
    USER = "by the user"
    GONE = "because the estimator disappeared"


@dataclass(frozen=True, eq=False)
class Played:
    """One pass: what was played since a reset of the estimator, and its answers."""

    answers: Answers
    ending: Ending
    span_s: float
    """Duration of the played part of the recording [s]."""
    wall_s: float
    """Elapsed wall time [s]."""
    behind_s: float
    """Maximum delay of a message after its due time [s]; 0 if played as fast as possible."""


class Player:
    """Plays recordings, one pass at a time, and shows the progress."""

    def __init__(
        self, model: Model, node: ReplayNode, executor: EventsExecutor, stop: StopRequest
    ) -> None:
        """Store the components; ``executor`` spins ``node``."""
        self.model = model
        self.node = node
        self.executor = executor
        self.bar = ProgressBar()
        self.estimator = NodeSettings()
        """Settings of the estimator; valid after ``wait_for_estimator``."""
        self._stop = stop
        self._before = Tally()
        """Counters of the earlier passes."""
        self._update_s = 0.0
        self._presence_s = 0.0
        self._clock_s = 0.0
        self._reached_ns = 0
        self._gone = False

    def wait_for_estimator(self) -> bool:
        """Wait until the estimator is connected in both directions; False if the user stops.

        Raises:
            NoEstimatorError: the estimator is not connected after ``PATIENCE_S``.
            UsageError: the estimator does not publish every estimate, or hears others, too.
        """
        begin = monotonic()
        news = begin + NEWS_S
        told: list[str] = []
        while missing := self.node.missing():
            self.executor.spin_once(timeout_sec=0.05)
            if self._stop:
                return False
            now = monotonic()
            if now - begin > PATIENCE_S:
                raise NoEstimatorError(
                    f"no estimator within {PATIENCE_S:g} s ({'; '.join(missing)}): start one with "
                    "'ros2 run cdrj_ros estimator --ros-args -p robot:=FILE' in the same ROS domain"
                )
            if now > news:
                news = now + NEWS_S
                what = "" if missing == told else f": {'; '.join(missing)}"
                self.bar.say(f"still waiting after {now - begin:.0f} s{what}")
                told = missing
        settled = monotonic() + SETTLE_S
        while self.node.unconnected() and monotonic() < settled and not self._stop:
            self.executor.spin_once(timeout_sec=0.05)
        for topic in self.node.unconnected():
            self.bar.say(f"warning: a listener of {topic} has a QoS that does not fit")
        self._refuse_other_publishers()
        self.estimator = self.node.settings(self.executor)
        require_every_sample(self.estimator)
        for topic in (one for one in self.node.outputs if self.node.count_publishers(one) > 1):
            self.bar.say(f"warning: several nodes publish {topic}; their answers are mixed")
        return True

    def play(self, playback: Playback) -> Played:
        """Play one pass from a reset of the estimator on.

        Raises:
            UsageError: others publish the estimator's inputs, too.
            NoEstimatorError: the estimator does not reset, or answers none of the inputs.
            AnotherRobotError: the estimator uses another robot.
        """
        self.node.reset_estimator(self.executor)
        run = Run(self.model, self.estimator.conditioning)
        self.node.listen(run)
        begin_s = perf_counter()
        total_s = (playback.end_ns - playback.begin_ns) * 1e-9
        self.bar.begin(f"playing {rate_in_words(playback.rate)}", total_s)
        playback.start(begin_s)
        try:
            ending = self._loop(playback, run)
        finally:
            self.node.listen(None)
        wall_s = perf_counter() - begin_s
        end_ns = playback.end_ns if ending is Ending.END else self._reached_ns
        answers = run.finish()
        self._before += answers.tally
        silent = not run.received_s and answers.tally.expected > 0
        if silent and ending is not Ending.GONE and not self._stop:
            self._refuse_silence(answers.tally)
        span_s = max(end_ns - playback.begin_ns, 0) * 1e-9
        return Played(answers, ending, span_s, wall_s, playback.behind_s)

    def _loop(self, playback: Playback, run: Run) -> Ending:
        """Send messages that are due and process answers until the pass ends."""
        routes = self._routes(run)
        spin_once = self.executor.spin_once
        paced = 0
        self._reached_ns = playback.begin_ns
        self._gone = False
        while not (playback.ended or self._stop or self._gone or run.trouble):
            now = perf_counter()
            if now >= self._update_s:
                self._update(now, playback, run)
            if run.under_way > WINDOW:
                spin_once(timeout_sec=max(self._update_s - now, 0.0))
            elif messages := playback.take(now, BATCH):
                self._send(messages, routes)
                paced = self._wait_until_through(run, paced)
                spin_once(timeout_sec=0.0)
            else:
                wait = min(self._update_s - now, playback.wait_s(now))
                spin_once(timeout_sec=max(wait, 0.0))
        ended = playback.ended
        if self._stop and run.under_way:
            self.bar.say(
                f"stopping: waiting for {run.under_way} answers; Ctrl-C again ends at once"
            )
        self._drain(playback, run)
        if run.trouble is not None:
            raise run.trouble
        if self._gone:
            return Ending.GONE
        return Ending.END if ended else Ending.USER

    def _wait_until_through(self, run: Run, paced: int) -> int:
        """Wait for the node after every ``UNANSWERABLE`` inputs without an expected estimate.

        ``paced`` is the number of such inputs at the last wait; returns its new value.
        """
        if run.unanswerable - paced >= UNANSWERABLE:
            paced = run.unanswerable
            self._gone = not self.node.is_through(self.executor)
        return min(paced, run.unanswerable)

    def _send(self, messages: Sequence[RawMessage], routes: Routes) -> None:
        """Publish messages and record the answers that they lead to."""
        for message in messages:
            for send, ask in routes[message.topic]:
                data = stamped(message.data, message.log_ns)
                ask(data, message.log_ns)
                send(data)
        self._reached_ns = messages[-1].log_ns

    def _drain(self, playback: Playback, run: Run) -> None:
        """Wait for the answers in flight; after a signal for at most ``ANSWERS_S``."""
        signalled_s = math.inf
        while run.under_way and not self._gone and run.trouble is None:
            now = perf_counter()
            if self._stop:
                signalled_s = min(signalled_s, now)
                if now - signalled_s > ANSWERS_S:
                    return
            if now >= self._update_s:
                self._update(now, playback, run)
            self.executor.spin_once(timeout_sec=max(self._update_s - now, 0.0))

    def _routes(self, run: Run) -> Routes:
        """Build the routes of a run, see ``Routes``."""
        node, topics, routes = self.node, self.node.topics, Routes()
        shared = len(node.inputs) == 1
        kinds: tuple[Kind, Kind] = ("both", "both") if shared else ("motors", "joints")
        for topic, publisher, kind in (
            (topics.motors, node.motors, kinds[0]),
            (topics.joints, node.joints, kinds[1]),
        ):
            route = (publisher.publish, run.asker(kind))
            if not (shared and topics.motors == topics.joints and topic in routes):
                routes.setdefault(topic, []).append(route)  # each message once per topic
        return routes

    def _update(self, now: float, playback: Playback, run: Run) -> None:
        """Handle clock, display and missing answers, which may wait some milliseconds."""
        self._update_s = now + UPDATE_S
        hertz = self.node.clock_hz
        if hertz > 0:
            if now >= self._clock_s:
                self.node.publish_clock(playback.position_ns(now))
                self._clock_s = max(self._clock_s + 1.0 / hertz, now)
            self._update_s = min(self._update_s, self._clock_s)
        if self.bar.is_due():
            self._show(now, playback, run)
        lost = run.give_up_stalled(now)
        if lost:
            self.bar.say(
                f"{lost} estimates did not arrive within the time allowed and count as lost"
            )
            self._gone = not self.node.is_through(self.executor)
            if not self._gone and not run.received_s:
                self._refuse_silence(run.tally())
        if now >= self._presence_s:
            self._presence_s = now + PRESENCE_S
            self._refuse_other_publishers()
            if missing := self.node.missing():
                self.bar.say(f"the estimator disappeared: {'; '.join(missing)}")
                self._gone = True

    def _show(self, now: float, playback: Playback, run: Run) -> None:
        """Draw the bar: the position, and the counters of all passes."""
        done = (playback.position_ns(now) - playback.begin_ns) * 1e-9
        total = (playback.end_ns - playback.begin_ns) * 1e-9
        counters = (self._before + run.tally()).words
        self.bar(done, f"{done:.1f}/{total:.1f} s, {counters}")

    def _refuse_other_publishers(self) -> None:
        """Refuse to play to an estimator that hears a robot as well; it may be discovered late."""
        for topic, names in self.node.other_publishers().items():
            named = ", ".join(name for name in names if "_UNKNOWN_" not in name)
            who = f": {named}" if named else ""  # a name is discovered after its publisher
            raise UsageError(f"{topic} is published by others, too{who}; stop them")

    def _refuse_silence(self, tally: Tally) -> None:
        raise NoEstimatorError(
            f"the estimator is present but answered none of {tally.sent} inputs: is it of "
            "another robot, with other names? /diagnostics counts the refused readings"
        )
