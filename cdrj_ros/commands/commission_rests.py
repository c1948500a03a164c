"""The poses in which a robot rests in a recording, of which the first is the reference pose."""

from __future__ import annotations

from typing import Final

import numpy as np

from cdrj_ros.estimation.changes import REST_NS, REST_STEP_NS, RestWatch
from cdrj_ros.estimation.estimator import Sample, Samples
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot.description import Robot

REST_IN_POSE_NS: Final = 2_000_000_000
"""Shortest rest in a further pose [ns]."""

REST_FIRST_NS: Final = 1_000_000_000
"""Shortest rest in the reference pose before the robot moves on [ns]."""

NEAR: Final = 0.05
"""Part of a joint's range within which a motion between two rests does not change the pose; without
joints, of every motor's motion."""


def rest_poses(robot: Robot, samples: Samples, name: str) -> tuple[Sample, ...]:
    """The poses in which the robot rests, in their order: mean angles, and a time of rest in each.

    Args:
        robot: the robot.
        samples: of a whole recording.
        name: of the recording.

    Raises:
        UsageError: the robot does not rest at the beginning.
    """
    angles, near = _pose_angles(robot, samples)
    poses: list[slice] = []
    for span in _rests(robot, samples, name):
        if poses:
            since = angles[poses[-1].stop : span.stop] - angles[poses[-1]].mean(axis=0)
            if np.all(np.abs(since) < near):
                continue
        poses.append(span)
    return tuple(_mean(samples, span) for span in poses)


def _pose_angles(robot: Robot, samples: Samples) -> tuple[Table, Vector]:
    """Angles that make a pose, shape (n, axes), and how little each may change within one."""
    if not robot.joints:
        return samples.motor_angle, NEAR * np.ptp(samples.motor_angle, axis=0)
    ranges = [joint.upper - joint.lower for joint in robot.joints]
    return samples.joint_angle, NEAR * np.array(ranges)


def _rests(robot: Robot, samples: Samples, name: str) -> list[slice]:
    """Stretches at rest, the first one at the beginning."""
    watch, stamps = RestWatch(), samples.stamp_ns
    first, last = int(stamps[0]), int(stamps[-1])
    steps = np.searchsorted(stamps, np.arange(first, last, REST_STEP_NS))
    found: list[slice] = []
    begin, reason, moved = -1, "", False
    for k in np.unique([*steps, stamps.size - 1]).tolist():
        watch.add(samples.at(k))
        reason = watch.in_motion(robot)
        moved = moved or (bool(reason) and stamps[k] - first >= REST_NS)
        if begin < 0 and not reason:
            begin = int(np.searchsorted(stamps, stamps[k] - REST_NS)) if moved else 0
        if begin >= 0 and (reason or stamps[k] == last):
            least = REST_IN_POSE_NS if found else REST_FIRST_NS
            if not moved or stamps[k] - stamps[begin] >= least:
                found.append(slice(begin, k if reason else k + 1))
            begin = -1
        if moved and not found:
            rest = f"a tare needs {1e-9 * REST_FIRST_NS:g} s at rest before any motion"
            raise UsageError(f"{name}: {reason}; {rest}")
    if not found:
        raise UsageError(f"{name}: {reason}")
    return found


def _mean(samples: Samples, span: slice) -> Sample:
    return Sample(
        int(samples.stamp_ns[(span.start + span.stop) // 2]),
        samples.motor_angle[span].mean(axis=0),
        samples.joint_angle[span].mean(axis=0),
    )


def pose_words(robot: Robot, pose: Sample) -> str:
    """The angles of the joints."""
    words = []
    for joint, angle in zip(robot.joints, pose.joint_angle.tolist(), strict=True):
        prismatic = joint.name in robot.prismatic_joints
        shown = f"{1e3 * angle:.1f} mm" if prismatic else f"{np.degrees(angle):.1f}°"
        words.append(f"{joint.name} {shown}")
    return ", ".join(words)
