"""A group of cables that depend on each other: their unknowns, and what sensors say about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.beliefs import Beliefs
from cdrj_ros.estimation.ensemble import stddev_columns
from cdrj_ros.estimation.estimator import Sample
from cdrj_ros.estimation.present import present
from cdrj_ros.estimation.sensors import Sensor
from cdrj_ros.estimation.signatures import Signatures
from cdrj_ros.estimation.unknowns import unknowns_of
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.packing import stddev_places
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Uncertainty
from cdrj_ros.robot.groups import has_number, part_of
from cdrj_ros.robot.reader import build_robot


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
        self.signatures = Signatures(own, self.unknowns, stddev_columns(own.layout))
        self.beliefs = Beliefs(self.unknowns)
        self.columns = _columns_in(model, own)
        """Index of every quantity of the group among those of the robot."""
        self.place = {column: k for k, column in enumerate(self.columns.tolist())}
        self.index: dict[str, int] = {}
        """Index of every sensor that was heard in ``beliefs``, by name."""
        self._related: list[NDArray[np.bool_]] = []
        self._own = own
        self._cable_of = _cables_of_columns(own)

    def follow(self, sample: Sample) -> bool:
        """``Signatures.follow`` of the group, with a sample of the whole robot."""
        return self.signatures.follow(
            sample.stamp_ns, sample.motor_angle[self._motors], sample.joint_angle[self._joints]
        )

    def forget(self) -> None:
        """Forget what sensors have said."""
        self.beliefs = Beliefs(self.unknowns)
        self.index.clear()
        self._related.clear()

    def hear(self, sensor: Sensor) -> int:
        """Index of a sensor in ``beliefs``, which begin to know it."""
        if sensor.name not in self.index:
            self.index[sensor.name] = len(self.index)
            self.beliefs.hear(sensor)
            self._relate(sensor)
        return self.index[sensor.name]

    def _relate(self, sensor: Sensor) -> None:
        own = [self.cables.index(c) for c in sensor.cables if c in self.cables]
        self._related.append(np.isin(self._cable_of, [-1, *own]))

    def correction(
        self, stamp_ns: int, values: Vector, deviation: Table
    ) -> tuple[Vector, Vector, Vector]:
        """``present`` for the group, from quantities and members of the whole robot."""
        return present(
            self.beliefs, stamp_ns, values[self.columns], self.signatures.slopes,
            deviation[:, self.columns], self.place,
            np.array(self._related, dtype=np.bool_).reshape(-1, self.columns.size),
        )  # fmt: skip

    def preload_of(self, cable: str) -> tuple[float, float] | None:
        """The preload of a cable and its standard deviation [N]; None if it is of another group."""
        names = self._own.layout.cables
        if cable not in names:
            return None
        change = [one.name for one in self.unknowns].index(f"preload of {cable}")
        share = np.zeros(self.beliefs.count)
        share[change] = self.unknowns[change].unit
        path = f"cables.{cable}.preload"
        if path in self._parameters:
            share[: self.modes.shape[1]] = self.modes[self._parameters.index(path)]
        mean, stddev = self.beliefs.moment_of(share)
        return self._own.robot.cables[names.index(cable)].preload + mean, stddev

    def recall(self, memory: Mapping[str, Any], sensors: Mapping[str, Sensor]) -> None:
        """Take up the memory of ``beliefs``, whose errors it raises."""
        self.beliefs.recall(memory, sensors)
        self.index = {one.sensor.name: k for k, one in enumerate(self.beliefs.heard)}
        self._related.clear()
        for one in self.beliefs.heard:
            self._relate(one.sensor)


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
