"""Lengths, moment arms and wraps of all cables in given poses, as a table.

A length is that of the whole cable with the drums at rest: in the reference pose, the length
between its drums or anchors; in other poses, this length minus the cable that they have wound up
as frames turned.  A moment arm is the sum of the lever arms of the cable's elements: without
friction, the effort on a joint is the tension times the arm, with the opposite sign.  It is the
derivative of the length wherever the path is the shortest one.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.text import printable
from cdrj_ros.model.prepared import Model, shape_at
from cdrj_ros.robot.description import Robot

Matrix = NDArray[np.float64]

MOST_POSES: Final = 1_000_000
"""Largest number of poses in a file."""

OUTSIDE: Final = 1e-9
"""Excess over a joint's range that counts as rounding [rad] or [m]."""


@dataclass(frozen=True)
class GeometryTable:
    """One row per pose."""

    columns: tuple[str, ...]
    """``length/<cable>`` [m], ``arm/<cable>/<joint>`` [m/rad] or [-], ``wrap/<cable>/<node>``
    [rad]."""
    values: Matrix
    """Shape (poses, columns)."""

    def text(self) -> str:
        """The table as CSV, every number with all of its digits."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([repr(value) for value in row] for row in self.values.tolist())
        return stream.getvalue()


def read_poses(text: str, robot: Robot, source: str) -> Matrix:
    """Joint angles of a table of poses in SI, shape (poses, joints).

    Args:
        text: CSV with a header of the names of all joints, and of motors, which are not used.
        robot: the robot.
        source: name of the table, for messages.

    Raises:
        UsageError: names the pose, the value given and the values allowed.
    """
    source = printable(source)
    try:
        lines = [line for line in csv.reader(io.StringIO(text)) if line]
    except csv.Error as error:
        raise UsageError(f"{source} is not a CSV table: {error}") from error
    if not lines:
        raise UsageError(f"{source} is empty; it needs a header of joint names")
    header = [name.strip() for name in lines[0]]
    places = _places(header, robot, source)
    if len(lines) < 2 or len(lines) > MOST_POSES + 1:
        raise UsageError(f"{source} must have 1 to {MOST_POSES} poses, got {len(lines) - 1}")
    poses = np.empty((len(lines) - 1, len(places)))
    for k, line in enumerate(lines[1:]):
        if len(line) != len(header):
            raise UsageError(
                f"{source}: pose {k + 1} has {len(line)} entries, the header {len(header)}"
            )
        for j, (joint, place) in enumerate(zip(robot.joints, places, strict=True)):
            value = _number(line[place], f"{source}: pose {k + 1}, {joint.name}")
            if not joint.lower - OUTSIDE <= value <= joint.upper + OUTSIDE:
                raise UsageError(
                    f"{source}: pose {k + 1}, {joint.name} must lie in the joint's range "
                    f"[{joint.lower:g}, {joint.upper:g}], got {value:g}"
                )
            poses[k, j] = value
    return poses


def _places(header: Sequence[str], robot: Robot, source: str) -> list[int]:
    """Column of every joint."""
    known = {axis.name for axis in robot.axes}
    for name in header:
        if name not in known:
            raise UsageError(
                f"{source}: {printable(name)!r} is neither a joint nor a motor of {robot.name}; "
                f"it has {', '.join(sorted(known))}"
            )
        if header.count(name) > 1:
            raise UsageError(f"{source} has two columns {name}")
    missing = [joint.name for joint in robot.joints if joint.name not in header]
    if missing:
        raise UsageError(f"{source} has no column for the joint {missing[0]}")
    return [header.index(joint.name) for joint in robot.joints]


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise UsageError(f"{where} must be a number, got {printable(text)!r}")
    return value


def geometry_table(model: Model, poses: Matrix) -> GeometryTable:
    """Evaluate a robot's geometry in poses, shape (poses, joints).

    Raises:
        UsageError: a pose in which no path of a cable exists.
    """
    robot, layout = model.robot, model.layout
    columns = [f"length/{name}" for name in layout.cables]
    columns += [f"arm/{cable}/{joint}" for cable in layout.cables for joint in layout.joints]
    columns += [f"wrap/{name}" for name in layout.pulleys]
    cables = list(_elements(robot))
    values = np.empty((len(poses), len(columns)))
    for k, pose in enumerate(poses):
        shape = shape_at(model, pose)
        if not shape.possible:
            where = ", ".join(
                f"{name} = {value:.6g}" for name, value in zip(layout.joints, pose, strict=True)
            )
            raise UsageError(f"pose {k + 1} is impossible for the cables of {robot.name}: {where}")
        lengths = [shape.length[part].sum() for part in cables]
        arms = [shape.lever_arm[part].sum(axis=0) for part in cables]
        values[k] = np.concatenate([lengths, *arms, shape.wrap])
    return GeometryTable(tuple(columns), values)


def _elements(robot: Robot) -> Iterator[slice]:
    """Elements of every cable."""
    first = 0
    for cable in robot.cables:
        yield slice(first, first + len(cable.nodes) - 1)
        first += len(cable.nodes) - 1
