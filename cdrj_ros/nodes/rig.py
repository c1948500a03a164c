"""The rig node: simulates a robot in real time, from motor commands to encoder readings."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from time import monotonic_ns, perf_counter, time_ns
from typing import Any, Final

from cdrj_msgs.srv import Push
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import Trigger

from cdrj_ros.commands.entry import run_command
from cdrj_ros.estimation.verdict_words import Level, Report
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.messages.topics import CLOCK, DIAGNOSTICS, FEW, NAMESPACE
from cdrj_ros.nodes.diagnostics import diagnostic_array, status_of
from cdrj_ros.nodes.rig_settings import SETTINGS, changed_payload, declare_rig, meant
from cdrj_ros.nodes.rig_topics import CommandListener, RigOutputs
from cdrj_ros.nodes.spinning import run_node
from cdrj_ros.simulation.drives import Command, Drives, program_of
from cdrj_ros.simulation.faults import Fault
from cdrj_ros.simulation.live import LiveRig

MOST_BEHIND_S: Final = 0.1
"""If the simulation lags by more than this, it skips the lag instead of catching up [s]."""

AT_ONCE: Final = 20
"""Maximum number of steps before commands and services are processed again."""

CLOCK_HZ: Final = 200.0
"""Rate of /clock in simulated time [Hz]."""

SLOW: Final = 0.95
"""Simulated per real time below which the node is too slow, relative to its speed [-]."""

WARNING_S: Final = 10.0
"""Minimum time between two warnings that the node cannot keep up [s]."""


class RigNode(Node):
    """Advances the simulated rig in real time."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters and the robot file, then open topics and services.

        Args:
            options: passed to rclpy's Node.

        Raises:
            CdrjError: the robot file or a parameter is invalid.
        """
        super().__init__("rig", namespace=NAMESPACE, **options)
        if self.get_parameter("use_sim_time").value:
            raise UsageError(
                "the rig keeps its own time: leave use_sim_time out; drive_clock:=true publishes it"
            )
        model, self.options = declare_rig(self)
        settings = self.options.settings
        self.rig = LiveRig(model.robot, settings)
        program = program_of(
            model, settings.joint, settings.rate, self.options.motion, self.options.seed
        )
        self.drives = Drives(self.options.limits, program)
        self._period_s = 1.0 / settings.rate
        self._time_s = 0.0
        self._base_s = 0.0
        self._zero_ns = 0
        self._origin_ns: int | None = None
        self._done = 0
        self._left_out_s = 0.0
        self._busy_s = 0.0
        self._reported = (monotonic_ns(), 0, 0.0)
        self._slow = False
        self._open(model)
        self.get_logger().info(
            f"{model.robot.name}: {settings.cells} contact cells per pulley, "
            f"{model.robot.joints[settings.joint].name} moves freely, motion "
            f"{self.options.motion}"
        )
        if self.rig.at_stop:
            self.get_logger().warning(
                f"{model.robot.joints[settings.joint].name} rests on its end stop at "
                f"{self.rig.joint_angle[settings.joint]:.4g}: the preloads do not hold it elsewhere"
            )

    def _open(self, model: Any) -> None:
        """Open topics, services and timers."""
        self.outputs = RigOutputs(self, model, self.rig, self.options)
        stands_in = self.options.sensors.update_rate is not None
        self.commands = CommandListener(
            self, model.robot, self.options.limits, self._on_command, stands_in
        )
        self._clock_publisher = (
            self.create_publisher(ClockMessage, CLOCK, FEW) if self.options.drive_clock else None
        )
        self._clock_every = max(round(self.options.settings.rate / CLOCK_HZ), 1)
        self._diagnostics = self.create_publisher(DiagnosticArray, DIAGNOSTICS, FEW)
        self.create_service(Push, "~/push", self._on_push)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.add_pre_set_parameters_callback(meant)
        self.add_on_set_parameters_callback(self._on_parameters)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        period_s = max(self._period_s / self.options.speed, 5e-4)
        self.create_timer(period_s, self._on_tick, clock=steady)
        self.create_timer(1.0, self._on_diagnostics, clock=steady)

    def _on_tick(self) -> None:
        """Compute the steps that are due."""
        if self._origin_ns is None:
            self._start()
            return
        speed = self.options.speed
        due = int((monotonic_ns() - self._origin_ns) * 1e-9 * speed / self._period_s)
        behind = due - self._done
        if behind * self._period_s > MOST_BEHIND_S * speed:
            self._leave_out(behind)
            behind = 1
        begin = perf_counter()
        for _ in range(min(behind, AT_ONCE)):
            self._step()
        self._busy_s += perf_counter() - begin

    def _start(self) -> None:
        """Take the first step, then start the clock: what is slow only once delays no stamp."""
        self._zero_ns = time_ns()
        self._step()
        self._set_origin()
        self._zero_ns = time_ns() - round(self._period_s * 1e9)
        self._reported = (monotonic_ns(), self._done, 0.0)

    def _set_origin(self) -> None:
        """Let the steps that are done be those that are due now."""
        self._origin_ns = monotonic_ns() - round(
            self._done * self._period_s / self.options.speed * 1e9
        )

    def _leave_out(self, steps: int) -> None:
        """Skip steps that the machine was too slow for."""
        lost_s = steps * self._period_s
        self._left_out_s += lost_s
        self._set_origin()
        if self._clock_publisher is None:  # keep the stamps close to the system clock
            self._zero_ns += round(lost_s * 1e9)

    def _step(self) -> None:
        """Advance by one step and publish the sensor readings that are due."""
        rig, drives = self.rig, self.drives
        now_s = (rig.steps + 1) * self._period_s
        angle = drives.next(rig.steps + 1, now_s, self._period_s, rig.motor_effort)
        if not rig.step(angle):
            drives.stopped(rig.motor_angle)
        self._done += 1
        self._time_s = self._base_s + rig.time_s
        self.outputs.emit(rig, drives.speed, self._time_s, self._zero_ns)
        if self._clock_publisher is not None and self._done % self._clock_every == 0:
            message = ClockMessage()
            stamp_ns = self._zero_ns + round(self._time_s * 1e9)
            message.clock.sec, message.clock.nanosec = divmod(stamp_ns, 1_000_000_000)
            self._clock_publisher.publish(message)

    def _on_command(self, command: Command) -> None:
        self.drives.command(command, self.rig.time_s)

    def _on_push(self, request: Push.Request, response: Push.Response) -> Push.Response:
        try:
            self.rig.push(request.torque, request.duration)
            response.success = True
            response.message = f"{request.torque:g} N m for {request.duration:g} s"
        except CdrjError as error:
            response.success, response.message = False, f"nothing changed: {error}"
        return response

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.rig.reset()
        self._base_s = self._time_s
        self.drives.reset()
        self.outputs.restart(self._time_s)
        response.success = True
        response.message = (
            "at rest without faults and pushes, the motors at their reference angles; time goes on"
        )
        return response

    def _on_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        load = changed_payload(self.options, changes)
        if load is not None:
            self.rig.set_load(load)
        return SetParametersResult(successful=True)

    def _on_diagnostics(self) -> None:
        now_ns = monotonic_ns()
        before_ns, done, busy_s = self._reported
        elapsed_s = (now_ns - before_ns) * 1e-9
        self._reported = (now_ns, self._done, self._busy_s)
        simulated_s = (self._done - done) * self._period_s
        busy = (self._busy_s - busy_s) / simulated_s if simulated_s > 0.0 else 0.0
        factor = simulated_s / elapsed_s if elapsed_s > 0.0 else 0.0
        self._warn(factor)
        status = self._status(factor, busy)
        self._diagnostics.publish(diagnostic_array(self.get_clock().now().to_msg(), status))

    def _warn(self, factor: float) -> None:
        """Log that the node cannot keep up; a single pause of the machine is only counted."""
        slow = factor < SLOW * self.options.speed
        if slow and self._slow:
            cells = self.options.settings.cells
            fewer = f"fewer contact cells (cells:={cells // 2}) or " if cells > 1 else ""
            self.get_logger().warning(
                f"cannot keep up: {self._left_out_s:.3g} s left out so far; {fewer}a lower rate "
                "would help",
                throttle_duration_sec=WARNING_S,
            )
        self._slow = slow

    def _status(self, factor: float, busy: float) -> DiagnosticStatus:
        rig = self.rig
        planned: tuple[Fault, ...] = (*self.options.settings.faults, *self.options.sensors.faults)
        faults = [str(fault) for fault in planned if fault.begin <= rig.time_s]
        level: Level = "ok"
        message = "running"
        if factor < SLOW * self.options.speed:
            level, message = "warn", f"cannot keep up: {factor:.2f} of real time"
        elif faults:
            level, message = "warn", f"faults: {', '.join(faults)}"
        values = {
            "real-time factor": f"{factor:.3f}",
            "computing time per second of the rig [s]": f"{busy:.3f}",
            "time left out [s]": f"{self._left_out_s:.3f}",
            "steps": str(self._done),
            "commanded": self.drives.mode,
            "at the stop": "yes" if rig.at_stop else "no",
            "faults": ", ".join(faults) or "none",
            "steps not solved": str(rig.unsolved),
            "steps in which cables stalled the motors": str(rig.stalled),
            "commands": str(self.commands.accepted),
            "commands not renewed in time": str(self.drives.timeouts),
            **{f"refused: {cause}": str(count) for cause, count in self.commands.refused.items()},
        }
        name = self.get_fully_qualified_name().lstrip("/")
        return status_of(name, Report(level, message, values), rig.robot.name)


def _body(argv: Sequence[str]) -> int:
    return run_node(
        "rig",
        SETTINGS,
        "rig [--supervised] --ros-args -p robot:=FILE [-p motion:=sine] [-p NAME:=VALUE] ...",
        "A simulated robot in real time. Topics in the namespace /cdrj: in commands/position, "
        "commands/velocity, commands/effort; out motor_states, "
        "joint_states, on request tension_sensors, truth/tensions, truth/nodal_forces, "
        "truth/states and /clock; /diagnostics. Services: ~/push, ~/reset.",
        lambda _: (RigNode(), None),
        argv,
    )


main = partial(run_command, "rig", _body)
"""Entry point; returns the exit code."""
