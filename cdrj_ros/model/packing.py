"""Flat vectors of a prepared robot, its scratch and estimates, and names of their parts.

``topology`` holds integers: how many parts there are, and their connections.  ``constants`` holds
reals; the members of an ensemble differ in them and share one topology.  The compiled core reads
the same two vectors, and reads and writes states, scratch and estimates.  Its headers describe and
order all parts and records: ``layout.hpp`` and ``robot_records.hpp``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.robot.description import Robot

Indices = NDArray[np.int64]

Views = SimpleNamespace
"""Views by the names of parts; rows of records have their fields as attributes."""


RECORDS: Final[dict[str, Any]] = {
    name: np.dtype((np.record, columns)) for name, columns in _core.records().items()
}
"""Types of rows by the name of the record."""


def topology_views(topology: Indices) -> Views:
    """Named views of the parts of a topology; ``sizes`` are how many parts the robot has."""
    found = views("Topology", topology, topology)
    found.sizes = found.sizes[0]
    return found


def constant_views(topology: Indices, constants: Vector) -> Views:
    """Named views of the parts of the constants.

    Args:
        topology: of the robot.
        constants: shape (constants,), or (robots, constants), and the views then have the
            same first axis.
    """
    return views("Constants", topology, constants)


def scratch_views(topology: Indices, scratch: Vector) -> Views:
    """Named views of the parts of the scratch, shape (core.scratch_size,)."""
    return views("Workspace", topology, scratch)


def empty_robot(**sizes: int) -> tuple[Indices, Vector]:
    """Topology and constants of a robot, all zero except for the sizes: ``Sizes`` of the core."""
    head = np.zeros(1, RECORDS["Sizes"])
    for name, count in sizes.items():
        head[name] = count
    head = head.view(np.int64)
    topology = np.zeros(_size_of("Topology", head), dtype=np.int64)
    topology[: head.size] = head
    return topology, np.zeros(_size_of("Constants", head))


def code_of(kinds: type[Enum], word: str) -> int:
    """Code of a kind in a row, by its word in a robot file.

    Args:
        kinds: an enumeration of the core: ``Guide``, ``Law``, ``Stribeck`` or ``FrameMotion``.
        word: the name of a member.
    """
    return int(kinds[word].value)


def views(array: str, topology: Indices, vector: NDArray[Any]) -> Views:
    """A view of every part of an array of a robot.

    Args:
        array: ``Topology``, ``Constants``, ``State`` or ``Workspace``: a struct of ``layout.hpp``.
        topology: of the robot.
        vector: the array, or a table with one in every row; the views then have the same first
            axis.
    """
    found = Views()
    for name, (first, end, shape, record) in _core.array_parts(array, topology).items():
        view = vector[..., first:end]
        if record in RECORDS:
            view = view.view(RECORDS[record])
        if record == "Vector3":
            view = view.reshape(-1, 3)
        elif len(shape) > 1:
            view = view.reshape(shape)
        setattr(found, name, view)
    return found


def _size_of(array: str, topology: Indices) -> int:
    """Words of 8 bytes of an array of a robot."""
    return max(end for _, end, _, _ in _core.array_parts(array, topology).values())


OK, SLACK, OVERLOAD, UNSURE, STALE, INVALID = 0, 1, 2, 4, 8, 16
"""Bit flags of an element's status; cdrj_msgs/CableTensions defines the same values."""


TENSION: Final = "tension"
"""``tension/cable/element`` [N]."""

NODAL_FORCE: Final = "nodal_force"
"""``nodal_force/cable/node``, the magnitude [N]."""

EFFORT: Final = "effort"
"""``effort/motor`` or ``effort/joint`` [N m], [N] for a prismatic joint."""


@dataclass(frozen=True)
class Layout:
    """Slices of all results in the estimate, and the names of their entries."""

    elements: tuple[str, ...]
    """``cable/element``, the order of ``tension`` and ``status``."""
    pulleys: tuple[str, ...]
    """``cable/node``, the order of everything that belongs to pulleys."""
    base_link: str
    """Name in tf of the robot's base frame."""
    force_frame: str
    """Frame of forces: ``base_link``; empty where all forces are in the frames of their pulleys."""
    motors: tuple[str, ...]
    joints: tuple[str, ...]
    cables: tuple[str, ...]
    element_before: NDArray[np.intp] = field(compare=False, repr=False)
    """Index of the element before every pulley; the next index is the one after it.  Read-only."""
    size: int
    """Floats of one estimate."""
    stddev: Mapping[str, slice]
    """Places of the parts that have standard deviations among these, in their order."""
    tension: slice
    """[N]."""
    status: slice
    """Bit flags, see ``cdrj_ros.model.packing``."""
    force_x: slice
    """[N], of the cable on the pulley."""
    force_y: slice
    """[N]."""
    force_z: slice
    """[N]; 0 for cables in a plane."""
    magnitude: slice
    """[N], eq. (38)."""
    friction: slice
    """t_i - t_{i-1} [N]."""
    slip_speed: slice
    """[m/s], positive towards the last node."""
    motor_effort: slice
    """[N m]."""
    joint_effort: slice
    """[N m], of a prismatic joint [N]."""
    iterations: slice
    """Newton iterations of every cable."""
    residual: slice
    """Largest force imbalance at a pulley of every cable [N]."""
    correction: slice
    """Learned correction that is part of an output [N] or [N m]."""
    trust: slice
    """Share of it that applies."""

    @property
    def effort(self) -> slice:
        """Of all motors, then all joints."""
        return slice(self.motor_effort.start, self.joint_effort.stop)

    def in_frame(self, base_link: str) -> Layout:
        """The layout with another name of the base frame; empty: this one."""
        base = base_link or self.base_link
        return replace(self, base_link=base, force_frame=base if self.force_frame else "")

    def pulley_status(self, status: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Flags of pulleys, shape (..., pulleys): the union of those of both adjacent elements.

        Args:
            status: flags of the elements, shape (..., elements).
        """
        before = self.element_before
        return status[..., before] | status[..., before + 1]


def layout_of(robot: Robot, topology: Indices) -> Layout:
    """Layout of the estimates of a robot and its topology, whose parts the core lays out."""
    parts = _core.estimate_parts(topology)
    before = topology_views(topology).pulleys["element"].astype(np.intp)
    before.flags.writeable = False
    placed = any(cable.placed for cable in robot.cables)
    return Layout(
        tuple(name for cable in robot.cables for name in cable.element_names),
        tuple(name for cable in robot.cables for name in cable.pulley_names),
        robot.base_link,
        robot.base_link if placed else "",
        tuple(motor.name for motor in robot.motors),
        tuple(joint.name for joint in robot.joints),
        tuple(cable.name for cable in robot.cables),
        before,
        max(end for _, end, _ in parts.values()),
        {name: slice(at, at + end - first) for name, (first, end, at) in parts.items() if at >= 0},
        **{name: slice(first, end) for name, (first, end, _) in parts.items()},
    )


def channel_columns(layout: Layout) -> dict[str, int]:
    """Columns of tensions, nodal forces, motor and joint efforts in an estimate, by channel."""
    return {
        f"{prefix}/{name}": getattr(layout, part).start + k
        for part, prefix, names in _channels(layout)
        for k, name in enumerate(names)
    }


def stddev_places(layout: Layout) -> dict[str, int]:
    """Places of the same channels among the standard deviations."""
    return {
        f"{prefix}/{name}": layout.stddev[part].start + k
        for part, prefix, names in _channels(layout)
        for k, name in enumerate(names)
    }


def _channels(layout: Layout) -> tuple[tuple[str, str, tuple[str, ...]], ...]:
    """Parts of an estimate that are channels, with the prefix and the ends of their names."""
    return (
        ("tension", TENSION, layout.elements),
        ("magnitude", NODAL_FORCE, layout.pulleys),
        ("motor_effort", EFFORT, layout.motors),
        ("joint_effort", EFFORT, layout.joints),
    )
