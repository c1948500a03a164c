"""The ``markers`` node: the robot as visualization_msgs/MarkerArray, cables coloured by tension."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
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
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.status import STALE
from cdrj_ros.nodes.rig_declaring import declare_flag, declare_number, declare_text
from cdrj_ros.nodes.robot_description import declared_model
from cdrj_ros.nodes.spinning import (
    OneLineParser,
    add_supervised_option,
    exit_code,
    ros_context,
    spin_until_stopped,
    starting,
)
from cdrj_ros.view.history import (
    joint_angles,
    joint_axes,
    nothing_known,
    pulley_columns,
    tension_columns,
)
from cdrj_ros.view.picture import FORCE, Picture, dashes_of, middle_of, picture_of

Namespace = Literal["cables", "wheels", "forces", "labels"]

SILENCE_S: Final = 0.5
"""Time without tensions after which all cables are drawn as stale [s]."""


class MarkersNode(Node):
    """Stores the last messages and draws them at a fixed rate while anybody subscribes."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters and the robot file, then open the topics.

        Raises:
            CdrjError: the robot file or a parameter is invalid.
        """
        super().__init__("markers", namespace="cdrj", **options)
        self.model = declared_model(self)
        self._frame = declare_text(self, "frame_id", "base", "Frame of the markers")
        self._labels = declare_flag(self, "labels", False, "Whether to label the elements")
        self._forces = declare_flag(self, "forces", True, "Whether to draw forces on pulleys")
        self._force_scale = declare_number(
            self, "force_scale", 0.0005, 0.0, 1.0, "Length of the arrow of a force [m/N]"
        )
        rate = declare_number(self, "rate", 30.0, 0.1, 30.0, "Rate of the pictures [Hz]")
        self._unknown = nothing_known(self.model)
        self._joints = joint_axes(self.model.robot)
        self.angles = self._unknown.angle
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
        self.angles = joint_angles(message, self._joints, self.angles)

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
        layout = self.model.layout
        tension, stddev, status = tension_columns(self.tensions, layout)
        if monotonic() - self._heard_s > SILENCE_S:
            status = status | np.uint8(STALE)
        force, friction, slip_speed, pulley_status = pulley_columns(self.nodal_forces, layout)
        shown = replace(
            self._unknown, angle=self.angles, tension=tension, stddev=stddev, status=status,
            force=force, friction=friction, slip_speed=slip_speed, pulley_status=pulley_status,
        )  # fmt: skip
        picture = picture_of(self.model, shown, force_scale=self._force_scale)
        markers = [*self._cables(picture), *self._wheels(picture)]
        if self._forces:
            markers += self._arrows(picture)
        return MarkerArray(markers=markers)

    def _marker(self, space: Namespace, number: int, kind: int) -> Marker:
        marker = Marker(ns=space, id=number, type=kind, action=Marker.ADD)
        marker.header.frame_id = self._frame
        marker.header.stamp = self.get_clock().now().to_msg()
        marker.pose.orientation.w = 1.0
        return marker

    def _cables(self, picture: Picture) -> Iterator[Marker]:
        """One line per element, and its label."""
        for e, look in enumerate(picture.cables):
            marker = self._marker(
                "cables", e, Marker.LINE_LIST if look.dashed else Marker.LINE_STRIP
            )
            marker.scale.x = look.width
            marker.color = _rgba(look.colour, look.opacity)
            marker.points = _points(dashes_of(look.path) if look.dashed else look.path)
            yield marker
            if self._labels:
                label = self._marker("labels", e, Marker.TEXT_VIEW_FACING)
                label.pose.position = _points(middle_of(look.path))[0]
                label.scale.z = 5.0 * look.width
                label.color = _rgba((0.1, 0.1, 0.1), 1.0)
                label.text = look.label
                yield label

    def _wheels(self, picture: Picture) -> Iterator[Marker]:
        """One disc per winch, pulley and anchor; slipping pulleys in another colour."""
        for k, look in enumerate(picture.wheels):
            marker = self._marker("wheels", k, Marker.CYLINDER)
            x, y, z = look.centre
            marker.pose.position = Point(x=x, y=y, z=z)
            size = 2.0 * look.radius
            marker.scale = Vector3(x=size, y=size, z=look.thickness)
            marker.color = _rgba(look.colour, 0.5)
            yield marker

    def _arrows(self, picture: Picture) -> Iterator[Marker]:
        """One arrow per pulley of the cables given by positions."""
        for look in picture.arrows:
            marker = self._marker("forces", look.wheel, Marker.ARROW)
            if np.isnan(look.end).any():
                marker.action = Marker.DELETE
            marker.scale = Vector3(x=look.width, y=2.5 * look.width, z=0.0)
            marker.color = _rgba(FORCE, 0.9)
            marker.points = _points(np.array([look.start, np.nan_to_num(look.end)]))
            yield marker


def _points(path: NDArray[np.float64]) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in np.atleast_2d(path).tolist()]


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
