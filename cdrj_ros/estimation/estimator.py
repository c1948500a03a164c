"""The estimator: ``step(model, state, sample) -> (state, estimate)``.

The node, the offline validation, the identification and the benchmark all call these functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample, Samples
from cdrj_ros.model.compiled import direct, ordinary
from cdrj_ros.model.mechanism import advance, advance_all
from cdrj_ros.model.prepared import Layout, Model, read_only

Vector = NDArray[np.float64]

NEVER: Final = -1
"""Stamp of a state before its first sample."""


_empty: Final = np.empty
_tuple: Final = tuple.__new__
FLOAT: Final = np.dtype(np.float64)
EVERYTHING: Final = slice(None)


class State(NamedTuple):
    """History-dependent state of the cables; opaque, never changed in place."""

    stamp_ns: int
    whole: Vector
    """The state, contiguous; from a step also all else that its kernel wrote, since two views of
    it would take a tenth of the time of a step."""
    place: slice = EVERYTHING
    """Of the state in ``whole``."""

    @property
    def values(self) -> Vector:
        """The state alone, shape (state_size,)."""
        return self.whole[self.place]


class Estimate(NamedTuple):
    """All estimated quantities at one time, as views of one vector."""

    stamp_ns: int
    whole: Vector
    """The estimate; from a step also all else that its kernel wrote, see ``State.whole``."""
    layout: Layout
    solved: bool
    """False where some element is ``INVALID``."""
    place: slice = EVERYTHING
    """Of the estimate in ``whole``."""

    @property
    def values(self) -> Vector:
        """All quantities in the order of ``layout``, shape (layout.size,)."""
        return self.whole[self.place]

    @property
    def tension(self) -> Vector:
        """Tension of every element [N], shape (elements,)."""
        return self.values[self.layout.tension]

    @property
    def status(self) -> Vector:
        """Status flags of every element, shape (elements,)."""
        return self.values[self.layout.status]

    @property
    def force_x(self) -> Vector:
        """Force on every pulley [N], shape (pulleys,)."""
        return self.values[self.layout.force_x]

    @property
    def force_y(self) -> Vector:
        """Force on every pulley [N], shape (pulleys,)."""
        return self.values[self.layout.force_y]

    @property
    def force_z(self) -> Vector:
        """Force on every pulley [N], shape (pulleys,); 0 for cables in a plane."""
        return self.values[self.layout.force_z]

    @property
    def nodal_force(self) -> Vector:
        """Magnitude of the force on every pulley [N], eq. (38), shape (pulleys,)."""
        return self.values[self.layout.magnitude]

    @property
    def friction(self) -> Vector:
        """Tension after minus tension before every pulley [N], shape (pulleys,)."""
        return self.values[self.layout.friction]

    @property
    def slip_speed(self) -> Vector:
        """Slip speed of the cable over every pulley [m/s], shape (pulleys,)."""
        return self.values[self.layout.slip_speed]

    @property
    def motor_effort(self) -> Vector:
        """Torque of the cables on every motor [N m], shape (motors,)."""
        return self.values[self.layout.motor_effort]

    @property
    def joint_effort(self) -> Vector:
        """Torque of the cables on every joint [N m], shape (joints,)."""
        return self.values[self.layout.joint_effort]


class Angles(NamedTuple):
    """Estimated angles of the joints without encoder over time."""

    names: tuple[str, ...]
    value: NDArray[np.float64]
    """[rad], of prismatic joints [m], shape (n, joints without encoder); NaN where unknown."""
    stddev: NDArray[np.float64]
    """Their standard deviations."""


@dataclass(frozen=True)
class Estimates:
    """All estimated quantities over time."""

    stamp_ns: NDArray[np.int64]
    """[ns], shape (n,)."""
    values: NDArray[np.float64]
    """Shape (n, layout.size)."""
    layout: Layout
    stddev: NDArray[np.float64] | None = None
    """Standard deviations of tensions, magnitudes of nodal forces, efforts of motors and of joints,
    shape (n, elements + pulleys + motors + joints); see ``cdrj_ros.estimation.ensemble``."""
    angles: Angles | None = None
    """Of the joints without encoder; None where every joint has one."""


def initial_state(model: Model) -> State:
    """The state before any sample; the first sample initialises it without friction."""
    return State(NEVER, np.zeros(model.state_size))


def as_plain(vector: Vector) -> Vector:
    """The array, or a copy, as a contiguous vector of floats: what entry points of kernels need."""
    return np.ascontiguousarray(vector, dtype=np.float64)


_entry: Final[list[Any]] = []
"""Entry point of ``advance``, from the first step on."""


def find_entry() -> None:
    """Load or compile ``advance``; the types of its arguments are the same for all robots."""
    plan, vector = np.empty(0, dtype=np.int64), np.empty(0)
    plan.flags.writeable = False
    _entry.append(direct(advance, plan, read_only(vector), *3 * (vector,), 0.0, vector))


def step(model: Model, state: State, sample: Sample) -> tuple[State, Estimate]:
    """Process one sample.

    Args:
        model: the prepared robot.
        state: from ``initial_state`` or the previous step.
        sample: later than the state; finite (see ``cdrj_ros.conditioning.time_line``).

    Returns:
        The new state and the estimate at the sample's stamp.

    Raises:
        ValueError: the angles are not those of this robot.
    """
    stamp, motor_angle, joint_angle, _, _, _, _ = sample
    before, whole, _ = state
    plan, numbers, size, state_part, estimate_part, layout = model.parts
    out = _empty(size)
    dt = (stamp - before) * 1e-9 if before != NEVER else 0.0
    if not _entry:
        find_entry()
    if not motor_angle.dtype is joint_angle.dtype is FLOAT:
        motor_angle, joint_angle = as_plain(motor_angle), as_plain(joint_angle)
    # a call without numba's dispatcher makes the step 5 % faster
    try:
        solved = _entry[0](plan, numbers, whole, motor_angle, joint_angle, dt, out)
    except ValueError:
        motor_angle, joint_angle = as_plain(motor_angle), as_plain(joint_angle)
        solved = _entry[0](plan, numbers, whole, motor_angle, joint_angle, dt, out)
    # the constructors of named tuples give the same result but take twice as long
    return (
        _tuple(State, (stamp, out, state_part)),
        _tuple(Estimate, (stamp, out, layout, solved, estimate_part)),
    )


def run(
    model: Model, state: State, samples: Samples, into: NDArray[np.float64] | None = None
) -> tuple[State, Estimates]:
    """Apply ``step`` to many samples in one call; the results are bit-identical.

    Args:
        model: the prepared robot.
        state: as for ``step``.
        samples: n samples.
        into: output array for the estimates, shape (n, layout.size); None: a new array.
    """
    stamps = samples.stamp_ns
    estimates = np.empty((stamps.size, model.layout.size)) if into is None else into
    if stamps.size == 0:
        return state, Estimates(stamps, estimates, model.layout)
    first = state.stamp_ns if state.stamp_ns != NEVER else int(stamps[0])
    dt = np.diff(stamps, prepend=np.int64(first)) * 1e-9
    values = state.values.copy()
    advance_all(
        model.plan,
        model.numbers,
        values,
        ordinary(samples.motor_angle),
        ordinary(samples.joint_angle),
        dt,
        estimates,
    )
    return State(int(stamps[-1]), values), Estimates(stamps, estimates, model.layout)
