"""The values that a picture shows, and the last ones for curves over time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from math import isfinite
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import Axis
from cdrj_ros.estimation.conditioner import axes_of
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.packing import INVALID, STALE, Layout
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot

Flags = NDArray[np.uint8]


class Snapshot(NamedTuple):
    """Estimates and references at one time; NaN where a value is unknown."""

    stamp_ns: Any
    """Time of the estimate [ns], an integer; 0 if there is none."""
    angle: Vector
    """Of every joint [rad] or [m], shape (joints,)."""
    tension: Vector
    """[N], shape (elements,)."""
    stddev: Vector
    """Of ``tension`` [N], shape (elements,)."""
    reference: Vector
    """Measured or true tension [N], shape (elements,)."""
    status: Flags
    """Flags of ``cdrj_ros.model.packing``, shape (elements,)."""
    force: NDArray[np.float64]
    """Of the cable on every pulley [N], shape (pulleys, 3)."""
    friction: Vector
    """[N], shape (pulleys,)."""
    slip_speed: Vector
    """[m/s], shape (pulleys,)."""
    pulley_status: Flags
    """Shape (pulleys,)."""


def nothing_known(model: Model) -> Snapshot:
    """A snapshot in the reference pose in which every estimate is INVALID."""
    layout = model.layout
    elements, pulleys = len(layout.elements), len(layout.pulleys)

    def unknown(*shape: int) -> Vector:
        return np.full(shape, np.nan)

    return Snapshot(
        0,
        model.robot.reference_pose,
        unknown(elements),
        unknown(elements),
        unknown(elements),
        np.full(elements, INVALID, np.uint8),
        unknown(pulleys, 3),
        unknown(pulleys),
        unknown(pulleys),
        np.full(pulleys, INVALID, np.uint8),
    )


def usable(status: Flags) -> NDArray[np.bool_]:
    """Where a value may be used: it is neither STALE nor INVALID."""
    return np.asarray((status & (STALE | INVALID)) == 0)


def columns_of(message: Any, fields: Sequence[str], names: Sequence[str]) -> dict[str, Vector]:
    """Fields of a message in the order of ``names``, NaN for a name that the message lacks.

    Args:
        message: has a list ``name`` and, by each field's name, as many numbers; or None.
        fields: names of the fields; one of another length counts as unknown.
        names: the order of the result.
    """
    given = {} if message is None else {name: k for k, name in enumerate(message.name)}
    columns = {}
    for field in fields:
        column = np.full(len(names), np.nan)
        values = [] if message is None else getattr(message, field)
        if len(values) == len(given):
            for at, name in enumerate(names):
                if name in given:
                    column[at] = values[given[name]]
        columns[field] = column
    return columns


def flags_of(column: Vector) -> Flags:
    """Status flags from numbers; INVALID where unknown."""
    return np.where(np.isnan(column), INVALID, column).astype(np.uint8)


def tension_columns(message: Any, layout: Layout) -> tuple[Vector, Vector, Flags]:
    """Tension, standard deviation and flags from a message of the type CableTensions."""
    found = columns_of(message, ("tension", "stddev", "status"), layout.elements)
    return found["tension"], found["stddev"], flags_of(found["status"])


def pulley_columns(
    message: Any, layout: Layout
) -> tuple[NDArray[np.float64], Vector, Vector, Flags]:
    """Force, friction, slip speed and flags from a message of the type NodalForces."""
    axes = ("force_x", "force_y", "force_z")
    found = columns_of(message, (*axes, "friction", "slip_speed", "status"), layout.pulleys)
    force = np.column_stack([found[axis] for axis in axes])
    return force, found["friction"], found["slip_speed"], flags_of(found["status"])


def joint_angles(message: Any, joints: Sequence[Axis], before: Vector) -> Vector:
    """Angles of all joints after a message of the type JointState, as the estimator converts them.

    Args:
        message: a joint of which it has no finite reading keeps its angle; or None.
        joints: their names, sensors and ranges, see ``joint_axes``.
        before: the angles before, shape (joints,) [rad] or [m].  A reading that wraps around stands
            for the angle in range that is nearest to this one.
    """
    readings = columns_of(message, ("position",), [joint.name for joint in joints])["position"]
    angles = before.copy()
    for j, (joint, reading) in enumerate(zip(joints, readings.tolist(), strict=True)):
        if isfinite(reading):
            angle = joint.angle_near(reading, float(before[j]))
            angles[j] = min(max(angle, joint.lower), joint.upper)
    return angles


def joint_axes(robot: Robot) -> list[Axis]:
    """Names, sensors and ranges of a robot's joints."""
    return axes_of(robot)[len(robot.motors) :]


PICTURES: Final = 1800
"""Number of snapshots that are kept: one minute at 30 Hz."""


class Curves(NamedTuple):
    """Values over time at one place of a cable; NaN where unknown."""

    element: str
    pulley: str
    """The pulley next to the element; empty if there is none."""
    time_s: Vector
    """[s], shape (n,)."""
    tension: Vector
    """[N]."""
    stddev: Vector
    """[N]."""
    reference: Vector
    """[N]."""
    friction: Vector
    """At the pulley [N]."""
    slip_speed: Vector
    """At the pulley [m/s]."""


class Table(Snapshot):
    """Snapshots over time: every field has a row for each."""

    @property
    def duration_s(self) -> float:
        """Time from the first to the last snapshot [s]."""
        return float(self.stamp_ns[-1] - self.stamp_ns[0]) * 1e-9

    def at(self, time_s: float) -> Snapshot:
        """The last snapshot at a time since the first one [s]; the first one before that."""
        wanted = int(self.stamp_ns[0]) + round(time_s * 1e9)
        k = max(int(np.searchsorted(self.stamp_ns, wanted, side="right")) - 1, 0)
        return Snapshot(*(column[k] for column in self))

    def curves(self, layout: Layout, chosen: str, zero_ns: int) -> Curves:
        """The curves of an element or a pulley, with its neighbour.

        Args:
            layout: of the columns.
            chosen: as ``indices_of`` takes it.
            zero_ns: stamp at which the time is 0 [ns].
        """
        element, pulley = indices_of(layout, chosen)
        fine = usable(self.status[:, element])
        sure = np.zeros(0) if pulley is None else usable(self.pulley_status[:, pulley])

        def of_pulley(values: Vector) -> Vector:
            if pulley is None:
                return np.full(len(self.stamp_ns), np.nan)
            return np.where(sure, values[:, pulley], np.nan)

        return Curves(
            layout.elements[element],
            "" if pulley is None else layout.pulleys[pulley],
            (self.stamp_ns - zero_ns).astype(np.float64) * 1e-9,
            np.where(fine, self.tension[:, element], np.nan),
            np.where(fine, self.stddev[:, element], np.nan),
            self.reference[:, element],
            of_pulley(self.friction),
            of_pulley(self.slip_speed),
        )


def stacked(snapshots: Iterable[Snapshot]) -> Table:
    """The table of at least one snapshot."""
    return Table(*map(np.array, zip(*snapshots, strict=True)))


def indices_of(layout: Layout, chosen: str) -> tuple[int, int | None]:
    """Indices of an element and of the pulley at one of its ends, of which ``chosen`` is one.

    Args:
        layout: of the robot.
        chosen: ``element cable/i`` or ``pulley cable/k``.
    """
    kind, _, name = chosen.partition(" ")
    if kind == "pulley":
        pulley = layout.pulleys.index(name)
        return int(layout.element_before[pulley]), pulley
    element = layout.elements.index(name)
    for neighbour in (element, element - 1):  # the pulley after the element, else before it
        found = np.flatnonzero(layout.element_before == neighbour)
        if found.size and layout.pulleys[found[0]].rpartition("/")[0] == name.rpartition("/")[0]:
            return element, int(found[0])
    return element, None


def choices(layout: Layout) -> tuple[str, ...]:
    """Everything that can be plotted, as ``indices_of`` takes it."""
    return (
        *(f"element {name}" for name in layout.elements),
        *(f"pulley {name}" for name in layout.pulleys),
    )


class History:
    """The last snapshots."""

    def __init__(self, size: int = PICTURES) -> None:
        """Keep at most ``size``."""
        self._kept: deque[Snapshot] = deque(maxlen=size)

    def clear(self) -> None:
        """Forget everything."""
        self._kept.clear()

    def add(self, shown: Snapshot) -> None:
        """Append a snapshot; a stamp that goes back clears the others, an equal one is ignored."""
        if self._kept and shown.stamp_ns < self._kept[-1].stamp_ns:
            self.clear()
        if not self._kept or shown.stamp_ns > self._kept[-1].stamp_ns:
            self._kept.append(shown)

    def table(self) -> Table | None:
        """All snapshots in the order of time; None if there are none."""
        return stacked(self._kept) if self._kept else None
