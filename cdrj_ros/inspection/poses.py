"""Poses in which cables are inspected, by the joints that move them, and how they are written."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from itertools import product
from math import degrees
from typing import Final

import numpy as np

from cdrj_ros.foundation.arrays import Matrix
from cdrj_ros.foundation.output import fixed
from cdrj_ros.robot.description import Cable, Robot
from cdrj_ros.robot.groups import joints_of

POSES_PER_JOINT: Final = (81, 21, 9, 5)
"""Grid points per joint for a robot with one, two, three or four joints."""

RANDOM_POSES: Final = 1000
"""Number of random poses for a robot with more joints."""

MOST_ANGLES: Final = 50_000
"""Largest number of angles in the random poses, of a robot with many joints."""

MOST_CORNERS: Final = 10
"""Largest number of joints for which all corners of the joint ranges are added."""


def pose_text(robot: Robot, pose: Iterable[float], cable: Cable | None = None) -> str:
    """Format a pose: ``elbow = 40.0°, slide = 0.120 m``; only the joints that move a cable."""
    positions = robot.prismatic_joints
    own = None if cable is None else joints_of(robot, cable)
    return ", ".join(
        f"{joint.name} = {fixed(value, 3)} m"
        if joint.name in positions
        else f"{joint.name} = {fixed(degrees(value), 1)}°"
        for joint, value in zip(robot.joints, pose, strict=True)
        if own is None or joint.name in own
    )


def visited_poses(robot: Robot, moved: Collection[str]) -> Matrix:
    """Reference pose, then a grid or, for many joints, the corners and random poses.

    Args:
        robot: the robot.
        moved: names of the joints that move; the others stay in the reference pose.

    Returns:
        Shape (poses, joints).
    """
    own = [j for j, joint in enumerate(robot.joints) if joint.name in moved]
    lower = np.array([robot.joints[j].lower for j in own])
    upper = np.array([robot.joints[j].upper for j in own])
    reference = robot.reference_pose[None]
    count = len(own)
    if count == 0:
        return reference
    if count <= len(POSES_PER_JOINT):
        axis = np.linspace(0.0, 1.0, POSES_PER_JOINT[count - 1])
        shares = np.array(list(product(axis, repeat=count)))
    else:
        poses = min(RANDOM_POSES, max(MOST_CORNERS, MOST_ANGLES // count))
        shares = np.random.default_rng(0).random((poses, count))
        if count <= MOST_CORNERS:
            shares = np.vstack([np.array(list(product((0.0, 1.0), repeat=count))), shares])
    grid = np.repeat(reference, 1 + len(shares), axis=0)
    grid[1:, own] = lower + shares * (upper - lower)
    return np.asarray(grid)
