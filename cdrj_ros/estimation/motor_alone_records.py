"""What the kernels of joints without encoder share: numbers, memory, readings, and what comes next.

The method is described in ``cdrj_ros.estimation.motor_alone``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import stage
from cdrj_ros.model.views import part, table

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

# Indices in ``Alone.progress``.
TURN, LAST_STAMP, PROGRESS = range(3)

# Indices in ``Unmeasured.agenda``: the phase of a solution, whether it needs derivatives and how
# many evaluations it has for them, Gauss-Newton steps so far, joint, place and round of a search,
# whether a search has just ended, whether all evaluations were solved.
PHASE, SLOPES, SHIFT, STEPS, JOINT, PLACE, ROUND, SEARCHED, SOLVED, AGENDA = range(10)

# Phases, each of which ends with an evaluation.
DONE, FOLLOW, PREDICT, CORRECT, FINAL, SEARCH = range(6)


class Unmeasured(NamedTuple):
    """The joints without encoder, u of them, what is known of them, and scratch."""

    joints: NDArray[np.int64]
    """Their indices, shape (u,)."""
    measured: NDArray[np.int64]
    """Indices of the other joints."""
    lower: Vector
    """Ends of their ranges [rad] or [m], shape (u,)."""
    upper: Vector
    start: Vector
    """Angles from which the first search begins, shape (u,)."""
    step: Vector
    """Difference by which derivatives are taken, shape (u,)."""
    wander: Vector
    """Variance per second of a joint's departure from the motion of its cables, shape (u,)."""
    load_drift: Vector
    """Variance per second of the load; 0 where nothing is known of it, shape (u,)."""
    noise: Vector
    """Standard deviation of measured efforts [N m], shape (motors,)."""
    angle: Vector
    """Scratch: angles of all joints, shape (joints,)."""
    effort: Vector
    """Scratch: efforts of the motors, shape (motors,), and their derivatives."""
    by_effort: Table
    load: Vector
    """Scratch: efforts of the joints without encoder, shape (u,), and their derivatives."""
    by_load: Table
    target: Vector
    """Scratch: predicted angles, shape (u,)."""
    right: Vector
    matrix: Table
    inverse: Table
    information: Table
    """Scratch, shape (u, u)."""
    best: Vector
    """Scratch of a search: angle before it, best angle and its misfit, shape (3,)."""
    agenda: NDArray[np.int64]
    """What a solution does next, shape (AGENDA,)."""
    out: Vector
    """Scratch of ``advance``."""


class Alone(NamedTuple):
    """All memory of the estimate (row 0) and of the members of its ensemble (the other rows)."""

    numbers: Table
    """Of the prepared robots, shape (rows, numbers); read-only."""
    states: Table
    """Shape (rows, state_size)."""
    memories: Table
    """See ``Memory``, shape (rows, 2 + 2 u + u^2)."""
    stamps: NDArray[np.int64]
    """Of the last updates [ns], shape (rows,)."""
    shares: Table
    """Initial friction as a share of its bound, shape (rows, pulleys)."""
    effort_errors: Table
    """Lasting errors of the efforts [N m], shape (rows, motors)."""
    reading_errors: Table
    """Rows of reading errors of motors and measured joints, used in turn [rad]."""
    progress: NDArray[np.int64]
    """Updates of members so far, and the last stamp [ns]."""
    columns: NDArray[np.int64]
    """Places in the estimate of the quantities that have a standard deviation."""
    deviation: Table
    """Differences of the members from the estimate: of those quantities, then of the angles."""
    variance: Vector
    unmodelled: Table
    """See ``cdrj_ros.estimation.discrepancy``, shape (2, columns); row 0 is zero, because the
    members' lasting errors of the efforts contain the model's error."""
    motor_angle: Vector
    """Scratch, shape (motors,)."""
    measured_angle: Vector
    """Scratch, shape (measured joints,)."""
    motor_effort: Vector
    """Scratch, shape (motors,)."""
    shifted: Vector
    """Scratch: the angle that is shifted, shape (1,)."""
    joints: Unmeasured


def no_rows() -> Alone:
    """Arrays of the right types without content, for which kernels can be compiled."""
    vector, table, counts = np.empty(0), np.empty((0, 0)), np.empty(0, dtype=np.int64)
    numbers = np.empty((0, 0))
    numbers.flags.writeable = False
    joints = Unmeasured(
        joints=counts, measured=counts, lower=vector, upper=vector, start=vector, step=vector,
        wander=vector, load_drift=vector, noise=vector, angle=vector, effort=vector,
        by_effort=table, load=vector, by_load=table, target=vector, right=vector, matrix=table,
        inverse=table, information=table, best=vector, agenda=counts, out=vector,
    )  # fmt: skip
    return Alone(
        numbers=numbers, states=table, memories=table, stamps=counts, shares=table,
        effort_errors=table, reading_errors=table, progress=counts, columns=counts,
        deviation=table, variance=vector, unmodelled=table, motor_angle=vector,
        measured_angle=vector, motor_effort=vector, shifted=vector, joints=joints,
    )  # fmt: skip


class Memory(NamedTuple):
    """What a solution remembers beside the robot's state: views of one row."""

    started: Vector
    """0 before the first sample, then 1, shape (1,)."""
    lost: Vector
    """Time since which the effort has not been explained [s], shape (1,)."""
    angle: Vector
    """Shape (u,)."""
    load: Vector
    """Shape (u,)."""
    covariance: Table
    """Of the angles, shape (u, u)."""


class Reading(NamedTuple):
    """Readings of one sample."""

    motor_angle: Vector
    measured_angle: Vector
    """Of the joints that have an encoder."""
    effort: Vector
    """NaN where none was heard [N m], shape (motors,)."""
    dt: float
    """Time since the last update [s]."""


class Recorded(NamedTuple):
    """Samples, and where their results are written."""

    stamp_ns: NDArray[np.int64]
    motor_angle: Table
    measured_angle: Table
    effort: Table
    """NaN where none was heard [N m], shape (n, motors)."""
    estimates: Table
    """Shape (n, estimate_size)."""
    stddevs: Table
    """Shape (n, columns)."""
    angles: Table
    """Of the joints without encoder, shape (n, u)."""
    angle_stddevs: Table
    """Shape (n, u)."""


@stage
def memory_of(row: Vector, count: int) -> Memory:
    """Views of a row of ``Alone.memories``."""
    return Memory(
        part(row, 0, 1),
        part(row, 1, 2),
        part(row, 2, 2 + count),
        part(row, 2 + count, 2 + 2 * count),
        table(row, 2 + 2 * count, count, count),
    )


@stage
def next_phase(joints: Unmeasured, phase: int, slopes: bool) -> None:
    """The next phase, and whether it needs derivatives."""
    joints.agenda[PHASE] = phase
    joints.agenda[SLOPES] = 1 if slopes else 0
    joints.agenda[SHIFT] = 0
