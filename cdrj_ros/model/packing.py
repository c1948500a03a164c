"""A prepared robot as two flat vectors, and named views of their parts.

``topology`` holds integers: how many parts there are, and their connections.  ``constants`` holds
reals; the members of an ensemble differ in them and share one topology.  The compiled core reads
the same two vectors; ``topology_views`` and ``constant_views`` return their named views.  Rows
have the fields of the core's records, whose headers describe them: ``robot_records.hpp`` and
``state_records.hpp``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import Enum
from functools import lru_cache
from math import prod
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.robot.description import TABLE_INTERVALS

Indices = NDArray[np.int64]


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
    surfaces: int = 0
    """Pulleys whose contact cells are fixed to their surface; 0 but for the simulated rig."""
    residuals: int = 0
    """Outputs with a learned correction."""
    residual_inputs: int = 0
    """Of all of them."""
    residual_weights: int = 0


_SIZES: Final = len(Sizes._fields)


class Topology(NamedTuple):
    """Connections of a robot: views of ``topology``, in its order."""

    sizes: Sizes
    cables: Rows
    ends: Rows
    """Shape (2 cables,); cable c has its first end at 2 c and its last end at 2 c + 1."""
    pulleys: Rows
    terms: Rows
    frames: Rows
    nodes: Rows
    residuals: Rows
    residual_inputs: Rows


class Constants(NamedTuple):
    """Constants of a robot: views of ``constants``, in its order."""

    cables: Rows
    ends: Rows
    """As in ``Topology``."""
    pulleys: Rows
    elements: Rows
    segments: Rows
    motors: Rows
    joints: Rows
    axes: Rows
    """All motors, then all joints."""
    tables: Rows
    """``TABLE_INTERVALS`` cubics for every term, shape (terms * TABLE_INTERVALS,)."""
    frames: Rows
    nodes: Rows
    residuals: Rows
    residual_ranges: Rows
    """Of ``Topology.residual_inputs``."""
    residual_weights: Vector


@lru_cache
def _topology_parts(sizes: Sizes) -> tuple[Part, ...]:
    """The parts of a topology after its sizes, in the order of ``Topology``."""
    return (
        part(sizes.cables, record=RECORDS["CableTopology"]),
        part(2 * sizes.cables, record=RECORDS["EndTopology"]),
        part(sizes.pulleys, record=RECORDS["PulleyTopology"]),
        part(sizes.terms, record=RECORDS["TermTopology"]),
        part(sizes.frames, record=RECORDS["FrameTopology"]),
        part(sizes.nodes, record=RECORDS["NodeTopology"]),
        part(sizes.residuals, record=RECORDS["ResidualTopology"]),
        part(sizes.residual_inputs, record=RECORDS["ResidualInputTopology"]),
    )


def topology_views(topology: Indices) -> Topology:
    """Named views of the parts of a topology."""
    sizes = Sizes(*topology[:_SIZES].tolist())
    return Topology(sizes, *views(topology, _topology_parts(sizes), _SIZES))


@lru_cache
def _constant_parts(sizes: Sizes) -> tuple[Part, ...]:
    """The parts of the constants, in the order of ``Constants``."""
    return (
        part(sizes.cables, record=RECORDS["CableConstants"]),
        part(2 * sizes.cables, record=RECORDS["EndConstants"]),
        part(sizes.pulleys, record=RECORDS["PulleyConstants"]),
        part(sizes.elements, record=RECORDS["ElementConstants"]),
        part(sizes.contacts + sizes.cables, record=RECORDS["SegmentConstants"]),
        part(sizes.motors, record=RECORDS["MotorConstants"]),
        part(sizes.joints, record=RECORDS["JointConstants"]),
        part(sizes.motors + sizes.joints, record=RECORDS["AxisConstants"]),
        part(sizes.terms * TABLE_INTERVALS, record=RECORDS["Cubic"]),
        part(sizes.frames, record=RECORDS["FrameConstants"]),
        part(sizes.nodes, record=RECORDS["NodeConstants"]),
        part(sizes.residuals, record=RECORDS["ResidualConstants"]),
        part(sizes.residual_inputs, record=RECORDS["ResidualRange"]),
        part(sizes.residual_weights),
    )


def constant_views(sizes: Sizes, constants: Vector) -> Constants:
    """Named views of the parts of the constants.

    Args:
        sizes: of the robot.
        constants: shape (constants,), or (robots, constants), and the views then have the
            same first axis.
    """
    return Constants(*views(constants, _constant_parts(sizes)))


def empty_robot(sizes: Sizes) -> tuple[Indices, Vector]:
    """Topology and constants of a robot, all zero except for the sizes."""
    topology = np.zeros(_SIZES + size_of(_topology_parts(sizes)), dtype=np.int64)
    topology[:_SIZES] = sizes
    return topology, np.zeros(size_of(_constant_parts(sizes)))


Rows = Any
"""A structured array, whose rows have the fields of a record as attributes."""


RECORDS: Final[dict[str, Any]] = {
    name: np.dtype((np.record, columns)) for name, columns in _core.RECORDS.items()
}
"""Types of rows by the name of the record."""


def code_of(kinds: type[Enum], word: str) -> int:
    """Code of a kind in a row, by its word in a robot file.

    Args:
        kinds: an enumeration of the core: ``Guide``, ``Law``, ``Stribeck`` or ``FrameMotion``.
        word: the name of a member.
    """
    return int(kinds[word].value)


def words(record: Any) -> int:
    """Number of 8-byte words in a row."""
    return int(record.itemsize) // 8


class Part(NamedTuple):
    """One part of a vector."""

    shape: tuple[int, ...]
    """Of its view: one number, or the sizes of a table."""
    record: Any
    """Record type of its rows, whose fields take 8 bytes each; None for plain constants."""
    size: int
    """Words of 8 bytes."""


def part(*shape: int, record: Any = None) -> Part:
    """A part of this shape."""
    return Part(shape, record, prod(shape) * (1 if record is None else words(record)))


def size_of(parts: Sequence[Part]) -> int:
    """Words of 8 bytes of all parts."""
    return sum(part.size for part in parts)


def views(vector: NDArray[Any], parts: Sequence[Part], begin: int = 0) -> Iterator[Any]:
    """A view of every part.

    Args:
        vector: in which the parts lie from ``begin`` on, or a table with such a vector in every
            row; the views then have the same first axis.
        parts: in their order.
        begin: where the first part begins.
    """
    for part in parts:
        end = begin + part.size
        view = vector[..., begin:end]
        if part.record is not None:
            view = view.view(part.record)
        yield view if len(part.shape) == 1 else view.reshape(part.shape)
        begin = end
