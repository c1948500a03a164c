"""The estimator inside a node: it subscribes to the inputs, estimates and publishes.

``EstimatorNode`` and the lifecycle node ``ManagedEstimator`` have one each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from pathlib import Path
from time import monotonic, time_ns
from typing import Any, Final

from cdrj_msgs.msg import CableTensions
from diagnostic_msgs.msg import DiagnosticArray, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from cdrj_ros._core import JointStateDecoder
from cdrj_ros.estimation.conditioner import Kind, efforts_of
from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.estimation.state_file import StateFileError, read_state, write_state
from cdrj_ros.estimation.verdict_words import Report
from cdrj_ros.foundation.output import counted, printable
from cdrj_ros.messages.cdr import MessageError, cable_tensions
from cdrj_ros.messages.templates import marked_stale
from cdrj_ros.messages.topics import DIAGNOSTICS, FEW, JOINT_STATES, MOTOR_STATES, TENSION_SENSORS
from cdrj_ros.nodes.changes import SIMULATED, Changes
from cdrj_ros.nodes.diagnostics import StepTimes, diagnostic_array, health_of, report_of, status_of
from cdrj_ros.nodes.inputs import AGAIN_S, InputTopic, InputWatch
from cdrj_ros.nodes.outputs import Outputs, RateLimit
from cdrj_ros.nodes.parameters import friction_of, options_of, settings
from cdrj_ros.nodes.robot_description import given_model
from cdrj_ros.nodes.settings import declare, has_chosen, values_of
from cdrj_ros.nodes.silence import Silence, StampClock
from cdrj_ros.nodes.spinning import CheckedClock

WATCHES: Final = 4
"""Number of checks of the inputs per timeout."""

WATCH_S: Final = 1.0
"""Maximum time between two checks of the inputs, however long the timeout is [s]."""

DIAGNOSIS_S: Final = 1.0
"""Time between two messages on /diagnostics [s]."""

IDLE: Final = {
    "unconfigured": "no robot is loaded; the transition configure loads it",
    "inactive": "no estimates; the transition activate starts them",
    "finalized": "shut down; end the process",
}
"""What diagnostics say of the states without estimates."""


class Estimation:
    """Subscribes to the inputs of a node, steps the estimator and publishes the estimates."""

    live: LiveEstimator
    """The estimator, while configured."""

    def __init__(
        self, node: CheckedClock, state_file: Path | None = None, *, managed: bool = False
    ) -> None:
        """Declare the parameters and publish diagnostics; ``configure`` loads the robot.

        Args:
            node: the node, whose parameters, topics and services these are.
            state_file: read by ``configure`` and updated every second; not a parameter, so that no
                other node can choose the file to be written.
            managed: whether every parameter may change while no robot is loaded.

        Raises:
            ParameterException: a given parameter has another type, or is out of range.
        """
        self.node, self._state_file, self._managed = node, state_file, managed
        self.state = "unconfigured"
        """``unconfigured``, ``inactive``, ``active`` or ``finalized``."""
        self.latest: Estimate | None = None
        """The last estimate."""
        self._simulated = False
        self._chosen: dict[str, bool] = {}
        """Whether the user has chosen the reliability of an input, by topic."""
        declare(node, settings(), fixed=not managed)
        self._given: list[Parameter] = []
        self._named: set[str] = set()
        """The causes that the last diagnosis named."""
        self._said_s: dict[str, float] = {}
        """When a logged cause was last named, by the steady clock [s]."""
        self._changes = Changes(self)
        self._diagnosed_s = monotonic()
        self.diagnostics = node.create_publisher(DiagnosticArray, DIAGNOSTICS, FEW)
        node.create_timer(DIAGNOSIS_S, self.diagnose)
        # a simulated clock may stand still or be set back, so timers run on a steady clock as well
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(DIAGNOSIS_S / 2.0, self._on_steady, clock=self._steady)

    @property
    def configured(self) -> bool:
        """Whether the robot is loaded, and outputs and services are open."""
        return self.state in ("inactive", "active")

    # --- states -----------------------------------------------------------------------------------

    def configure(self) -> None:
        """Read the parameters and the robot file, prepare the estimator, open outputs and services.

        Raises:
            CdrjError: a parameter, the robot file or the state file is missing or invalid.
        """
        node, values = self.node, values_of(self.node, settings())
        options = options_of(values)
        model = given_model(node, values["robot"], [*(values["preload"] or ())])
        self.timeout_s, self.stamps = values["timeout"], StampClock(values["same_clock_within"])
        self.live = LiveEstimator(model, options)
        if friction := friction_of(values):
            self.live.set_numbers(friction)
        self._read_state()
        self.live.expect_sensors()
        self._limit = RateLimit(values["max_rate"])
        self.latest = None
        self.times = StepTimes()
        self._simulated = bool(node.get_parameter(SIMULATED).value)
        self.silence = Silence(self.timeout_s, self._simulated)
        self._counted, self._counted_ns = 0, self.now_ns()
        self.outputs = Outputs(node, self.live, values["frame_id"])
        self._changes.offer_services()
        self._given = [node.get_parameter_or(one.name) for one in settings() if one.changeable]
        self.state = "inactive"
        self._changes.show_in_force()
        layout = model.layout
        node.get_logger().info(
            f"{model.robot.name}: {counted(len(layout.motors), 'motor')}, "
            f"{counted(len(layout.joints), 'joint')}, {counted(len(layout.elements), 'element')}, "
            f"{counted(len(layout.pulleys), 'pulley')}"
        )

    def activate(self) -> None:
        """Subscribe to the inputs and check them regularly."""
        self.inputs = self._subscribe()
        self.watch = InputWatch(
            self.node, self.live, self.inputs, self.silence, self.stamps, self.now_ns
        )
        period_s = min(self.timeout_s / WATCHES, WATCH_S)
        clocks = [self._steady, *([self.node.get_clock()] if self._simulated else [])]
        self._checks = [
            self.node.create_timer(period_s, self._on_watch, clock=one) for one in clocks
        ]
        self.state = "active"

    def deactivate(self) -> None:
        """Publish the last estimate as STALE, write the state file and close the inputs."""
        self.state = "inactive"
        for timer in self._checks:
            self.node.destroy_timer(timer)
        for one in self.inputs:
            one.close()
        self.forget()
        self.live.suspend()

    def clean_up(self) -> None:
        """Close outputs and services, unload the robot; parameters return to what was given."""
        self.state = "unconfigured"
        self.outputs.close()
        self._changes.close()
        del self.live, self.outputs
        unset = Parameter.Type.NOT_SET
        self.node.set_parameters(
            [
                Parameter(one.name, Parameter.Type.DOUBLE_ARRAY, []) if one.type_ == unset else one
                for one in self._given
            ]
        )

    def shut_down(self) -> None:
        """Deactivate and clean up, whatever the state."""
        if self.state == "active":
            self.deactivate()
        if self.configured:
            self.clean_up()
        self.state = "finalized"

    def _subscribe(self) -> list[InputTopic]:
        robot, resolve = self.live.model.robot, self.node.resolve_topic_name
        motors = self.live.model.layout.motors
        joints = tuple(joint.name for joint in robot.as_read.joints)
        kinds: dict[str, tuple[Kind, tuple[str, ...]]] = {MOTOR_STATES: ("motors", motors)}
        if joints and resolve(MOTOR_STATES) == resolve(JOINT_STATES):
            kinds = {MOTOR_STATES: ("both", motors + joints)}
        elif joints:
            kinds[JOINT_STATES] = ("joints", joints)
        inputs = []
        for name, (kind, axes) in kinds.items():
            topic = self._input(JointState, name, axes)
            topic.subscribe(self.angle_callback(kind, topic))
            inputs.append(topic)
        topic = self._input(CableTensions, TENSION_SENSORS, ())
        topic.subscribe(self.on_tensions)
        inputs.append(topic)
        return inputs

    def _input(self, message: Any, name: str, axes: tuple[str, ...]) -> InputTopic:
        if name not in self._chosen:
            self._chosen[name] = has_chosen(self.node, name)
        return InputTopic(self.node, message, name, axes, chosen=self._chosen[name])

    # --- from a reading to an estimate ------------------------------------------------------------

    def angle_callback(self, kind: Kind, topic: InputTopic) -> Callable[[bytes], None]:
        """The callback of a topic of angles: decodes, conditions, steps and publishes."""
        live = self.live
        message = topic.last = JointStateDecoder(efforts=True)

        def read_efforts() -> None:
            stamp_ns, names = message.stamp_ns, message.names
            if live.wants_efforts(names, stamp_ns):
                efforts = efforts_of(live.model.robot, names, message.efforts)
                live.feed_efforts(stamp_ns, names, efforts)

        def on_angles(payload: bytes) -> None:
            begin_s = topic.heard_s = monotonic()
            if not message.decode(payload, self.now_ns()):
                live.conditioner.refuse("malformed")
                return
            topic.note()
            if message.has_efforts:
                read_efforts()
            jumped, estimates = live.feed_message(kind, message)
            if jumped:
                self.node.get_logger().warning(
                    "the clock of the inputs went back: estimate restarted",
                    throttle_duration_sec=1.0,
                )
            if estimates:
                self._publish(estimates, begin_s)

        return on_angles

    def _publish(self, estimates: list[Estimate], begin_s: float) -> None:
        """Publish the estimates that one message led to; those older than the timeout as STALE.

        Args:
            estimates: at least one.
            begin_s: when that message arrived, by the steady clock [s].
        """
        now_ns, now_s = self.now_ns(), monotonic()
        self.times.add((now_s - begin_s) / len(estimates))
        newest_ns = estimates[-1].stamp_ns + self.live.conditioner.lag_ns
        late_ns = self.stamps.note(newest_ns, now_ns)
        fresh_ns = newest_ns + max(late_ns, 0) - round(self.timeout_s * 1e9)
        for estimate in estimates:
            self.latest = estimate
            if not self._limit.passes(estimate.stamp_ns):
                continue
            is_fresh = estimate.stamp_ns >= fresh_ns
            self.outputs.publish(estimate if is_fresh else marked_stale(estimate))
        self.watch.note(now_ns, now_s)

    def on_tensions(self, payload: bytes) -> None:
        """Take a message of load cells; a malformed one is counted."""
        try:
            stamp_ns, names, tension, stddev = cable_tensions(payload)
            self.live.feed_tensions(stamp_ns or self.now_ns(), names, tension, stddev)
        except MessageError:
            self.live.conditioner.refuse("malformed")

    # --- time -------------------------------------------------------------------------------------

    def now_ns(self) -> int:
        """Time of the node's clock, which may be simulated [ns]."""
        if not self._simulated:  # the same time; rclpy's clock takes 3 us or more
            return time_ns()
        return int(self.node.get_clock().now().nanoseconds)

    def _on_watch(self) -> None:
        """Republish the last estimate as STALE once the inputs have been silent for the timeout."""
        if self.latest is not None and self.watch.lost():
            self.outputs.publish_stale(self.latest)

    def _on_steady(self) -> None:
        """Publish diagnostics if the timer on the node's clock has not done so."""
        if monotonic() - self._diagnosed_s > 1.5 * DIAGNOSIS_S:
            self.diagnose()

    def diagnose(self) -> None:
        """Publish diagnostics and write the state file."""
        self._diagnosed_s = monotonic()
        name = self.node.get_fully_qualified_name().lstrip("/")
        robot = self.live.model.robot.name if self.configured else ""
        reports = {name: self._report()}
        if self.configured and (found := health_of(self.live)) is not None:
            reports[f"{name}: health"] = found
        statuses = [status_of(one, report, robot) for one, report in reports.items()]
        if self._managed:
            statuses[0].values.append(KeyValue(key="lifecycle state", value=self.state))
        stamp = self.node.get_clock().now().to_msg()
        self.diagnostics.publish(diagnostic_array(stamp, *statuses))
        self._log(list(reports.values()))
        self.write_state()

    def _report(self) -> Report:
        if self.state != "active":
            return Report("warn", f"{self.state}: {IDLE[self.state]}", {})
        now_ns = self.now_ns()
        elapsed_s = (now_ns - self._counted_ns) * 1e-9
        since = self.outputs.published - self._counted
        self._counted, self._counted_ns = self.outputs.published, now_ns
        rate_hz = since / elapsed_s if elapsed_s > 0.0 else 0.0
        health = self.watch.health(self.latest, rate_hz, self.node.clock_refused)
        self.watch.warn(health)
        return report_of(self.live, self.latest, health, self.times)

    def _log(self, reports: Sequence[Report]) -> None:
        """Log what reports say, once while a cause lasts that two diagnoses in a row have named."""
        now_s = monotonic()
        named = {one for report in reports for one in report.named}
        lasting, self._named = named & self._named, named
        new = {one for one in lasting if now_s - self._said_s.get(one, -inf) > AGAIN_S}
        self._said_s |= dict.fromkeys(lasting, now_s)
        for report in reports:
            if not new.isdisjoint(report.named):
                self.node.get_logger().warning(printable(report.message))

    # --- state file -------------------------------------------------------------------------------

    def _read_state(self) -> None:
        if self._state_file is None:
            return
        try:
            if words := read_state(self.live, self._state_file):
                self.node.get_logger().info(words)
        except StateFileError as error:
            self.node.get_logger().warning(f"{error}; starting without it")

    def write_state(self) -> None:
        """Write the state file, if there is one."""
        if self._state_file is None or not self.configured:
            return
        try:
            write_state(self.live, self._state_file)
        except StateFileError as error:
            self.node.get_logger().warning(str(error), throttle_duration_sec=60.0)

    def forget(self) -> None:
        """Republish the last estimate as STALE, then discard it."""
        if self.latest is not None:
            self.outputs.publish_stale(self.latest)
        self.latest = None
        self.silence.forget()
        self._limit.reset()
        self.write_state()
