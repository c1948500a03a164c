"""Poses and velocities of frames at many joint angles at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Frame:
    """A frame in its parent, as a URDF's joint and link."""

    name: str
    parent: str
    motion: str
    """``revolute`` or ``prismatic``."""
    joint: str
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """In the parent [m]."""
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Fixed-axis roll, pitch and yaw in the parent at joint angle 0 [rad]."""
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Unit vector of the motion, in the frame."""


@dataclass(frozen=True)
class Screw:
    """How one joint moves a frame, at n joint angles."""

    joint: int
    revolute: bool
    axis: Array
    """In the base, shape (n, 3)."""
    origin: Array
    """A point of the axis in the base [m], shape (n, 3)."""


@dataclass(frozen=True)
class Pose:
    """A frame at n joint angles."""

    turn: Array
    """From the frame to the base, shape (n, 3, 3)."""
    origin: Array
    """In the base [m], shape (n, 3)."""
    screws: tuple[Screw, ...] = ()

    def point(self, local: Sequence[float] | Array) -> Array:
        """A point of the frame in the base [m], shape (n, 3)."""
        return self.origin + self.turn @ np.asarray(local)

    def velocity(self, point: Array, joints: int) -> Array:
        """Motion of the body's point per unit of every joint's, shape (n, joints, 3)."""
        velocity = np.zeros((len(point), joints, 3))
        for screw in self.screws:
            turning = np.cross(screw.axis, point - screw.origin) if screw.revolute else screw.axis
            velocity[:, screw.joint] += turning
        return velocity


def place(frames: Sequence[Frame], joints: Sequence[str], angle: Array) -> Mapping[str, Pose]:
    """Poses of all frames, and of ``base``, at the joint angles of shape (n, joints)."""
    count = len(angle)
    poses = {"base": Pose(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))}
    for frame in frames:
        parent, j = poses[frame.parent], joints.index(frame.joint)
        turn = parent.turn @ Rotation.from_euler("xyz", frame.rpy).as_matrix()
        origin = parent.point(frame.origin)
        axis = turn @ np.asarray(frame.axis)
        screw = Screw(j, frame.motion == "revolute", axis, origin)
        if screw.revolute:
            vector = angle[:, j, None] * np.asarray(frame.axis)
            turn = turn @ Rotation.from_rotvec(vector).as_matrix()
        else:
            origin = origin + angle[:, j, None] * axis
        poses[frame.name] = Pose(turn, origin, (*parent.screws, screw))
    return poses
