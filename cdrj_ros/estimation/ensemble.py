"""Uncertainty of the estimate from an ensemble that varies every unknown quantity.

Each member has its own parameters (drawn from their covariance), its own reading errors (within
noise and resolution) and its own friction history, because the initial friction of every pulley
is unknown within its bound.  Members are stepped by the same ``advance`` as the estimate.  A pulley
that slips loses its friction history in every member, so the spread narrows without further rules.

At each sample, but at most every ``APART_NS``, one member in turn is updated.  The cost is that of
one more estimate or less, independent of the number of members, and the spread is complete after as
many updates as there are members: 64 ms at 1 kHz.
Friction hardly depends on rate, so a member can cover all samples since its last update in one
step.  See docs/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import ALL_SEEN, Sample, Samples
from cdrj_ros.estimation.discrepancy import unmodelled
from cdrj_ros.estimation.estimator import FLOAT, NEVER, Estimate, Estimates, State, as_plain, run
from cdrj_ros.estimation.member_kernels import (
    SOLVED,
    SPECIAL,
    UNFIT,
    WAITING,
    advance_with_members,
    begin_sample,
    follow_members,
)
from cdrj_ros.estimation.member_records import LAST, LAST_STAMP, PROGRESS, TURN, Members, Path
from cdrj_ros.estimation.member_spread import ANY
from cdrj_ros.estimation.member_steps import step_members
from cdrj_ros.estimation.members import (
    friction_shares,
    preload_differently,
    reading_errors,
    unseen_ways,
    wind_differently,
)
from cdrj_ros.estimation.parameter_draws import Draw, draw_numbers
from cdrj_ros.estimation.snapshot import Snapshot
from cdrj_ros.model.compiled import direct, ordinary
from cdrj_ros.model.packing import number_views
from cdrj_ros.model.prepared import Layout, Model, read_only
from cdrj_ros.robot.description import Uncertainty

_empty: Final = np.empty
_tuple: Final = tuple.__new__

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

MEMBERS: Final = 32
"""Members of the ensemble: the standard deviation is accurate to 1 / sqrt(2 * 32) = 12 %."""


def spread_columns(layout: Layout) -> NDArray[np.int64]:
    """Indices in the estimate of the quantities that have a standard deviation.

    In order: tensions of all elements, magnitudes of the force on all pulleys, efforts of all
    motors, efforts of all joints.
    """
    parts = (layout.tension, layout.magnitude, layout.motor_effort, layout.joint_effort)
    return np.concatenate([np.arange(part.start, part.stop) for part in parts]).astype(np.int64)


def _elements_of(layout: Layout) -> NDArray[np.int64]:
    """An element of each spread column's cable; -1 for efforts, to which all cables contribute."""
    cables = [name.rsplit("/", 1)[0] for name in layout.elements]
    elements = [cables.index(cable) for cable in cables]
    pulleys = [cables.index(name.rsplit("/", 1)[0]) for name in layout.pulleys]
    efforts = [int(ANY)] * (len(layout.motors) + len(layout.joints))
    return np.array(elements + pulleys + efforts, dtype=np.int64)


def _new_members(
    model: Model,
    columns: NDArray[np.int64],
    numbers: Table,
    seed: int,
    generator: np.random.Generator,
) -> Members:
    """Members before their first sample, with random friction histories and reading errors."""
    robot, members = model.robot, len(numbers)
    axes = len(robot.motors) + len(robot.joints)
    shares = [friction_shares(members, len(cable.pulleys), generator) for cable in robot.cables]
    spans = [(-np.inf, np.inf) for _ in robot.motors]
    spans += [(joint.lower, joint.upper) for joint in robot.joints]
    unsure = robot.uncertainty is not None and not robot.uncertainty.drums_hold
    return Members(
        numbers=read_only(numbers),
        states=np.zeros((members, model.state_size)),
        stamps=np.zeros(members, dtype=np.int64),
        shares=np.concatenate(shares, axis=1),
        forgetful=(np.arange(members) // 2 % 2 == 1) & unsure,
        reading_errors=reading_errors(robot, generator),
        progress=np.zeros(PROGRESS, dtype=np.int64),
        columns=columns,
        element_of=_elements_of(model.layout),
        deviation=np.zeros((members, columns.size)),
        variance=np.zeros(columns.size),
        unmodelled=unmodelled(model),
        intervals=np.zeros(axes, dtype=np.int64),
        ways=unseen_ways(members, axes, np.random.default_rng((seed, 1))),
        span=np.array(spans).T.copy(),
        angle=np.zeros(axes),
        new_angle=np.zeros(axes),
        old_angle=np.zeros(axes),
        unseen=np.zeros((4, axes)),
        estimate=np.zeros(model.layout.size),
        readings=np.empty(axes),
        out=np.empty(model.out_size),
    )


class Kernels(NamedTuple):
    """Entry points of the kernels for single samples."""

    begin: Any
    step_waiting: Any
    advance: Any


def find_kernels(plan: NDArray[np.int64], numbers: Vector, members: Members) -> Kernels:
    """Load the kernels for arrays of these types, or compile them."""
    vector = members.variance
    of_sample = (vector, vector, vector, 1, 1, True, True, vector)
    with_advance = (vector, members, vector, vector, 0.0, 1, True, True, vector, vector)
    return Kernels(
        direct(begin_sample, plan, members, *of_sample),
        direct(step_members, plan, members, 1, True, 0.0),
        direct(advance_with_members, plan, numbers, *with_advance),
    )


class Spread:
    """The ensemble of one robot; call ``update`` after every ``step``, with sample and estimate."""

    def __init__(
        self,
        model: Model,
        members: int = MEMBERS,
        seed: int = 0,
        preload_share: float = 0.0,
        known: Uncertainty | None = None,
        before: Spread | None = None,
    ) -> None:
        """Draw the members.

        Args:
            model: the prepared robot; its uncertainty and its sensors define what is unknown.
            members: number of members, even and at least 8.
            seed: seed of the draws; the same seed gives the same spread.
            preload_share: standard deviation of every preload in addition to the robot file's, as
                a fraction of the preload.
            known: standard deviations of the parameters; None: those of the robot.
            before: an ensemble of the same robot.  If only friction differs, its draws save time;
                the result is the same.
        """
        if members < 8 or members % 2:
            raise ValueError(f"members must be even and at least 8, got {members}")
        generator = np.random.default_rng(seed)
        self.model = model
        self.columns = spread_columns(model.layout)
        self._width = self.columns.size
        self.draw: Draw = draw_numbers(
            model, members, generator, known, before.draw if before else None
        )
        numbers = self.draw.numbers.copy()
        wind_differently(model, numbers, generator)
        if preload_share > 0.0:
            preload_differently(model, numbers, preload_share, generator)
        self.numbers = numbers
        self._drawn = numbers.copy()
        self._members = _new_members(model, self.columns, numbers, seed, generator)
        self.states, self.stamps = self._members.states, self._members.stamps
        self.deviation, self.variance = self._members.deviation, self._members.variance
        self.variance_is_old = False
        """Whether ``deviation`` has changed, so that ``renew_variance`` is to be called."""
        self._of_step: Any = None
        """What ``step`` reads, in one place."""
        own = self._members
        self._before_look = Snapshot(
            *(own.states, own.stamps, own.progress),
            *(own.deviation, own.variance, own.intervals, own.angle, own.unseen[LAST]),
        )
        """What ``look_ahead`` changes."""
        self.generator = generator
        self.reset()

    @property
    def started(self) -> bool:
        """Whether the members have had a sample since the last reset."""
        return bool(self._members.progress[TURN] > 0)

    def restore_preloads(self) -> None:
        """Discard the members' history, and what other sensors have taught of their preloads."""
        self.numbers[:] = self._drawn
        self.reset()

    def keep_preloads(self, other: Spread) -> None:
        """Take over what other sensors have taught of the preloads of another ensemble's members.

        Both are of the same robot, which may have different numbers.
        """
        mine, theirs, drawn = (
            number_views(self.model.sizes, numbers).segments["material"]  # type: ignore[call-overload]
            for numbers in (self.numbers, other.numbers, other._drawn)
        )
        mine *= theirs / drawn

    def reset(self) -> None:
        """Discard the members' history; the next sample starts them anew."""
        self._before_look.forget()
        self.states[:] = 0.0
        self._members.progress[:] = (0, -1, 0)
        self._members.intervals[:] = 0
        self._members.unseen[LAST] = 0.0
        self.deviation[:] = 0.0
        self.variance[:] = 0.0
        self._waiting = False
        """Whether one member has yet to be updated to the last sample."""
        self._hidden = False
        """Whether an axis had no reading at the last sample."""

    def memory(self) -> dict[str, NDArray[Any]]:
        """The ensemble's memory, which ``recall`` restores."""
        self.look_back()
        self.finish()
        return {
            "members": self.states,
            "member_stamps": self.stamps,
            "member_numbers": self.numbers,
            "progress": self._members.progress,
            "last_angle": self._members.angle,
            "intervals": self._members.intervals,
            "last_unseen": self._members.unseen[LAST],
            "deviation": self.deviation,
        }

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
        for name, values in own.items():
            values[:] = arrays[name]
        self.renew_variance()
        return True

    def renew_variance(self) -> None:
        """Compute the variances anew, after changes of ``deviation``."""
        self.variance_is_old = False
        np.add.reduce(self.deviation * self.deviation, axis=0, out=self.variance)
        self.variance /= len(self.deviation)

    def shift_clock(self, by_ns: int) -> None:
        """Shift the members' stamps by ``by_ns`` [ns]."""
        self.finish()
        self.stamps += by_ns
        progress = self._members.progress
        if progress[LAST_STAMP] >= 0:
            progress[LAST_STAMP] += by_ns

    def update(self, sample: Sample, estimate: Estimate) -> Vector:
        """Update the ensemble with the sample of a step and the resulting estimate.

        Returns:
            Standard deviations, in the order of ``spread_columns``.
        """
        return self.begin(sample, estimate, at_once=True)

    def step(
        self, state: State, sample: Sample, at_once: bool = True
    ) -> tuple[State, Estimate, Vector]:
        """``step`` and ``update``, or ``step`` and ``begin`` if not ``at_once``, in one call.

        Returns:
            The new state, the estimate and the standard deviations, bit-identical to theirs.

        Raises:
            ValueError: the angles are not those of this robot.
        """
        if self._waiting or self._before_look.taken:
            self._settle()
        stamp, motor_angle, joint_angle, unseen = sample[:4]
        before, whole, _ = state
        if self._of_step is None:
            self._of_step = (*self.model.parts, self._width, self._members, self._kernels.advance)
        plan, numbers, size, state_part, estimate_part, layout, width, members, advance = (
            self._of_step
        )
        hidden = False if unseen is ALL_SEEN else self._hide(unseen)
        out, stddev = _empty(size), _empty(width)
        dt = (stamp - before) * 1e-9 if before != NEVER else 0.0
        if not motor_angle.dtype is joint_angle.dtype is FLOAT:
            motor_angle, joint_angle = as_plain(motor_angle), as_plain(joint_angle)
        try:
            after = advance(
                plan, numbers, whole, members, motor_angle, joint_angle, dt, stamp, hidden,
                at_once, out, stddev,
            )  # fmt: skip
        except ValueError:
            motor_angle, joint_angle = as_plain(motor_angle), as_plain(joint_angle)
            after = advance(
                plan, numbers, whole, members, motor_angle, joint_angle, dt, stamp, hidden,
                at_once, out, stddev,
            )  # fmt: skip
        if after >= SPECIAL:
            after -= SPECIAL
            after += self._kernels.begin(
                plan, members, motor_angle, joint_angle, out[estimate_part], 1, stamp, hidden,
                at_once, stddev,
            )  # fmt: skip
        if after & WAITING:
            self._waiting, self._hidden = True, hidden
        return (
            _tuple(State, (stamp, out, state_part)),
            _tuple(Estimate, (stamp, out, layout, after >= SOLVED, estimate_part)),
            stddev,
        )

    def begin(self, sample: Sample, estimate: Estimate, at_once: bool = False) -> Vector:
        """The first half of ``update``: the standard deviations, before a member is updated.

        What is sent need not wait for a member, which changes the standard deviations by one part
        in as many as there are members.  ``finish`` can follow at any time before the next call;
        ``at_once`` includes it, and saves a call from Python.
        """
        self._settle()
        return self._begin(sample, estimate, 1, at_once)

    def look_ahead(self, sample: Sample, estimate: Estimate) -> Vector:
        """Standard deviations at a predicted sample, which the ensemble forgets again.

        Members are updated only where the prediction adds to their deviations.
        """
        if not self._before_look.taken:
            self.finish()
            self._before_look.take()
        stddev = self._begin(sample, estimate, 1, False)
        self._waiting = False
        return stddev

    def look_back(self) -> None:
        """Undo ``look_ahead``; without effect if nothing has been predicted."""
        self._before_look.restore()

    def finish(self) -> None:
        """The second half of ``update``; without effect if it has already been called."""
        if self._waiting:
            self._waiting = False
            self._kernels.step_waiting(self.model.plan, self._members, 1, self._hidden, 0.0)

    def catch_up(self, sample: Sample, estimate: Estimate) -> None:
        """Update all members to ``sample``, the last one given to ``update``."""
        self.finish()
        if not (self.stamps == sample.stamp_ns).all():
            self._begin(sample, estimate, len(self.states), False)

    def _settle(self) -> None:
        """Undo a prediction, and update the member that waits."""
        self.look_back()
        self.finish()

    def _hide(self, unseen: Vector) -> bool:
        """Note ``Sample.unseen`` for the kernels; False if everything was seen."""
        if len(unseen) == 0:
            return False
        self._members.unseen[:2] = unseen
        return True

    def _begin(self, sample: Sample, estimate: Estimate, least: int, at_once: bool) -> Vector:
        """Call ``begin_sample``, whatever the arrays of sample and estimate are."""
        stamp, motor_angle, joint_angle, unseen = sample[:4]
        hidden = self._hidden = self._hide(unseen)
        stddev = _empty(self._width)
        after = self._kernels.begin(
            self.model.plan, self._members, as_plain(motor_angle), as_plain(joint_angle),
            as_plain(estimate.values), least, stamp, hidden, at_once, stddev,
        )  # fmt: skip
        if after == UNFIT:
            raise ValueError("the sample or the estimate is of another robot")
        self._waiting = after == WAITING
        return stddev

    @cached_property
    def _kernels(self) -> Kernels:
        """The kernels; the members' arrays stay the same, so that types are known."""
        return find_kernels(self.model.plan, self.model.numbers, self._members)

    def run(self, state: State, samples: Samples) -> tuple[State, Estimates]:
        """Apply ``step`` to many samples in two calls; the results are bit-identical."""
        state, estimates = run(self.model, state, samples)
        return state, self.follow(samples, estimates)

    def follow(self, samples: Samples, estimates: Estimates) -> Estimates:
        """Apply ``update`` to many samples and their estimates; adds the standard deviations."""
        stddev = np.empty((samples.stamp_ns.size, self.columns.size))
        self.finish()
        path = Path(
            ordinary(samples.stamp_ns),
            ordinary(samples.motor_angle),
            ordinary(samples.joint_angle),
            ordinary(samples.unseen),
        )
        follow_members(self.model.plan, self._members, path, estimates.values, stddev)
        return replace(estimates, stddev=stddev)
