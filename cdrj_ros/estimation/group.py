"""A group of cables that depend on each other: their unknowns, and what sensors say about them."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from math import inf
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.beliefs import Beliefs
from cdrj_ros.estimation.changes import narrowed
from cdrj_ros.estimation.ensemble import stddev_columns
from cdrj_ros.estimation.estimator import NEVER, Estimate, Sample
from cdrj_ros.estimation.sensors import Reading, Sensor
from cdrj_ros.estimation.unknowns import ALIKE, PRELOAD, SLIP, signatures_of, unknowns_of
from cdrj_ros.estimation.verdicts import Heard, Verdict, judge
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.packing import INVALID, stddev_places
from cdrj_ros.model.prepared import Model, of_cables
from cdrj_ros.robot.groups import joints_of

HISTORY_NS: Final = 200_000_000
"""Maximum age of a reading [ns]."""

TICK_NS: Final = 20_000_000
"""Signatures and corrections are renewed once in this time [ns]."""

LONGEST_NS: Final = 1_000_000_000
"""After a longer time without a sample the robots of the signatures start anew [ns]."""

JUDGED_NS: Final = 500_000_000
"""Time between two verdicts [ns]."""

APART: Final = 2.0
"""Few large changes show other tensions than the beliefs beyond so many standard deviations."""

SHOWN: Final = 0.5
"""Of a change of a cable's preload its mean tension shows less than this share if it is slack."""


Said = tuple[Vector, Vector, Vector]
"""What sensors say: changes of a group's quantities; the shares of the variances of their histories
that the readings take away; and the variances that the unknowns leave."""


class Past(NamedTuple):
    """The model's estimate at a sample."""

    stamp_ns: int
    values: Vector
    """Of all quantities of the robot, shape (columns,)."""
    stddev: Vector


def _at(past: Sequence[Past], stamp_ns: int, column: int) -> tuple[float, Past] | None:
    """A quantity by the model at a time, and the sample at or after it; None if too old."""
    if not past[0].stamp_ns <= stamp_ns <= past[-1].stamp_ns:
        return None
    k = len(past) - 1
    while k > 0 and past[k - 1].stamp_ns >= stamp_ns:
        k -= 1
    after = past[k]
    value = float(after.values[column])
    if after.stamp_ns != stamp_ns:
        before = past[k - 1]
        share = (after.stamp_ns - stamp_ns) / (after.stamp_ns - before.stamp_ns)
        value += share * (float(before.values[column]) - value)
    return value, after


class Group:
    """Cables that belong together: their unknowns and what the sensors say about them."""

    def __init__(self, model: Model, cables: Sequence[int], changed: Mapping[str, float]) -> None:
        """Prepare.

        Args:
            model: the whole robot.
            cables: numbers of the group's.
            changed: numbers of the file that were measured at run time, see ``narrowed``.
        """
        own = of_cables(model, cables)
        layout = model.layout
        self._motors = [layout.motors.index(name) for name in own.layout.motors]
        self._joints = [layout.joints.index(name) for name in own.layout.joints]
        self.cables = list(cables)
        known = narrowed(own.robot, changed)
        self._parameters = known.parameters if known is not None else ()
        self.unknowns, self.modes = unknowns_of(own, known)
        """Change of the file's numbers per unit of every mode, see ``unknowns_of``."""
        self.signatures = signatures_of(own, self.unknowns)
        self.columns = _columns_in(model, own)
        """Index of every quantity of the group among those of the robot."""
        self._alike = [one.kind for one in self.unknowns].index(ALIKE)
        self._preloads = [k for k, one in enumerate(self.unknowns) if one.kind is PRELOAD]
        """Index of the unknown of every own cable's preload."""
        self._units = np.array([self.unknowns[k].unit for k in self._preloads])
        """Of these [N], shape (own cables,)."""
        self._means = np.zeros((len(self._units), len(self.columns)))
        """Share of every quantity in every own cable's mean tension."""
        for own_means, part in zip(self._means, own.robot.parts, strict=True):
            own_means[part] = 1.0 / (part.stop - part.start)
        self.place = {column: k for k, column in enumerate(self.columns.tolist())}
        self.refused = 0
        """Readings that were too old."""
        self._model = model
        self._cable_of = _cables_of_columns(own)
        self._axes = [joints_of(own.robot, one).union(one.motors) for one in own.robot.cables]
        """Names of the axes of every own cable."""
        self.forget()

    def forget(self) -> None:
        """Forget what sensors have said."""
        self.beliefs = Beliefs(self.unknowns)
        self.index: dict[str, int] = {}
        """Index of every sensor that was heard in ``beliefs``, by name."""
        self._parts: list[Table] = []
        """``Sensor.parts_of`` each."""
        self._read: list[float] = []
        """Last reading of each."""
        self._of: list[set[int]] = []
        """Own cables that contribute to it."""
        self._beside: list[set[int]] = []
        """Own cables on the axes of these."""
        self.forget_evidence()

    def restart(self) -> None:
        """Begin with an unknown history; what is known of robot and sensors is kept."""
        self.beliefs.core.widen(self._slipped())
        self.beliefs.core.pause()
        self.forget_evidence()

    def forget_evidence(self) -> None:
        """Forget what the latest readings show."""
        self.waiting: list[tuple[Reading, Sensor]] = []
        """Readings up to the last sample, which the next renewal takes."""
        self._solved_ns = inf
        """Stamp of the first sample since which all cables are solved [ns]."""
        self._tick = NEVER
        """Number of the last renewal."""
        self._slopes: deque[tuple[int, Table]] = deque(maxlen=HISTORY_NS // TICK_NS + 1)
        """Signatures with the stamps of their samples [ns]."""
        self.verdict: Verdict | None = None
        """What the latest readings show; None: they are too few."""
        self._judged_ns = NEVER
        """When that was seen [ns]."""

    def take(
        self, sample: Sample, phase: float, past: Sequence[Past], deviation: Table
    ) -> Said | None:
        """Renew signatures, beliefs and verdict, once in ``TICK_NS``, and say what follows, (B4).

        Args:
            sample: now, of the whole robot.
            phase: when in every ``TICK_NS`` that is due, from 0 to 1.
            past: the model's estimates for the last samples, this one included.
            deviation: of the members from it by their histories, shape (members, columns).

        Returns:
            None if nothing was due.
        """
        if not self.follow(sample, phase):
            return None
        waiting, self.waiting = self.waiting, []
        for reading, sensor in waiting:
            self._take(reading, sensor, past)
        values = past[-1].values[self.columns]
        shift, known, left = self.beliefs.core.present(
            sample.stamp_ns, values, self.slopes, deviation[:, self.columns]
        )
        if abs(sample.stamp_ns - self._judged_ns) >= JUDGED_NS:
            self._judged_ns = sample.stamp_ns
            self.verdict = self._judge(sample.stamp_ns)
        if self.verdict is not None:
            left = left * self.verdict.unexplained
            left = left + self._by_few_changes(shift, left)
        return shift, known, left + self._hidden(values, shift)

    def is_solved(self, estimate: Estimate) -> bool:
        """Whether the cables are; readings of before are of no use and dropped."""
        if not estimate.solved:
            flags = estimate.status.astype(np.uint8) & INVALID
            if any(flags[self._model.robot.parts[c]].any() for c in self.cables):
                self.waiting.clear()
                self._solved_ns = inf
                return False
        self._solved_ns = min(self._solved_ns, estimate.stamp_ns)
        return True

    def follow(self, sample: Sample, phase: float) -> bool:
        """Renew the signatures, once in ``TICK_NS``; whether that was due, see ``take``."""
        tick = (sample.stamp_ns + round(phase * TICK_NS)) // TICK_NS
        if tick == self._tick:
            return False
        self._tick = tick
        passed = sample.stamp_ns - self._slopes[-1][0] if self._slopes else 0
        goes_on = 0 < passed <= LONGEST_NS
        if not goes_on:
            self.beliefs.core.widen(self._slipped())
            self.signatures.reset()
            self._slopes.clear()
        slopes = self.signatures.follow(
            sample.motor_angle[self._motors], sample.joint_angle[self._joints],
            passed * 1e-9 if goes_on else 0.0,
        )  # fmt: skip
        self._slopes.append((sample.stamp_ns, slopes))
        return True

    @property
    def slopes(self) -> Table:
        """Change of every quantity per unit of every unknown, (B2), shape (unknowns, columns)."""
        return self._slopes[-1][1]

    def _slipped(self) -> Vector:
        """Variances of the unknowns by what slips have taken: over a break it is lost preload."""
        variances = np.zeros(self.beliefs.count)
        if not self._slopes:
            return variances
        mean, stddev = self.beliefs.moments()
        for k, one in enumerate(self.unknowns):
            if one.kind is SLIP:
                taken = float(self.slopes[k] @ self._means[one.only])
                size = taken / self._units[one.only]
                variances[self._preloads[one.only]] = size**2 * (mean[k] ** 2 + stddev[k] ** 2)
        return variances

    def widen(self, changes: Vector) -> None:
        """Leave open changes of mean tensions of these sizes [N], shape (all cables,)."""
        size = np.zeros(self.beliefs.count)
        size[self._preloads] = (changes[self.cables] / self._units) ** 2
        self.beliefs.core.widen(size)

    def memory(self) -> dict[str, Any]:
        """What ``recall`` needs to go on, as JSON."""
        return self.beliefs.memory() | {"slipped": self._slipped().tolist()}

    def hear(self, sensor: Sensor) -> int:
        """Index of a sensor in ``beliefs``, which begin to know it."""
        if sensor.name not in self.index:
            self.index[sensor.name] = len(self.index)
            own = [self.cables.index(c) for c in sensor.cables if c in self.cables]
            contributes = np.isin(self._cable_of, [-1, *own])
            axes = frozenset[str]().union(*(self._axes[c] for c in own))
            self._of.append(set(own))
            self._beside.append({c for c, one in enumerate(self._axes) if one & axes})
            self.beliefs.hear(sensor, self.place[sensor.column], contributes)
            self._parts.append(sensor.parts_of(self._model.robot))
            self._read.append(0.0)
        return self.index[sensor.name]

    def _take(self, reading: Reading, sensor: Sensor, past: Sequence[Past]) -> None:
        """Take a reading, unless it is too old."""
        found = _at(past, reading.stamp_ns, sensor.column)
        if found is None or reading.stamp_ns < self._solved_ns:
            self.refused += 1
            return
        h, then = found
        since = (one for at, one in reversed(self._slopes) if at <= then.stamp_ns)
        slopes = next(since, self._slopes[0][1])
        k, own = self.hear(sensor), slopes[:, self.place[sensor.column]]
        self._read[k] = reading.value
        parts = self._parts[k] @ then.values[: self._parts[k].shape[1]]
        self.beliefs.core.take(
            k, reading.stamp_ns, reading.value, reading.noise, h, own,
            float(then.stddev[sensor.column]), parts,
        )  # fmt: skip

    def _judge(self, now_ns: int) -> Verdict | None:
        """What the latest readings show; the verdict before while the sensors are silent."""
        core = self.beliefs.core
        heard = [
            Heard(
                sensor, core.heard(k)[2], self.beliefs.probability_right(k), self._parts[k],
                *core.evidence(k, now_ns),
            )
            for k, sensor in enumerate(self.beliefs.sensors)
        ]  # fmt: skip
        cables = self._model.layout.cables
        return judge(self.unknowns, heard, cables, self.verdict) or self.verdict

    def _by_few_changes(self, shift: Vector, left: Vector) -> Vector:
        """Variances of all quantities that few large changes show otherwise than the beliefs, (B7).

        Beliefs explain the same readings by many changes as small as their priors, and other few
        changes may explain them as well.  Which is right is open: one effort reads a loss of both
        preloads as less friction, one load cell the zero of a joint as a preload.

        Args:
            shift: of the model's quantities by the beliefs, shape (quantities,).
            left: its variances.
        """
        found, slopes = np.zeros(shift.size), self.slopes
        for one in self.verdict.explanations if self.verdict is not None else ():
            differs = (one.mean @ slopes - shift) ** 2
            variance = left + np.einsum("iq,ij,jq->q", slopes, one.covariance, slopes)
            apart = differs > APART**2 * variance
            found = np.maximum(found, one.probability * np.where(apart, differs, 0.0))
        return found

    def _hidden(self, values: Vector, shift: Vector) -> Vector:
        """Variances by what signatures do not show: a cable that the model holds slack may be taut.

        Its preload is open by more than a unit, as after a break, or its sensors read a tension.
        Beside changes that the file does not leave open its angles may be wrong: what any sensor on
        its axes reads otherwise than the model is open then, and by a sensor whose cables are all
        held slack, the other cables on these axes as well.

        Args:
            values: quantities of the group by the model, shape (columns,).
            shift: of these by the beliefs.
        """
        changed = self.verdict is not None and bool(self.verdict.found)
        expected, doubted = (values, self._beside) if changed else (values + shift, self._of)
        shown = (self.slopes[self._preloads] * self._means).sum(axis=1)
        is_slack = shown < SHOWN * self._units
        open_by = np.zeros(len(self._units) + 1)  # the last one is of efforts
        if not is_slack.any():
            return open_by[self._cable_of]
        stddev = self.beliefs.moments()[1][self._preloads]
        open_by[:-1] = np.where(is_slack & (stddev > 1.0), stddev, 0.0)
        slack = set(np.flatnonzero(is_slack).tolist())
        for k, one in enumerate(self.beliefs.sensors):
            off = abs(self._read[k] - expected[self.place[one.column]]) / (PRELOAD.unit * one.scale)
            for c in doubted[k] if slack.issuperset(self._of[k]) else slack & doubted[k]:
                open_by[c] = max(open_by[c], off)
        found = np.square(open_by * [*self._units, 0.0])
        return found[self._cable_of]

    def changes(self) -> dict[str, tuple[float, float]]:
        """What preloads and reference angles differ by from the file, and standard deviations [SI].

        By path.  A reading that is too large by an angle belongs to a reference angle that is too
        small by it.
        """
        found, places = {}, {path: k for k, path in enumerate(self._parameters)}
        for k, one in enumerate(self.unknowns):
            if not one.path:
                continue
            share = np.zeros(self.beliefs.count)
            of_file = [(one.path, 1.0)]
            if one.kind is PRELOAD:
                share[[k, self._alike]] = one.unit
            else:
                share[k] = -one.unit
                of_file.append((one.path.replace(".reference_angle", ".offset"), -1.0))
            for path, sign in of_file:
                if path in places:
                    share[: self.modes.shape[1]] += sign * self.modes[places[path]]
            found[one.path] = self.beliefs.moment_of(share)
        return found

    def recall(self, memory: Mapping[str, Any], sensors: Mapping[str, Sensor]) -> None:
        """Take up ``memory``.

        Raises:
            KeyError, TypeError, ValueError: it is not one of this robot.
        """
        self.forget()
        for name, _ in memory["sensors"]:
            self.hear(sensors[name])
        self.beliefs.restore(memory)
        slipped = np.array(memory["slipped"], np.float64)
        if not (np.isfinite(slipped).all() and (slipped >= 0.0).all()):
            raise ValueError("what has slipped is negative or infinite")
        self.beliefs.core.widen(slipped)


def _columns_in(model: Model, own: Model) -> NDArray[np.int64]:
    """Index in ``stddev_columns`` of a robot of every quantity of the robot with fewer cables."""
    at, places = stddev_places(model.layout), stddev_places(own.layout)
    found = np.empty(len(places), dtype=np.int64)
    found[list(places.values())] = [at[name] for name in places]
    return found


def _cables_of_columns(model: Model) -> NDArray[np.int64]:
    """Number of the cable of every quantity in ``stddev_columns``; -1 for efforts."""
    robot = model.robot
    cables, places = range(len(robot.cables)), model.layout.stddev
    found = np.full(stddev_columns(model.layout).size, -1)
    found[places["tension"]] = robot.per_element(np.array(cables))
    found[places["magnitude"]] = np.repeat(cables, [len(one.pulleys) for one in robot.cables])
    return found
