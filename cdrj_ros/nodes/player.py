"""Plays recorded messages to an estimator node and keeps count of its answers."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from time import monotonic, perf_counter
from typing import Any, Final

from builtin_interfaces.msg import Time
from cdrj_msgs.msg import CableTensions, NodalForces
from rcl_interfaces.srv import GetParameters
from rclpy.duration import Duration
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cdrj_ros.bag import Topics
from cdrj_ros.conditioning.time_line import MODES
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.qos import default_profile
from cdrj_ros.nodes.spinning import StopRequest
from cdrj_ros.replay.answers import KINDS, Heard, Run, Tally
from cdrj_ros.replay.controls import Controls
from cdrj_ros.replay.display import Display
from cdrj_ros.replay.keyboard import Keyboard
from cdrj_ros.replay.playback import Playback

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
"""Time between two looks at whether the estimator is still there [s]."""

NEWS_S: Final = 3.0
"""Time between two lines of what is still missing [s]."""

SETTLE_S: Final = 2.0
"""How long to wait for other listeners, so that they miss no message either [s]."""

ANSWER_S: Final = 5.0
"""How long a service of the estimator may take [s]."""


class NoEstimatorError(CdrjError):
    """No estimator node answered."""


class Ending(enum.Enum):
    """Why a run is over."""

    END = "at the end"
    SOUGHT = "by a seek"
    USER = "by the user"
    GONE = "as the estimator went away"


@dataclass(frozen=True)
class Extra:
    """A topic that is played although the estimator does not listen to it."""

    topic: str
    msgtype: str
    latched: bool = False


@dataclass(frozen=True)
class Wiring:
    """What goes where."""

    topics: Topics = field(default_factory=Topics)
    extras: tuple[Extra, ...] = ()
    remap: Mapping[str, str] = field(default_factory=dict)
    """Names to publish under, by name in the bag."""
    overrides: Mapping[str, QoSProfile] = field(default_factory=dict)
    """By name in the bag, and for the answers by the name listened to."""
    clock_hz: float = 0.0
    clock_topics: frozenset[str] = frozenset()
    """Topics whose messages are preceded by the clock."""
    estimator: str = "/cdrj/estimator"


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


class ReplayNode(Node):
    """Topics and clients beside an estimator's."""

    def __init__(self, wiring: Wiring, **options: Any) -> None:
        """Open them.

        Raises:
            UsageError: an extra topic whose type is not installed, or that would meet the answers.
        """
        super().__init__("replay", namespace="cdrj", **options)
        self.wiring = wiring
        topics, qos = wiring.topics, default_profile()

        def publisher(message: Any, topic: str, default: str, other: QoSProfile = qos) -> Any:
            name = wiring.remap.get(topic, default)
            return self.create_publisher(message, name, wiring.overrides.get(topic, other))

        self.motors = publisher(JointState, topics.motors, "motor_states")
        self.joints = publisher(JointState, topics.joints, "joint_states")
        self.inputs = tuple({p.topic_name: p for p in (self.motors, self.joints)}.values())
        self.outputs = tuple(self.resolve_topic_name(kind.topic) for kind in KINDS)
        self._ears: list[Callable[[bytes], None]] = [_ignore] * len(KINDS)
        for number, message in enumerate((CableTensions, NodalForces, JointState)):
            self.create_subscription(
                message, KINDS[number].topic, self._listener(number),
                wiring.overrides.get(self.outputs[number], qos), raw=True,
            )  # fmt: skip
        self.extras: dict[str, Any] = {}
        for extra in wiring.extras:
            name = self.resolve_topic_name(wiring.remap.get(extra.topic, extra.topic))
            if name in self.outputs:
                raise UsageError(
                    f"{extra.topic} is where the estimator answers: give it another name with "
                    f"--remap {extra.topic}:=/recorded{extra.topic}"
                )
            self.extras[extra.topic] = publisher(
                message_class(extra.msgtype), extra.topic, extra.topic,
                default_profile(latched=extra.latched),
            )  # fmt: skip
        wants_clock = wiring.clock_hz > 0 or wiring.clock_topics
        self.clock = self.create_publisher(Clock, "/clock", 10) if wants_clock else None
        self._reset = self.create_client(Trigger, wiring.estimator + "/reset")
        self._ping = self.create_client(GetParameters, wiring.estimator + "/get_parameters")

    def _listener(self, number: int) -> Callable[[bytes], None]:
        ears = self._ears

        def on_answer(payload: bytes) -> None:
            ears[number](payload)

        return on_answer

    def listen(self, run: Run | None) -> None:
        """From now on the answers are of this run."""
        for number in range(len(KINDS)):
            self._ears[number] = run.listener(number) if run else _ignore

    def missing(self) -> list[str]:
        """What of the estimator is not there, in words; empty when all is."""
        gaps = [f"no subscriber of {p.topic_name}" for p in self.inputs if not _matched(p)]
        gaps += [f"no publisher of {t}" for t in self.outputs if not self.count_publishers(t)]
        for client in (self._reset, self._ping):
            if not client.service_is_ready():
                gaps.append(f"no service {client.srv_name}")
        return gaps

    def unconnected(self) -> list[str]:
        """Topics played of which a listener is known but not connected yet."""
        return [
            p.topic_name
            for p in (*self.inputs, *self.extras.values())
            if p.get_subscription_count() < self.count_subscribers(p.topic_name)
        ]

    def rivals(self) -> list[str]:
        """Topics of the answers on which more than one node publishes."""
        return [topic for topic in self.outputs if self.count_publishers(topic) > 1]

    def reset_estimator(self, executor: EventsExecutor) -> str:
        """Let it forget all; returns what it said.

        Raises:
            NoEstimatorError: it does not answer, or refuses.
        """
        future = self._reset.call_async(Trigger.Request())
        executor.spin_until_future_complete(future, timeout_sec=ANSWER_S)
        if not future.done():
            raise NoEstimatorError(
                f"the estimator does not answer {self._reset.srv_name} within {ANSWER_S:g} s"
            )
        response = future.result()
        if not response.success:
            raise NoEstimatorError(f"the estimator refuses to start anew: {response.message}")
        return str(response.message)

    def is_through(self, executor: EventsExecutor) -> bool:
        """Whether the estimator answers a question put to it now, behind all that was sent."""
        future = self._ping.call_async(GetParameters.Request(names=[]))
        executor.spin_until_future_complete(future, timeout_sec=ANSWER_S)
        return bool(future.done())

    def conditioning(self, executor: EventsExecutor) -> str:
        """How the estimator brings its topics together: its parameter of that name."""
        future = self._ping.call_async(GetParameters.Request(names=["conditioning"]))
        executor.spin_until_future_complete(future, timeout_sec=ANSWER_S)
        values = future.result().values if future.done() else []
        mode = str(values[0].string_value) if values else ""
        return mode if mode in MODES else MODES[0]

    def publish_clock(self, time_ns: int) -> None:
        """Say what time it is in the recording."""
        if self.clock is not None:
            sec, nanosec = divmod(max(time_ns, 0), 1_000_000_000)
            self.clock.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))

    def wait_for_acknowledgements(self, timeout_s: float) -> list[str]:
        """Names of the topics of which not all listeners have acknowledged everything by then."""
        deadline = monotonic() + timeout_s
        slow = []
        for publisher in (*self.inputs, *self.extras.values()):
            left = max(deadline - monotonic(), 0.0)
            if not publisher.wait_for_all_acked(Duration(seconds=left)):
                slow.append(str(publisher.topic_name))
        return slow


def _ignore(_payload: bytes) -> None:
    """Nothing has been asked."""


def _matched(publisher: Any) -> bool:
    return bool(publisher.get_subscription_count())


def message_class(msgtype: str) -> Any:
    """The class of ``sensor_msgs/msg/Imu``.

    Raises:
        UsageError: it is not installed.
    """
    package, _, name = msgtype.replace("/msg/", "/").partition("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError, ValueError):
        raise UsageError(f"messages of type {msgtype or '(none)'} are not installed here") from None


class Player:
    """Plays, listens, and attends to the user in between."""

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
        """Bring together what is there; ``executor`` spins ``node``."""
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
        self._conditioning = MODES[0]

    @property
    def stopping(self) -> bool:
        """By signal, key or service."""
        return bool(self._stop) or self.controls.stopped

    @property
    def tally(self) -> Tally:
        """Of all runs."""
        return self.before + self._run.tally()

    def wait_for_estimator(self, patience_s: float) -> bool:
        """Until it listens and is heard; False where the user would rather stop.

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
        self._conditioning = self.node.conditioning(self.executor)
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
        self._run = run = Run(self.model, self._conditioning)
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
        """Send what is due, let answers in, until there is a reason to stop."""
        routes = self._routes(run)
        spin_once = self.executor.spin_once
        stop, controls = self._stop, self.controls
        paced = 0
        self._reached_ns = playback.position_ns(perf_counter())
        self._gone = False
        while not playback.ended:
            now = perf_counter()
            if now >= self._chores_s:
                watch.tick(now, playback)
                self._do_chores(now, playback, run)
            if stop or controls.stopped or playback.sought or run.trouble or self._gone:
                break
            if run.under_way > WINDOW:
                self._let_answers_in(run, now)
                continue
            messages = playback.take(now, BATCH)
            if messages:
                for message in messages:
                    for send, ask in routes[message.topic]:
                        if ask is not None:
                            ask(message.data)
                        send(message.data)
                self._reached_ns = messages[-1].log_ns
                if run.unanswerable - paced >= UNANSWERABLE:
                    paced = run.unanswerable
                    self._gone = not self.node.is_through(self.executor)
                paced = min(paced, run.unanswerable)
                spin_once(timeout_sec=0.0)
                continue
            wait = min(self._chores_s - now, playback.wait_s(now))
            spin_once(timeout_sec=max(wait, 0.0))
        ended = playback.ended
        if stop and run.under_way:
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

    def _let_answers_in(self, run: Run, now: float) -> None:
        """Until there is room for another batch, or something else to do."""
        room: Future = Future()
        run.call_at(WINDOW - BATCH, lambda: room.set_result(None))
        # one call for many answers: spinning once for each takes longer than hearing it
        left_s = max(self._chores_s - now, 0.0)
        self.executor.spin_until_future_complete(room, timeout_sec=left_s)

    def _drain(self, playback: Playback, run: Run, watch: _Stopwatch) -> None:
        """Hear out what is under way."""
        while run.under_way and not self._gone and run.trouble is None:
            now = perf_counter()
            if now >= self._chores_s:
                watch.tick(now, playback)
                self._do_chores(now, playback, run)
            self.executor.spin_once(timeout_sec=max(self._chores_s - now, 0.0))

    def _routes(self, run: Run) -> dict[str, list[tuple[Any, Callable[[bytes], None] | None]]]:
        """By topic in the bag: what publishes its messages, and what foresees the answers."""
        node, topics, gate = self.node, self.node.wiring.topics, run.conditioner
        routes: dict[str, list[tuple[Any, Callable[[bytes], None] | None]]] = {
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
        """What can wait for a hundredth of a second: keys, clock, display, missing answers."""
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


def wiring_of(
    topics: Topics,
    extras: Sequence[Extra],
    remap: Mapping[str, str],
    overrides: Mapping[str, QoSProfile],
    *,
    clock_hz: float,
    clock_topics: Sequence[str] | None,
    estimator: str,
) -> Wiring:
    """Check what the user has asked for against what there is.

    Args:
        topics, extras, remap, overrides, clock_hz, estimator: see ``Wiring``.
        clock_topics: None for every topic that is played.

    Raises:
        UsageError: a topic that is not played, or a clock beside a clock.
    """
    played = {topics.motors, topics.joints, *(extra.topic for extra in extras)}
    stamped = played if clock_topics is None else frozenset(clock_topics)
    for option, named in (("--remap", remap), ("--clock-topics", stamped)):
        if unknown := sorted(set(named) - played):
            raise UsageError(
                f"{option}: {', '.join(unknown)} is not played, only {', '.join(sorted(played))}"
            )
    return Wiring(
        topics, tuple(extras), dict(remap), dict(overrides), clock_hz, frozenset(stamped), estimator
    )
