"""Flat vectors of a prepared robot, its scratch and estimates, and names of their parts.

``topology`` holds integers: how many parts there are, and their connections.  ``constants`` holds
reals; the members of an ensemble differ in them and share one topology.  The compiled core reads
the same two vectors, and reads and writes states, scratch and estimates.  Its headers describe all
parts and records, and it lays them out: ``layout.hpp`` and ``robot_records.hpp``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache
from math import prod
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.robot.description import Robot

Indices = NDArray[np.int64]

Views = SimpleNamespace
"""Views by the names of parts; rows of records have their fields as attributes."""


class Sizes(NamedTuple):
    """How many parts a robot has; a topology begins with them."""

    motors: int
    joints: int
    cables: int
    elements: int
    pulleys: int
    contacts: int
    """Contact cells of all pulleys."""
    frames: int
    """0 for a robot without positions."""
    nodes: int
    """Of all cables; 0 for a robot without positions."""
    terms: int
    """Tabulated functions of a joint angle that are added to a span or a wrap."""
    drums: int
    """Ends of cables that take up cable: drums and sectors."""
    turns: int
    """Of drums by motors, several where several motors turn one drum."""
    surfaces: int = 0
    """Pulleys whose contact cells are fixed to their surface; 0 but for the simulated rig."""
    residuals: int = 0
    """Outputs with a learned correction."""
    residual_inputs: int = 0
    """Of all of them."""
    residual_weights: int = 0


_SIZES: Final = len(Sizes._fields)


class Part(NamedTuple):
    """One part of a flat array."""

    shape: tuple[int, ...]
    """Of its view: one number, or the sizes of a table."""
    record: Any
    """Type of its rows, whose fields take 8 bytes each; None for plain numbers."""
    size: int
    """Words of 8 bytes."""


@lru_cache
def parts_of(sizes: Sizes) -> dict[str, dict[str, Part]]:
    """Parts of ``topology`` after its sizes, ``constants``, ``state`` and ``scratch``, by name."""

    def part(shape: list[int], columns: list[tuple[str, str]]) -> Part:
        record = np.dtype((np.record, columns)) if columns else None
        return Part(tuple(shape), record, prod(shape) * (record.itemsize // 8 if record else 1))

    return {
        array: {name: part(shape, columns) for name, shape, columns in parts}
        for array, parts in _core.robot_parts(np.array(sizes)).items()
    }


def topology_views(topology: Indices) -> Views:
    """Named views of the sizes and the parts of a topology."""
    sizes = Sizes(*topology[:_SIZES].tolist())
    return Views(sizes=sizes, **vars(views(topology[_SIZES:], parts_of(sizes)["topology"])))


def constant_views(sizes: Sizes, constants: Vector) -> Views:
    """Named views of the parts of the constants.

    Args:
        sizes: of the robot.
        constants: shape (constants,), or (robots, constants), and the views then have the
            same first axis.
    """
    return views(constants, parts_of(sizes)["constants"])


def empty_robot(sizes: Sizes) -> tuple[Indices, Vector]:
    """Topology and constants of a robot, all zero except for the sizes."""
    words = {
        name: sum(part.size for part in parts.values()) for name, parts in parts_of(sizes).items()
    }
    topology = np.zeros(_SIZES + words["topology"], dtype=np.int64)
    topology[:_SIZES] = sizes
    return topology, np.zeros(words["constants"])


def code_of(kinds: type[Enum], word: str) -> int:
    """Code of a kind in a row, by its word in a robot file.

    Args:
        kinds: an enumeration of the core: ``Guide``, ``Law``, ``Stribeck`` or ``FrameMotion``.
        word: the name of a member.
    """
    return int(kinds[word].value)


def views(vector: NDArray[Any], parts: Mapping[str, Part]) -> Views:
    """A view of every part.

    Args:
        vector: of the parts, or a table with such a vector in every row; the views then have the
            same first axis.
        parts: by name, in their order.
    """
    found, begin = Views(), 0
    for name, part in parts.items():
        end = begin + part.size
        view = vector[..., begin:end]
        if part.record is not None:
            view = view.view(part.record)
        setattr(found, name, view if len(part.shape) == 1 else view.reshape(part.shape))
        begin = end
    return found


OK, SLACK, OVERLOAD, UNSURE, STALE, INVALID = 0, 1, 2, 4, 8, 16
"""Bit flags of an element's status; cdrj_msgs/CableTensions defines the same values."""


def scratch_views(sizes: Sizes, scratch: Vector) -> Views:
    """Named views of the parts of the scratch, shape (core.scratch_size,)."""
    return views(scratch, parts_of(sizes)["scratch"])


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
    return _by_channel(layout, vars(layout))


def stddev_places(layout: Layout) -> dict[str, int]:
    """Places of the same channels among the standard deviations."""
    return _by_channel(layout, layout.stddev)


def _by_channel(layout: Layout, parts: Mapping[str, slice]) -> dict[str, int]:
    """Place of every channel, whose parts are at these places."""
    channels = (
        ("tension", TENSION, layout.elements),
        ("magnitude", NODAL_FORCE, layout.pulleys),
        ("motor_effort", EFFORT, layout.motors),
        ("joint_effort", EFFORT, layout.joints),
    )
    return {
        f"{prefix}/{name}": parts[part].start + k
        for part, prefix, names in channels
        for k, name in enumerate(names)
    }
