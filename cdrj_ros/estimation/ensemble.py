"""Uncertainty of the estimate from an ensemble that varies every unknown quantity.

Each member has its own parameters (drawn from their covariance), its own reading errors (within
noise and resolution) and its own friction history, because the initial friction of every pulley
is unknown within its bound.  Members are stepped by the same ``advance`` as the estimate.  A pulley
that slips loses its friction history in every member, so the spread narrows without further rules.

At each sample, but at most every ``APART_NS``, one member in turn is updated.  The cost is that of
one more estimate or less, independent of the number of members, and the spread is complete after as
many updates as there are members: 64 ms at 1 kHz.
Friction hardly depends on rate, so a member can cover all samples since its last update in one
step, or one to every point where an axis has turned.  See docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.estimation.draws import Draws, draw
from cdrj_ros.estimation.estimator import Estimate, Estimates, Sample, Samples, State
from cdrj_ros.estimation.model_error import (
    in_all_quantities,
    length_share,
    load_share,
    offset_gain,
    unmodelled,
)
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.packing import Layout
from cdrj_ros.model.prepared import Model, shape_at
from cdrj_ros.robot.description import Uncertainty

LAST_STAMP: Final = 1
"""Index of the last sample's stamp in the ensemble's progress; that of the last update follows."""

UNSURE_SHARE: Final = 0.1
"""An element is ``UNSURE`` if its standard deviation exceeds this fraction of its tension or of
its cable's preload, whichever is larger."""

NO_STDDEVS: Final = np.empty((0, 0))
"""Standard deviations that are not estimated."""

MEMBERS: Final = 32
"""Members of the ensemble: the standard deviation is accurate to 1 / sqrt(2 * 32) = 12 %."""


def stddev_columns(layout: Layout) -> NDArray[np.int64]:
    """Indices in the estimate of the quantities that have a standard deviation.

    Their order is that of ``Layout.stddev``.
    """
    parts = [getattr(layout, name) for name in layout.stddev]
    return np.concatenate([np.arange(part.start, part.stop) for part in parts]).astype(np.int64)


def new_members(model: Model, draws: Draws) -> _core.Ensemble:
    """Members before their first sample."""
    robot, members = model.robot, len(draws.constants)
    spans = [(-np.inf, np.inf) for _ in robot.motors]
    spans += [(joint.lower, joint.upper) for joint in robot.joints]
    doubted = robot.uncertainty.may_slip if robot.uncertainty else ()
    slips = [cable.name in doubted for cable in robot.cables]
    error = unmodelled(model)
    if robot.unmeasured:  # the lasting errors of the efforts contain it
        error[0] = 0.0
    return _core.Ensemble(
        model.core,
        **vars(draws),
        slipping=np.outer(np.arange(members) // 2 % 2 == 1, slips),
        offset_gain=offset_gain(model),
        length_share=length_share(model),
        load_share=load_share(model),
        span=np.array(spans).T.copy(),
        unmodelled=error,
    )


class Ensemble:
    """The ensemble of one robot.

    The reports of standard deviations are in the order of ``stddev_columns``.
    """

    def __init__(
        self,
        model: Model,
        members: int = MEMBERS,
        seed: int = 0,
        known: Uncertainty | None = None,
    ) -> None:
        """Draw the members, as ``draw`` does.

        Args:
            model: the prepared robot; its uncertainty and its sensors define what is unknown.
            members: number of members, even and at least 8.
            seed: seed of the draws; the same seed gives the same standard deviations.
            known: standard deviations of the parameters; None: those of the robot.

        Raises:
            ValueError: the number of members is odd or too small.
        """
        if members < 8 or members % 2:
            raise ValueError(f"members must be even and at least 8, got {members}")
        draws = draw(model, members, seed, known)
        self.model = model
        self.columns = stddev_columns(model.layout)
        self.core = new_members(model, draws)
        """The compiled ensemble, of whose memory the arrays below are views."""
        self.deviation = self.core.deviation
        """Differences from the estimate, shape (members, columns)."""
        self.variance = self.core.variance
        """Their mean squares (U1), shape (columns,)."""

    def reset(self) -> None:
        """Discard the members' history; the next sample starts them anew."""
        self.core.reset()

    def memory(self) -> dict[str, NDArray[Any]]:
        """The ensemble's memory, which ``recall`` restores."""
        self.core.roll_back()
        return self.core.memory()

    def recall(self, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Restore the arrays from ``memory``; False, with nothing changed, if they do not fit."""
        own = self.memory()
        for name, values in own.items():
            there = arrays.get(name)
            if there is None or there.shape != values.shape or there.dtype != values.dtype:
                return False
            infinite = values.dtype == np.float64 and ~np.isfinite(there)
            if np.any(infinite & np.isfinite(values)):  # limits that a robot lacks are infinite
                return False
        counts = (arrays["intervals"], arrays["progress"][:LAST_STAMP])
        states = arrays["members"]
        if any(np.any(one < 0) for one in counts) or not all(map(self.model.core.is_state, states)):
            return False
        for name, values in own.items():
            values[:] = arrays[name]
        self.core.renew_lasting()
        self.variance[:] = np.mean(self.deviation**2, axis=0)
        return True

    def show_at_least(self, changes: Vector) -> None:
        """Show no smaller standard deviations than those of changes of mean tensions, (U15).

        Args:
            changes: of all cables [N], shape (cables,).
        """
        robot = self.model.robot
        shape = shape_at(self.model, robot.reference_pose)
        least = in_all_quantities(self.model, shape, np.abs(robot.per_element(changes)))
        self.core.roll_back()  # or the next sample would forget it with what was predicted
        np.maximum(self.core.least_variance, least**2, out=self.core.least_variance)

    def shift_clock(self, by_ns: int) -> None:
        """Shift the members' stamps by ``by_ns`` [ns]."""
        self.core.stamps[:] += by_ns
        memory = self.core.memory()
        names = ("turn_stamps", "sudden_stamps")
        for stamps in (memory["progress"][LAST_STAMP:], *(memory[name] for name in names)):
            stamps[stamps >= 0] += by_ns

    def step(self, state: State, sample: Sample) -> tuple[State, Estimate]:
        """``estimator.step``, and an update of the members.

        Returns:
            The new state, and the estimate with standard deviations before the update of a single
            member, which changes them by one part in as many as there are members.

        Raises:
            ValueError: the angles are not those of this robot.
        """
        stamp, motor_angle, joint_angle, unseen, offset = sample[:5]
        after, values, solved, stddev = self.core.step(
            state, stamp, motor_angle, joint_angle, unseen, offset
        )
        return after, Estimate(stamp, values, self.model.layout, solved, stddev)

    def predict(self, sample: Sample, estimate: Estimate) -> Vector:
        """Standard deviations at a predicted sample, which the ensemble forgets again.

        Members are updated only where the prediction adds to their deviations.
        """
        return self.core.predict(*sample[:5], estimate.values)

    def follow(self, samples: Samples, estimates: Estimates) -> Estimates:
        """Update the members with many samples and their estimates; adds standard deviations."""
        stddev = np.empty((samples.stamp_ns.size, self.columns.size))
        self.core.follow(
            samples.stamp_ns,
            samples.motor_angle,
            samples.joint_angle,
            samples.unseen,
            samples.offset_rows,
            samples.offset,
            estimates.values,
            stddev,
        )
        return replace(estimates, stddev=stddev)
