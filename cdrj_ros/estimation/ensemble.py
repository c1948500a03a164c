"""How sure the estimate is: an ensemble of estimators that differ in everything that is not known.

Every member has its own parameters, drawn from their covariance, its own readings, within noise
and resolution, and its own friction history, since at the start nobody knows on which side of its
bound a pulley's friction lies.  Members go through the same ``advance`` as the estimate, so what
pulleys forget when they slip, members forget too, and the spread narrows by itself.

At each sample one member in turn is brought up to date: the cost is that of one more estimate,
whatever the number of members, and the spread is complete after as many samples.  Friction hardly
depends on rate, so a member may take all the samples since its last turn in one step.
docs/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample, Samples
from cdrj_ros.estimation.estimator import NEVER, Estimate, Estimates, State
from cdrj_ros.estimation.members import (
    draw_members,
    friction_shares,
    preload_differently,
    reading_errors,
    unseen_ways,
    wind_differently,
)
from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.friction_history import impose_friction
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.packing import plan_views
from cdrj_ros.model.prepared import Layout, Model, prepare, read_only
from cdrj_ros.model.state import state_views
from cdrj_ros.model.status import INVALID, UNSURE

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

# What the members have come to.
TURN, LAST_STAMP, BEHIND, PROGRESS = range(4)

MEMBERS: Final = 32
"""Members of the ensemble: the standard deviation is known to 1 / sqrt(2 * 32) = 12 %."""

MOVED: Final = 0.01
"""An axis that has moved further than this in a gap has an unknown history [rad]."""

UNSEEN_NS: Final = 1_000_000_000
"""A longer time between two samples is a gap [ns]."""

ROUND_NS: Final = 4_000_000
"""Time in which all members are brought up to date while an axis is not seen [ns]."""


# A literal in a call has a type of its own, for which numba compiles the callee once more.
ONE: Final[Any] = np.int64(1)
ANY: Final[Any] = np.int64(-1)


def spread_columns(layout: Layout) -> NDArray[np.int64]:
    """Where the quantities with a standard deviation lie in the estimate.

    Tensions of all elements, magnitudes of the force on all pulleys, efforts of all motors, then
    of all joints.
    """
    parts = (layout.tension, layout.magnitude, layout.motor_effort, layout.joint_effort)
    return np.concatenate([np.arange(part.start, part.stop) for part in parts]).astype(np.int64)


@compiled
def _advance_member(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    share: Vector,
    motor_angle: Vector,
    joint_angle: Vector,
    dt: float,
    estimate_size: int,
    out: Vector,
) -> bool:
    """Bring one member up to date, or start it with its friction history; False: not solved.

    Takes 9 arguments because it passes the 7 of ``advance`` on.
    """
    size, sizes = state.size, plan_views(plan).sizes
    if state_views(sizes, state).started[0] == 0.0:
        advance(plan, numbers, state, motor_angle, joint_angle, 0.0, out)
        if state_views(sizes, out).started[0] == 0.0:  # no such pose
            return False
        state[:] = out[:size]
        impose_friction(plan, numbers, share, state, out[size + estimate_size :])
        dt = 0.0
    solved = advance(plan, numbers, state, motor_angle, joint_angle, dt, out)
    state[:] = out[:size]
    return solved


def _elements_of(layout: Layout) -> NDArray[np.int64]:
    """Of every spread column an element of its cable; -1 for efforts, which all cables make."""
    cables = [name.rsplit("/", 1)[0] for name in layout.elements]
    elements = [cables.index(cable) for cable in cables]
    pulleys = [cables.index(name.rsplit("/", 1)[0]) for name in layout.pulleys]
    efforts = [int(ANY)] * (len(layout.motors) + len(layout.joints))
    return np.array(elements + pulleys + efforts, dtype=np.int64)


@compiled
def _is_invalid(estimate: Vector, elements: int, element: int) -> bool:
    """Whether an estimate says nothing of an element, or of some element for ``ANY``."""
    if element >= 0:
        return int(estimate[elements + element]) & INVALID != 0
    flags = 0
    for e in range(elements):
        flags |= int(estimate[elements + e])
    return flags & INVALID != 0


@compiled
def _was_unseen(
    last_stamp: int, stamp: int, last_angle: Vector, motor_angle: Vector, joint_angle: Vector
) -> bool:
    """Whether an axis has moved in a gap before this sample."""
    if last_stamp < 0 or stamp - last_stamp <= UNSEEN_NS:
        return False
    motors = motor_angle.size
    for m in range(motors):
        if abs(motor_angle[m] - last_angle[m]) > MOVED:
            return True
    for j in range(joint_angle.size):
        if abs(joint_angle[j] - last_angle[motors + j]) > MOVED:
            return True
    return False


@compiled
def _is_on_the_way(unseen: Table) -> bool:
    """Whether an axis may have been elsewhere between the sample before and this one."""
    return unseen.shape[0] > 0 and bool(np.any(unseen[1] > 0.0))


@compiled
def _note_unseen(unseen: Table, intervals: NDArray[np.int64]) -> bool:
    """Count every axis's intervals without readings; whether one is not seen now.

    Twice the number of intervals, and one more during one of them.
    """
    hidden = False
    for a in range(intervals.size):
        if unseen.shape[0] and unseen[0, a] > 0.0:
            intervals[a] |= 1
            hidden = True
        else:
            intervals[a] += intervals[a] & 1
            if unseen.shape[0] and unseen[1, a] > 0.0:
                intervals[a] += 2
    return hidden


@compiled
def _deviate(
    readings: Vector,
    deviation: Vector,
    ways: NDArray[np.float64],
    intervals: NDArray[np.int64],
    member: int,
    span: Table,
) -> None:
    """Move a member's readings by its share of what has not been seen, within the axes' ranges.

    A member keeps its sense and size over a whole interval between readings: its way is a smooth
    one, and what slips on it slips.
    """
    for a in range(readings.size):
        if deviation[a] > 0.0:
            way = ways[(intervals[a] >> 1) % ways.shape[0], member, a]
            moved = readings[a] + deviation[a] * way
            low, high = min(span[0, a], readings[a]), max(span[1, a], readings[a])
            readings[a] = min(max(moved, low), high)


@compiled
def _take_deviation(
    columns: NDArray[np.int64],
    element_of: NDArray[np.int64],
    elements: int,
    all_solved: bool,
    estimate: Vector,
    own: Vector,
    deviation: Table,
    variance: Vector,
    member: int,
) -> None:
    """Take over a member's difference from the estimate, and its part in the variance (U1).

    What was not solved in either keeps its last difference.  Takes 9 arguments because kernels
    take arrays and numbers, not objects.
    """
    members = deviation.shape[0]
    for c in range(columns.size):
        if not all_solved and (
            _is_invalid(estimate, elements, element_of[c])
            or _is_invalid(own, elements, element_of[c])
        ):
            continue
        d = own[columns[c]] - estimate[columns[c]]
        variance[c] += (d * d - deviation[member, c] * deviation[member, c]) / members
        deviation[member, c] = d
    if member == members - 1:  # rounding does not add up
        for c in range(columns.size):
            total = 0.0
            for i in range(members):
                total += deviation[i, c] * deviation[i, c]
            variance[c] = total / members


@compiled
def update_members(
    plan: NDArray[np.int64],
    numbers: Table,
    states: Table,
    stamps: NDArray[np.int64],
    shares: Table,
    reading_errors: Table,
    progress: NDArray[np.int64],
    count: int,
    columns: NDArray[np.int64],
    element_of: NDArray[np.int64],
    elements: int,
    stamp: int,
    motor_angle: Vector,
    joint_angle: Vector,
    unseen: Table,
    estimate: Vector,
    deviation: Table,
    variance: Vector,
    last_angle: Vector,
    intervals: NDArray[np.int64],
    ways: NDArray[np.float64],
    span: Table,
    readings: Vector,
    out: Vector,
    stddev: Vector,
) -> None:
    """Bring the next ``count`` members up to date and write the standard deviations.

    All members where they have seen nothing yet, where an axis moved during a gap (their
    histories start anew then), after samples of which something was not solved, and where an axis
    may have been elsewhere since the sample before: each member then comes a way of its own, (U3).

    Takes 25 arguments because kernels take arrays and numbers, not objects, and members share
    all of the memory of ``Spread``.  Longer than a screen because its arguments take half of one.
    """
    members, size = states.shape
    motors, joints = motor_angle.size, joint_angle.size
    if _was_unseen(progress[LAST_STAMP], stamp, last_angle, motor_angle, joint_angle):
        states[:] = 0.0
        deviation[:] = 0.0
        variance[:] = 0.0
        progress[TURN] = 0
        intervals[:] = 0
    last_stamp = progress[LAST_STAMP]
    new = stamp != last_stamp
    on_the_way = new and progress[TURN] > 0 and _is_on_the_way(unseen)
    if new and _note_unseen(unseen, intervals) and progress[TURN] > 0:
        passed = (stamp - last_stamp) / ROUND_NS
        count = max(count, min(members, ceil(members * passed)))
    sizes = plan_views(plan).sizes
    middle_angle = 0.5 * last_angle
    half = 0.0
    if on_the_way:
        count = members
        middle_angle[:motors] += 0.5 * motor_angle
        middle_angle[motors:] += 0.5 * joint_angle
        half = (stamp - last_stamp) * 0.5e-9
    progress[LAST_STAMP] = stamp
    last_angle[:motors] = motor_angle
    last_angle[motors:] = joint_angle
    unsolved = _is_invalid(estimate, elements, ANY)
    if progress[TURN] == 0 or (progress[BEHIND] and not unsolved):
        count = members
    progress[BEHIND] = unsolved
    for _ in range(count):
        k = progress[TURN] % members
        errors = reading_errors[progress[TURN] % reading_errors.shape[0]]
        progress[TURN] += 1
        dt = (stamp - stamps[k]) * 1e-9
        started = state_views(sizes, states[k]).started[0] != 0.0
        if on_the_way and started:
            for a in range(readings.size):
                readings[a] = middle_angle[a] + errors[a]
            _deviate(readings, unseen[1], ways, intervals, k, span)
            _advance_member(
                plan, numbers[k], states[k], shares[k], readings[:motors], readings[motors:],
                dt - half, estimate.size, out,
            )  # fmt: skip
            dt = half
        for m in range(motors):
            readings[m] = motor_angle[m] + errors[m]
        for j in range(joints):
            readings[motors + j] = joint_angle[j] + errors[motors + j]
        if unseen.shape[0]:
            _deviate(readings, unseen[0], ways, intervals, k, span)
        solved = _advance_member(
            plan, numbers[k], states[k], shares[k], readings[:motors], readings[motors:],
            dt, estimate.size, out,
        )  # fmt: skip
        stamps[k] = stamp
        own = out[size : size + estimate.size]
        _take_deviation(
            columns, element_of, elements, solved and not unsolved, estimate, own, deviation,
            variance, k,
        )  # fmt: skip
    for c in range(columns.size):
        stddev[c] = sqrt(max(variance[c], 0.0))


@compiled
def _run(
    plan: NDArray[np.int64],
    nominal: Vector,
    state: Vector,
    numbers: Table,
    states: Table,
    stamps: NDArray[np.int64],
    shares: Table,
    reading_errors: Table,
    progress: NDArray[np.int64],
    columns: NDArray[np.int64],
    element_of: NDArray[np.int64],
    elements: int,
    sample_stamps: NDArray[np.int64],
    motor_angles: Table,
    joint_angles: Table,
    unseen: NDArray[np.float64],
    dt: Vector,
    deviation: Table,
    variance: Vector,
    last_angle: Vector,
    intervals: NDArray[np.int64],
    ways: NDArray[np.float64],
    span: Table,
    readings: Vector,
    out: Vector,
    estimates: Table,
    stddevs: Table,
) -> None:
    """``advance`` and ``update_members`` over many samples, the very same functions.

    Takes 27 arguments because it passes those of ``update_members`` on.
    """
    size = state.size
    wanted = estimates.shape[1]
    seen = np.empty((0, 0))
    for k in range(dt.size):
        advance(plan, nominal, state, motor_angles[k], joint_angles[k], dt[k], out)
        state[:] = out[:size]
        estimates[k] = out[size : size + wanted]
        update_members(
            plan, numbers, states, stamps, shares, reading_errors, progress, ONE, columns,
            element_of, elements, sample_stamps[k], motor_angles[k], joint_angles[k],
            unseen[k] if unseen.shape[0] else seen, estimates[k],
            deviation, variance, last_angle, intervals, ways, span, readings, out, stddevs[k],
        )  # fmt: skip


@compiled
def mark_unsure(values: Vector, preload: Vector, stddev: Vector, share: float) -> None:
    """Set ``UNSURE`` where a standard deviation exceeds a share of the tension or the preload.

    Args:
        values: an estimate: tensions, then status of all elements, then the rest; changed.
        preload: of every element's cable [N], shape (elements,).
        stddev: of the tensions, then the rest [N].
        share: see ``Options.unsure_share``.
    """
    elements = preload.size
    for e in range(elements):
        if stddev[e] > share * max(values[e], preload[e]):
            flags = int(values[elements + e])
            if flags & INVALID == 0:
                values[elements + e] = flags | UNSURE


class Spread:
    """The ensemble of one robot; ``update`` after every ``step``, with what it took and gave."""

    def __init__(
        self, model: Model, members: int = MEMBERS, seed: int = 0, preload_share: float = 0.0
    ) -> None:
        """Draw the members.

        Args:
            model: the prepared robot; its uncertainty and its sensors say what is not known.
            members: their number, even and at least 8.
            seed: of the draws; the same seed gives the same spread.
            preload_share: standard deviation of every preload beside the robot file's, as a share
                of it.
        """
        if members < 8 or members % 2:
            raise ValueError(f"members must be even and at least 8, got {members}")
        generator = np.random.default_rng(seed)
        robot = model.robot
        self.model = model
        self.columns = spread_columns(model.layout)
        rows = draw_members(robot, members, generator)
        if rows:
            numbers = np.stack([prepare(one, check_range=False).numbers for one in rows])
        else:
            numbers = np.repeat(model.numbers[None, :], members, axis=0)
        wind_differently(model, numbers, generator)
        if preload_share > 0.0:
            preload_differently(model, numbers, preload_share, generator)
        self.numbers = numbers
        self._shares = np.concatenate(
            [friction_shares(members, len(cable.pulleys), generator) for cable in robot.cables],
            axis=1,
        )
        self._errors = reading_errors(robot, generator)
        self.states = np.zeros((members, model.state_size))
        self.stamps = np.zeros(members, dtype=np.int64)
        self._progress = np.zeros(PROGRESS, dtype=np.int64)
        self._element_of = _elements_of(model.layout)
        self._elements = len(model.layout.elements)
        self._out = np.empty(model.out_size)
        self._readings = np.empty(len(robot.motors) + len(robot.joints))
        self._last_angle = np.zeros(len(robot.motors) + len(robot.joints))
        self._intervals = np.zeros(self._last_angle.size, dtype=np.int64)
        self._ways = unseen_ways(members, self._last_angle.size, np.random.default_rng((seed, 1)))
        self._span = np.array(
            [(-np.inf, np.inf) for _ in robot.motors]
            + [(joint.lower, joint.upper) for joint in robot.joints]
        ).T.copy()
        self.deviation = np.zeros((members, self.columns.size))
        self.variance = np.zeros(self.columns.size)
        self.generator = generator
        self.reset()

    def reset(self) -> None:
        """Forget what the members have seen; the next sample starts them anew."""
        self.states[:] = 0.0
        self._progress[:] = (0, -1, 0)
        self._intervals[:] = 0
        self.deviation[:] = 0.0
        self.variance[:] = 0.0

    def memory(self) -> dict[str, NDArray[Any]]:
        """What the members know, to be given to ``recall`` later."""
        return {
            "members": self.states,
            "member_stamps": self.stamps,
            "member_numbers": self.numbers,
            "progress": self._progress,
            "last_angle": self._last_angle,
            "intervals": self._intervals,
            "deviation": self.deviation,
        }

    def recall(self, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Take up what ``memory`` gave; False, and nothing changed, where it does not fit."""
        own = self.memory()
        for name, values in own.items():
            there = arrays.get(name)
            if there is None or there.shape != values.shape or there.dtype != values.dtype:
                return False
            if values.dtype == np.float64 and not np.all(np.isfinite(there)):
                return False
        for name, values in own.items():
            values[:] = arrays[name]
        self.variance[:] = (self.deviation**2).mean(axis=0)
        return True

    def shift_clock(self, by_ns: int) -> None:
        """Move the members' stamps."""
        self.stamps += by_ns
        if self._progress[LAST_STAMP] >= 0:
            self._progress[LAST_STAMP] += by_ns

    def update(self, sample: Sample, estimate: Estimate) -> Vector:
        """Take the sample of a step and what came of it.

        Returns:
            Standard deviations, in the order of ``spread_columns``.
        """
        stddev = np.empty(self.columns.size)
        self._advance(sample, estimate, 1, stddev)
        return stddev

    def catch_up(self, sample: Sample, estimate: Estimate) -> None:
        """Bring all members to the sample that ``update`` has seen last."""
        if np.all(self.stamps == sample.stamp_ns):
            return
        self._advance(sample, estimate, len(self.states), np.empty(self.columns.size))

    def _advance(self, sample: Sample, estimate: Estimate, count: int, stddev: Vector) -> None:
        update_members(
            self.model.plan, read_only(self.numbers), self.states, self.stamps, self._shares,
            self._errors, self._progress, count, self.columns, self._element_of,
            self._elements, sample.stamp_ns, sample.motor_angle, sample.joint_angle,
            sample.unseen, estimate.values, self.deviation, self.variance, self._last_angle,
            self._intervals, self._ways, self._span, self._readings, self._out, stddev,
        )  # fmt: skip

    def run(
        self,
        state: State,
        samples: Samples,
        into: Table | None = None,
        stddev_into: Table | None = None,
    ) -> tuple[State, Estimates]:
        """``step`` and ``update`` over many samples in one call; bit for bit the same numbers.

        ``into`` as for the estimator's ``run``, ``stddev_into`` of shape (n, columns).
        """
        model = self.model
        stamps = samples.stamp_ns
        estimates = np.empty((stamps.size, model.layout.size)) if into is None else into
        stddev = np.empty((stamps.size, self.columns.size)) if stddev_into is None else stddev_into
        if stamps.size == 0:
            return state, Estimates(stamps, estimates, model.layout, stddev)
        first = state.stamp_ns if state.stamp_ns != NEVER else int(stamps[0])
        dt = np.diff(stamps, prepend=np.int64(first)) * 1e-9
        values = state.values.copy()
        _run(
            model.plan, model.numbers, values, read_only(self.numbers), self.states, self.stamps,
            self._shares, self._errors, self._progress, self.columns,
            self._element_of, self._elements, stamps, samples.motor_angle, samples.joint_angle,
            samples.unseen, dt, self.deviation, self.variance, self._last_angle, self._intervals,
            self._ways, self._span, self._readings, self._out, estimates, stddev,
        )  # fmt: skip
        return State(int(stamps[-1]), values), Estimates(stamps, estimates, model.layout, stddev)
