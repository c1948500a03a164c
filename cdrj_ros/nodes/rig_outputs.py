"""The rig's publishers: encoder readings and, on request, load cells and the true state."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from cdrj_msgs.msg import CableTensions, NodalForces
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import JointState

from cdrj_ros.messages import topics
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, NODAL_FORCES
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import Model
from cdrj_ros.model.status import OVERLOAD, SLACK
from cdrj_ros.nodes.qos import default_profile
from cdrj_ros.nodes.rig_settings import Reader, RigOptions
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation.live import LiveRig
from cdrj_ros.simulation.live_sensors import LiveCells, LiveEncoders

FORCES: Final = ("force_x", "force_y", "force_z", "magnitude", "status")
"""What the truth gives of the forces on pulleys."""


class _Encoders:
    """Encoders that share a topic and a clock, and therefore a message."""

    def __init__(self, publisher: Any, sensor: LiveEncoders, columns: list[int], efforts: bool):
        self.publisher, self.sensor, self.columns = publisher, sensor, columns
        names = [axis.name for axis in sensor.axes]
        self.template = Template(
            JOINT_STATE, names, ("position", "effort") if efforts else ("position",)
        )
        self.offset_ns = sensor.axes[0].sensor.clock_offset_ns


class RigOutputs:
    """Samples the rig after every step and publishes the readings whose latency has elapsed."""

    def __init__(self, node: Node, model: Model, options: RigOptions) -> None:
        """Open the topics."""
        robot, seed = model.robot, options.seed
        self._efforts: LiveCells | None = None
        if options.efforts is not None:
            cells = options.efforts
            self._efforts = LiveCells(cells, cells.torque_noise, cells.torque_step, 0.0, [seed, 4])
        self._effort = np.zeros(len(robot.motors))
        self._effort_scale = np.array([motor.effort_scale for motor in robot.motors])
        publishers = [
            node.create_publisher(JointState, topic, default_profile())
            for topic in (topics.MOTOR_STATES, topics.JOINT_STATES)
        ]
        self._motors = _groups(publishers[0], robot.motors, options.motors, [seed, 1],
                               options.efforts is not None)  # fmt: skip
        self._joints = _groups(publishers[1], robot.joints, options.joints, [seed, 2], False)
        self._open_cells(node, model, options)
        self._open_truth(node, model, options)

    def freeze(self, name: str) -> bool | None:
        """Freeze the encoder of a motor or joint; None if there is none of this name."""
        for group in (*self._motors, *self._joints):
            if name in (axis.name for axis in group.sensor.axes):
                return group.sensor.freeze(name)
        return None

    def thaw(self) -> None:
        """Unfreeze all encoders."""
        for group in (*self._motors, *self._joints):
            group.sensor.thaw()

    @property
    def frozen(self) -> tuple[str, ...]:
        """Axes whose encoders are frozen."""
        groups = (*self._motors, *self._joints)
        return tuple(name for group in groups for name in group.sensor.frozen)

    def emit(
        self, rig: LiveRig, motor_speed: NDArray[np.float64], now_s: float, zero_ns: int
    ) -> None:
        """Publish the readings that are due at this time.

        Args:
            rig: the rig after a step.
            motor_speed: speed of the motors [rad/s], shape (motors,).
            now_s: time of the sensors [s]; a reset of the rig does not reset it.
            zero_ns: stamp of time 0 [ns].
        """
        if self._efforts is not None:
            for reading in self._efforts.take(now_s, rig.motor_effort):
                self._effort = reading.values / self._effort_scale
        for groups, angle in ((self._motors, rig.motor_angle), (self._joints, rig.joint_angle)):
            for group in groups:
                for reading in group.sensor.take(now_s, angle[group.columns]):
                    stamp = zero_ns - group.offset_ns + round(reading.stamp_s * 1e9)
                    arrays = {"position": reading.values}
                    if "effort" in group.template.spans:
                        arrays["effort"] = self._effort[group.columns]
                    group.publisher.publish(group.template.encode(stamp, **arrays))
        if self._cells is not None:
            for reading in self._cells.take(now_s, rig.tension[self._elements]):
                self._publish_cells(zero_ns + round(reading.stamp_s * 1e9), reading.values)
        if self._truth_every and rig.steps % self._truth_every == 0:
            self._publish_truth(rig, motor_speed, zero_ns + round(now_s * 1e9))

    def _open_cells(self, node: Node, model: Model, options: RigOptions) -> None:
        self._elements = list(options.load_cells)
        self._cells: LiveCells | None = None
        if not self._elements:
            return
        cells = options.cells
        self._cells = LiveCells(
            cells, cells.force_noise, cells.force_step, cells.force_bias, [options.seed, 3]
        )
        names = [model.layout.elements[element] for element in self._elements]
        self._cell_template = Template(CABLE_TENSIONS, names, ("tension", "status", "stddev"))
        resolution = cells.force_step / np.sqrt(12.0)
        stddev = float(np.hypot(cells.force_noise, resolution))
        self._cell_stddev = np.full(len(names), stddev)
        self._cell_publisher = node.create_publisher(
            CableTensions, topics.TENSION_SENSORS, default_profile()
        )

    def _publish_cells(self, stamp_ns: int, tension: NDArray[np.float64]) -> None:
        status = np.zeros(tension.size)
        self._cell_publisher.publish(
            self._cell_template.encode(
                stamp_ns, tension=tension, status=status, stddev=self._cell_stddev
            )
        )

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
        self._free = options.settings.joint
        self._tension_publisher = node.create_publisher(
            CableTensions, f"truth/{topics.TENSIONS}", default_profile()
        )
        self._force_publisher = node.create_publisher(
            NodalForces, f"truth/{topics.NODAL_FORCES}", default_profile()
        )
        self._state_publisher = node.create_publisher(JointState, "truth/states", default_profile())

    def _publish_truth(self, rig: LiveRig, motor_speed: NDArray[np.float64], stamp_ns: int) -> None:
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
        joint_speed = np.zeros(rig.joint_angle.size)
        joint_speed[self._free] = rig.joint_speed
        self._state_publisher.publish(
            self._state_template.encode(
                stamp_ns,
                position=np.concatenate([rig.motor_angle, rig.joint_angle]),
                velocity=np.concatenate([motor_speed, joint_speed]),
                effort=np.concatenate([rig.motor_effort, rig.joint_effort]),
            )
        )


def _groups(
    publisher: Any, axes: Any, reader: Reader, seed: list[int], efforts: bool
) -> list[_Encoders]:
    """Group encoders by clock, since a message has only one stamp."""
    groups = []
    for offset in dict.fromkeys(axis.sensor.clock_offset_ns for axis in axes):
        columns = [k for k, axis in enumerate(axes) if axis.sensor.clock_offset_ns == offset]
        sensor = LiveEncoders(
            reader.encoder, [axes[k] for k in columns], [*seed, columns[0]], reader.latency_s
        )
        groups.append(_Encoders(publisher, sensor, columns, efforts))
    return groups


def _bounds(robot: Robot) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Tensions at or below which each element is slack, and above which it is overloaded [N]."""
    counts = [len(cable.nodes) - 1 for cable in robot.cables]
    return (
        np.repeat([cable.slack_tension for cable in robot.cables], counts),
        np.repeat([cable.maximum_tension for cable in robot.cables], counts),
    )
