"""Corrections of the estimate by sensors, for every group of cables that belong together.

The model's estimate is not touched: what sensors say is added to it, and their beliefs about the
unknowns are kept beside it.  The members of the ensemble hold the history alone then; what the file
leaves open is in the beliefs.  See docs/estimation.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import correct
from cdrj_ros.estimation.ensemble import Ensemble, stddev_columns
from cdrj_ros.estimation.estimator import NO_DOUBTS, Estimate, Sample
from cdrj_ros.estimation.group import HISTORY_NS, Group, Past
from cdrj_ros.estimation.model_error import unmodelled
from cdrj_ros.estimation.sensors import Reading, Sensor
from cdrj_ros.estimation.unknowns import AXIS
from cdrj_ros.estimation.verdict_words import Report, report
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Uncertainty
from cdrj_ros.robot.groups import connected_cables
from cdrj_ros.robot.tolerances import SPRING_SCALE_NOW

KEPT: Final = 5_000
"""Maximum number of past estimates."""

CONFIRMED: Final = 2.0
"""A spring scale confirms sensors that agree with it within so many standard deviations,"""

TELLING: Final = 0.1
"""if they know the preload better than by this share."""


def exact(known: Uncertainty | None) -> Uncertainty | None:
    """Standard deviations of no number; what else ``known`` says stays."""
    if known is None:
        return None
    return replace(known, parameters=(), covariance=np.zeros((0, 0)), stated=0)


class Corrections:
    """What a robot's sensors say, and the estimate with it."""

    def __init__(
        self, model: Model, changed: Mapping[str, float], sensors: Mapping[str, Sensor]
    ) -> None:
        """Prepare; the members of the robot's ensemble hold no error of its numbers, see ``exact``.

        Args:
            model: the robot.
            changed: numbers of its file that were measured at run time, see ``narrowed``.
            sensors: all that it may have, by name.
        """
        self.model = model
        self.sensors = sensors
        self.groups = [Group(model, cables, changed) for cables in _groups_of(model, sensors)]
        self._columns = stddev_columns(model.layout)
        self._group_of = {c: group for group in self.groups for c in group.cables}
        self.doubted = NO_DOUBTS
        """Whether each element is of a cable that carries nothing, shape (elements,) or (0,)."""
        self._past: deque[Past] = deque(maxlen=KEPT)
        self._said = np.zeros((3, len(self.groups), self._columns.size))
        """What the sensors of every group say."""
        self._shift, self._known, self._left = np.zeros((3, self._columns.size))
        """What all say: of a joint's effort, which several groups share, the changes add up."""
        self._least = unmodelled(model)[1]

    def forget(self) -> None:
        """Forget what sensors have said."""
        for group in self.groups:
            group.forget()
        self.restart()

    def restart(self) -> None:
        """Begin with an unknown history; what is known of robot and sensors is kept."""
        for group in self.groups:
            group.restart()
        self.doubted = NO_DOUBTS
        self._past.clear()
        self._said[1] = self._known[:] = 0.0

    def widen(self, changes: Vector) -> None:
        """Leave open changes of all cables' mean tensions of these sizes [N], shape (cables,)."""
        for group in self.groups:
            group.widen(changes)

    def take(
        self, sample: Sample, estimate: Estimate, readings: Iterable[Reading], ensemble: Ensemble
    ) -> None:
        """Take a sample and the readings up to it, and ``correct`` the model's estimate.

        Beliefs and what is said of the present are renewed by one group after the other, so that no
        sample waits for all; many sensors that read at different times cost no more than one.

        Args:
            sample: not a predicted one.
            estimate: for it by the model, with standard deviations; changed.
            readings: that have become due.
            ensemble: whose members have been updated with the sample.
        """
        assert estimate.stddev is not None
        now = Past(sample.stamp_ns, estimate.values[self._columns], estimate.stddev)
        self._past.append(now)
        while now.stamp_ns - self._past[0].stamp_ns > HISTORY_NS:
            self._past.popleft()
        for reading in readings:
            sensor = self.sensors[reading.name]
            self._group_of[sensor.cables[0]].waiting.append((reading, sensor))
        renewed = False
        for k, group in enumerate(self.groups):
            phase = k / len(self.groups)
            if not group.is_solved(estimate):
                continue
            if (found := group.take(sample, phase, self._past, ensemble.deviation)) is not None:
                self._said[:, k, group.columns] = found
                renewed = True
        if renewed:
            self._shift, self._left = self._said[[0, 2]].sum(axis=1)
            self._known = self._said[1].max(axis=0)
            broken = {group.verdict.broken for group in self.groups if group.verdict} - {""}
            robot = self.model.robot
            gone = [cable.name in broken for cable in robot.cables]
            self.doubted = robot.per_element(gone) if broken else NO_DOUBTS
        self.correct(estimate, ensemble.variance)

    def doubted_beside(self, elements: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Flagged elements with all of their groups, and those of cables that carry nothing.

        What sensors say of one cable of a group depends on the estimates of the others.

        Args:
            elements: flags, shape (elements,).

        Returns:
            Likewise.
        """
        found, parts = elements.copy(), self.model.robot.parts
        for group in self.groups:
            if any(elements[parts[c]].any() for c in group.cables):
                for c in group.cables:
                    found[parts[c]] = True
        return found | self.doubted if self.doubted.size else found

    def correct(self, estimate: Estimate, history: Vector) -> None:
        """Change an estimate with standard deviations into that with what the sensors say.

        Args:
            estimate: of the model, changed.
            history: variances of its quantities by the members.
        """
        assert estimate.stddev is not None
        estimate.stddev = correct(
            self.model.core, estimate.values, estimate.stddev, history,
            self._shift, self._known, self._left, self._least,
        )  # fmt: skip

    @property
    def refused(self) -> int:
        """Number of readings that were too old."""
        return sum(group.refused for group in self.groups)

    def report(self, travel: str = "") -> Report:
        """What the readings say about robot and sensors, and ``travel`` of motors."""
        return report(self.model.robot, [group.verdict for group in self.groups], travel)

    @property
    def right(self) -> dict[str, float]:
        """Probability that each sensor that was heard is right, by name."""
        return {
            name: group.beliefs.probability_right(k)
            for group in self.groups
            for name, k in group.index.items()
        }

    def words(self) -> dict[str, str]:
        """What is known of each sensor that was heard, by name."""
        right, found = self.right, {}
        for group in self.groups:
            mean, stddev = group.beliefs.moments()
            unknowns = {one.name: k for k, one in enumerate(group.unknowns)}
            for k, sensor in enumerate(group.beliefs.sensors):
                bias, gain = group.beliefs.errors_of(k)
                _, used, frozen = group.beliefs.core.heard(k)
                unit = sensor.unit
                words = (
                    f"right with {right[sensor.name]:.0%}; {used} readings; "
                    f"bias {mean[bias]:.3g} +- {stddev[bias]:.2g} {unit}, "
                    f"gain {mean[gain]:+.1%} +- {stddev[gain]:.1%}"
                )
                friction = unknowns.get(AXIS.what.format(sensor.name))
                if friction is not None:
                    size = group.unknowns[friction].unit
                    words += (
                        f", friction {size * mean[friction]:.3g} +- "
                        f"{size * stddev[friction]:.2g} {unit}"
                    )
                found[sensor.name] = words + (", frozen" if frozen else "")
        return found

    def confirmed_by(self, preloads: Mapping[str, float]) -> set[str]:
        """Sensors of cables whose preload, read on a spring scale [N], is as they say."""
        found, changes = set[str](), self.changes()
        for c, cable in enumerate(self.model.robot.cables):
            value = preloads.get(cable.name)
            if value is None:
                continue
            by, stddev = changes[f"cables.{cable.name}.preload"]
            allowed = CONFIRMED * float(np.hypot(stddev, SPRING_SCALE_NOW * value))
            if stddev <= TELLING * value and abs(value - cable.preload - by) <= allowed:
                heard = self._group_of[c].beliefs.sensors
                found |= {one.name for one in heard if c in one.cables}
        return found

    def changes(self) -> dict[str, tuple[float, float]]:
        """``Group.changes`` of all groups."""
        return {path: one for group in self.groups for path, one in group.changes().items()}

    def memory(self) -> list[dict[str, Any]]:
        """What ``recall`` needs to go on, as JSON."""
        return [group.memory() for group in self.groups]

    def recall(self, memory: Sequence[Mapping[str, Any]]) -> None:
        """Take up ``memory``.

        Raises:
            KeyError, TypeError, ValueError: it is not one of this robot.
        """
        if len(memory) != len(self.groups):
            raise ValueError("other groups of cables")
        for group, own in zip(self.groups, memory, strict=True):
            group.recall(own, self.sensors)


def _groups_of(model: Model, sensors: Mapping[str, Sensor]) -> list[list[int]]:
    """Cables that depend on each other, or whose sum an effort reads."""
    groups = [set(one) for one in connected_cables(model.robot, branches=True)]
    for sensor in sensors.values():
        touched = [one for one in groups if one.intersection(sensor.cables)]
        groups = [one for one in groups if one not in touched] + [set().union(*touched)]
    return sorted(sorted(one) for one in groups)
