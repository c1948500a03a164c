"""The rig's topics: readings and the true state out, commands to its motors in.

Commands in the namespace of the nodes are angles, speeds and torques of the motors.  Those of
ros2_control's controllers are in the units in which the robot publishes its states.
"""

from __future__ import annotations

from collections.abc import Callable
from heapq import heappop, heappush
from math import copysign
from typing import Any, Final

import numpy as np
from cdrj_msgs.msg import CableTensions, NodalForces
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.messages import topics
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE
from cdrj_ros.messages.templates import EstimateEncoder, Template
from cdrj_ros.model.packing import Layout
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.rig_settings import RigOptions
from cdrj_ros.nodes.settings import default_profile
from cdrj_ros.robot.description import Motor, Robot
from cdrj_ros.simulation.drives import (
    CAUSES,
    MODES,
    Cause,
    Command,
    CommandError,
    DriveLimits,
    Mode,
    checked_command,
)
from cdrj_ros.simulation.live import LiveRig
from cdrj_ros.simulation.sensors import CellGroup, angle_of, encoder_groups, truth_table

BASE_LINK: Final = "base_link"
"""Frame of joint_state_broadcaster's messages."""

DEPTH = 10
"""Queue depth of a topic [messages]; small because old commands are useless."""

WARNING_S = 5.0
"""Minimum time between two logged refusals [s]."""


FORWARD: Final[dict[Mode, str]] = {mode: f"/forward_{mode}_controller/commands" for mode in MODES}
"""Topics of ros2_control's forward_command_controller, by the commanded interface."""


class _Queue:
    """Encoded messages of all topics that have not arrived yet, in the order of their arrival."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, int, Any, bytes]] = []
        self._count = 0

    def send(self, arrival_s: float, publisher: Any, message: bytes) -> None:
        self._count += 1  # messages that arrive at the same time stay in order
        heappush(self._waiting, (arrival_s, self._count, publisher, message))

    def deliver(self, now_s: float) -> None:
        """Publish what has arrived."""
        while self._waiting and self._waiting[0][0] <= now_s:
            _, _, publisher, message = heappop(self._waiting)
            publisher.publish(message)


class RigOutputs:
    """Samples the rig after every step and publishes the readings whose latency has elapsed."""

    def __init__(self, node: Node, model: Model, rig: LiveRig, options: RigOptions) -> None:
        """Open the topics."""
        self._groups = encoder_groups(model, options.sensors, options.seed)
        names = {
            "motors": topics.MOTOR_STATES, "joints": topics.JOINT_STATES, "all": topics.BROADCAST,
        }  # fmt: skip
        publishers = {
            kind: node.create_publisher(JointState, names[kind], default_profile())
            for kind in dict.fromkeys(group.kind for group in self._groups)
        }
        self._publishers = [publishers[group.kind] for group in self._groups]
        self._queue = _Queue()
        self._templates = [
            Template(JOINT_STATE, one.names, one.fields, BASE_LINK if one.kind == "all" else "")
            for one in self._groups
        ]
        self._free = len(model.robot.motors) + options.settings.joint
        self._speed = np.zeros(len(model.robot.axes))
        self._open_cells(node, model, options)
        self._state_template = Template(JOINT_STATE, [axis.name for axis in model.robot.axes])
        self._open_truth(node, rig.layout, options)

    def restart(self, now_s: float) -> None:
        """End the faults of all encoders; they happen again at their times."""
        for group in self._groups:
            group.restart(now_s)

    def emit(self, rig: LiveRig, motor_speed: Vector, now_s: float, zero_ns: int) -> None:
        """Publish the readings that are due at this time.

        Args:
            rig: the rig after a step.
            motor_speed: speed of the motors [rad/s], shape (motors,).
            now_s: time of the sensors [s]; a reset of the rig does not reset it.
            zero_ns: stamp of time 0 [ns].
        """
        self._speed[: motor_speed.size], self._speed[self._free] = motor_speed, rig.joint_speed
        position = np.concatenate([rig.motor_angle, rig.joint_angle])
        effort = np.concatenate([rig.motor_effort, rig.joint_effort])
        time = np.array([now_s])
        truth = truth_table(position[None], self._speed[None], effort[None], rig.tension[None])
        for group, publisher, template in zip(
            self._groups, self._publishers, self._templates, strict=True
        ):
            read = group.take(time, truth)
            arrays = {field: getattr(read, field) for field in group.fields}
            for k, stamp_s in enumerate(read.stamps.tolist()):
                stamp_ns = zero_ns - group.clock_offset_ns + round(stamp_s * 1e9)
                row = {field: array[k] for field, array in arrays.items()}
                message = template.encode(stamp_ns, **row)
                self._queue.send(stamp_s + group.latency, publisher, message)
        if self._cells is not None:
            self._emit_cells(self._cells, time, truth, zero_ns)
        self._queue.deliver(now_s)
        if self._truth_every and rig.steps % self._truth_every == 0:
            self._publish_truth(rig, position, effort, zero_ns + round(now_s * 1e9))

    def _open_cells(self, node: Node, model: Model, options: RigOptions) -> None:
        self._cells: CellGroup | None = None
        cells = CellGroup(model, options.sensors, options.seed)
        if not cells.names:
            return
        self._cells = cells
        self._cell_template = Template(CABLE_TENSIONS, cells.names, ("tension", "status", "stddev"))
        self._cell_publisher = node.create_publisher(
            CableTensions, topics.TENSION_SENSORS, default_profile()
        )

    def _emit_cells(self, cells: CellGroup, time: Vector, truth: Table, zero_ns: int) -> None:
        stamps, tensions = cells.take(time, truth)
        count = len(cells.names)
        for stamp_s, tension in zip(stamps.tolist(), tensions, strict=True):
            message = self._cell_template.encode(
                zero_ns + round(stamp_s * 1e9), tension=tension, status=np.zeros(count),
                stddev=np.full(count, cells.stddev),
            )  # fmt: skip
            self._queue.send(stamp_s + cells.latency, self._cell_publisher, message)

    def _open_truth(self, node: Node, layout: Layout, options: RigOptions) -> None:
        self._truth_every = 0
        if options.truth_rate == 0.0:
            return
        self._truth_every = max(round(options.settings.rate / options.truth_rate), 1)
        self._truth = EstimateEncoder(layout)
        self._truth_publishers = [
            node.create_publisher(kind, f"{topics.TRUTH}/{topic}", default_profile())
            for kind, topic in (
                (CableTensions, topics.TENSIONS),
                (NodalForces, topics.NODAL_FORCES),
                (JointState, topics.STATES),
            )
        ]

    def _publish_truth(self, rig: LiveRig, position: Vector, effort: Vector, stamp_ns: int) -> None:
        truth = Estimate(stamp_ns, rig.values, rig.layout, solved=True)
        tensions, forces, _ = self._truth.encode(truth)
        state = self._state_template.encode(
            stamp_ns, position=position, velocity=self._speed, effort=effort
        )
        for publisher, message in zip(
            self._truth_publishers, (tensions, forces, state), strict=True
        ):
            publisher.publish(message)


class CommandListener:
    """Subscribes to the topics of all kinds of commands: one value per motor."""

    def __init__(
        self,
        node: Node,
        robot: Robot,
        limits: DriveLimits,
        accept: Callable[[Command], None],
        controllers: bool,
    ) -> None:
        """Open the topics.

        Args:
            node: the node that subscribes.
            robot: its motors convert the commands of controllers.
            limits: limits of the drives.
            accept: called with every valid command.
            controllers: whether to listen to ros2_control's controllers, too.
        """
        self._node, self._robot, self._limits, self._accept = node, robot, limits, accept
        self.accepted = 0
        self.refused: dict[Cause, int] = dict.fromkeys(CAUSES, 0)
        for mode in MODES:
            self._listen(f"commands/{mode}", mode, published=False)
            if controllers:
                self._listen(FORWARD[mode], mode, published=True)

    def _listen(self, topic: str, mode: Mode, *, published: bool) -> None:
        """Subscribe; ``published``: the values are in the units in which the robot is published."""

        def on_array(message: Float64MultiArray) -> None:
            values, motors = message.data, self._robot.motors
            if published and len(values) == len(motors):
                values = [_of_motor(*pair, mode) for pair in zip(motors, values, strict=True)]
            try:
                if message.layout.data_offset:
                    raise CommandError("malformed", "data_offset must be 0")
                command = checked_command(self._limits, mode, values)
            except CommandError as error:
                self.refused[error.cause] += 1
                self._node.get_logger().warning(
                    f"{topic} refused: {error}", throttle_duration_sec=WARNING_S
                )
                return
            self.accepted += 1
            self._accept(command)

        self._node.create_subscription(Float64MultiArray, topic, on_array, DEPTH)


def _of_motor(motor: Motor, value: float, mode: Mode) -> float:
    """What a command means for a motor's axis [rad], [rad/s] or [N m].

    A positive effort drives the published position up, as hardware does, whatever the efforts are
    that it publishes.
    """
    if mode == "position":
        return float(angle_of(motor.sensor, np.asarray(value, dtype=np.float64)))
    scale = motor.sensor.scale
    return value * (scale if mode == "velocity" else copysign(motor.effort_scale, scale))
