"""All memory of an ensemble, and samples, as kernels take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

# Indices in the array of the members' progress.
TURN, LAST_STAMP, BEHIND, PROGRESS = range(4)

LAST, BETWEEN = 2, 3
"""Rows of ``Members.unseen``."""


class Members(NamedTuple):
    """All memory of an ensemble."""

    numbers: Table
    """Of the prepared robot of every member, shape (members, numbers); read-only."""
    states: Table
    """Shape (members, state_size)."""
    stamps: NDArray[np.int64]
    """Of every member's last update [ns], shape (members,)."""
    shares: Table
    """Initial friction as a share of its bound, shape (members, pulleys)."""
    forgetful: NDArray[np.bool_]
    """Whether the member's drums forget at which strain cable went on, shape (members,)."""
    reading_errors: Table
    """Rows of reading errors, used in turn [rad], shape (rows, axes)."""
    progress: NDArray[np.int64]
    """Updates so far, last stamp [ns], whether the last estimate was not solved: (PROGRESS,)."""
    columns: NDArray[np.int64]
    """Places in the estimate of the quantities that have a standard deviation."""
    element_of: NDArray[np.int64]
    """An element of each column's cable; -1 for efforts."""
    deviation: Table
    """Differences from the estimate, shape (members, columns)."""
    variance: Vector
    """Shape (columns,)."""
    unmodelled: Table
    """What no member shows, see ``cdrj_ros.estimation.discrepancy``, shape (2, columns)."""
    intervals: NDArray[np.int64]
    """Of every axis, see ``note_unseen``, shape (axes,)."""
    ways: NDArray[np.float64]
    """Shares of the deviation between readings, shape (ways, members, axes)."""
    span: Table
    """Ranges of all axes [rad], shape (2, axes)."""
    angle: Vector
    """Of all axes at the last sample [rad], shape (axes,)."""
    new_angle: Vector
    """The same of the sample that begins."""
    old_angle: Vector
    """The same of the sample before ``angle``."""
    unseen: Table
    """``Sample.unseen``, its first row at the sample before, and scratch, shape (4, axes).  One
    array, because each further one makes an update slower."""
    estimate: Vector
    """At the last sample at which a member was updated, shape (estimate_size,)."""
    readings: Vector
    """Scratch, shape (axes,)."""
    out: Vector
    """Scratch of ``advance``, shape (out_size,)."""


def no_members() -> Members:
    """Arrays of the right types without content, for which kernels can be compiled."""
    vector, table, counts = np.empty(0), np.empty((0, 0)), np.empty(0, dtype=np.int64)
    numbers, flags = np.empty((0, 0)), np.empty(0, dtype=np.bool_)
    numbers.flags.writeable = False
    return Members(
        numbers=numbers, states=table, stamps=counts, shares=table, forgetful=flags,
        reading_errors=table, progress=counts, columns=counts, element_of=counts, deviation=table,
        variance=vector, unmodelled=table, intervals=counts, ways=np.empty((0, 0, 0)), span=table,
        angle=vector, new_angle=vector, old_angle=vector, unseen=table, estimate=vector,
        readings=vector, out=vector,
    )  # fmt: skip


class Path(NamedTuple):
    """Samples as ``follow_members`` takes them; see ``cdrj_ros.conditioning.samples``."""

    stamp_ns: NDArray[np.int64]
    motor_angle: Table
    joint_angle: Table
    unseen: NDArray[np.float64]
