"""Poses in which the robot rests in a recording, and what a spring scale reads in them.

The scale's gain errs in all readings alike, so only their ratios to those in the reference pose are
fitted: they show what neither a tare nor one reading shows, such as the radius of a drum.  The
recording contains the ways between the poses, and so the friction of their directions.
docs/commission.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import sqrt
from typing import Final

import numpy as np

from cdrj_ros.estimation.changes import REST_NS, REST_STEP_NS, RestWatch
from cdrj_ros.estimation.estimator import Sample, Samples
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.observations import Recorded, ScaleReading, samples_of
from cdrj_ros.model.packing import TENSION
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot

READING: Final = 0.01
"""Error of a spring scale's reading beside that of its gain, as a fraction."""

LEAST_NS: Final = 2_000_000_000
"""Shortest rest in a pose, unless the robot does not move at all [ns]."""

NEAR: Final = 0.05
"""Part of a joint's range within which a motion between two rests does not change the pose; without
measured joints, of every motor's motion."""


def rest_poses(model: Model, recorded: Recorded) -> tuple[Sample, ...]:
    """The poses in which the robot rests, in their order: mean angles, and a time of rest in each.

    Raises:
        UsageError: the robot does not rest at the beginning.
    """
    samples = samples_of(model, recorded)
    angles, near = _pose_angles(model.robot, samples)
    poses: list[slice] = []
    for span in _rests(model.robot, samples, recorded.name):
        if poses:
            since = angles[poses[-1].stop : span.stop] - angles[poses[-1]].mean(axis=0)
            if np.all(np.abs(since) < near):
                continue
        poses.append(span)
    return tuple(_mean(samples, span) for span in poses)


def _pose_angles(robot: Robot, samples: Samples) -> tuple[Table, Vector]:
    """Angles that make a pose, shape (n, axes), and how little each may change within one."""
    measured = [k for k, joint in enumerate(robot.joints) if joint.measured]
    if not measured:
        return samples.motor_angle, NEAR * np.ptp(samples.motor_angle, axis=0)
    ranges = [robot.joints[k].upper - robot.joints[k].lower for k in measured]
    return samples.joint_angle[:, measured], NEAR * np.array(ranges)


def _rests(robot: Robot, samples: Samples, name: str) -> list[slice]:
    """Stretches at rest, the first one at the beginning."""
    watch, stamps = RestWatch(), samples.stamp_ns
    first, last = int(stamps[0]), int(stamps[-1])
    steps = np.searchsorted(stamps, np.arange(first, last, REST_STEP_NS))
    found: list[slice] = []
    begin = -1
    for k in np.unique([*steps, stamps.size - 1]).tolist():
        watch.add(samples.at(k))
        reason = watch.in_motion(robot)
        if begin < 0 and not reason:
            begin = int(np.searchsorted(stamps, stamps[k] - REST_NS))
        if begin >= 0 and (reason or stamps[k] == last):
            whole = begin == 0 and not reason
            if whole or stamps[k] - stamps[begin] >= LEAST_NS:
                found.append(slice(begin, k if reason else k + 1))
            begin = -1
        watched = stamps[k] - first >= REST_NS or stamps[k] == last
        if reason and watched and not found:
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


def scale_readings(
    robot: Robot,
    recorded: Recorded | None,
    poses: Sequence[Sample],
    readings: Sequence[Mapping[str, float]],
) -> tuple[dict[str, float], Recorded | None]:
    """What a spring scale read: the preloads, and the tensions in all further poses.

    Args:
        robot: the robot.
        recorded: the recording with the poses, if there is one.
        poses: those in which the robot rests.
        readings: tensions by element, ``upper/8``, or by cable if it has one [N], for every pose.

    Returns:
        The preloads by cable [N], and the recording with the other readings as references; None
        without any.

    Raises:
        UsageError: the readings are not those of the poses, or a name is none.
    """
    if len(readings) > 1 and len(readings) != len(poses):
        rests = "; ".join(pose_words(robot, pose) for pose in poses)
        raise UsageError(
            f"the spring scale was read in {len(readings)} poses; the recording of the tare rests "
            f"for {1e-9 * LEAST_NS:g} s or more in {len(poses)}" + (f": {rests}" if rests else "")
        )
    elements = {cable.name: cable.element_names for cable in robot.cables}
    for name in readings[0]:
        if "/" in name:
            _element(name, elements)
    preloads = {name.split("/")[0]: value for name, value in readings[0].items()}
    rows: dict[str, list[tuple[int, float]]] = {}
    for pose, read in zip(poses[1:], readings[1:], strict=False):
        for name, value in read.items():
            element, cable = _element(name, elements), name.split("/")[0]
            if not preloads.get(cable, 0.0) > 0.0:
                raise UsageError(f"{name}: read the tension of {cable} in the reference pose too")
            if not 0.0 < value < 1e6:
                raise UsageError(f"the tension of {name} must be in (0, 1e6) N, got {value:g}")
            rows.setdefault(element, []).append((pose.stamp_ns, value))
    references, scales = {}, {}
    for element, row in rows.items():
        stamps, values = (np.array(column) for column in zip(*row, strict=True))
        channel, cable = f"{TENSION}/{element}", element.split("/")[0]
        references[channel] = (stamps, np.asarray(values, dtype=float))
        scales[channel] = ScaleReading(preloads[cable], _noise(values, rows, cable))
    if recorded is None or not references:
        return preloads, None
    return preloads, replace(recorded, name="spring scale", references=references, scales=scales)


def _element(name: str, elements: Mapping[str, Sequence[str]]) -> str:
    """The element of a name, which may be that of its cable if there is only one.

    Raises:
        UsageError: there is none.
    """
    cable = name.partition("/")[0]
    names = elements.get(cable, ())
    element = names[0] if name == cable and len(names) == 1 else name
    if element not in names:
        there = ", ".join(f"{one[0]} to {one[-1]}" for one in elements.values())
        raise UsageError(f"there is no element {name!r}; there are {there}")
    return element


def _noise(values: Vector, rows: Mapping[str, Sequence[object]], cable: str) -> float:
    """Standard deviation of readings [N].

    The error of the reading in the reference pose is common to the ratios of all others of a cable.
    As if each had an own error √(1 + count) times as large, their mean errs as it does.
    """
    count = sum(len(row) for name, row in rows.items() if name.split("/")[0] == cable)
    return READING * sqrt(1.0 + count) * float(np.mean(values))
