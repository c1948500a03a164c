"""A group of cables that depend on each other: their unknowns, and what sensors say about them."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.estimation.beliefs import Beliefs
from cdrj_ros.estimation.ensemble import stddev_columns
from cdrj_ros.estimation.estimator import NEVER, Sample
from cdrj_ros.estimation.evidence import FADES_S, Sums, contributions, nothing
from cdrj_ros.estimation.sensors import Reading, Sensor
from cdrj_ros.estimation.unknowns import ALIKE, SLIP, Unknown, unknowns_of
from cdrj_ros.estimation.verdicts import Verdict, judge
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.packing import constant_views, stddev_places
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Uncertainty
from cdrj_ros.robot.groups import has_number, part_of
from cdrj_ros.robot.reader import build_robot

HISTORY_NS: Final = 200_000_000
"""Maximum age of a reading [ns]."""

TICK_NS: Final = 20_000_000
"""Signatures and corrections are renewed once in this time [ns]."""

LONGEST_NS: Final = 1_000_000_000
"""After a longer time without a sample the robots of the signatures start anew [ns]."""

JUDGED_NS: Final = 500_000_000
"""Time between two verdicts [ns]."""

STRAYS: Final = 2
"""So many stray readings in a row are no evidence."""

CONTRADICTED: Final = 2.0
"""Tensions contradict readings that show others by more than so many standard deviations."""

CONTRADICTED_NS: Final = round(2e9 * FADES_S)
"""Time for which they do until the tensions are in doubt [ns]."""


Said = tuple[Vector, Vector, Vector]
"""What sensors say, see ``Group.correction``."""


class Past(NamedTuple):
    """The model's estimate at a sample."""

    stamp_ns: int
    values: Vector
    """Of all quantities of the robot, shape (columns,)."""
    stddev: Vector
    direction: Vector
    """Of the axes' friction, see ``Directions``."""


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

    def __init__(self, model: Model, cables: Sequence[int], known: Uncertainty | None) -> None:
        """Prepare.

        Args:
            model: the whole robot.
            cables: numbers of the group's.
            known: standard deviations of the robot's numbers.
        """
        own = _of_cables(model, cables)
        layout = model.layout
        self._motors = [layout.motors.index(name) for name in own.layout.motors]
        self._joints = [layout.joints.index(name) for name in own.layout.joints]
        self.cables = list(cables)
        own_known = _known_of(known, own)
        self._parameters = own_known.parameters if own_known is not None else ()
        self.unknowns, self.modes = unknowns_of(own, own_known)
        """Change of the file's numbers per unit of every mode, see ``unknowns_of``."""
        self.signatures = _signatures(own, self.unknowns)
        self.columns = _columns_in(model, own)
        """Index of every quantity of the group among those of the robot."""
        self._alike = [one.kind for one in self.unknowns].index(ALIKE)
        self.place = {column: k for k, column in enumerate(self.columns.tolist())}
        self.refused = 0
        """Readings that were too old."""
        self._model = model
        self._own = own
        self._cable_of = _cables_of_columns(own)
        self._tensions = own.layout.stddev["tension"]
        self.forget()

    def forget(self) -> None:
        """Forget what sensors have said."""
        self.beliefs = Beliefs(self.unknowns)
        self.index: dict[str, int] = {}
        """Index of every sensor that was heard in ``beliefs``, by name."""
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
        self._tick = NEVER
        """Number of the last renewal."""
        self._slopes: deque[tuple[int, Table]] = deque(maxlen=HISTORY_NS // TICK_NS + 1)
        """Signatures with the stamps of their samples [ns]."""
        self.sums = [self._no_evidence(sensor) for sensor in self.beliefs.sensors]
        """(B5) of every sensor that was heard."""
        self.verdict: Verdict | None = None
        """What the latest readings show; None: they are too few."""
        self.doubted: Sequence[int] = ()
        """Numbers of the cables whose tensions are in doubt whatever their deviations say."""
        self._agreed_ns, self._judged_ns = NEVER, NEVER
        """When the tensions last agreed with the verdict, and when that was judged [ns]."""

    def take(
        self, sample: Sample, phase: float, past: Sequence[Past], deviation: Table
    ) -> Said | None:
        """Renew signatures, beliefs and verdict, once in ``TICK_NS``.

        Args:
            sample: now, of the whole robot.
            phase: when in every ``TICK_NS`` that is due, from 0 to 1.
            past: the model's estimates for the last samples, this one included.
            deviation: of the members from it by their histories, shape (members, columns).

        Returns:
            What the sensors say, see ``correction``; None if nothing was due.
        """
        if not self.follow(sample, phase):
            return None
        waiting, self.waiting = self.waiting, []
        for reading, sensor in waiting:
            self._take(reading, sensor, past)
        said = self.correction(sample.stamp_ns, past[-1].values, deviation)
        if abs(sample.stamp_ns - self._judged_ns) >= JUDGED_NS:
            self._judged_ns = sample.stamp_ns
            self._judge(past[-1], said)
        shift, known, left = said
        return shift, known, left * self._unexplained()

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
        of_elements, cables = self._cable_of[self._tensions], self._own.layout.cables
        names = [one.name for one in self.unknowns]
        for k, one in enumerate(self.unknowns):
            if one.kind is SLIP and one.cable is not None:
                preload = names.index(f"preload of {cables[one.cable]}")
                taken = self.slopes[k, self._tensions][of_elements == one.cable].mean()
                size = taken / self.unknowns[preload].unit
                variances[preload] = size**2 * (mean[k] ** 2 + stddev[k] ** 2)
        return variances

    def memory(self) -> dict[str, Any]:
        """What ``recall`` needs to go on, as JSON."""
        return self.beliefs.memory() | {"slipped": self._slipped().tolist()}

    def _no_evidence(self, sensor: Sensor) -> Sums:
        return nothing(self.beliefs.count + 3, contributions(self._model.robot, sensor))

    def hear(self, sensor: Sensor) -> int:
        """Index of a sensor in ``beliefs``, which begin to know it."""
        if sensor.name not in self.index:
            self.index[sensor.name] = len(self.index)
            own = [self.cables.index(c) for c in sensor.cables if c in self.cables]
            contributes = np.isin(self._cable_of, [-1, *own])
            self.beliefs.hear(sensor, self.place[sensor.column], contributes)
            self.sums.append(self._no_evidence(sensor))
        return self.index[sensor.name]

    def _take(self, reading: Reading, sensor: Sensor, past: Sequence[Past]) -> None:
        """Take a reading, unless it is too old."""
        found = _at(past, reading.stamp_ns, sensor.column)
        if found is None:
            self.refused += 1
            return
        h, then = found
        since = (one for at, one in reversed(self._slopes) if at <= then.stamp_ns)
        slopes = next(since, self._slopes[0][1])
        k, own = self.hear(sensor), slopes[:, self.place[sensor.column]]
        direction = float(then.direction[sensor.axis]) if sensor.axis >= 0 else 0.0
        history, core = float(then.stddev[sensor.column]), self.beliefs.core
        core.take(k, reading.stamp_ns, reading.value, reading.noise, h, own, history, direction)
        *_, strays = core.heard(k)
        if not 0 < strays <= STRAYS:
            self.sums[k].add(
                reading.stamp_ns, reading.value - h, np.concatenate([own, [1.0, h, direction]]),
                reading.noise**2, sensor.model_error(reading.value) ** 2 + history**2, then.values,
            )  # fmt: skip

    def _judge(self, now: Past, said: Said) -> None:
        """Renew ``verdict`` and ``doubted``; both stay while the sensors are silent."""
        beliefs, names = self.beliefs, self._model.layout.cables
        frozen = [beliefs.core.heard(k)[2] for k in range(len(beliefs.sensors))]
        sums = [one.faded(now.stamp_ns) for one in self.sums]
        verdict = judge(self.unknowns, beliefs.sensors, frozen, sums, names)
        if verdict is None:
            return
        self.verdict = verdict
        if verdict.broken or self._agrees(verdict, now, said):
            self._agreed_ns = now.stamp_ns
        # after a sudden change its readings mix with those before
        lost = now.stamp_ns - self._agreed_ns > CONTRADICTED_NS
        broken = [names.index(verdict.broken)] if verdict.broken else []
        self.doubted = self.cables if lost else broken

    def _unexplained(self) -> float:
        """By how much variances are too small, since the readings deviate more than is expected."""
        if self.verdict is None:
            return 1.0
        squares = number = 0.0
        for name, (own, readings) in self.verdict.left_of.items():
            right = self.beliefs.probability_right(self.index[name])
            squares += right * own
            number += right * readings
        return max(1.0, squares / max(number, 1.0))

    def _agrees(self, verdict: Verdict, now: Past, said: Said) -> bool:
        """Whether the published tensions are those of what the latest readings show."""
        if not any(one.matters for one in verdict.found):
            return verdict.explained
        shift, known, left = (one[self._tensions] for one in said)
        slopes = self.slopes[:, self._tensions]
        variance = (1.0 - known) * now.stddev[self.columns[self._tensions]] ** 2 + left
        variance += np.einsum("iq,ij,jq->q", slopes, verdict.covariance, slopes)
        differs = (verdict.mean @ slopes - shift) ** 2 > CONTRADICTED**2 * variance
        return verdict.explained and not differs.any()

    def correction(self, stamp_ns: int, values: Vector, deviation: Table) -> Said:
        """What the sensors say about the present, (B4).

        Args:
            stamp_ns: now [ns].
            values: quantities of the whole robot by the model, shape (columns,).
            deviation: of the members from them by their histories, shape (members, columns).

        Returns:
            Changes of the group's quantities; the shares of the variances of their histories that
            the readings take away; and the variances that the unknowns leave.
        """
        columns = self.columns
        return self.beliefs.core.present(
            stamp_ns, values[columns], self.slopes, deviation[:, columns]
        )

    def preload_of(self, cable: str) -> tuple[float, float] | None:
        """The preload of a cable and its standard deviation [N]; None if it is of another group."""
        names = self._own.layout.cables
        if cable not in names:
            return None
        change = [one.name for one in self.unknowns].index(f"preload of {cable}")
        share = np.zeros(self.beliefs.count)
        share[[change, self._alike]] = self.unknowns[change].unit
        path = f"cables.{cable}.preload"
        if path in self._parameters:
            share[: self.modes.shape[1]] = self.modes[self._parameters.index(path)]
        mean, stddev = self.beliefs.moment_of(share)
        return self._own.robot.cables[names.index(cable)].preload + mean, stddev

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


def _signatures(model: Model, unknowns: Sequence[Unknown]) -> _core.Signatures:
    """The robots at plus and minus one unit of every unknown of a robot."""
    ends = {id(end): end for one in unknowns for end in (one.more, one.less)}
    number = {end: k for k, end in enumerate(ends)}
    constants = np.stack([end.model.constants for end in ends.values()])
    residuals: Any = constant_views(model.sizes, constants).residuals
    residuals["bound"] = 0.0  # the estimate alone is corrected by what its file has learned
    return _core.Signatures(
        model.core, constants, np.stack([end.angle for end in ends.values()]),
        np.array([end.slipping for end in ends.values()]),
        np.array(
            [
                (number[id(one.more)], number[id(one.less)], -1 if one.cable is None else one.cable)
                for one in unknowns
            ],
            dtype=np.int64,
        ),
    )  # fmt: skip


def _known_of(known: Uncertainty | None, own: Model) -> Uncertainty | None:
    """The standard deviations of the numbers that a robot with fewer cables has."""
    if known is None:
        return None
    document: Any = own.robot.document
    kept = [k for k, path in enumerate(known.parameters) if has_number(document, path)]
    return replace(
        known, parameters=tuple(known.parameters[k] for k in kept),
        covariance=known.covariance[np.ix_(kept, kept)],
        stated=sum(k < known.stated for k in kept),
    )  # fmt: skip


def _of_cables(model: Model, cables: Sequence[int]) -> Model:
    """The robot with some of its cables only, and the axes that move them."""
    robot = model.robot
    if len(cables) == len(robot.cables):
        return model
    return prepare(build_robot(part_of(robot, cables), robot.source), check_range=False)


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
