"""The estimator node: encoder readings in; tensions, nodal forces and efforts out."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from cdrj_msgs.msg import CableTensions, NodalForces
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cdrj_ros.cdr import JointStateDecoder, MessageError
from cdrj_ros.commands.shared import BAD_INPUT, DONE, load_model
from cdrj_ros.conversions import EstimateEncoder, marked_stale
from cdrj_ros.estimation.conditioning import Conditioner
from cdrj_ros.estimation.estimator import Estimate, Sample, initial_state, step
from cdrj_ros.model.errors import CdrjError, UsageError
from cdrj_ros.model.plan import Model
from cdrj_ros.nodes.diagnostics import StepTimes, diagnostic_array, status_of
from cdrj_ros.nodes.spinning import STOP_POLL_S, ros_context

DEPTH = 1000
"""Messages that a topic may queue: a burst of a second at 1 kHz is not lost."""


class EstimatorNode(Node):
    """Subscribes, steps, publishes."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters and the robot file, then open topics and services.

        Raises:
            CdrjError: the robot file is missing or wrong.
        """
        super().__init__("estimator", namespace="cdrj", **options)
        path = self._declare_text("robot", "", "Robot file (YAML), or the name of an installed one")
        if not path:
            raise UsageError("the parameter robot is missing: --ros-args -p robot:=FILE")
        self.timeout_s = self._declare_number(
            "timeout", 0.5, 0.001, 3600.0, "Silence after which outputs are marked stale [s]"
        )
        frame_id = self._declare_text("frame_id", "", "frame_id of the outgoing headers")
        preload = self.declare_parameter(
            "preload",
            Parameter.Type.DOUBLE_ARRAY,
            ParameterDescriptor(
                description="Preload of every cable [N]; unset: the robot file's", read_only=True
            ),
        ).value
        self.model: Model = load_model(path, preload)
        self._warm_up()
        self.conditioner = Conditioner(self.model.robot)
        self.encoder = EstimateEncoder(self.model.layout, frame_id)
        self.state = initial_state(self.model)
        self.estimate: Estimate | None = None
        self.times = StepTimes()
        self.unsolved = 0
        self._jumps = 0
        self._heard_s: float | None = None
        self._published = 0

        qos = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)
        overridable = QoSOverridingOptions.with_default_policies()
        self.tensions = self.create_publisher(
            CableTensions, "tensions", qos, qos_overriding_options=overridable
        )
        self.forces = self.create_publisher(
            NodalForces, "nodal_forces", qos, qos_overriding_options=overridable
        )
        self.efforts = self.create_publisher(
            JointState, "efforts", qos, qos_overriding_options=overridable
        )
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self._subscribe(qos, overridable)
        self.create_timer(1.0, self._on_diagnostics)
        self.create_timer(self.timeout_s / 2.0, self._on_watchdog)
        gc.collect()
        gc.freeze()  # what lives as long as the node is not looked at again and again
        layout = self.model.layout
        self.get_logger().info(
            f"{self.model.robot.name}: {len(layout.motors)} motors, {len(layout.joints)} joints, "
            f"{len(layout.elements)} elements, {len(layout.pulleys)} pulleys"
        )

    def _declare_text(self, name: str, default: str, description: str) -> str:
        descriptor = ParameterDescriptor(description=description, read_only=True)
        return str(self.declare_parameter(name, default, descriptor).value)

    def _declare_number(
        self, name: str, default: float, low: float, high: float, description: str
    ) -> float:
        descriptor = ParameterDescriptor(
            description=description,
            read_only=True,
            floating_point_range=[FloatingPointRange(from_value=low, to_value=high)],
        )
        return float(self.declare_parameter(name, default, descriptor).value)

    def _warm_up(self) -> None:
        """Compile or load the kernels before the first message, not during it."""
        begin = perf_counter()
        reference = Sample(
            0,
            np.array([motor.reference_angle for motor in self.model.robot.motors]),
            np.array([joint.reference_angle for joint in self.model.robot.joints]),
        )
        state, _ = step(self.model, initial_state(self.model), reference)
        step(self.model, state, reference._replace(stamp_ns=1_000_000))
        took = perf_counter() - begin
        if took > 2.0:
            self.get_logger().info(f"kernels compiled in {took:.0f} s; kept for the next start")

    def _subscribe(self, qos: QoSProfile, overridable: QoSOverridingOptions) -> None:
        motors = self.resolve_topic_name("motor_states")
        joints = self.resolve_topic_name("joint_states")
        if motors == joints:
            feeds = {"motor_states": self.conditioner.feed_both}
        else:
            feeds = {
                "motor_states": self.conditioner.feed_motors,
                "joint_states": self.conditioner.feed_joints,
            }
        for topic, feed in feeds.items():
            self.create_subscription(
                JointState,
                topic,
                self._listener(feed),
                qos,
                raw=True,
                qos_overriding_options=overridable,
            )

    def _listener(self, feed: Callable[..., list[Sample]]) -> Callable[[bytes], None]:
        """The callback of one topic: decode, condition, step, publish."""
        decode = JointStateDecoder()
        refused = self.conditioner.refused

        def on_message(payload: bytes) -> None:
            try:
                stamp, names, position = decode(payload)
            except MessageError:
                refused["malformed"] += 1
                return
            samples = feed(stamp, names, position)
            if self.conditioner.clock_jumps != self._jumps:
                self._jumps = self.conditioner.clock_jumps
                self.state = initial_state(self.model)
                self.get_logger().warning("the clock of the inputs went back: started anew")
            for sample in samples:
                self._step(sample)

        return on_message

    def _step(self, sample: Sample) -> None:
        begin = perf_counter()
        self.state, estimate = step(self.model, self.state, sample)
        self.times.add(perf_counter() - begin)
        self.estimate = estimate
        if not estimate.solved:
            self.unsolved += 1
        self._publish(estimate)
        self._published += 1
        self._heard_s = begin

    def _publish(self, estimate: Estimate) -> None:
        self.tensions.publish(self.encoder.tensions(estimate))
        self.forces.publish(self.encoder.nodal_forces(estimate))
        self.efforts.publish(self.encoder.efforts(estimate))

    def _on_watchdog(self) -> None:
        """Say again, and marked stale, what was known when the inputs fell silent."""
        if self.estimate is None or self._heard_s is None:
            return
        if perf_counter() - self._heard_s > self.timeout_s:
            stale = marked_stale(self.estimate)
            self.tensions.publish(self.encoder.tensions(stale))
            self.forces.publish(self.encoder.nodal_forces(stale))

    def _on_diagnostics(self) -> None:
        age = None if self._heard_s is None else perf_counter() - self._heard_s
        status = status_of(
            self.get_fully_qualified_name().lstrip("/"),
            self.model.robot.name,
            self.estimate,
            float(self._published),
            age,
            self.timeout_s,
            self.times,
            self.unsolved,
            self.conditioner.refused,
        )
        self._published = 0
        self.diagnostics.publish(diagnostic_array(self.get_clock().now().to_msg(), status))

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.conditioner.reset()
        self.state = initial_state(self.model)
        self.estimate = None
        self._heard_s = None
        response.success = True
        response.message = (
            f"{self.model.robot.name}: friction history and waiting readings forgotten; the next "
            "sample of every motor and joint starts anew"
        )
        return response


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    arguments = list(sys.argv if argv is None else ["estimator", *argv])
    rest = remove_ros_args(arguments)[1:]
    if rest in (["--help"], ["-h"]):
        print(
            "usage: estimator --ros-args -p robot:=FILE [-p timeout:=S] [-r FROM:=TO] ...\n\n"
            "Tension of every cable element and force on every pulley from motor encoders and\n"
            "joint angles. Topics in the namespace /cdrj: in motor_states, joint_states; out\n"
            "tensions, nodal_forces, efforts; /diagnostics. Service: ~/reset."
        )
        return DONE
    if rest:
        print(f"estimator: unknown arguments {' '.join(rest)}; see --help", file=sys.stderr)
        return BAD_INPUT
    with ros_context(arguments) as stop:
        try:
            node = EstimatorNode()
        except CdrjError as error:
            print(f"estimator: {error}", file=sys.stderr)
            return BAD_INPUT
        executor = EventsExecutor()
        executor.add_node(node)
        try:
            while not stop:
                executor.spin_once(timeout_sec=STOP_POLL_S)
        finally:
            executor.shutdown()
            node.destroy_node()
    return DONE
