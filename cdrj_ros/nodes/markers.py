"""The ``markers`` node: the robot as visualization_msgs/MarkerArray, cables coloured by tension."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from geometry_msgs.msg import Point, Quaternion, Vector3
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cdrj_ros.commands.entry import run_command
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.messages.topics import NAMESPACE
from cdrj_ros.nodes.robot_description import ROBOT_SETTINGS, given_model
from cdrj_ros.nodes.settings import Setting, declare, values_of
from cdrj_ros.nodes.spinning import run_node
from cdrj_ros.nodes.view_inputs import Inputs
from cdrj_ros.report.scene import Wxyz, middle_of, quaternion_to
from cdrj_ros.view.picture import FORCE, LINKS, Picture, dashes_of, picture_of

Namespace = Literal["cables", "bodies", "links", "visuals", "forces", "labels"]

VISUAL: Final = 0.25
"""Opacity of the shapes of bodies."""

BODY: Final = 0.5
"""Opacity of bodies and links."""

SETTINGS: Final = (
    *ROBOT_SETTINGS,
    Setting(
        "frame_id", "",
        "Frame of the markers; empty: base_link of the robot file, the root link of its URDF, or "
        "base",
    ),
    Setting("labels", False, "Whether to label the elements"),
    Setting("forces", True, "Whether to draw forces on pulleys"),
    Setting("force_scale", 0.0005, "Length of the arrow of a force", "m/N", 0.0, 1.0),
    Setting("rate", 30.0, "Rate of the pictures", "Hz", 0.1, 30.0),
)  # fmt: skip
"""The node's parameters."""


class MarkersNode(Node):
    """Draws the last messages at a fixed rate, and hears them, only while anybody subscribes."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters and the robot file, then open the topics.

        Raises:
            CdrjError: the robot file or a parameter is invalid.
        """
        super().__init__("markers", namespace=NAMESPACE, **options)
        declare(self, SETTINGS)
        values = values_of(self, SETTINGS)
        self.model = given_model(self, values["robot"])
        self._frame = self.model.layout.in_frame(values["frame_id"]).base_link
        self._labels, self._forces = values["labels"], values["forces"]
        self._force_scale, rate = values["force_scale"], values["rate"]
        self.inputs = Inputs(self, self.model)
        self.drawn = 0
        """Number of pictures drawn."""
        self._publisher = self.create_publisher(MarkerArray, "markers", 1)
        self.create_timer(1.0 / rate, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_timer(self) -> None:
        if not self.inputs.listen(self._publisher.get_subscription_count() > 0):
            return
        try:
            self._publisher.publish(self.picture())
        except CdrjError as error:
            self.get_logger().warning(f"nothing drawn: {error}", throttle_duration_sec=5.0)
            return
        self.drawn += 1

    def picture(self) -> MarkerArray:
        """All markers of the current state."""
        shown = self.inputs.snapshot()
        picture = picture_of(self.model, shown, force_scale=self._force_scale)
        markers = [*self._cables(picture), *self._bodies(picture), *self._links(picture)]
        markers += self._visuals(picture)
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

    def _bodies(self, picture: Picture) -> Iterator[Marker]:
        """A cylinder or sphere for every winch, pulley, eyelet and anchor, in its size."""
        for k, look in enumerate(picture.bodies):
            body = look.body
            ball = body.shape in ("sphere", "point")
            marker = self._marker("bodies", k, Marker.SPHERE if ball else Marker.CYLINDER)
            marker.pose.position = _points(body.centre)[0]
            size = 2.0 * body.radius
            marker.pose.orientation = _quaternion(quaternion_to(body.axis))
            marker.scale = Vector3(x=size, y=size, z=size if ball else body.length)
            marker.color = _rgba(look.colour, BODY)
            yield marker

    def _links(self, picture: Picture) -> Iterator[Marker]:
        """A cylinder for every link."""
        for k, (start, end) in enumerate(picture.links):
            marker = self._marker("links", k, Marker.CYLINDER)
            length, size = float(np.linalg.norm(end - start)), 2.0 * picture.link_width
            marker.pose.position = _points(0.5 * (start + end))[0]
            marker.pose.orientation = _quaternion(quaternion_to((end - start) / length))
            marker.scale = Vector3(x=size, y=size, z=length)
            marker.color = _rgba(LINKS, BODY)
            yield marker

    def _visuals(self, picture: Picture) -> Iterator[Marker]:
        """A marker for every shape of a body."""
        kinds = {
            "box": Marker.CUBE, "cylinder": Marker.CYLINDER, "sphere": Marker.SPHERE,
            "mesh": Marker.MESH_RESOURCE,
        }  # fmt: skip
        for k, look in enumerate(picture.visuals):
            marker = self._marker("visuals", k, kinds[look.shape])
            marker.pose.position = _points(look.centre)[0]
            marker.pose.orientation = _quaternion(look.quaternion)
            x, y, z = look.size.tolist()
            if look.shape in ("cylinder", "sphere"):  # RViz takes diameters
                x, y, z = 2.0 * x, 2.0 * y, z if look.shape == "cylinder" else 2.0 * z
            marker.scale = Vector3(x=x, y=y, z=z)
            marker.color = _rgba(LINKS, VISUAL)
            if look.mesh:
                marker.mesh_resource = Path(look.mesh).resolve().as_uri()
            yield marker

    def _arrows(self, picture: Picture) -> Iterator[Marker]:
        """One arrow per pulley of the cables given by positions."""
        for look in picture.arrows:
            marker = self._marker("forces", look.body, Marker.ARROW)
            if np.isnan(look.end).any():
                marker.action = Marker.DELETE
            marker.scale = Vector3(x=look.width, y=2.5 * look.width, z=0.0)
            marker.color = _rgba(FORCE, 0.9)
            marker.points = _points(np.array([look.start, np.nan_to_num(look.end)]))
            yield marker


def _quaternion(wxyz: Wxyz) -> Quaternion:
    w, x, y, z = wxyz
    return Quaternion(x=x, y=y, z=z, w=w)


def _points(path: NDArray[np.float64]) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in np.atleast_2d(path).tolist()]


def _rgba(colour: tuple[float, float, float], opacity: float) -> ColorRGBA:
    return ColorRGBA(r=colour[0], g=colour[1], b=colour[2], a=opacity)


def _body(argv: Sequence[str]) -> int:
    return run_node(
        "markers",
        SETTINGS,
        "markers [--supervised] --ros-args -p robot:=FILE [-p NAME:=VALUE] ...",
        "The robot as markers for RViz. Topics in the namespace /cdrj: in tensions, nodal_forces, "
        "joint_states; out markers (visualization_msgs/MarkerArray), while anybody subscribes.",
        lambda _: (MarkersNode(), None),
        argv,
    )


main = partial(run_command, "markers", _body)
"""Entry point; returns the exit code."""
