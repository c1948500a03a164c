"""The estimator node: computes tensions, nodal forces and efforts from encoder readings."""

from __future__ import annotations

import gc
from collections.abc import Callable
from pathlib import Path
from time import monotonic, time_ns
from typing import Any, Final

from cdrj_msgs.msg import CableTensions
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState

from cdrj_ros.conditioning.conditioner import Kind
from cdrj_ros.estimation.session import LiveEstimator, Output
from cdrj_ros.estimation.state_file import StateFileError, read_state, write_state
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.foundation.text import counted
from cdrj_ros.messages.cdr import MessageError
from cdrj_ros.messages.conversions import marked_stale
from cdrj_ros.messages.decoders import cable_tensions
from cdrj_ros.messages.topics import (
    DIAGNOSTICS,
    FEW,
    JOINT_STATES,
    MOTOR_STATES,
    NAMESPACE,
    TENSION_SENSORS,
)
from cdrj_ros.model.loading import load_model
from cdrj_ros.nodes.diagnostics import StepTimes, diagnostic_array, status_of
from cdrj_ros.nodes.estimator_services import EstimatorServices
from cdrj_ros.nodes.health import HealthWatch
from cdrj_ros.nodes.input_watch import InputWatch
from cdrj_ros.nodes.inputs import InputTopic, reliability_parameter
from cdrj_ros.nodes.listener import Listener
from cdrj_ros.nodes.output_topics import OutputTopics
from cdrj_ros.nodes.robot_description import robot_description
from cdrj_ros.nodes.settings import (
    SIMULATED,
    changed_options,
    declare,
    given_parameter,
    in_force,
    meant,
    read,
)
from cdrj_ros.nodes.silence import Silence, StampClock
from cdrj_ros.nodes.spinning import starting
from cdrj_ros.nodes.thinning import Thinning
from cdrj_ros.nodes.words import TopicHeard
from cdrj_ros.robot.urdf import description_given

WATCHES: Final = 4
"""Number of checks of the inputs per timeout."""

WATCH_S: Final = 1.0
"""Maximum time between two checks of the inputs, however long the timeout is [s]."""

DIAGNOSIS_S: Final = 1.0
"""Time between two messages on /diagnostics [s]."""


class EstimatorNode(Node):
    """Subscribes to the inputs, steps the estimator and publishes the estimates."""

    live: LiveEstimator

    def __init__(self, state_file: Path | None = None, **options: Any) -> None:
        """Declare the parameters and start.

        Args:
            state_file: read at the start and updated every second; not a parameter, so that no
                other node can choose the file to be written.
            options: passed to rclpy's Node.

        Raises:
            CdrjError: a parameter or the robot file is missing or invalid.
        """
        self.clock_refused = 0
        """Number of invalid times received on /clock."""
        self.configured = False
        """Whether the robot is loaded, and outputs and services are open."""
        self._showing = self._simulated = False
        self._chosen: dict[str, bool] = {}
        """Whether the user has chosen the reliability of an input, by topic."""
        super().__init__("estimator", namespace=NAMESPACE, **options)
        self._state_file = state_file
        self._start()

    def _start(self) -> None:
        """Estimate from now on."""
        declare(self)
        self._configure()
        self._listen()
        self._diagnose()
        self._watch_parameters()

    def _configure(self) -> None:
        """Read the parameters and the robot file, prepare the estimator, open outputs and services.

        Raises:
            CdrjError: a parameter or the robot file is missing or invalid.
        """
        started = read(self)
        if not started.robot:
            raise UsageError("the parameter robot is missing: --ros-args -p robot:=FILE")
        self.timeout_s, self.stamps = started.timeout_s, StampClock(started.same_clock_s)
        with description_given(lambda: robot_description(self)):
            model = load_model(started.robot, started.preload)
        self.live = LiveEstimator(model, started.options)
        if started.friction:
            self.live.set_numbers(started.friction)
        # it needs the angle of every joint
        watched = started.health and self.live.encoderless is None
        self.health = HealthWatch(self.live, marks_unsure=started.health_marks) if watched else None
        if self._state_file is not None:
            self._read_state(self._state_file)
        self._thinning = Thinning(model.robot, started.output, started.max_rate_hz)
        self.output: Output | None = None
        self.times = StepTimes()
        self._simulated = bool(self.get_parameter(SIMULATED).value)
        self.silence = Silence(self.timeout_s, self._simulated)
        self._diagnosed = 0
        self._diagnosed_ns = self._now_ns()
        self.topics = OutputTopics(self, self.live, started)
        self._offered = EstimatorServices(
            self,
            self.live,
            forget=self._forget,
            forget_clock=self.stamps.forget,
            show=self._show_in_force,
            is_silent=lambda: self.watch.silence_s() > self.timeout_s,
            timeout_s=self.timeout_s,
        )
        self.configured = True
        self._show_in_force()
        gc.collect()
        gc.freeze()  # exclude objects that live as long as the node from later collections
        layout = model.layout
        self.get_logger().info(
            f"{model.robot.name}: {counted(len(layout.motors), 'motor')}, "
            f"{counted(len(layout.joints), 'joint')}, {counted(len(layout.elements), 'element')}, "
            f"{counted(len(layout.pulleys), 'pulley')}"
        )

    def _listen(self) -> None:
        """Subscribe to the inputs and check them regularly."""
        self._subscribe()
        period_s = self.timeout_s / WATCHES
        # a simulated clock may stand still or be set back, so timers run on a steady clock as well
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._checks = [
            self.create_timer(min(period_s, WATCH_S), self._on_watch, clock=steady),
            self.create_timer(period_s, self._on_watch),
        ]

    def _diagnose(self) -> None:
        """Publish diagnostics regularly."""
        self._diagnosed_s = monotonic()
        self.diagnostics = self.create_publisher(DiagnosticArray, DIAGNOSTICS, FEW)
        self.create_timer(DIAGNOSIS_S, self._on_diagnostics)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(DIAGNOSIS_S / 2.0, self._on_steady, clock=steady)

    def _watch_parameters(self) -> None:
        self.add_pre_set_parameters_callback(
            lambda changes: meant(self.live if self.configured else None, changes)
        )
        self.add_on_set_parameters_callback(self._on_parameters)

    def _subscribe(self) -> None:
        layout = self.live.model.layout
        joints = tuple(joint.name for joint in self.live.model.robot.as_read.joints)
        kinds: dict[str, tuple[Kind, tuple[str, ...]]]
        if not joints:
            kinds = {MOTOR_STATES: ("motors", layout.motors)}
        elif self.resolve_topic_name(MOTOR_STATES) == self.resolve_topic_name(JOINT_STATES):
            kinds = {MOTOR_STATES: ("both", layout.motors + joints)}
        else:
            kinds = {
                MOTOR_STATES: ("motors", layout.motors),
                JOINT_STATES: ("joints", joints),
            }
        inputs = []
        for topic, (kind, axes) in kinds.items():
            heard = TopicHeard(self.resolve_topic_name(topic), axes)
            chosen = self._has_chosen(heard.topic)
            take = self._listener(kind, heard)
            inputs.append(InputTopic(self, JointState, topic, take, heard, chosen=chosen))
        if self.live.options.tension_sensors:
            cells = TopicHeard(self.resolve_topic_name(TENSION_SENSORS))
            chosen, take = self._has_chosen(cells.topic), self._on_tensions
            inputs.append(
                InputTopic(self, CableTensions, TENSION_SENSORS, take, cells, chosen=chosen)
            )
        self.inputs = inputs
        self.watch = InputWatch(self, self.live, inputs, self.silence, self._now_ns, self.stamps)

    def _has_chosen(self, topic: str) -> bool:
        """Whether the user has chosen a reliability; the first subscription declares a default."""
        if topic not in self._chosen:
            given = given_parameter(self, reliability_parameter(topic))
            self._chosen[topic] = given.type_ != Parameter.Type.NOT_SET
        return self._chosen[topic]

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, *a: Any, **k: Any
    ) -> Any:
        """As in rclpy, but drop invalid times on /clock, which would make rclpy end the node."""
        if msg_type is ClockMessage:
            take = callback

            def callback(message: ClockMessage) -> None:
                if message.clock.sec >= 0 and message.clock.nanosec < 1_000_000_000:
                    take(message)
                else:
                    self.clock_refused += 1

        return super().create_subscription(msg_type, topic, callback, *a, **k)

    def _now_ns(self) -> int:
        """Time of the node's clock, which may be simulated [ns]."""
        if not self._simulated:  # the same time; rclpy's clock takes 3 us or more
            return time_ns()
        return int(self.get_clock().now().nanoseconds)

    def _read_state(self, path: Path) -> None:
        try:
            if words := read_state(self.live, path):
                self.get_logger().info(words)
        except StateFileError as error:
            self.get_logger().warning(f"{error}; starting without it")

    def write_state(self) -> None:
        """Write the state file, if there is one."""
        if self._state_file is None or not self.configured:
            return
        try:
            write_state(self.live, self._state_file)
        except StateFileError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=60.0)

    # --- messages ---------------------------------------------------------------------------------

    def _listener(self, kind: Kind, heard: TopicHeard | None = None) -> Callable[[bytes], None]:
        """The callback of one topic: decodes, conditions, steps and publishes."""
        listener = Listener(
            kind,
            self.live,
            self._thinning,
            self.health,
            heard=TopicHeard("") if heard is None else heard,
            publish=self._take,
            warn=lambda words: self.get_logger().warning(words, throttle_duration_sec=1.0),
        )
        return listener.on_message

    def _take(self, outputs: list[Output], step_s: float) -> None:
        """Publish the estimates that one message led to; those older than the timeout as STALE.

        Args:
            outputs: at least one.
            step_s: time that each has taken [s].
        """
        self.times.add(step_s)
        thinning = self._thinning
        newest_ns = outputs[-1].estimate.stamp_ns + self.live.conditioner.lag_ns
        now_ns = self._now_ns()
        self.stamps.note(newest_ns, now_ns)
        fresh_ns = self.stamps.stale_before_ns(now_ns, self.timeout_s)
        for output in outputs:
            estimate = output.estimate
            self.output = output
            if thinning.active and not thinning.passes(estimate.stamp_ns):
                continue
            if estimate.stamp_ns < fresh_ns:
                self.topics.publish(output._replace(estimate=marked_stale(estimate)))
            else:
                self.topics.publish(output)
        self.live.finish()
        if self.health is not None:
            self.health.follow(outputs[-1])
        self.watch.note()

    def _on_tensions(self, payload: bytes) -> None:
        try:
            readings = cable_tensions(payload)
            self.live.feed_tensions(*readings)
            if self.health is not None:
                self.health.read_tensions(*readings)
        except MessageError:
            self.live.conditioner.refuse("malformed")

    # --- time -------------------------------------------------------------------------------------

    def _on_watch(self) -> None:
        """Republish the last estimate as STALE once the inputs have been silent for the timeout."""
        if self.output is not None and self.watch.lost():
            self.topics.publish_stale(self.output)

    def _on_steady(self) -> None:
        """Publish diagnostics if the timer on the node's clock has not done so."""
        if monotonic() - self._diagnosed_s > 1.5 * DIAGNOSIS_S:
            self._on_diagnostics()

    def _on_diagnostics(self) -> None:
        self._diagnosed_s = monotonic()
        name = self.get_fully_qualified_name().lstrip("/")
        statuses = [self._status(name)]
        if self.configured and self.health is not None and self.health.heard:
            statuses.append(self.health.status(f"{name}: health"))
        self.diagnostics.publish(diagnostic_array(self.get_clock().now().to_msg(), *statuses))
        self.write_state()

    def _status(self, name: str) -> DiagnosticStatus:
        now = self._now_ns()
        elapsed = (now - self._diagnosed_ns) * 1e-9
        rate = (self.topics.published - self._diagnosed) / elapsed if elapsed > 0.0 else 0.0
        self._diagnosed, self._diagnosed_ns = self.topics.published, now
        health = self.watch.health(self.output, rate, self.clock_refused)
        self.watch.warn(health)
        return status_of(name, self.live, self.output, health, self.times)

    def _forget(self) -> None:
        """Republish the last estimate as STALE, then discard it."""
        if self.output is not None:
            self.topics.publish_stale(self.output)
        self.output = None
        if self.health is not None:
            self.health.reset()
        self.silence.forget()
        self._thinning.reset()
        self.write_state()

    # --- parameters -------------------------------------------------------------------------------

    def _show_in_force(self) -> None:
        """Set the parameters to the preloads and the friction in use."""
        self._showing = True
        try:
            with starting():
                self.set_parameters(in_force(self.live))
        finally:
            self._showing = False

    def _on_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        if self._showing:
            return SetParametersResult(successful=True)
        simulated = {change.name: change.value for change in changes}.get(SIMULATED)
        if simulated is not None and simulated != self.get_parameter(SIMULATED).value:
            return SetParametersResult(
                successful=False,
                reason=f"nothing changed: {SIMULATED} is read-only after the start",
            )
        before = self.live.last_ns
        try:
            words = changed_options(self.live, changes)
        except CdrjError as error:
            return SetParametersResult(successful=False, reason=f"nothing changed: {error}")
        if self.live.last_ns != before:
            self._forget()
        if words:
            self.get_logger().info(words)
        return SetParametersResult(successful=True)
