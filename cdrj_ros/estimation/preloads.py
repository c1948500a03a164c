"""The preloads of the members, which other sensors correct: they drift, and may change suddenly.

The correction is one update of an ensemble Kalman filter, (U2) of docs/uncertainty.md, with a gain
from the ensemble (Evensen 2003; perturbed observations, restricted to the cables concerned).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import sqrt
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.cable_index import CableIndex, CableStates, lengthen
from cdrj_ros.estimation.draws import root_mean_square, standard
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.innovation_gate import SensorState
from cdrj_ros.estimation.measurements import Quantity
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.prepared import Model, read_only

SLOW_DRIFT: Final = 0.002
"""Random-walk spread of a preload after 1 s with load cells, as a fraction of the preload."""

FREE_DRIFT: Final = 0.02
"""The same where a motor's effort alone tracks the preload."""

START_SHARE: Final = 0.2
"""Standard deviation of every preload at the start, and its largest sudden change that a sensor may
show, as a fraction of the preload."""


class Innovation(NamedTuple):
    """What a reading says that was not expected."""

    size: float
    """Reading minus what was expected of it [N] or [N m]."""
    variance: float
    """Variance of the errors that are new in every reading."""
    factors: Vector
    """Change of the reading per unit of every unknown of its sensor, see ``LastingError``."""


class MemberCable(NamedTuple):
    """One cable of all members: views of the ensemble's arrays, prepared once."""

    states: CableStates
    start: Table
    """Material in the reference pose [m], shape (members, elements)."""
    tension: Table
    """Deviation of the tensions [N], shape (members, elements)."""
    force: Table
    """Deviation of the forces on its pulleys [N], shape (members, pulleys)."""
    efforts: list[tuple[Vector, float]]
    """Deviation of every effort on which it acts [N m], shape (members,), and that per newton."""


class Preloads:
    """Changes of the preloads in all members."""

    def __init__(self, ensemble: Ensemble) -> None:
        """Prepare for one robot.

        Args:
            ensemble: the robot's ensemble, which every call changes.
        """
        self.ensemble = ensemble
        self.indices = [
            CableIndex(ensemble.model, c) for c in range(len(ensemble.model.robot.cables))
        ]
        self._preload = [max(cable.preload, 1.0) for cable in ensemble.model.robot.cables]
        self._cables = [self._cable(index) for index in self.indices]
        self._scales: dict[int, float] = {}
        self.known = np.zeros(len(self.indices))
        """What the estimate's cables have more in material than the robot file's [m]."""

    def restore(self) -> None:
        """Forget all corrections: every preload is that of the robot file, as uncertain as then."""
        self.known[:] = 0.0
        self.ensemble.restore_preloads()

    def corrected(self, model: Model) -> Model:
        """The robot with the preloads that are known by now."""
        if not self.known.any():
            return model
        constants = model.constants.copy()
        for index, known in zip(self.indices, self.known, strict=True):
            lengthen(index.start(constants), np.asarray(known))
        return replace(model, constants=read_only(constants))

    def update(
        self,
        what: Quantity,
        sensor: SensorState,
        innovation: Innovation,
        lasting: Sequence[Vector],
        values: Vector,
    ) -> Vector:
        """Correct a state, the ensemble and the sensor's lasting error with one reading.

        Args:
            what: the measured quantity.
            sensor: the sensor, whose lasting error is corrected too.
            innovation: of the reading.
            lasting: lasting errors of all sensors in every member, see ``standard``.
            values: of the state, shape (state_size,), changed.

        Returns:
            The gain of every column of the ensemble.
        """
        ensemble = self.ensemble
        deviation = ensemble.deviation
        members = len(deviation)
        errors = sensor.errors
        h = deviation[:, what.column] + innovation.factors @ errors.deviation
        variance = float(h @ h) / members + innovation.variance
        gain = deviation.T @ h / (members * variance)
        gain[what.others] = 0.0
        noise = sqrt(innovation.variance) * standard(ensemble.generator, members, lasting)
        differences = innovation.size - h + noise
        change = differences[:, None] * gain
        for c in what.cables:
            elements = self.indices[c].elements
            self._correct(c, values, gain[elements] * innovation.size, change[:, elements])
        gains = errors.deviation @ h / (members * variance)
        errors.correct(differences, gains, innovation.size)
        own_gain = float(innovation.factors @ gains) if sensor.checked_by_effort else 0.0
        sensor.note((float(gain[what.column]) + own_gain) * innovation.size)
        deviation += change - gain * innovation.size
        ensemble.variance_is_old = True
        return gain

    def _correct(self, c: int, state: Vector, shift: Vector, changes: Table) -> None:
        """Change the tensions of a cable, and what is known of its preload.

        Args:
            c: the cable.
            state: of the estimate, changed.
            shift: of its tensions [N], shape (elements,).
            changes: of those of all members, shape (members, elements).
        """
        estimate, cable = (
            self.indices[c].states(state, self.ensemble.model.constants),
            self._cables[c],
        )
        self.known[c] += estimate.stretch(shift)
        lengthen(cable.start, cable.states.stretch(changes))

    def drift_unmeasured(self, seconds: float, shares: Sequence[float]) -> None:
        """Let the preloads drift while nothing was measured, by no more than they may at the start.

        Args:
            seconds: the time [s].
            shares: as for ``drift``, of every cable.
        """
        shares = [min(share * sqrt(seconds), START_SHARE) for share in shares]
        self.vary(np.multiply(shares, self._preload))

    def vary(self, sizes: Vector) -> None:
        """Add independent changes of these standard deviations [N], shape (cables,), to them."""
        for c, size in enumerate(sizes):
            change = size * standard(self.ensemble.generator, len(self.ensemble.states))
            if self.ensemble.started:
                self._shift(c, change)
            else:
                self.indices[c].preload(self.ensemble.constants, change)
        self.ensemble.renew_variance()

    def mean_tensions(self, tension: Vector) -> Vector:
        """Mean tension of every cable [N], which slip along it does not change, shape (cables,)."""
        return np.array([tension[one.elements] @ one.weight for one in self.indices])

    def widen_before_start(self, size: float, column: int, cables: list[int]) -> None:
        """Add to every preload what would change a measured quantity by ``size``, before a start.

        At most its own size is added to a preload.
        """
        for c, arm in self._arms(column, cables):
            normal = standard(self.ensemble.generator, len(self.ensemble.states))
            change = min(abs(size / arm), self._preload[c])
            self.indices[c].preload(self.ensemble.constants, change * normal)

    def drift(self, seconds: float, shares: Mapping[int, float], apart: Sequence[Vector]) -> None:
        """Add a random walk to every member's preloads, since preloads are not constant.

        Args:
            seconds: time since the last reading that corrected the cables [s].
            shares: standard deviation of every preload's random walk after 1 s, as a fraction of
                it, by cable.
            apart: see ``standard``.
        """
        if seconds <= 0.0:
            return
        ensemble = self.ensemble
        for c, share in shares.items():
            normal = standard(ensemble.generator, len(ensemble.states), apart)
            self._shift(c, share * self._preload[c] * sqrt(seconds) * normal)

    def scale(self, column: int, cables: list[int]) -> float:
        """Change of a measured quantity if all preloads vary by themselves [N] or [N m] (RMS)."""
        if column not in self._scales:
            changes = [(arm * self._preload[c]) ** 2 for c, arm in self._arms(column, cables)]
            self._scales[column] = sqrt(sum(changes))
        return self._scales[column]

    def widen(self, size: float, column: int, cables: list[int], apart: Sequence[Vector]) -> None:
        """Add to every preload what would change a measured quantity by ``size``."""
        ensemble = self.ensemble
        for c, arm in self._arms(column, cables):
            self._shift(
                c, size / abs(arm) * standard(ensemble.generator, len(ensemble.states), apart)
            )

    def total(self, changes: Vector, what: Quantity) -> float:
        """What changes of all preloads [N], shape (cables,), are worth in a quantity."""
        arms = self._arms(what.column, what.cables)
        return sum(arm * float(changes[c]) for c, arm in arms)

    def stddev(self, what: Quantity) -> float:
        """Standard deviation of what the preloads, that is the mean tensions, are worth in it."""
        arms = self._arms(what.column, what.cables)
        return root_mean_square(
            sum(arm * (self._cables[c].tension @ self.indices[c].weight) for c, arm in arms)
        )

    def exchange(self, size: float, what: Quantity, apart: Sequence[Vector]) -> Vector:
        """Vary the preloads by themselves so that a quantity varies by ``size``.

        Args:
            size: standard deviation of the quantity [N] or [N m].
            what: the quantity, with which the changes are not correlated.
            apart: see ``standard``.

        Returns:
            The change of the quantity in every member, shape (members,).
        """
        ensemble = self.ensemble
        known = [*apart, ensemble.deviation[:, what.column]]
        arms = self._arms(what.column, what.cables)
        changes = np.zeros(len(ensemble.states))
        for c, arm in arms:
            normal = standard(ensemble.generator, changes.size, known)
            change = size / sqrt(len(arms)) * normal
            known.append(change)
            self._shift(c, change / arm)
            changes += change
        return changes

    def show_at_least(self, sizes: Vector) -> None:
        """Show no smaller standard deviations than those of changes of all preloads, (U15).

        Args:
            sizes: standard deviations, with signs that tell which rise together [N], shape
                (cables,).
        """
        changes = np.zeros(self.ensemble.columns.size)
        for index, size in zip(self.indices, sizes, strict=True):
            changes[index.elements] = size
            changes[index.pulleys] = size * index.lever
            for column, arm in index.motors:
                changes[column] += arm * size
        self.ensemble.core.least_variance[:] = changes**2

    def _arms(self, column: int, cables: list[int]) -> list[tuple[int, float]]:
        """Cables that act on a measured quantity, and its change per newton in each of them."""
        if column < len(self.ensemble.model.layout.elements):
            return [(c, 1.0) for c in cables]
        arms = [(c, sum(arm for at, arm in self.indices[c].motors if at == column)) for c in cables]
        return [(c, arm) for c, arm in arms if arm != 0.0]

    def _cable(self, index: CableIndex) -> MemberCable:
        """The views of one cable."""
        ensemble, deviation = self.ensemble, self.ensemble.deviation
        return MemberCable(
            states=index.states(ensemble.states, ensemble.constants),
            start=index.start(ensemble.constants),
            tension=deviation[:, index.elements],
            force=deviation[:, index.pulleys],
            efforts=[(deviation[:, column], arm) for column, arm in index.motors],
        )

    def _shift(self, c: int, tension: Vector) -> None:
        """Change the tension of a cable [N] in every member, shape (members,)."""
        cable, shift = self._cables[c], tension[:, None]
        lengthen(cable.start, cable.states.stretch(shift))
        np.add(cable.tension, shift, out=cable.tension)
        np.add(cable.force, shift * self.indices[c].lever, out=cable.force)
        for effort, arm in cable.efforts:
            np.add(effort, arm * tension, out=effort)
        self.ensemble.variance_is_old = True
