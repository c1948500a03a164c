"""The parts of a robot in the plane as parts in space: at z = 0, turning about z."""

from __future__ import annotations

from math import cos, sin

from cdrj_ros.robot.description import Frame, Node, Robot
from cdrj_ros.robot.space import SpatialFrame, SpatialPlace


def frames_in_space(robot: Robot) -> tuple[SpatialFrame, ...]:
    """Frames of the robot, parents first; none where tables give all lengths and wraps."""
    return robot.spatial_frames or tuple(map(_frame, robot.frames))


def place_in_space(node: Node) -> SpatialPlace | None:
    """Position and shape of a node; None where its cable is given by tables."""
    place = node.place
    if place is None:
        return node.space
    position = (place.x, place.y, 0.0)
    if place.turn == 0:
        return SpatialPlace("point", place.frame, position)
    return SpatialPlace("pulley", place.frame, position, turn=place.turn)


def _frame(frame: Frame) -> SpatialFrame:
    c, s = cos(frame.angle), sin(frame.angle)
    along = (*frame.direction, 0.0)
    return SpatialFrame(
        frame.name,
        frame.parent,
        frame.motion,
        frame.joint,
        origin=(frame.x, frame.y, 0.0),
        rotation=(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0),
        axis=along if frame.motion == "prismatic" else (0.0, 0.0, 1.0),
        rolling_radius=frame.rolling_radius,
    )
