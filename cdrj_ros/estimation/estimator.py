"""One estimator, many doors: ``step(model, state, sample) -> (state, estimate)``.

The node, the offline validation, the identification and the benchmark all call these functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample, Samples
from cdrj_ros.model.mechanism import advance, advance_all
from cdrj_ros.model.prepared import Layout, Model

Vector = NDArray[np.float64]

NEVER: Final = -1
"""Stamp of a state that has seen no sample."""


_empty: Final = np.empty
_tuple: Final = tuple.__new__


class State(NamedTuple):
    """What the past has left in the cables; opaque, never changed in place."""

    stamp_ns: int
    values: Vector


class Estimate(NamedTuple):
    """Everything that is estimated at one time; views of one vector."""

    stamp_ns: int
    values: Vector
    """Shape (layout.size,)."""
    layout: Layout
    solved: bool
    """False where some element is ``INVALID``."""

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
    def nodal_force(self) -> Vector:
        """Magnitude of the force on every pulley [N], eq. (38), shape (pulleys,)."""
        return self.values[self.layout.magnitude]

    @property
    def friction(self) -> Vector:
        """Tension after less tension before every pulley [N], shape (pulleys,)."""
        return self.values[self.layout.friction]

    @property
    def slip_speed(self) -> Vector:
        """Material passing every pulley [m/s], shape (pulleys,)."""
        return self.values[self.layout.slip_speed]

    @property
    def motor_effort(self) -> Vector:
        """Torque of the cables on every motor [N m], shape (motors,)."""
        return self.values[self.layout.motor_effort]

    @property
    def joint_effort(self) -> Vector:
        """Torque of the cables on every joint [N m], shape (joints,)."""
        return self.values[self.layout.joint_effort]


@dataclass(frozen=True)
class Estimates:
    """Everything that is estimated over time."""

    stamp_ns: NDArray[np.int64]
    """[ns], shape (n,)."""
    values: NDArray[np.float64]
    """Shape (n, layout.size)."""
    layout: Layout
    stddev: NDArray[np.float64] | None = None
    """Standard deviations of tensions, magnitudes of nodal forces, efforts of motors and of joints,
    shape (n, elements + pulleys + motors + joints); see ``cdrj_ros.estimation.ensemble``."""


def initial_state(model: Model) -> State:
    """A robot of which nothing has been seen: the first sample starts it without friction."""
    return State(NEVER, np.zeros(model.state_size))


def step(model: Model, state: State, sample: Sample) -> tuple[State, Estimate]:
    """Take one sample.

    Args:
        model: the prepared robot.
        state: from ``initial_state`` or the step before.
        sample: later than the state; finite (see ``cdrj_ros.conditioning.time_line``).

    Returns:
        The new state and the estimate at the sample's stamp.
    """
    stamp, motor_angle, joint_angle, _ = sample
    before, values = state
    out = _empty(model.out_size)
    dt = (stamp - before) * 1e-9 if before != NEVER else 0.0
    solved = advance(model.plan, model.numbers, values, motor_angle, joint_angle, dt, out)
    # the constructors of named tuples take twice as long and do the same
    return (
        _tuple(State, (stamp, out[model.state_part])),
        _tuple(Estimate, (stamp, out[model.estimate_part], model.layout, solved)),
    )


def run(
    model: Model, state: State, samples: Samples, into: NDArray[np.float64] | None = None
) -> tuple[State, Estimates]:
    """``step`` over many samples in one call; bit for bit the same numbers.

    Args:
        model: the prepared robot.
        state: as for ``step``.
        samples: n of them.
        into: where the estimates are to be written, shape (n, layout.size); None: a new array.
    """
    stamps = samples.stamp_ns
    estimates = np.empty((stamps.size, model.layout.size)) if into is None else into
    if stamps.size == 0:
        return state, Estimates(stamps, estimates, model.layout)
    first = state.stamp_ns if state.stamp_ns != NEVER else int(stamps[0])
    dt = np.diff(stamps, prepend=np.int64(first)) * 1e-9
    values = state.values.copy()
    advance_all(
        model.plan, model.numbers, values, samples.motor_angle, samples.joint_angle, dt, estimates
    )
    return State(int(stamps[-1]), values), Estimates(stamps, estimates, model.layout)
