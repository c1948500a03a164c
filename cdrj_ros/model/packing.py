"""A prepared robot as two flat vectors, and named views of their parts.

``topology`` holds integers: how many parts there are, and their connections.  ``constants`` holds
reals; the members of an ensemble differ in them and share one topology.  The compiled core reads
the same two vectors; ``topology_views`` and ``constant_views`` return their named views.  The
core's headers describe all parts and records: ``layout.hpp``, ``robot_records.hpp`` and
``state_records.hpp``.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from functools import lru_cache
from math import prod
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.robot.description import TABLE_INTERVALS

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
    surfaces: int = 0
    """Pulleys whose contact cells are fixed to their surface; 0 but for the simulated rig."""
    residuals: int = 0
    """Outputs with a learned correction."""
    residual_inputs: int = 0
    """Of all of them."""
    residual_weights: int = 0


_SIZES: Final = len(Sizes._fields)


@lru_cache
def _topology_parts(sizes: Sizes) -> dict[str, Part]:
    """The parts of a topology after its sizes: ``Topology`` of the core."""
    return {
        "cables": part(sizes.cables, record="CableTopology"),
        "ends": part(2 * sizes.cables, record="EndTopology"),
        "pulleys": part(sizes.pulleys, record="PulleyTopology"),
        "terms": part(sizes.terms, record="TermTopology"),
        "frames": part(sizes.frames, record="FrameTopology"),
        "nodes": part(sizes.nodes, record="NodeTopology"),
        "residuals": part(sizes.residuals, record="ResidualTopology"),
        "residual_inputs": part(sizes.residual_inputs, record="ResidualInputTopology"),
    }


def topology_views(topology: Indices) -> Views:
    """Named views of the sizes and the parts of a topology."""
    sizes = Sizes(*topology[:_SIZES].tolist())
    return Views(sizes=sizes, **vars(views(topology, _topology_parts(sizes), _SIZES)))


@lru_cache
def _constant_parts(sizes: Sizes) -> dict[str, Part]:
    """The parts of the constants: ``Constants`` of the core."""
    return {
        "cables": part(sizes.cables, record="CableConstants"),
        "ends": part(2 * sizes.cables, record="EndConstants"),
        "pulleys": part(sizes.pulleys, record="PulleyConstants"),
        "elements": part(sizes.elements, record="ElementConstants"),
        "segments": part(sizes.contacts + sizes.cables, record="SegmentConstants"),
        "motors": part(sizes.motors, record="MotorConstants"),
        "joints": part(sizes.joints, record="JointConstants"),
        "axes": part(sizes.motors + sizes.joints, record="AxisConstants"),
        "tables": part(sizes.terms * TABLE_INTERVALS, record="Cubic"),
        "frames": part(sizes.frames, record="FrameConstants"),
        "nodes": part(sizes.nodes, record="NodeConstants"),
        "residuals": part(sizes.residuals, record="ResidualConstants"),
        "residual_ranges": part(sizes.residual_inputs, record="ResidualRange"),
        "residual_weights": part(sizes.residual_weights),
    }


def constant_views(sizes: Sizes, constants: Vector) -> Views:
    """Named views of the parts of the constants.

    Args:
        sizes: of the robot.
        constants: shape (constants,), or (robots, constants), and the views then have the
            same first axis.
    """
    return views(constants, _constant_parts(sizes))


def empty_robot(sizes: Sizes) -> tuple[Indices, Vector]:
    """Topology and constants of a robot, all zero except for the sizes."""
    topology = np.zeros(_SIZES + size_of(_topology_parts(sizes)), dtype=np.int64)
    topology[:_SIZES] = sizes
    return topology, np.zeros(size_of(_constant_parts(sizes)))


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
    """Record type of its rows, whose fields take 8 bytes each; None for plain numbers."""
    size: int
    """Words of 8 bytes."""


def part(*shape: int, record: str = "") -> Part:
    """A part of this shape, of plain numbers or of the records of a name."""
    rows = RECORDS[record] if record else None
    return Part(shape, rows, prod(shape) * (words(rows) if record else 1))


def size_of(parts: Mapping[str, Part]) -> int:
    """Words of 8 bytes of all parts."""
    return sum(part.size for part in parts.values())


def views(vector: NDArray[Any], parts: Mapping[str, Part], begin: int = 0) -> Views:
    """A view of every part.

    Args:
        vector: in which the parts lie from ``begin`` on, or a table with such a vector in every
            row; the views then have the same first axis.
        parts: by name, in their order.
        begin: where the first part begins.
    """
    found = Views()
    for name, part in parts.items():
        end = begin + part.size
        view = vector[..., begin:end]
        if part.record is not None:
            view = view.view(part.record)
        setattr(found, name, view if len(part.shape) == 1 else view.reshape(part.shape))
        begin = end
    return found
