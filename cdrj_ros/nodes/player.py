"""Plays recorded messages to an estimator node and keeps count of its answers."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import monotonic, perf_counter
from typing import Any, Final

from rclpy.experimental import EventsExecutor
from rclpy.task import Future

from cdrj_ros.bag import RawMessage
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.replay_node import NoEstimatorError, ReplayNode
from cdrj_ros.nodes.spinning import StopRequest
from cdrj_ros.replay.agreement import NodeSettings, require_every_sample
from cdrj_ros.replay.answers import Heard, Run, Tally
from cdrj_ros.replay.controls import Controls
from cdrj_ros.replay.display import Display
from cdrj_ros.replay.keyboard import Keyboard
from cdrj_ros.replay.playback import Playback

Routes = dict[str, list[tuple[Any, Callable[[bytes], None] | None]]]
"""By topic in the bag: what publishes its messages, and what foresees the answers."""

WINDOW: Final = 64
"""Estimates under way at once: far fewer than any queue holds, so that none is lost."""

BATCH: Final = 16
"""Messages sent between two looks at the answers."""

UNANSWERABLE: Final = 256
"""Inputs in a row that make no estimate possible (a slow or late channel); then the estimator is
asked whether it is through with them."""

CHORES_S: Final = 0.02
"""Time between two looks at the keyboard and the display [s]."""

PRESENCE_S: Final = 0.5
"""Time between two checks that the estimator is still there [s]."""

NEWS_S: Final = 3.0
"""Time between two lines that name what is still missing [s]."""

SETTLE_S: Final = 2.0
"""How long to wait for other listeners, so that they miss no message either [s]."""


class Ending(enum.Enum):
    """Why a run is over."""

    END = "at the end"
    SOUGHT = "by a seek"
    USER = "by the user"
    GONE = "as the estimator went away"


@dataclass(frozen=True, eq=False)
class Played:
    """One run of the estimator: from its reset to the next."""

    heard: Heard
    ending: Ending
    whole: bool
    """From the beginning to the end."""
    span_s: float
    """Time of the recording that was covered [s]."""
    wall_s: float
    """Wall time it took, pauses left out [s]."""
    from_s: float
    """Where it began [s], from the beginning of what is played."""
    behind_s: float
    """Greatest delay of a message behind its due time [s]; 0 as fast as possible."""


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
        """Keep the parts; ``executor`` spins ``node``."""
        self.model = model
        self.node = node
        self.executor = executor
        self.controls = controls
        self.display = display
        self.before = Tally()
        """Of the runs before the present one."""
        self.runs = 0
        self._stop = stop
        self._keyboard = keyboard
        self._run = Run(model)
        self._chores_s = 0.0
        self._presence_s = 0.0
        self._clock_s = 0.0
        self._gone = False
        self.estimator = NodeSettings()
        """How the estimator is set; known once it has been waited for."""

    @property
    def stopping(self) -> bool:
        """By signal, key or service."""
        return bool(self._stop) or self.controls.stopped

    @property
    def tally(self) -> Tally:
        """Of all runs."""
        return self.before + self._run.tally()

    def wait_for_estimator(self, patience_s: float) -> bool:
        """Wait until the estimator is connected both ways; False if the user stops.

        Raises:
            NoEstimatorError: after ``patience_s``.
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
            self.display.say(f"warning: several nodes publish {topic}; their answers mix")
        return True

    def play(self, playback: Playback, delay_s: float = 0.0) -> list[Played]:
        """One pass: a run of the estimator, and another after every seek.

        Raises:
            NoEstimatorError: it does not reset, or hears everything and answers nothing.
            AnotherRobotError: it is of another robot.
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
        if not run.heard_s and heard.tally.expected and ending is not Ending.GONE:
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
        """Send what is due and take answers until there is a reason to stop."""
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
                f"stopping: {run.under_way} answers are under way; Ctrl-C again ends at once"
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
        """Let the node catch up after ``UNANSWERABLE`` messages that get no answer; their count."""
        if run.unanswerable - paced >= UNANSWERABLE:
            paced = run.unanswerable
            self._gone = not self.node.is_through(self.executor)
        return min(paced, run.unanswerable)

    def _broken_off(self, playback: Playback, run: Run) -> bool:
        """Whether the run ends before the recording does."""
        return self.stopping or playback.sought or self._gone or run.trouble is not None

    def _send(self, messages: Sequence[RawMessage], routes: Routes) -> None:
        """Publish messages and note the answers that they make possible."""
        for message in messages:
            for send, ask in routes[message.topic]:
                if ask is not None:
                    ask(message.data)
                send(message.data)
        self._reached_ns = messages[-1].log_ns

    def _let_answers_in(self, run: Run, now: float) -> None:
        """Wait until another batch may be sent, or something else has to be done."""
        room: Future = Future()
        run.call_at(WINDOW - BATCH, lambda: room.set_result(None))
        # one call for many answers: spinning once for each takes longer than hearing it
        left_s = max(self._chores_s - now, 0.0)
        self.executor.spin_until_future_complete(room, timeout_sec=left_s)

    def _drain(self, playback: Playback, run: Run, watch: _Stopwatch) -> None:
        """Wait for the answers that are under way."""
        while run.under_way and not self._gone and run.trouble is None:
            now = perf_counter()
            if now >= self._chores_s:
                watch.tick(now, playback)
                self._do_chores(now, playback, run)
            self.executor.spin_once(timeout_sec=max(self._chores_s - now, 0.0))

    def _routes(self, run: Run) -> Routes:
        """By topic in the bag: what publishes its messages, and what foresees the answers."""
        node, topics, gate = self.node, self.node.wiring.topics, run.conditioner
        routes: Routes = {
            topic: [(publisher.publish, None)] for topic, publisher in node.extras.items()
        }
        shared = len(node.inputs) == 1
        for topic, publisher, feed in (
            (topics.motors, node.motors, gate.feed_motors),
            (topics.joints, node.joints, gate.feed_joints),
        ):
            route = (publisher.publish, run.asker(gate.feed_both if shared else feed))
            if not (shared and topics.motors == topics.joints and topic in routes):
                routes.setdefault(topic, []).append(route)  # each message once on each topic
        for topic in self.node.wiring.clock_topics & routes.keys():
            routes[topic].insert(0, (self._stamp_clock, None))
        return routes

    def _stamp_clock(self, _payload: bytes) -> None:
        playback = self.controls.playback
        if playback is not None:
            self.node.publish_clock(playback.position_ns(perf_counter()))

    def _do_chores(self, now: float, playback: Playback, run: Run) -> None:
        """Do what can wait for some milliseconds: keys, clock, display, missing answers."""
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
            self.display.say(f"{lost} estimates did not come within the time allowed: counted lost")
            self._gone = not self.node.is_through(self.executor)
            if not self._gone and not run.heard_s:
                self._refuse_silence(run.finish())
        if now >= self._presence_s:
            self._presence_s = now + PRESENCE_S
            if missing := self.node.missing():
                self.display.say(f"the estimator went away: {'; '.join(missing)}")
                self._gone = True

    def _refuse_silence(self, heard: Heard) -> None:
        raise NoEstimatorError(
            f"the estimator is there and answered none of {heard.tally.sent} inputs: is it of "
            "another robot, with other names? /diagnostics counts what it refuses"
        )

    def _read_keys(self) -> None:
        for key in self._keyboard.read():
            reply = self.controls.press(key)
            if reply is not None:
                self.display.say(reply.words)


class _Stopwatch:
    """Wall time spent playing, pauses left out."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._last: float | None = None

    def tick(self, now: float, playback: Playback) -> None:
        """Count the time since the last tick, unless it was one of waiting."""
        if self._last is not None:
            self.seconds += now - self._last
        idle = playback.paused or playback.wait_s(now) > 1e6
        self._last = None if idle and not playback.ended else now
