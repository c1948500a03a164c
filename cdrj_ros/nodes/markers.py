"""The ``markers`` node: the robot as visualization_msgs/MarkerArray, cables coloured by tension."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from time import monotonic
from typing import Any, Final, Literal

import numpy as np
from cdrj_msgs.msg import CableTensions, NodalForces
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cdrj_ros.commands.running import run_command
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model
from cdrj_ros.model.status import INVALID, SLACK, STALE, UNSURE
from cdrj_ros.nodes.rig_declaring import declare_flag, declare_number, declare_text
from cdrj_ros.nodes.spinning import (
    OneLineParser,
    add_supervised_option,
    exit_code,
    ros_context,
    spin_until_stopped,
    starting,
)
from cdrj_ros.report.scene import Scene, scene_of, tension_colour
from cdrj_ros.robot.description import Joint

Namespace = Literal["cables", "wheels", "forces", "labels"]

SILENCE_S: Final = 0.5
"""Time without tensions after which all cables are drawn as stale [s]."""

SLIP_SPEED: Final = 1e-4
"""Slip speed from which a pulley is drawn as slipping [m/s]."""

SLIPPING: Final = (0.96, 0.55, 0.15)
STICKING: Final = (0.72, 0.72, 0.70)
UNKNOWN: Final = (0.55, 0.55, 0.55)
FORCE: Final = (0.20, 0.20, 0.22)

DASHES: Final = 12
"""Number of dashes of an element whose tension must not be used."""


class MarkersNode(Node):
    """Stores the last messages and draws them at a fixed rate while anybody subscribes."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters and the robot file, then open the topics.

        Raises:
            CdrjError: the robot file or a parameter is invalid.
        """
        super().__init__("markers", namespace="cdrj", **options)
        robot = declare_text(
            self, "robot", "", "Robot file (YAML), or the name of an installed one"
        )
        if not robot:
            raise UsageError("the parameter robot is missing: --ros-args -p robot:=FILE")
        self.model = load_model(robot)
        self._frame = declare_text(self, "frame_id", "base", "Frame of the markers")
        self._labels = declare_flag(self, "labels", False, "Whether to label the elements")
        self._forces = declare_flag(self, "forces", True, "Whether to draw forces on pulleys")
        self._force_scale = declare_number(
            self, "force_scale", 0.0005, 0.0, 1.0, "Length of the arrow of a force [m/N]"
        )
        rate = declare_number(self, "rate", 30.0, 0.1, 30.0, "Rate of the pictures [Hz]")
        self.angles = np.array([joint.reference_angle for joint in self.model.robot.joints])
        self.tensions: CableTensions | None = None
        self.nodal_forces: NodalForces | None = None
        self._heard_s = -np.inf
        self.drawn = 0
        """Number of pictures drawn."""
        quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(JointState, "joint_states", self._on_joints, quality)
        self.create_subscription(CableTensions, "tensions", self._on_tensions, quality)
        self.create_subscription(NodalForces, "nodal_forces", self._on_forces, quality)
        self._publisher = self.create_publisher(MarkerArray, "markers", 1)
        self.create_timer(1.0 / rate, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_joints(self, message: JointState) -> None:
        for j, joint in enumerate(self.model.robot.joints):
            if joint.name in message.name:
                k = message.name.index(joint.name)
                if k < len(message.position) and np.isfinite(message.position[k]):
                    self.angles[j] = shown_angle(joint, message.position[k], self.angles[j])

    def _on_tensions(self, message: CableTensions) -> None:
        self.tensions, self._heard_s = message, monotonic()

    def _on_forces(self, message: NodalForces) -> None:
        self.nodal_forces = message

    def _on_timer(self) -> None:
        if self._publisher.get_subscription_count() == 0:
            return
        try:
            self._publisher.publish(self.picture())
        except CdrjError as error:
            self.get_logger().warning(f"nothing drawn: {error}", throttle_duration_sec=5.0)
            return
        self.drawn += 1

    def picture(self) -> MarkerArray:
        """All markers of the current state."""
        scene = scene_of(self.model, self.angles)
        markers = [*self._cables(scene), *self._wheels(scene)]
        if self._forces:
            markers += self._arrows(scene)
        return MarkerArray(markers=markers)

    def _marker(self, space: Namespace, number: int, kind: int) -> Marker:
        marker = Marker(ns=space, id=number, type=kind, action=Marker.ADD)
        marker.header.frame_id = self._frame
        marker.header.stamp = self.get_clock().now().to_msg()
        marker.pose.orientation.w = 1.0
        return marker

    def _cables(self, scene: Scene) -> Iterator[Marker]:
        """One line per element, and its label."""
        width = 0.1 * _typical_radius(scene)
        values = _by_name(self.tensions, ("tension", "status"))
        silent = monotonic() - self._heard_s > SILENCE_S
        for e, (name, path) in enumerate(
            zip(self.model.layout.elements, scene.elements, strict=True)
        ):
            tension, status = values.get(name, (0.0, INVALID))
            flags = int(status) | (STALE if silent else 0)
            usable = not flags & (STALE | INVALID)
            marker = self._marker("cables", e, Marker.LINE_STRIP if usable else Marker.LINE_LIST)
            marker.scale.x = width * (0.4 if flags & SLACK else 1.0)
            cable = self.model.robot.cables[_cable_of(self.model, e)]
            colour = tension_colour(tension, cable.preload, cable.maximum_tension)
            marker.color = _rgba(colour if usable else UNKNOWN, 0.4 if flags & UNSURE else 1.0)
            marker.points = _points(path if usable else _dashed(path))
            yield marker
            if self._labels:
                label = self._marker("labels", e, Marker.TEXT_VIEW_FACING)
                label.pose.position = _points(
                    path[len(path) // 2 - 1 : len(path) // 2 + 1].mean(0)
                )[0]
                label.scale.z = 5.0 * width
                label.color = _rgba((0.1, 0.1, 0.1), 1.0)
                label.text = f"{name} {tension:.1f} N" if usable else f"{name} ?"
                yield label

    def _wheels(self, scene: Scene) -> Iterator[Marker]:
        """One disc per winch, pulley and anchor; slipping pulleys in another colour."""
        slips = _by_name(self.nodal_forces, ("slip_speed", "status"))
        least = 0.3 * _typical_radius(scene)
        for k, wheel in enumerate(scene.wheels):
            marker = self._marker("wheels", k, Marker.CYLINDER)
            marker.pose.position = Point(x=wheel.centre[0], y=wheel.centre[1], z=wheel.centre[2])
            size = 2.0 * max(wheel.radius, least)
            marker.scale = Vector3(x=size, y=size, z=0.5 * least)
            speed, status = slips.get(wheel.name, (0.0, INVALID))
            slipping = abs(speed) > SLIP_SPEED and not int(status) & (STALE | INVALID)
            marker.color = _rgba(SLIPPING if slipping else STICKING, 0.5)
            yield marker

    def _arrows(self, scene: Scene) -> Iterator[Marker]:
        """One arrow per pulley of the cables given by positions."""
        forces = _by_name(self.nodal_forces, ("force_x", "force_y", "force_z", "status"))
        placed = {cable.name for cable in self.model.robot.cables if cable.routed or cable.spatial}
        for k, wheel in enumerate(scene.wheels):
            if wheel.name.rpartition("/")[0] not in placed or wheel.kind != "pulley":
                continue
            *force, status = forces.get(wheel.name, (0.0, 0.0, 0.0, INVALID))
            marker = self._marker("forces", k, Marker.ARROW)
            if int(status) & (STALE | INVALID):
                marker.action = Marker.DELETE
            width = 0.05 * _typical_radius(scene)
            marker.scale = Vector3(x=width, y=2.5 * width, z=0.0)
            marker.color = _rgba(FORCE, 0.9)
            tip = np.array(wheel.centre) + self._force_scale * np.array(force)
            marker.points = _points(np.array([wheel.centre, tip]))
            yield marker


def shown_angle(joint: Joint, reading: float, before: float) -> float:
    """Angle of a reading [rad]; of a reading that wraps around, the turn nearest to ``before``."""
    sensor = joint.sensor
    angle = sensor.scale * reading + sensor.offset
    turn = abs(sensor.scale) * sensor.period
    if np.isfinite(turn):
        angle += turn * round((before - angle) / turn)
    return float(min(max(angle, joint.lower), joint.upper))


def _by_name(message: Any, fields: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """Entries of a message by name; empty if there is no message or its arrays do not match."""
    if message is None or any(len(getattr(message, f)) != len(message.name) for f in fields):
        return {}
    columns = zip(*(getattr(message, field) for field in fields), strict=True)
    return dict(zip(message.name, columns, strict=True))


def _cable_of(model: Model, element: int) -> int:
    counts = np.cumsum([len(cable.nodes) - 1 for cable in model.robot.cables])
    return int(np.searchsorted(counts, element, side="right"))


def _typical_radius(scene: Scene) -> float:
    """Median radius of the wheels [m]."""
    radii = [wheel.radius for wheel in scene.wheels if wheel.radius > 0.0]
    return float(np.median(radii)) if radii else 0.01


def _points(path: NDArray[np.float64]) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in np.atleast_2d(path).tolist()]


def _dashed(path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ends of dashes along a path, shape (2 * DASHES, 3)."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], 2 * DASHES)
    return np.column_stack([np.interp(at, along, path[:, k]) for k in range(3)])


def _rgba(colour: tuple[float, float, float], opacity: float) -> ColorRGBA:
    return ColorRGBA(r=colour[0], g=colour[1], b=colour[2], a=opacity)


def _body(argv: Sequence[str]) -> int:
    arguments = ["markers", *argv]
    parser = OneLineParser(
        prog="markers",
        usage="markers [--supervised] --ros-args -p robot:=FILE [-p NAME:=VALUE] ...",
        description="The robot as markers for RViz. Topics in the namespace /cdrj: in tensions, "
        "nodal_forces, joint_states; out markers (visualization_msgs/MarkerArray), while anybody "
        "subscribes. Parameters: robot, frame_id, rate, labels, forces, force_scale.",
    )
    add_supervised_option(parser)
    with starting():
        own = parser.parse_args(remove_ros_args(arguments)[1:])
    with ros_context(arguments) as stop:
        with starting():
            node = MarkersNode()
        spin_until_stopped(node, stop)
    return exit_code("markers", stop, supervised=own.supervised)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("markers", _body, sys.argv[1:] if argv is None else argv)
