"""The poses in which a robot rests in a recording, and what a spring scale read there.

The first one is the reference pose.  A spring scale's gain errs in all readings alike, so only
their ratios to those in the reference pose are fitted: they show what neither a tare nor one
reading shows, such as the radius of a drum.  The recording contains the ways between the poses, and
so the friction of their directions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import sqrt
from typing import Final

import numpy as np

from cdrj_ros.estimation.changes import REST_NS, REST_STEP_NS, RestWatch
from cdrj_ros.estimation.estimator import Sample, Samples
from cdrj_ros.foundation.arrays import Series, Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.observations import Recorded, ScaleReading
from cdrj_ros.inspection.poses import pose_text
from cdrj_ros.model.packing import TENSION
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.tolerances import SCALE_READING

REST_IN_POSE_NS: Final = 2_000_000_000
"""Shortest rest in a further pose [ns]."""

REST_FIRST_NS: Final = 1_000_000_000
"""Shortest rest in the reference pose before the robot moves on [ns]."""

NEAR: Final = 0.05
"""Part of a joint's range within which a motion between two rests does not change the pose; without
joints, of every motor's motion."""


Readings = Mapping[str, float]
"""Of a spring scale [N], by cable or element."""


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


def scale_readings(
    robot: Robot,
    recorded: Recorded | None,
    poses: Sequence[Sample],
    readings: Sequence[Readings],
) -> tuple[dict[str, float], list[Recorded]]:
    """What a spring scale read: the preloads, and the tensions in all further poses.

    Args:
        robot: the robot.
        recorded: the recording with the poses, if there is one.
        poses: those in which the robot rests.
        readings: tensions by element, ``upper/8``, or by cable if it has one [N], for every pose.

    Returns:
        The preloads by cable [N], and the recording with the other readings as references, if there
        are any.

    Raises:
        UsageError: the readings are not those of the poses, or a name is none.
    """
    if len(readings) > 1 and len(readings) != len(poses):
        rests = "; ".join(pose_text(robot, pose.joint_angle) for pose in poses)
        raise UsageError(
            f"the spring scale was read in {len(readings)} poses; the recording of the tare rests "
            f"for {1e-9 * REST_IN_POSE_NS:g} s or more in {len(poses)}"
            + (f": {rests}" if rests else "")
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
    if recorded is None or not rows:
        return preloads, []
    references, scales = {}, {}
    for element, row in rows.items():
        stamps, values = (np.array(column) for column in zip(*row, strict=True))
        channel, cable = f"{TENSION}/{element}", element.split("/")[0]
        references[channel] = Series(stamps, stamps, np.asarray(values, dtype=float))
        scales[channel] = ScaleReading(preloads[cable], _noise(values, rows, cable))
    return preloads, [replace(recorded, name="spring scale", references=references, scales=scales)]


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
    return SCALE_READING * sqrt(1.0 + count) * float(np.mean(values))
