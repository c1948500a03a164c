"""A prepared robot as two flat vectors, and named views of their parts.

``plan`` holds integers: the numbers of all parts and their connections.  ``numbers`` holds reals;
the members of an ensemble differ only in ``numbers`` and share one plan.  The compiled core reads
the same two vectors; ``plan_views`` and ``number_views`` return their named views in Python.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.records import RECORDS, Part, Rows, part, size_of, views
from cdrj_ros.robot.description import TABLE_INTERVALS

Indices = NDArray[np.int64]


class Sizes(NamedTuple):
    """Numbers of the parts of a robot; a plan begins with them."""

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


_SIZES: Final = len(Sizes._fields)


class Plan(NamedTuple):
    """Connections of a robot: views of ``plan``, in its order."""

    sizes: Sizes
    cables: Rows
    ends: Rows
    """Shape (2 cables,); cable c has its first end at 2 c and its last end at 2 c + 1."""
    pulleys: Rows
    terms: Rows
    frames: Rows
    nodes: Rows


class Numbers(NamedTuple):
    """Constants of a robot: views of ``numbers``, in its order."""

    cables: Rows
    ends: Rows
    """As in ``Plan``."""
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


@lru_cache
def _plan_parts(sizes: Sizes) -> tuple[Part, ...]:
    """The parts of a plan after its sizes, in the order of ``Plan``."""
    return (
        part(sizes.cables, record=RECORDS["CableTopology"]),
        part(2 * sizes.cables, record=RECORDS["EndTopology"]),
        part(sizes.pulleys, record=RECORDS["PulleyTopology"]),
        part(sizes.terms, record=RECORDS["TermTopology"]),
        part(sizes.frames, record=RECORDS["FrameTopology"]),
        part(sizes.nodes, record=RECORDS["NodeTopology"]),
    )


def plan_views(plan: Indices) -> Plan:
    """Named views of the parts of a plan."""
    sizes = Sizes(*plan[:_SIZES].tolist())
    return Plan(sizes, *views(plan, _plan_parts(sizes), _SIZES))


@lru_cache
def _number_parts(sizes: Sizes) -> tuple[Part, ...]:
    """The parts of the numbers, in the order of ``Numbers``."""
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
    )


def number_views(sizes: Sizes, numbers: Vector) -> Numbers:
    """Named views of the parts of the numbers.

    Args:
        sizes: of the robot.
        numbers: shape (numbers,); in Python also (robots, numbers), and the views then have the
            same first axis.
    """
    return Numbers(*views(numbers, _number_parts(sizes)))


def empty_robot(sizes: Sizes) -> tuple[Indices, Vector]:
    """Plan and numbers of a robot, all zero except for the sizes."""
    plan = np.zeros(_SIZES + size_of(_plan_parts(sizes)), dtype=np.int64)
    plan[:_SIZES] = sizes
    return plan, np.zeros(size_of(_number_parts(sizes)))
