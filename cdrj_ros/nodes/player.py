"""Plays recorded messages to an estimator node and tracks its outputs."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import monotonic, perf_counter
from typing import Any, Final

from rclpy.experimental import EventsExecutor
from rclpy.task import Future

from cdrj_ros.bag import RawMessage
from cdrj_ros.conditioning.conditioner import Kind
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.replay_node import NoEstimatorError, ReplayNode
from cdrj_ros.nodes.spinning import StopRequest
from cdrj_ros.replay.agreement import NodeSettings, require_every_sample
from cdrj_ros.replay.answers import Run
from cdrj_ros.replay.controls import Controls
from cdrj_ros.replay.display import Display
from cdrj_ros.replay.heard import Heard, Tally
from cdrj_ros.replay.keyboard import Keyboard
from cdrj_ros.replay.playback import Playback

Routes = dict[str, list[tuple[Any, Callable[[bytes], None] | None]]]
"""By topic in the bag: functions that publish a message, each with one to predict the answers."""

WINDOW: Final = 64
"""Maximum number of estimates in flight; far below any queue depth, so that none is lost."""

BATCH: Final = 16
"""Maximum number of messages sent before answers are processed."""

UNANSWERABLE: Final = 256
"""Number of consecutive inputs without an expected estimate (because a channel is slow or late)
after which the replay waits until the estimator has processed them."""

CHORES_S: Final = 0.02
"""Time between two updates of the keyboard and the display [s]."""

PRESENCE_S: Final = 0.5
"""Time between two checks that the estimator is still there [s]."""

NEWS_S: Final = 3.0
"""Time between two messages that list what is still missing [s]."""

SETTLE_S: Final = 2.0
"""Maximum time to wait for other subscribers, so that they do not miss messages [s]."""


ANSWERS_S: Final = 0.5
"""Maximum time to wait for answers in flight after a signal [s]."""


class Ending(enum.Enum):
    """Reason for the end of a run."""

    END = "at the end"
    SOUGHT = "by a seek"
    USER = "by the user"
    GONE = "because the estimator disappeared"


@dataclass(frozen=True, eq=False)
class Played:
    """One run of the estimator: from its reset to the next."""

    heard: Heard
    ending: Ending
    whole: bool
    """Whether the run went from the beginning to the end."""
    span_s: float
    """Duration of the played part of the recording [s]."""
    wall_s: float
    """Elapsed wall time, without pauses [s]."""
    from_s: float
    """Start of the run [s], relative to the beginning of the playback."""
    behind_s: float
    """Maximum delay of a message after its due time [s]; 0 if played as fast as possible."""


class Player:
    """Plays recordings, collects the answers, and handles keys and services."""

    def __init__(
        self,
        model: Model,
        node: ReplayNode,
        executor: EventsExecutor,
        stop: StopRequest,
        controls: Controls,
        keyboard: Keyboard,
        display: Display,
    ) -> None:
        """Store the components; ``executor`` spins ``node``."""
        self.model = model
        self.node = node
        self.executor = executor
        self.controls = controls
        self.display = display
        self.before = Tally()
        """Counters of the runs before the current one."""
        self.runs = 0
        self._stop = stop
        self._keyboard = keyboard
        self._run = Run(model)
        self._chores_s = 0.0
        self._presence_s = 0.0
        self._clock_s = 0.0
        self._gone = False
        self.estimator = NodeSettings()
        """Settings of the estimator; valid after ``wait_for_estimator``."""

    @property
    def stopping(self) -> bool:
        """Whether a signal, key or service has requested the end."""
        return bool(self._stop) or self.controls.stopped

    @property
    def tally(self) -> Tally:
        """Counters of all runs."""
        return self.before + self._run.tally()

    def wait_for_estimator(self, patience_s: float) -> bool:
        """Wait until the estimator is connected in both directions; False if the user stops.

        Raises:
            NoEstimatorError: the estimator is not connected after ``patience_s``.
            UsageError: the estimator does not publish every estimate.
        """
        begin = monotonic()
        news = begin + NEWS_S
        told: list[str] = []
        while missing := self.node.missing():
            self.executor.spin_once(timeout_sec=0.05)
            self._read_keys()
            if self.stopping:
                return False
            now = monotonic()
            if now - begin > patience_s:
                raise NoEstimatorError(
                    f"no estimator within {patience_s:g} s ({'; '.join(missing)}): start one with "
                    "'ros2 run cdrj_ros estimator --ros-args -p robot:=FILE' in the same ROS domain"
                )
            if now > news:
                news = now + NEWS_S
                what = "" if missing == told else f": {'; '.join(missing)}"
                self.display.say(f"still waiting after {now - begin:.0f} s{what}")
                told = missing
        settled = monotonic() + SETTLE_S
        while self.node.unconnected() and monotonic() < settled and not self.stopping:
            self.executor.spin_once(timeout_sec=0.05)
        for topic in self.node.unconnected():
            self.display.say(f"warning: a listener of {topic} has a QoS that does not fit")
        self.estimator = self.node.settings(self.executor)
        require_every_sample(self.estimator)
        for topic in self.node.rivals():
            self.display.say(f"warning: several nodes publish {topic}; their answers are mixed")
        return True

    def play(self, playback: Playback, delay_s: float = 0.0) -> list[Played]:
        """Play one pass: one run of the estimator, and another run after every seek.

        Raises:
            NoEstimatorError: the estimator does not reset, or answers none of the inputs.
            AnotherRobotError: the estimator uses another robot.
        """
        self.controls.playback = playback
        played: list[Played] = []
        try:
            while not played or played[-1].ending is Ending.SOUGHT:
                self.node.reset_estimator(self.executor)
                self.runs += 1
                if played:
                    playback.resume_after_seek(perf_counter())
                else:
                    playback.start(perf_counter(), delay_s)
                played.append(self._play_run(playback))
        finally:
            self.controls.playback = None
            self.node.listen(None)
        return played

    def _play_run(self, playback: Playback) -> Played:
        self._run = run = Run(self.model, self.estimator.conditioning)
        self.node.listen(run)
        begin_ns = playback.position_ns(perf_counter())
        playback.behind_s = 0.0
        watch = _Stopwatch()
        watch.tick(perf_counter(), playback)
        try:
            ending = self._loop(playback, run, watch)
        finally:
            self.node.listen(None)
        watch.tick(perf_counter(), playback)
        end_ns = playback.end_ns if ending is Ending.END else self._reached_ns
        heard = run.finish()
        self.before += heard.tally
        self._run = Run(self.model)
        silent = not run.heard_s and heard.tally.expected > 0
        if silent and ending is not Ending.GONE and not self._stop:
            self._refuse_silence(heard)
        return Played(
            heard, ending,
            whole=ending is Ending.END and begin_ns == playback.begin_ns,
            span_s=max(end_ns - begin_ns, 0) * 1e-9,
            wall_s=watch.seconds,
            from_s=(begin_ns - playback.begin_ns) * 1e-9,
            behind_s=playback.behind_s,
        )  # fmt: skip

    def _loop(self, playback: Playback, run: Run, watch: _Stopwatch) -> Ending:
        """Send messages that are due and process answers until the run ends."""
        routes = self._routes(run)
        spin_once = self.executor.spin_once
        paced = 0
        self._reached_ns = playback.position_ns(perf_counter())
        self._gone = False
        while not playback.ended:
            now = perf_counter()
            if now >= self._chores_s:
                watch.tick(now, playback)
                self._do_chores(now, playback, run)
            if self._broken_off(playback, run):
                break
            if run.under_way > WINDOW:
                self._let_answers_in(run, now)
            elif messages := playback.take(now, BATCH):
                self._send(messages, routes)
                paced = self._wait_until_through(run, paced)
                spin_once(timeout_sec=0.0)
            else:
                wait = min(self._chores_s - now, playback.wait_s(now))
                spin_once(timeout_sec=max(wait, 0.0))
        ended = playback.ended
        if self._stop and run.under_way:
            self.display.say(
                f"stopping: waiting for {run.under_way} answers; Ctrl-C again ends at once"
            )
        self._drain(playback, run, watch)
        if run.trouble is not None:
            raise run.trouble
        if self._gone:
            return Ending.GONE
        if playback.sought and not self.stopping:
            return Ending.SOUGHT
        return Ending.END if ended else Ending.USER

    def _wait_until_through(self, run: Run, paced: int) -> int:
        """Wait for the node after every ``UNANSWERABLE`` inputs without an expected estimate.

        ``paced`` is the number of such inputs at the last wait; returns its new value.
        """
        if run.unanswerable - paced >= UNANSWERABLE:
            paced = run.unanswerable
            self._gone = not self.node.is_through(self.executor)
        return min(paced, run.unanswerable)

    def _broken_off(self, playback: Playback, run: Run) -> bool:
        """Whether the run has to end before the end of the recording."""
        return self.stopping or playback.sought or self._gone or run.trouble is not None

    def _send(self, messages: Sequence[RawMessage], routes: Routes) -> None:
        """Publish messages and record the answers that they lead to."""
        for message in messages:
            for send, ask in routes[message.topic]:
                if ask is not None:
                    ask(message.data)
                send(message.data)
        self._reached_ns = messages[-1].log_ns

    def _let_answers_in(self, run: Run, now: float) -> None:
        """Wait until another batch may be sent or the chores are due."""
        room: Future = Future()
        run.call_at(WINDOW - BATCH, lambda: room.set_result(None))
        # one call for many answers, since spin_once per answer costs more than its callback
        left_s = max(self._chores_s - now, 0.0)
        self.executor.spin_until_future_complete(room, timeout_sec=left_s)

    def _drain(self, playback: Playback, run: Run, watch: _Stopwatch) -> None:
        """Wait for the answers in flight; after a signal for at most ``ANSWERS_S``."""
        signalled_s = math.inf
        while run.under_way and not self._gone and run.trouble is None:
            now = perf_counter()
            if self._stop:
                signalled_s = min(signalled_s, now)
                if now - signalled_s > ANSWERS_S:
                    return
            if now >= self._chores_s:
                watch.tick(now, playback)
                self._do_chores(now, playback, run)
            self.executor.spin_once(timeout_sec=max(self._chores_s - now, 0.0))

    def _routes(self, run: Run) -> Routes:
        """Build the routes of a run, see ``Routes``."""
        node, topics = self.node, self.node.wiring.topics
        routes: Routes = {
            topic: [(publisher.publish, None)] for topic, publisher in node.extras.items()
        }
        shared = len(node.inputs) == 1
        kinds: tuple[Kind, Kind] = ("both", "both") if shared else ("motors", "joints")
        for topic, publisher, kind in (
            (topics.motors, node.motors, kinds[0]),
            (topics.joints, node.joints, kinds[1]),
        ):
            route = (publisher.publish, run.asker(kind))
            if not (shared and topics.motors == topics.joints and topic in routes):
                routes.setdefault(topic, []).append(route)  # each message once per topic
        for topic in self.node.wiring.clock_topics & routes.keys():
            routes[topic].insert(0, (self._stamp_clock, None))
        return routes

    def _stamp_clock(self, _payload: bytes) -> None:
        playback = self.controls.playback
        if playback is not None:
            self.node.publish_clock(playback.position_ns(perf_counter()))

    def _do_chores(self, now: float, playback: Playback, run: Run) -> None:
        """Handle keys, clock, display and missing answers, which may wait some milliseconds."""
        self._chores_s = now + CHORES_S
        hertz = self.node.wiring.clock_hz
        if hertz > 0:
            if now >= self._clock_s:
                self.node.publish_clock(playback.position_ns(now))
                self._clock_s = max(self._clock_s + 1.0 / hertz, now)
            self._chores_s = min(self._chores_s, self._clock_s)
        self._read_keys()
        self.display.show(playback, self.controls, self.before, run, now)
        lost = run.give_up_stalled(now)
        if lost:
            self.display.say(
                f"{lost} estimates did not arrive within the time allowed and count as lost"
            )
            self._gone = not self.node.is_through(self.executor)
            if not self._gone and not run.heard_s:
                self._refuse_silence(run.finish())
        if now >= self._presence_s:
            self._presence_s = now + PRESENCE_S
            if missing := self.node.missing():
                self.display.say(f"the estimator disappeared: {'; '.join(missing)}")
                self._gone = True

    def _refuse_silence(self, heard: Heard) -> None:
        raise NoEstimatorError(
            f"the estimator is present but answered none of {heard.tally.sent} inputs: is it of "
            "another robot, with other names? /diagnostics counts the refused readings"
        )

    def _read_keys(self) -> None:
        for key in self._keyboard.read():
            reply = self.controls.press(key)
            if reply is not None:
                self.display.say(reply.words)


class _Stopwatch:
    """Wall time of the playback, without pauses."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._last: float | None = None

    def tick(self, now: float, playback: Playback) -> None:
        """Add the time since the last tick unless the playback was idle."""
        if self._last is not None:
            self.seconds += now - self._last
        idle = playback.paused or playback.wait_s(now) > 1e6
        self._last = None if idle and not playback.ended else now
