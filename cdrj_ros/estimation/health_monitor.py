"""A monitor of the robot: says which change of the robot its efforts and load cells show.

It runs the robot file and one changed robot per possible change beside the estimator, at 20 Hz and
one model per sample, and compares their readings with the measured ones cycle by cycle.  Nothing
in it depends on ROS, and it changes no estimate.  See docs/reliability.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np

from cdrj_ros import _core
from cdrj_ros.estimation.estimator import NEVER, Sample
from cdrj_ros.estimation.health_changes import Change, changes_of, magnitude, sensor_changes
from cdrj_ros.estimation.health_evaluation import Evaluation, Reading, Turns, Window, evaluate
from cdrj_ros.estimation.health_verdict import Report, report
from cdrj_ros.estimation.sensors import LARGEST
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.packing import EFFORT, TENSION, stddev_places
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Uncertainty

TICK_NS: Final = 50_000_000
"""Time between two samples that the models process [ns]."""

LEAST_NS: Final = 20_000_000
"""Shortest time between two used readings of one sensor [ns]."""

LONGEST_NS: Final = 2_000_000_000
"""A longer gap between samples discards the cycle [ns]."""

FEWEST: Final = 40
"""Smallest number of readings of a window."""

SHORTEST_NS: Final = 3_000_000_000
"""Shortest duration of a window [ns]."""

MOST: Final = 4000
"""Readings after which a window without a whole cycle is discarded."""

KEPT: Final = 2000
"""Largest number of readings that wait for a sample."""

QUICK: Final = 48
"""Number of latest readings in which a broken cable is sought between the ends of cycles."""

IN_A_ROW: Final = 3
"""Cycles that must show the same change, unless one of them is certain."""

REMEMBERED: Final = 64
"""Cycles whose results are kept."""


@dataclass
class _Tick:
    """One sample on its way through the robots."""

    sample: Sample
    stddev: Vector | None
    expected: list[Vector]
    """Values of ``_columns`` by the robots so far."""


class HealthMonitor:
    """Compares measured efforts and tensions with the file and with changed robots."""

    def __init__(
        self,
        model: Model,
        known: Uncertainty | None = None,
    ) -> None:
        """Prepare nothing yet: models are prepared one per sample once a reading has arrived.

        Args:
            model: the prepared robot.
            known: what is uncertain about its numbers; None: nothing.
        """
        self.model = model
        self._effort_noise = {one.name: one.effort_noise for one in model.robot.motors}
        self._offset_ns = {one.name: one.sensor.clock_offset_ns for one in model.robot.motors}
        layout = model.layout
        columns = [*range(layout.motor_effort.start, layout.motor_effort.stop)]
        columns += range(layout.tension.start, layout.tension.stop)
        self._columns = np.array(columns)
        self._index = {name: k for k, name in enumerate((*layout.motors, *layout.elements))}
        """Index of every sensor in ``_columns``."""
        places = stddev_places(layout)
        self._stddev_column = {name: places[f"{EFFORT}/{name}"] for name in layout.motors}
        self._stddev_column |= {name: places[f"{TENSION}/{name}"] for name in layout.elements}
        self._makers: deque[Callable[[], Change]] = deque(changes_of(model.robot, known))
        self._changes: list[Change] = []
        self._constants = [model.constants]
        """Constants of the robot of the file, then of every changed one."""
        self._robots: _core.Population | None = None
        """These robots, once all are prepared."""
        self._scale: dict[str, float] = {}
        self.reset()

    def reset(self) -> None:
        """Forget readings and results: the robot has moved unobserved, or was mended."""
        self._pending: deque[tuple[int, str, float, float]] = deque(maxlen=KEPT)
        self._read_ns: dict[str, int] = {}
        self._oldest_ns = -LEAST_NS
        """Oldest of the motors' latest efforts [ns]; before all times if one has none."""
        self._tick: _Tick | None = None
        self._interval_ns = 0
        self._sampled_ns = NEVER
        self._evaluations: deque[Evaluation] = deque(maxlen=REMEMBERED)
        self._standing: Evaluation | None = None
        self._clear = 0
        self.cycles = 0
        """Cycles that have been evaluated."""
        self._begin()

    def _begin(self) -> None:
        """Start all models anew, with unknown friction history: the first cycle counts for none."""
        if self._robots is not None:
            self._robots.reset()
        self._before: tuple[int, Table] | None = None
        self._turns = [Turns(abs(a.sensor.scale) * a.sensor.resolution)
                       for a in self.model.robot.axes]  # fmt: skip
        self._settled = False
        self._window, self._window_ns = Window(), 0

    # --- readings ---------------------------------------------------------------------------------

    def read_efforts(
        self, stamp_ns: int, names: Sequence[str], efforts: Sequence[float] | Vector
    ) -> None:
        """Take measured efforts of motors [N m]; ignores other names, and efforts without names."""
        if len(efforts) != len(names):
            return
        for name, value in zip(names, efforts, strict=True):
            if name in self._offset_ns:
                stamp = stamp_ns + self._offset_ns[name]
                self._read(stamp, name, float(value), self._effort_noise[name])
        if all(name in self._read_ns for name in self._offset_ns):
            self._oldest_ns = min(self._read_ns[n] - by for n, by in self._offset_ns.items())

    def read_tensions(
        self,
        stamp_ns: int,
        names: Sequence[str],
        tensions: Sequence[float] | Vector,
        stddevs: Sequence[float] | Vector = (),
    ) -> None:
        """Take readings of load cells [N]; ignores other elements, and readings without names."""
        if len(tensions) != len(names):
            return
        noises = {cable.name: cable.sensor_noise for cable in self.model.robot.cables}
        for k, name in enumerate(names):
            if name in self._index and name not in self._offset_ns:
                stated = float(stddevs[k]) if len(stddevs) == len(names) else 0.0
                noise = stated if stated > 0.0 else noises[name.rpartition("/")[0]]
                self._read(stamp_ns, name, float(tensions[k]), noise)

    def wants_efforts(self, stamp_ns: int) -> bool:
        """Whether efforts of this stamp [ns] would be used for any motor."""
        return not 0 <= stamp_ns - self._oldest_ns < LEAST_NS

    @property
    def heard(self) -> bool:
        """Whether any sensor has sent a reading."""
        return bool(self._scale)

    def _read(self, stamp_ns: int, name: str, value: float, noise: float) -> None:
        last = self._read_ns.get(name)
        if last is not None and 0 <= stamp_ns - last < LEAST_NS:
            return
        if not abs(value) <= LARGEST or not 0.0 <= noise <= LARGEST:  # NaN too
            return
        self._read_ns[name] = stamp_ns
        self._scale.setdefault(name, magnitude(self.model.robot, name))
        self._pending.append((stamp_ns, name, value, noise))

    # --- samples ----------------------------------------------------------------------------------

    def follow(self, sample: Sample, stddev: Vector | None = None) -> None:
        """Take the estimator's sample; steps one model or a few, whatever the number of models.

        Args:
            sample: the last sample of the estimator.
            stddev: standard deviations of its estimate, in the order of ``stddev_columns``; None:
                zero.
        """
        if not self._scale:
            return
        if self._makers:
            self._prepare_one()
            return
        passed = sample.stamp_ns - self._sampled_ns
        if self._sampled_ns != NEVER and passed == 0:
            return
        if self._sampled_ns != NEVER and not 0 < passed <= LONGEST_NS:
            self._tick = None
            self._pending.clear()
            self._begin()
            passed = TICK_NS
        self._sampled_ns = sample.stamp_ns
        self._interval_ns = passed
        if self._tick is None:
            last = self._before[0] if self._before is not None else NEVER
            if last == NEVER or sample.stamp_ns - last >= TICK_NS:
                self._tick = _Tick(sample, stddev, [])
        if self._tick is not None:
            for _ in range(max(1, ceil(len(self._constants) * self._interval_ns / TICK_NS))):
                if self._step_one(self._tick):
                    break

    def prepare(self) -> None:
        """Prepare all models now instead of one with every sample."""
        while self._makers:
            self._prepare_one()

    def _prepare_one(self) -> None:
        try:
            change = self._makers.popleft()()
            assert change.robot is not None
            model = (
                self.model
                if change.robot is self.model.robot
                else prepare(change.robot, check_range=False)
            )
        except CdrjError:  # numbers that no robot can have: this change cannot be told
            return
        self._changes.append(change)
        self._constants.append(model.constants)

    def _step_one(self, tick: _Tick) -> bool:
        """Step the next robot; True once the sample has passed through all of them."""
        if self._robots is None:
            self._robots = _core.Population(self.model.core, np.stack(self._constants))
        k = len(tick.expected)
        angles = tick.sample.joint_angle
        if k and (shift := self._changes[k - 1].joint_shift):
            angles = angles + np.array(shift)
        dt = 0.0
        if self._before is not None:
            dt = (tick.sample.stamp_ns - self._before[0]) * 1e-9
        solved, values = self._robots.advance(k, tick.sample.motor_angle, angles, dt)
        tick.expected.append(values[self._columns])
        if not solved and k == 0:
            self._tick = None
            self._begin()
            return True
        if len(tick.expected) < len(self._constants):
            return False
        self._tick = None
        self._complete(tick)
        return True

    def _complete(self, tick: _Tick) -> None:
        """Compare the waiting readings with the models, and end the cycle if it is whole."""
        stamp = tick.sample.stamp_ns
        expected = np.array(tick.expected)
        before, self._before = self._before, (stamp, expected)
        angles = (*tick.sample.motor_angle.tolist(), *tick.sample.joint_angle.tolist())
        for turns, angle in zip(self._turns, angles, strict=True):
            turns.add(angle)
        later = deque[tuple[int, str, float, float]](maxlen=KEPT)
        for reading in self._pending:
            if reading[0] > stamp:
                later.append(reading)
            elif before is not None and reading[0] > before[0]:
                share = (reading[0] - before[0]) / (stamp - before[0])
                self._add(reading, before[1], expected, share, tick.stddev)
        self._pending = later
        whole = any(turns.whole for turns in self._turns) and (
            stamp - self._window_ns >= SHORTEST_NS
        )
        if whole and (self._window.size >= FEWEST or not self._settled):
            if self._settled:
                self._evaluate(self._window)
            self._settled = True
            self._next_window(stamp)
        elif self._window.size >= MOST:
            for turns in self._turns:
                turns.forget()
            self._next_window(stamp)

    def _next_window(self, stamp_ns: int) -> None:
        self._window, self._window_ns = Window(), stamp_ns
        for turns in self._turns:
            turns.begin()

    def _add(
        self,
        reading: tuple[int, str, float, float],
        before: Table,
        after: Table,
        share: float,
        stddev: Vector | None,
    ) -> None:
        """Add a reading that lies ``share`` of the way between two samples."""
        _, name, value, noise = reading
        old, new = before[:, self._index[name]], after[:, self._index[name]]
        unsure = 0.0 if stddev is None else float(stddev[self._stddev_column[name]])
        expected, is_effort = old + share * (new - old), name in self._offset_ns
        self._window.add(name, Reading(value, noise, expected, unsure, is_effort))

    # --- results ----------------------------------------------------------------------------------

    def _evaluate(self, window: Window) -> None:
        sensors = sensor_changes(self.model.robot, sorted(window.rows))
        evaluated = evaluate(window, self._changes, sensors, self._scale)
        if evaluated is None:
            return
        self.cycles += 1
        self._evaluations.append(evaluated)
        if not evaluated.alarming:
            self._clear += 1
            if self._clear >= 2:
                self._standing = None
            return
        self._clear = 0
        latest = list(self._evaluations)[-IN_A_ROW:]
        if evaluated.certain or (
            len(latest) == IN_A_ROW and all(_agree(one, evaluated) for one in latest)
        ):
            self._standing = evaluated

    def report(self) -> Report:
        """What the monitor has found so far, for people; also looks for a broken cable now."""
        if self._window.size >= QUICK and self._settled:
            evaluated = evaluate(self._window.latest(QUICK), self._changes, (), self._scale)
            if evaluated is not None and any(f.change.kind == "broken" for f in evaluated.found):
                self._standing, self._clear = evaluated, 0
                self._evaluations.append(evaluated)
        return report(
            self.model.robot,
            tuple(self._scale),
            self.cycles,
            self._standing,
            tuple(self._evaluations),
        )

    @property
    def standing(self) -> Evaluation | None:
        """The present verdict; None while the robot agrees with its file."""
        return self._standing


def _agree(one: Evaluation, other: Evaluation) -> bool:
    """Whether two cycles in a row show the same."""
    if not one.alarming:
        return False
    if not (one.explained and other.explained):
        return one.explained == other.explained
    return bool(one.named & other.named)
