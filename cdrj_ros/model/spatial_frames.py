"""Poses and velocities of frames in space; see docs/geometry.md, section 1."""

from __future__ import annotations

from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import lean, stage
from cdrj_ros.model.geometry import PRISMATIC, REVOLUTE, ROLLING
from cdrj_ros.model.records import Grid, Rows
from cdrj_ros.model.spatial_records import (
    SpatialFrameNumbers,
    SpatialFramePlan,
    SpatialPose,
    SpatialTwist,
)
from cdrj_ros.model.spatial_vectors import (
    Vector3,
    about,
    combined,
    cross,
    load,
    plus,
    rotated,
    scaled,
    store,
)

Vector = NDArray[np.float64]


@stage
def point_velocity(twist: SpatialTwist, point: Vector3) -> Vector3:
    """Velocity of a point that moves with a frame; both vectors are in the base."""
    return plus(load(twist.linear), cross(load(twist.angular), point))


@stage
def _turn(twist: SpatialTwist, axis: Vector3, origin: Vector3) -> None:
    """Add an angular velocity about a line in the base."""
    store(twist.angular, plus(load(twist.angular), axis))
    store(twist.linear, plus(load(twist.linear), cross(origin, axis)))


@stage
def _multiply_columns(pose: SpatialPose, left: Vector, right: Vector) -> None:
    """Set the rotation of a pose to the product of two rotations stored by rows."""
    for i in range(3):
        for k in range(3):
            pose.rotation[3 * i + k] = (
                left[3 * i] * right[k]
                + left[3 * i + 1] * right[3 + k]
                + left[3 * i + 2] * right[6 + k]
            )


@stage
def _turn_pose(pose: SpatialPose, axis: Vector3, angle: float) -> None:
    """Turn a pose about a unit vector in its own axes.

    Turning about the vector in the base would multiply rounding errors from joint to joint.
    """
    c, s = cos(angle), sin(angle)
    first = rotated(pose.rotation, about(axis, c, s, (1.0, 0.0, 0.0)))
    second = rotated(pose.rotation, about(axis, c, s, (0.0, 1.0, 0.0)))
    third = rotated(pose.rotation, about(axis, c, s, (0.0, 0.0, 1.0)))
    for i in range(3):
        pose.rotation[3 * i] = first[i]
        pose.rotation[3 * i + 1] = second[i]
        pose.rotation[3 * i + 2] = third[i]


@stage
def _start_frame(
    parent: int, frame: SpatialFrameNumbers, f: int, poses: Rows[SpatialPose]
) -> Vector3:
    """Write the rotation of an unmoved frame in the base; returns its origin in the base [m]."""
    pose = poses[f]
    if parent >= 0:
        carrier = poses[parent]
        _multiply_columns(pose, carrier.rotation, frame.rotation)
        return plus(load(carrier.origin), rotated(carrier.rotation, load(frame.origin)))
    for i in range(9):
        pose.rotation[i] = frame.rotation[i]
    return load(frame.origin)


@lean
def place_spatial_frames(
    plans: Rows[SpatialFramePlan],
    frames: Rows[SpatialFrameNumbers],
    joint_angle: Vector,
    poses: Rows[SpatialPose],
    twists: Grid[SpatialTwist],
) -> None:
    """Pose of every frame in the base, and its velocity per joint.

    Args:
        plans, frames: every frame, parents first, shape (f,).
        joint_angle: [rad] or [m], shape (j,).
        poses: shape (f,), written.
        twists: shape (f, j), written.

    A rolling frame follows two equal circles of radius R as in the plane (eq. 5).  It rolls about
    its z axis and starts on its x axis.
    """
    for f in range(len(frames)):
        frame, plan, pose = frames[f], plans[f], poses[f]
        origin = _start_frame(plan.parent, frame, f, poses)
        for j in range(joint_angle.size):
            moved = twists[f, j]
            for i in range(3):
                moved.angular[i], moved.linear[i] = 0.0, 0.0
                if plan.parent >= 0:
                    moved.angular[i] = twists[plan.parent, j].angular[i]
                    moved.linear[i] = twists[plan.parent, j].linear[i]
        if plan.joint >= 0:
            q = frame.multiplier * joint_angle[plan.joint] + frame.offset
            axis = rotated(pose.rotation, load(frame.axis))
            rate = scaled(frame.multiplier, axis)
            twist = twists[f, plan.joint]
            if plan.motion == REVOLUTE:
                _turn(twist, rate, origin)
                _turn_pose(pose, load(frame.axis), q)
            elif plan.motion == PRISMATIC:
                store(twist.linear, plus(load(twist.linear), rate))
                origin = combined(1.0, origin, q, axis)
            elif plan.motion == ROLLING:
                start = rotated(pose.rotation, (frame.rolling_radius, 0.0, 0.0))
                radius = about(axis, cos(q), sin(q), start)
                _turn(twist, scaled(2.0, rate), plus(origin, radius))
                origin = combined(1.0, origin, 2.0, radius)
                _turn_pose(pose, load(frame.axis), 2.0 * q)
        store(pose.origin, origin)
