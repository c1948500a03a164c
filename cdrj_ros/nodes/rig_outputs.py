"""The rig's publishers: encoder readings and, on request, load cells and the true state."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import numpy as np
from cdrj_msgs.msg import CableTensions, NodalForces
from rclpy.node import Node
from sensor_msgs.msg import JointState

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.messages import topics
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, NODAL_FORCES
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import Model
from cdrj_ros.model.state import OVERLOAD, SLACK
from cdrj_ros.nodes.qos import default_profile
from cdrj_ros.nodes.rig_settings import RigOptions
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation.live import LiveRig
from cdrj_ros.simulation.sensor_groups import CellGroup, encoder_groups, truth_table

BASE_LINK: Final = "base_link"
"""Frame of joint_state_broadcaster's messages."""


FORCES: Final = ("force_x", "force_y", "force_z", "magnitude", "status")
"""What the truth gives of the forces on pulleys."""


class _Queue:
    """Encoded messages of one topic that have not arrived yet."""

    def __init__(self, publisher: Any, latency_s: float) -> None:
        self._publisher, self._latency_s = publisher, latency_s
        self._waiting: deque[tuple[float, bytes]] = deque()

    def send(self, stamp_s: float, message: bytes) -> None:
        self._waiting.append((stamp_s + self._latency_s, message))

    def deliver(self, now_s: float) -> None:
        """Publish what has arrived."""
        while self._waiting and self._waiting[0][0] <= now_s:
            self._publisher.publish(self._waiting.popleft()[1])


class RigOutputs:
    """Samples the rig after every step and publishes the readings whose latency has elapsed."""

    def __init__(self, node: Node, model: Model, options: RigOptions) -> None:
        """Open the topics."""
        self._groups = encoder_groups(model, options.sensors, options.seed)
        names = {
            "motors": topics.MOTOR_STATES, "joints": topics.JOINT_STATES, "all": topics.BROADCAST,
        }  # fmt: skip
        publishers = {
            kind: node.create_publisher(JointState, names[kind], default_profile())
            for kind in dict.fromkeys(group.kind for group in self._groups)
        }
        self._queues = [_Queue(publishers[one.kind], one.latency_s) for one in self._groups]
        self._templates = [
            Template(JOINT_STATE, one.names, one.fields, BASE_LINK if one.kind == "all" else "")
            for one in self._groups
        ]
        self._free = len(model.robot.motors) + options.settings.joint
        self._speed = np.zeros(len(model.robot.axes))
        self._open_cells(node, model, options)
        self._open_truth(node, model, options)

    def freeze(self, name: str, now_s: float) -> None:
        """Freeze the encoder of a motor or joint."""
        for group in self._groups:
            if name in group.names:
                group.freeze(name, now_s)

    def restart(self, now_s: float) -> None:
        """End the faults of all encoders; those of the rig file happen again."""
        for group in self._groups:
            group.restart(now_s)

    def frozen(self, now_s: float) -> tuple[str, ...]:
        """Axes whose encoders are frozen."""
        return tuple(name for group in self._groups for name in group.frozen(now_s))

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
        for group, queue, template in zip(self._groups, self._queues, self._templates, strict=True):
            read = group.take(time, truth)
            arrays = {field: getattr(read, field) for field in group.fields}
            for k, stamp_s in enumerate(read.stamps.tolist()):
                stamp_ns = zero_ns - group.clock_offset_ns + round(stamp_s * 1e9)
                row = {field: array[k] for field, array in arrays.items()}
                queue.send(stamp_s, template.encode(stamp_ns, **row))
            queue.deliver(now_s)
        if self._cells is not None:
            self._emit_cells(self._cells, time, truth, zero_ns)
        if self._truth_every and rig.steps % self._truth_every == 0:
            self._publish_truth(rig, position, effort, zero_ns + round(now_s * 1e9))

    def _open_cells(self, node: Node, model: Model, options: RigOptions) -> None:
        self._cells: CellGroup | None = None
        cells = CellGroup(model, options.sensors, options.seed)
        if not cells.names:
            return
        self._cells = cells
        self._cell_template = Template(CABLE_TENSIONS, cells.names, ("tension", "status", "stddev"))
        publisher = node.create_publisher(CableTensions, topics.TENSION_SENSORS, default_profile())
        self._cell_queue = _Queue(publisher, cells.latency_s)

    def _emit_cells(self, cells: CellGroup, time: Vector, truth: Table, zero_ns: int) -> None:
        stamps, tensions = cells.take(time, truth)
        count = len(cells.names)
        for stamp_s, tension in zip(stamps.tolist(), tensions, strict=True):
            message = self._cell_template.encode(
                zero_ns + round(stamp_s * 1e9), tension=tension, status=np.zeros(count),
                stddev=np.full(count, cells.stddev),
            )  # fmt: skip
            self._cell_queue.send(stamp_s, message)
        self._cell_queue.deliver(float(time[0]))

    def _open_truth(self, node: Node, model: Model, options: RigOptions) -> None:
        self._truth_every = 0
        if options.truth_rate == 0.0:
            return
        self._truth_every = max(round(options.settings.rate / options.truth_rate), 1)
        layout = model.layout
        self._tension_template = Template(
            CABLE_TENSIONS, layout.elements, ("tension", "status"), layout.base_link
        )
        self._force_template = Template(NODAL_FORCES, layout.pulleys, FORCES, layout.force_frame)
        self._pulley_status = layout.pulley_status
        self._state_template = Template(JOINT_STATE, layout.motors + layout.joints)
        self._slack_at, self._overload_at = _bounds(model.robot)
        self._tension_publisher = node.create_publisher(
            CableTensions, f"truth/{topics.TENSIONS}", default_profile()
        )
        self._force_publisher = node.create_publisher(
            NodalForces, f"truth/{topics.NODAL_FORCES}", default_profile()
        )
        self._state_publisher = node.create_publisher(JointState, "truth/states", default_profile())

    def _publish_truth(self, rig: LiveRig, position: Vector, effort: Vector, stamp_ns: int) -> None:
        tension = rig.tension
        status = SLACK * (tension <= self._slack_at) + OVERLOAD * (tension > self._overload_at)
        self._tension_publisher.publish(
            self._tension_template.encode(stamp_ns, tension=tension, status=status)
        )
        x, y, z = rig.force.T
        self._force_publisher.publish(
            self._force_template.encode(
                stamp_ns,
                force_x=x,
                force_y=y,
                force_z=z,
                magnitude=np.linalg.norm(rig.force, axis=1),
                status=self._pulley_status(status.astype(np.uint8)),
            )
        )
        self._state_publisher.publish(
            self._state_template.encode(
                stamp_ns, position=position, velocity=self._speed, effort=effort
            )
        )


def _bounds(robot: Robot) -> tuple[Vector, Vector]:
    """Tensions at or below which each element is slack, and above which it is overloaded [N]."""
    counts = [len(cable.nodes) - 1 for cable in robot.cables]
    return (
        np.repeat([cable.slack_tension for cable in robot.cables], counts),
        np.repeat([cable.maximum_tension for cable in robot.cables], counts),
    )
