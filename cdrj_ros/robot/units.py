"""Numbers of a robot file that were probably given in another unit than the file says."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees, pi, radians
from typing import Final, NamedTuple

from cdrj_ros.robot.description import Cable, Joint, Robot

LARGEST_ANGLE: Final = 2.0 * pi
"""Joint angle beyond which degrees were probably given as radians [rad]."""

SMALLEST_RANGE: Final = radians(pi)
"""Angle within which a whole range was probably given in radians under a key in degrees [rad]."""

LARGEST_RADIUS: Final = 5.0
"""Radius of a drum, pulley or body beyond which millimetres were probably given as metres [m]."""

SMALLEST_RADIUS: Final = 1e-4
"""Radius below which metres were probably given under a key in millimetres [m]."""

FARTHEST: Final = 50.0
"""Coordinate beyond which millimetres were probably given as metres [m]."""


class Doubt(NamedTuple):
    """A number in a doubtful unit."""

    where: str
    """Name of the joint, frame or node."""
    text: str


def unit_doubts(robot: Robot) -> Iterator[Doubt]:
    """Numbers in doubtful units, in the order of the file."""
    for joint in robot.joints:
        if joint.name not in robot.prismatic_joints:
            yield from _range(joint)
    for frame in robot.frames:
        yield from _coordinates(f"frame {frame.name}", "origin", frame.origin)
    for cable in robot.cables:
        yield from _nodes(cable)


def _range(joint: Joint) -> Iterator[Doubt]:
    farthest = max(abs(joint.lower), abs(joint.upper))
    if farthest > LARGEST_ANGLE:
        yield Doubt(
            joint.name,
            f"range [{joint.lower:g}, {joint.upper:g}] is in rad, {farthest / (2.0 * pi):.1f} "
            "turns: is it range_deg?",
        )
    elif farthest <= SMALLEST_RANGE:
        yield Doubt(
            joint.name,
            f"range [{degrees(joint.lower):g}, {degrees(joint.upper):g}] is in degrees: is it "
            "range, in rad?",
        )


def _coordinates(where: str, key: str, values: tuple[float, ...]) -> Iterator[Doubt]:
    farthest = max(values, key=abs)
    if abs(farthest) > FARTHEST:
        yield Doubt(where, f"{key} is {farthest:g} m away: is it {key}_mm? A URDF is in m.")


def _nodes(cable: Cable) -> Iterator[Doubt]:
    for k, node in enumerate(cable.nodes):
        where = f"{cable.name}/{k + 1}"
        if node.radius > LARGEST_RADIUS:
            yield Doubt(where, f"radius is {node.radius:g} m: is it radius_mm?")
        elif 0.0 < node.radius < SMALLEST_RADIUS:
            yield Doubt(where, f"radius is {1e3 * node.radius:g} mm: is it radius, in m?")
        if node.place is not None:
            yield from _coordinates(where, "position", node.place.position)
