"""The estimator's input topics: subscriptions, and why there is no estimate.

A subscription adapts to the reliability of its publishers.  ``InputWatch`` notices when estimates
begin, stop and resume, and explains in the log and on /diagnostics what is missing or refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import inf, isfinite
from time import monotonic
from typing import Any, Final

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from cdrj_ros._core import JointStateDecoder
from cdrj_ros.estimation.conditioner import axis_of
from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.estimation.refusals import Sizes, clocks_apart, range_words, refusal_words
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.foundation.output import counted, listed, printable
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.topics import TENSIONS
from cdrj_ros.nodes.diagnostics import Health, unread_axes
from cdrj_ros.nodes.feed import SILENCE_S
from cdrj_ros.nodes.settings import (
    default_profile,
    publishing_nodes,
    reliability_parameter,
    remapping,
)
from cdrj_ros.nodes.silence import Silence, StampClock
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.names import naming_hint

PATIENCE_S: Final = 3.0
"""Time without an estimate after which the reason is logged [s]."""

AGAIN_S: Final = 10.0
"""Time between two equal warnings, and without a cause until it is logged anew [s]."""

STANDS: Final = "/clock stands still: is it published, and use_sim_time meant?"
"""What is said of a simulated clock that stands still."""

TOLERATED_PER_S: Final = 5.0
"""Rate of refused readings below which no warning is given [1/s]."""

BY_ARRIVAL: Final = (
    "the stamps in the headers are zero, so the times of arrival are used; the standard deviations "
    "contain the error of these. Set header.stamp to the time of the reading to avoid it"
)
"""What is said of a topic without stamps."""

LONG: Final = 60
"""Maximum number of characters shown of a name."""


class InputTopic:
    """One subscription, which is reliable until a best-effort publisher is found.

    A best-effort subscription would match both kinds of publishers at once, but it would also lose
    messages of a reliable publisher whenever the node cannot keep up for a moment.
    """

    def __init__(
        self, node: Node, message: Any, topic: str, axes: Sequence[str], *, chosen: bool
    ) -> None:
        """Prepare; ``subscribe`` subscribes.

        Args:
            node: the node that subscribes.
            message: class of the messages; they are received serialised.
            topic: relative name.
            axes: motors and joints that the topic should carry.
            chosen: whether the user has chosen the reliability, with ``reliability_parameter``.
        """
        self._node, self._message, self._chosen = node, message, chosen
        self._name, self.topic = topic, node.resolve_topic_name(topic)
        self.axes = tuple(axes)
        self.messages = 0
        """Number of messages decoded since the start."""
        self.last = JointStateDecoder()
        """Has the last message of angles."""
        self.by_arrival = False
        """Whether a message had no stamp."""
        self.publishers = 0
        self.remapping = ""
        """Where messages of this type are, or are not, while this topic has no publisher."""
        self.heard_s = -inf
        """Steady time of the last message, good or not [s]."""

    def subscribe(self, callback: Callable[[bytes], None]) -> None:
        """Subscribe; ``callback`` takes every serialised message."""
        self._callback = callback
        self.subscription = self._subscribe(
            default_profile(), qos_overriding_options=QoSOverridingOptions.with_default_policies()
        )

    def _subscribe(self, profile: QoSProfile, **options: Any) -> Any:
        """Subscribe without rclpy's warnings of incompatible publishers, which ``adapt`` replaces.

        An event that waits while its subscription is destroyed would end the node.
        """
        return self._node.create_subscription(
            self._message, self.topic, self._callback, profile, raw=True,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False), **options,
        )  # fmt: skip

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self.subscription)

    @property
    def reliability(self) -> ReliabilityPolicy:
        """Reliability that the subscription currently requests."""
        return self.subscription.qos_profile.reliability

    def note(self) -> None:
        """Count the message that ``last`` has just decoded; say once that stamps are missing."""
        self.messages += 1
        if self.last.by_arrival and not self.by_arrival:
            self.by_arrival = True
            self._node.get_logger().warning(f"{self.topic}: {BY_ARRIVAL}")

    def silent(self, after_s: float) -> bool:
        """Whether the last message came longer than a time ago [s]."""
        return self.messages > 0 and monotonic() - self.heard_s > after_s

    def adapt(self) -> str:
        """Count the publishers and adapt to best-effort ones; call while inputs are missing.

        Returns:
            A log message about what was found and done; empty if all publishers are compatible.
        """
        publishers = self._node.get_publishers_info_by_topic(self.topic)
        self.publishers = len(publishers)
        self.remapping = "" if publishers else remapping(self._node, self._name, JOINT_STATE.name)
        unreliable = {
            info.node_name
            for info in publishers
            if info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
        }
        if not unreliable or self.reliability != ReliabilityPolicy.RELIABLE:
            return ""
        who = f"{self.topic}: the publisher in {', '.join(sorted(unreliable))} is best-effort"
        if self._chosen:
            return (
                f"{who}, but the parameter {reliability_parameter(self.topic)} requires reliable, "
                "so no messages arrive. Set it to best_effort, or make the publisher reliable"
            )
        profile = self.subscription.qos_profile
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
        self._node.destroy_subscription(self.subscription)
        self.subscription = self._subscribe(profile)
        return (
            f"{who}: subscribed best-effort as well. Readings may be lost under load; a "
            "reliable publisher avoids this"
        )


# --- what is missing or refused -----------------------------------------------------------------


def missing_inputs(
    topics: Sequence[InputTopic],
    unheard: Sequence[str],
    unread: Mapping[str, str],
    refused: str,
    apart: str,
    robot: Robot,
) -> str:
    """Why there is no estimate.

    Args:
        topics: what has been received on each input topic.
        unheard: motors and joints without an accepted reading.
        unread: those without a further one, and for how long, in words by name.
        refused: readings refused, in words.
        apart: clocks that differ, in words.
        robot: provides the joints and their ranges.
    """
    silent = [topic.topic for topic in topics if topic.silent(SILENCE_S)]
    if unheard:
        what = f"no reading of {_listed(unheard)} accepted"
    elif silent:
        what = f"no further message on {_listed(silent)}"
    elif unread:
        what = f"no further reading of {_listed([*unread.values()])} accepted"
    else:
        what = f"no common time of all axes{': ' if apart else ''}{apart}"
    lines = [what, *(_heard_on(topic, unheard or [*unread], robot) for topic in topics)]
    if refused:
        lines.append(f"refused: {refused}")
    return ". ".join(lines)


def _heard_on(topic: InputTopic, unheard: Sequence[str], robot: Robot) -> str:
    """Describe one topic: messages received, missing names, and positions out of range."""
    if not topic.messages:
        there = counted(topic.publishers, "publisher") if topic.publishers else "no publisher"
        elsewhere = f"; {topic.remapping}" if topic.remapping else ""
        return f"{topic.topic}: {there}, no message{elsewhere}"
    parts, names = [counted(topic.messages, "message")], topic.last.names
    expected = [axis for axis in topic.axes if axis in unheard]
    if missing := [axis for axis in expected if axis not in names]:
        parts.append(f"the last names {_listed(names) or 'nothing'}, not {_listed(missing)}")
        if hint := naming_hint(names, missing, robot.document):
            parts.append(hint[: 2 * LONG])
    at = dict(zip(names, topic.last.positions, strict=False))  # a message may have none
    outside = {}
    for joint in robot.as_read.joints:
        if joint.name in at and isfinite(at[joint.name]):
            angle = axis_of(joint).angle_near(float(at[joint.name]), joint.reference_angle)
            if not joint.lower <= angle <= joint.upper:
                outside[joint.name] = angle
    return f"{topic.topic}: {', '.join([*parts, *range_words(robot, outside)])}"


def _listed(names: Sequence[str]) -> str:
    """A list of untrusted names, truncated and made printable."""
    return listed([printable(name)[:LONG] or "''" for name in names])


class InputWatch:
    """Detects when estimates begin, stop and resume, and why there is none."""

    def __init__(
        self,
        node: Node,
        live: LiveEstimator,
        inputs: Sequence[InputTopic],
        silence: Silence,
        stamps: StampClock,
        now_ns: Callable[[], int],
    ) -> None:
        """Start without an estimate.

        Args:
            node: provides the log.
            live: provides the counters.
            inputs: the subscribed topics; those that carry axes are named in the log.
            silence: measures the time since the last estimate.
            stamps: knows how late the stamps of the inputs are.
            now_ns: returns the time of the node's clock [ns].
        """
        self._node, self._live, self._inputs = node, live, inputs
        self._silence, self._now_ns, self._stamps = silence, now_ns, stamps
        self._refused: dict[str, int] = {}
        self._sizes: Sizes = {}
        """Of the readings refused between the last two calls of ``health`` that refused any."""
        self.looked_s = self.estimated_s = monotonic()
        """Steady times of the last call of ``health`` and of the last estimate [s]."""
        self._first = True
        """Whether there has been no estimate since the start."""
        self._quiet = True
        """Whether there has been no estimate since the start or, as logged, for the timeout."""

    def silence_s(self) -> float:
        """Time since the last estimate [s]; infinite before the first."""
        return self._silence.seconds(self._now_ns(), monotonic())

    def note(self, now_ns: int, now_s: float) -> None:
        """Record an estimate; log the first one, and the first one after a silence.

        Args:
            now_ns: time of the node's clock [ns].
            now_s: time of the steady clock [s].
        """
        self._silence.note(now_ns, now_s)
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

    def health(self, latest: Estimate | None, rate_hz: float, clock_refused: int) -> Health:
        """State of the inputs and outputs; call once a second."""
        conditioner = self._live.conditioner
        silence_s = self.silence_s()
        refusing = self._refusing()
        age = float("inf")
        if latest is not None:
            lag_s = conditioner.lag_ns * 1e-9
            age = self._stamps.age_s(latest.stamp_ns, self._now_ns(), lag_s, silence_s)
        waiting = ""
        if self._quiet or latest is None:
            for one in self._inputs:
                if words := one.adapt():
                    self._node.get_logger().warning(words, throttle_duration_sec=AGAIN_S)
            robot = self._live.model.robot
            waiting = missing_inputs(
                [one for one in self._inputs if one.axes],
                conditioner.unheard,
                unread_axes(self._live),
                refusal_words(conditioner.refused, self._sizes, robot),
                clocks_apart(conditioner.ahead),
                robot,
            )
        timeout_s, now_s = self._silence.timeout_s, monotonic()
        heard = any(now_s - one.heard_s <= timeout_s for one in self._inputs)
        return Health(
            timeout_s, silence_s, age, rate_hz, waiting, refusing, clock_refused,
            STANDS if self._silence.clock_stands(now_s) else "", self._live.misfit(),
            self._alternating(), self._other_estimators(), heard,
            tuple(one.topic for one in self._inputs if one.by_arrival),
        )  # fmt: skip

    def _other_estimators(self) -> str:
        """Who publishes the tensions, if more than this node does; otherwise empty."""
        topic = self._node.resolve_topic_name(TENSIONS)
        names = publishing_nodes(self._node, topic)
        if len(names) < 2:
            return ""
        return f"several estimators: {topic} is published by {_listed(names)}; stop or remap one"

    def _alternating(self) -> str:
        """Axes whose readings alternate between two motions, and who publishes them; or empty.

        Those of a single publisher may do so within counts or noise that the file does not state.
        """
        axes, found = self._live.conditioner.alternating, []
        for one in self._inputs:
            if own := [axis for axis in axes if axis in one.axes]:
                names = publishing_nodes(self._node, one.topic)
                alone = ": is resolution or noise in the robot file too small?"
                found.append(
                    f"{', '.join(own)}, published by {_listed(names)}{alone * (len(names) == 1)}"
                )
        return "; ".join(found)

    def _refusing(self) -> str:
        """Rate and causes of the readings refused since the last call; empty if tolerated.

        Unknown names are not counted: a shared topic may carry other axes.
        """
        now_s, refused = monotonic(), self._live.conditioner.refused
        since = {
            cause: count - self._refused.get(cause, 0)
            for cause, count in refused.items()
            if cause != "unknown_name"
        }
        elapsed_s = now_s - self.looked_s
        rate = sum(since.values()) / elapsed_s if elapsed_s > 0.0 else 0.0
        self._sizes = self._live.conditioner.take_refused() or self._sizes
        self._refused, self.looked_s = refused, now_s
        if rate <= TOLERATED_PER_S:
            return ""
        crowds = [
            f"; {one.topic} is published by {_listed(names)}"
            for one in self._inputs
            if len(names := publishing_nodes(self._node, one.topic)) > 1
        ]
        words = refusal_words(since, self._sizes, self._live.model.robot)
        return f"{rate:.0f} readings per second refused: {words}{''.join(crowds)}"

    def warn(self, health: Health) -> None:
        """Log why there is no estimate, at most every AGAIN_S."""
        if health.waiting and monotonic() - self.estimated_s > PATIENCE_S:
            self._quiet = True
            words = f"no estimate: {health.waiting}"
            self._node.get_logger().warning(words, throttle_duration_sec=AGAIN_S)
