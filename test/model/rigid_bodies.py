"""The bodies of a robot by its frames alone, and the points at which cables pull at them.

In plain NumPy: rotations by Rodrigues' formula, velocities by complex steps of the joint angles.
Nothing here knows lever arms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from model.reference_geometry import STEP
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Model, placed
from cdrj_ros.robot.description import Node, Robot

Vector = NDArray[np.float64]
Array = NDArray[Any]
Body = tuple[Array, Array]
"""Rotation and origin in the base, shapes (3, 3) and (3,)."""


def turned(axis: Array, angle: complex) -> Array:
    """Rotation about a unit vector."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def bodies(robot: Robot, q: Array) -> dict[str, Body]:
    """Every frame in the base, for real or complex joint angles; parents come first."""
    joints = {joint.name: k for k, joint in enumerate(robot.joints)}
    found: dict[str, Body] = {"base": (np.eye(3), np.zeros(3))}
    for frame in robot.frames:
        rotation, origin = found[frame.parent or "base"]
        place, rest = np.array(frame.origin), np.reshape(frame.rotation, (3, 3))
        axis = np.array(frame.axis)
        origin, rotation = origin + rotation @ place, rotation @ rest
        if frame.joint:
            motion = frame.multiplier * q[joints[frame.joint]] + frame.offset
            if frame.motion == "prismatic":
                origin = origin + rotation @ axis * motion
            elif frame.motion == "rolling":
                reach = turned(axis, motion) @ np.array([2 * frame.rolling_radius, 0.0, 0.0])
                origin, rotation = origin + rotation @ reach, rotation @ turned(axis, 2 * motion)
            else:
                rotation = rotation @ turned(axis, motion)
        found[frame.name] = rotation, origin
    return found


@dataclass(frozen=True)
class Pull:
    """A free length that pulls at the body it has left and at the one on which it arrives."""

    elements: slice
    """The elements that it consists of; several where it passes bodies without touching them."""
    unit: Vector
    """Towards the last node, in the base, shape (3,)."""
    left: tuple[str, Vector]
    """Frame of the body that it has left, and the point there in the base [m]."""
    meets: tuple[str, Vector]
    """The same of the body on which it arrives."""


def pulls(model: Model, q: Vector, motor: Vector | None = None) -> list[Pull]:
    """All free lengths of cables given by positions in a pose, in their order.

    Points of contact in space are the estimator's, in the plane they follow from the directions.
    """
    robot, (shape, views) = model.robot, placed(model, q, motor)
    touches: Any = views.touches
    here = bodies(robot, q)
    found: list[Pull] = []
    node = element = 0
    for cable in robot.cables:
        count, first = len(cable.nodes) - 1, 0
        for k in range(count if cable.placed else 0):
            if k + 1 < count and not robot.planar and touches["touching"][node + k + 1] == 0.0:
                continue
            unit = shape.direction[element + k].copy()
            if not robot.planar:
                left = _frame(cable.nodes[first], leaving=True), touches["exit"][node + first]
                meets = _frame(cable.nodes[k + 1]), touches["entry"][node + k + 1]
            else:
                left = _tangent_point(here, cable.nodes[first], unit)
                meets = _tangent_point(here, cable.nodes[k + 1], unit)
            free = meets[1] - left[1]
            np.testing.assert_allclose(free, np.linalg.norm(free) * unit, rtol=0, atol=1e-12)
            found.append(Pull(slice(element + first, element + k + 1), unit, left, meets))
            first = k + 1
        node, element = node + count + 1, element + count
    return found


def velocity(robot: Robot, q: Vector, joint: int, frame: str, point: Vector) -> Vector:
    """Velocity of a body's point that is now at ``point``, per unit of a joint's velocity."""
    rotation, origin = bodies(robot, q)[frame]
    moved = q.astype(complex)
    moved[joint] += 1j * STEP
    turn, place = bodies(robot, moved)[frame]
    return np.asarray((place + turn @ (rotation.T @ (point - origin))).imag / STEP)


def rate_of_free_length(robot: Robot, q: Vector, joint: int, pull: Pull) -> float:
    """Rate of the distance of both points as their bodies carry them, per unit of a joint's."""
    meets, left = (velocity(robot, q, joint, *point) for point in (pull.meets, pull.left))
    return float(pull.unit @ (meets - left))


def _frame(node: Node, leaving: bool = False) -> str:
    place = node.place
    assert place is not None
    return place.exit_frame if leaving and place.kind == "sheath" else place.frame


def _tangent_point(here: dict[str, Body], node: Node, unit: Vector) -> tuple[str, Vector]:
    """Point of a circle in the plane at which the cable has a direction."""
    place = node.place
    assert place is not None
    rotation, origin = here[place.frame or "base"]
    centre = origin + rotation @ np.array(place.position)
    right = np.array([unit[1], -unit[0], 0.0])  # the centre lies to the left, counter-clockwise
    return place.frame or "base", centre + place.turn * node.radius * right
