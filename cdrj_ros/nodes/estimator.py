"""The estimator node: encoder readings in; tensions, nodal forces and efforts out."""

from __future__ import annotations

import argparse
import gc
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NoReturn

import numpy as np
from cdrj_msgs.msg import CableTensions, NodalForces
from cdrj_msgs.srv import SetPreload
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cdrj_ros.commands.shared import DONE, run_command
from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.conditioning.tracking import new_track, track
from cdrj_ros.estimation.session import LiveEstimator, Output
from cdrj_ros.estimation.state_file import StateFileError, read_state, write_state
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.foundation.text import counted
from cdrj_ros.messages.cdr import (
    JointStateDecoder,
    MessageError,
    cable_tensions,
    joint_state_efforts,
)
from cdrj_ros.messages.conversions import EstimateEncoder, marked_stale
from cdrj_ros.model.loading import load_model
from cdrj_ros.nodes.diagnostics import StepTimes, diagnostic_array, status_of
from cdrj_ros.nodes.settings import (
    changed_options,
    declare_friction,
    declare_number,
    declare_options,
    declare_preload,
    declare_text,
)
from cdrj_ros.nodes.spinning import RANGE, STOP_POLL_S, ros_context, starting

DEPTH = 1000
"""Messages that a topic may queue: a burst of a second at 1 kHz is not lost."""

WATCHES = 4
"""Looks at the inputs within the timeout."""


def _quality() -> QoSProfile:
    """Of one topic; a profile of its own each, for an override changes the one it is given."""
    return QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)


class EstimatorNode(Node):
    """Subscribes, steps, publishes."""

    def __init__(self, state_file: Path | None = None, **options: Any) -> None:
        """Read the parameters and the robot file, then open topics and services.

        Args:
            state_file: kept up to date, and taken up at the start; never a parameter, so that
                nobody on the network can have a file written.
            options: of rclpy's Node.

        Raises:
            CdrjError: the robot file is missing or wrong.
        """
        super().__init__("estimator", namespace="cdrj", **options)
        path = declare_text(self, "robot", "", "Robot file (YAML), or the name of an installed one")
        if not path:
            raise UsageError("the parameter robot is missing: --ros-args -p robot:=FILE")
        self.timeout_s = declare_number(
            self, "timeout", 0.5, 0.001, 3600.0, "Silence after which outputs are marked stale [s]",
            read_only=True,
        )  # fmt: skip
        self._frame_id = declare_text(self, "frame_id", "", "frame_id of the outgoing headers")
        model = load_model(path, declare_preload(self))
        self.live = LiveEstimator(model, declare_options(self))
        if friction := declare_friction(self):
            self.live.set_numbers(friction)
        self._warm_up()
        self._state_file = state_file
        if state_file is not None:
            self._read_state(state_file)
        self._open()
        gc.collect()
        gc.freeze()  # what lives as long as the node is not looked at again and again
        layout = model.layout
        self.get_logger().info(
            f"{model.robot.name}: {counted(len(layout.motors), 'motor')}, "
            f"{counted(len(layout.joints), 'joint')}, {counted(len(layout.elements), 'element')}, "
            f"{counted(len(layout.pulleys), 'pulley')}"
        )

    def _open(self) -> None:
        """Topics, services, timers."""
        live = self.live
        self.encoder = EstimateEncoder(
            live.model.layout, self._frame_id, uncertain=live.spread is not None
        )
        self.output: Output | None = None
        self.times = StepTimes()
        self._published = 0
        self._diagnosed = 0
        self._heard_ns: int | None = None
        self._diagnosed_ns = self._now_ns()

        overridable = QoSOverridingOptions.with_default_policies()
        self.tensions, self.forces, self.efforts = (
            self.create_publisher(message, topic, _quality(), qos_overriding_options=overridable)
            for message, topic in (
                (CableTensions, "tensions"),
                (NodalForces, "nodal_forces"),
                (JointState, "efforts"),
            )
        )
        self.efforts_stddev = (
            self.create_publisher(
                JointState, "efforts_stddev", _quality(), qos_overriding_options=overridable
            )
            if live.spread is not None
            else None
        )
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(Trigger, "~/tare", self._on_tare)
        self.create_service(SetPreload, "~/set_preload", self._on_set_preload)
        self._subscribe(overridable)
        self.create_timer(1.0, self._on_diagnostics)
        self.create_timer(self.timeout_s / WATCHES, self._on_watch)
        self.add_on_set_parameters_callback(self._on_parameters)

    def _now_ns(self) -> int:
        """Time of the node's clock, simulated time included [ns]."""
        return int(self.get_clock().now().nanoseconds)

    def _warm_up(self) -> None:
        """Compile or load the kernels before the first message, not during it."""
        begin = perf_counter()
        robot = self.live.model.robot
        reference = Sample(
            1_000_000_000,
            np.array([motor.reference_angle for motor in robot.motors]),
            np.array([joint.reference_angle for joint in robot.joints]),
        )
        self.live.take(reference)
        self.live.take(reference._replace(stamp_ns=1_001_000_000))
        self.live.reset()
        track(new_track(), 1_000_000, 0.0, 1.0, 1.0)
        took = perf_counter() - begin
        if took > 2.0:
            self.get_logger().info(f"kernels compiled in {took:.0f} s; kept for the next start")

    def _read_state(self, path: Path) -> None:
        try:
            if words := read_state(self.live, path):
                self.get_logger().info(words)
        except StateFileError as error:
            self.get_logger().warning(f"{error}; starting without it")

    def write_state(self) -> None:
        """Keep what is known, where a state file was asked for."""
        if self._state_file is None:
            return
        try:
            write_state(self.live, self._state_file)
        except StateFileError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=60.0)

    def _subscribe(self, overridable: QoSOverridingOptions) -> None:
        motors = self.resolve_topic_name("motor_states")
        joints = self.resolve_topic_name("joint_states")
        kinds = {"motor_states": "motors", "joint_states": "joints"}
        if motors == joints:
            kinds = {"motor_states": "both"}
        for topic, kind in kinds.items():
            self.create_subscription(
                JointState,
                topic,
                self._listener(kind),
                _quality(),
                raw=True,
                qos_overriding_options=overridable,
            )
        if self.live.options.tension_sensors:
            self.create_subscription(
                CableTensions,
                "tension_sensors",
                self._on_tensions,
                _quality(),
                raw=True,
                qos_overriding_options=overridable,
            )

    def _listener(self, kind: str) -> Callable[[bytes], None]:
        """The callback of one topic: decode, condition, step, publish."""
        decode = JointStateDecoder()
        live = self.live
        feed, refused = live.feed, live.conditioner.refused
        with_efforts = live.options.track_preload and kind != "joints"

        def on_message(payload: bytes) -> None:
            begin = perf_counter()
            try:
                stamp, names, position = decode(payload)
                if with_efforts:
                    live.feed_efforts(*joint_state_efforts(payload))
            except MessageError:
                refused["malformed"] += 1
                return
            jumped, outputs = feed(kind, stamp, names, position)
            if jumped:
                self.get_logger().warning(
                    "the clock of the inputs went back: started anew", throttle_duration_sec=1.0
                )
            if outputs:
                self.times.add((perf_counter() - begin) / len(outputs))
                for output in outputs:
                    self._publish(output)
                self._heard_ns = self._now_ns()

        return on_message

    def _publish(self, output: Output) -> None:
        estimate, stddev = self.output = output
        self.tensions.publish(self.encoder.tensions(estimate, stddev))
        self.forces.publish(self.encoder.nodal_forces(estimate, stddev))
        self.efforts.publish(self.encoder.efforts(estimate))
        on_efforts = self.efforts_stddev
        if on_efforts is not None and stddev is not None and on_efforts.get_subscription_count():
            on_efforts.publish(self.encoder.efforts_stddev(estimate, stddev))
        self._published += 1

    def _on_tensions(self, payload: bytes) -> None:
        try:
            self.live.feed_tensions(*cable_tensions(payload))
        except MessageError:
            self.live.conditioner.refused["malformed"] += 1

    def _on_watch(self) -> None:
        """Say again, and marked stale, what was known when the inputs fell silent."""
        if self.output is None or self._heard_ns is None:
            return
        now = self._now_ns()
        self._heard_ns = min(self._heard_ns, now)  # the node's clock may have been set back
        if now - self._heard_ns > self.timeout_s * 1e9:
            self._publish_stale(self.output)

    def _on_diagnostics(self) -> None:
        now = self._now_ns()
        elapsed = (now - self._diagnosed_ns) * 1e-9
        rate = (self._published - self._diagnosed) / elapsed if elapsed > 0.0 else 0.0
        self._diagnosed, self._diagnosed_ns = self._published, now
        status = status_of(
            self.get_fully_qualified_name().lstrip("/"),
            self.live,
            self.output,
            rate,
            None if self._heard_ns is None else self._silence_s(),
            self.timeout_s,
            self.times,
        )
        self.diagnostics.publish(diagnostic_array(self.get_clock().now().to_msg(), status))
        self.write_state()

    def _forget(self) -> None:
        """What was said last holds no longer: the last message on the topics says so."""
        if self.output is not None:
            self._publish_stale(self.output)
        self.output = None
        self._heard_ns = None
        self.write_state()

    def _publish_stale(self, output: Output) -> None:
        stale = marked_stale(output.estimate)
        self.tensions.publish(self.encoder.tensions(stale, output.stddev))
        self.forces.publish(self.encoder.nodal_forces(stale, output.stddev))

    def _silence_s(self) -> float:
        """Time since the last estimate [s]; infinite before the first."""
        if self._heard_ns is None:
            return float("inf")
        return max(self._now_ns() - self._heard_ns, 0) * 1e-9

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.live.reset()
        self._forget()
        response.success = True
        response.message = (
            f"{self.live.model.robot.name}: friction history and waiting readings forgotten; the "
            "next sample of every motor and joint starts anew"
        )
        return response

    def _on_tare(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            if self.live.sample is not None and self._silence_s() > self.timeout_s:
                raise UsageError(
                    f"no estimate for {self.timeout_s:g} s: where the robot is now is not known"
                )
            response.message = self.live.tare()
            response.success = True
            self._forget()
            self.get_logger().info(response.message)
        except CdrjError as error:
            response.success, response.message = False, f"nothing changed: {error}"
        return response

    def _on_set_preload(
        self, request: SetPreload.Request, response: SetPreload.Response
    ) -> SetPreload.Response:
        try:
            if len(request.cable) != len(request.preload):
                raise UsageError(
                    f"as many preloads as cables are needed, got {len(request.cable)} cables and "
                    f"{len(request.preload)} preloads"
                )
            if len(set(request.cable)) != len(request.cable):
                raise UsageError("a cable is named twice")
            changes = dict(zip(request.cable, request.preload, strict=True))
            response.message = self.live.set_preload(changes)
            response.success = True
            self._forget()
            self.get_logger().info(f"preload of {response.message}")
        except CdrjError as error:
            response.success, response.message = False, f"nothing changed: {error}"
        return response

    def _on_parameters(self, changes: list[Parameter]) -> SetParametersResult:
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


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see --help")


def _arguments(arguments: list[str]) -> argparse.Namespace:
    parser = _Parser(
        prog="estimator",
        usage="estimator [--state-file FILE] --ros-args -p robot:=FILE [-p timeout:=S] "
        "[-r FROM:=TO] ...",
        description="Tension of every cable element and force on every pulley from motor encoders "
        "and joint angles. Topics in the namespace /cdrj: in motor_states, joint_states, "
        "tension_sensors; out tensions, nodal_forces, efforts; /diagnostics. Services: ~/reset, "
        "~/tare, ~/set_preload.",
    )
    parser.add_argument(
        "--state-file", type=Path, metavar="FILE",
        help="what is known is written there every second, and taken up at the next start",
    )  # fmt: skip
    return parser.parse_args(arguments)


def _body(argv: Sequence[str]) -> int:
    arguments = ["estimator", *argv]
    with starting():
        own = _arguments(remove_ros_args(arguments)[1:])
    with ros_context(arguments) as stop:
        with starting():
            node = EstimatorNode(own.state_file)
        if os.environ.get(RANGE) == "LOCALHOST":
            node.get_logger().info(f"heard on this machine only; {RANGE}=SUBNET opens the network")
        executor = EventsExecutor()
        executor.add_node(node)
        with stop.listening():
            try:
                while not stop:
                    executor.spin_once(timeout_sec=STOP_POLL_S)
            finally:
                node.write_state()
                executor.shutdown()
                node.destroy_node()
    return DONE


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("estimator", _body, sys.argv[1:] if argv is None else argv)
