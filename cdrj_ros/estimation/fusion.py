"""Fusion of measured tensions and efforts by an ensemble Kalman filter, with sensor checks.

A load cell at one element corrects every element of its cable through the covariance of the
members' tensions; a motor's effort corrects all cables on its drum.  The corrected quantity is the
material in the elements, which determines elongation, friction history and preload together.  Here
is decided which readings are used, and with which errors; the correction itself is that of
``Preloads.update``.  See docs/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any, Final

import numpy as np

from cdrj_ros.estimation.draws import standard
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import Estimate, Sample, State
from cdrj_ros.estimation.innovation_gate import (
    FILE_ERROR,
    HISTORY_ERROR,
    PreloadEvidence,
    SensorState,
    finite,
)
from cdrj_ros.estimation.known_sensors import KnownSensors
from cdrj_ros.estimation.lasting_error import BIAS, CELL, EFFORT, LastingError, MotorFriction
from cdrj_ros.estimation.measurements import (
    Expected,
    Measurement,
    PastEstimates,
    Quantity,
    WaitingMeasurements,
    quantities_of,
)
from cdrj_ros.estimation.preloads import FREE_DRIFT, SLOW_DRIFT, START_SHARE, Innovation, Preloads
from cdrj_ros.estimation.sensor_health import enough
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.prepared import Model

MODEL_ERROR: Final = 0.01
"""Standard deviation of the model's error, in addition to the sensor's noise, as a fraction of the
measured value: of a lasting error, and of another one in every reading."""

EFFORT_ERROR: Final = 0.02
"""The same for an effort, as a fraction of the torque of the preloads: an effort is a small
difference of cables, and its errors last over many readings."""

SINCE: Final = 2.0
"""What a late reading errs by as a statement about the present, per relative change of the estimate
since its time [standard deviations of the estimate], (U16)."""

SUDDEN: Final = 0.5
"""Largest sudden change of the preloads that a motor's effort may show, as a fraction of them."""

UNCONFIRMED: Final = 1.0 / 3.0
"""Standard deviation of a preload of which one load cell, or an effort alone, says otherwise than
the robot file, as a fraction of the difference: either is wrong."""

LARGEST: Final = 1e9
"""Measured values of larger magnitude are refused [N or N m]."""


class SensorFusion:
    """Corrects the estimate and the ensemble with measured tensions and efforts."""

    def __init__(self, ensemble: Ensemble, *, track_preload: bool = False) -> None:
        """Begin without measurements.

        Args:
            ensemble: the robot's ensemble, changed by every correction.
            track_preload: whether efforts are used; preloads without load cell drift freely then.
        """
        drift = FREE_DRIFT if track_preload else SLOW_DRIFT
        self.sensors = KnownSensors(quantities_of(ensemble.model), drift)
        """Which of them are trusted, and what is known of each."""
        self._changed = np.zeros(len(ensemble.model.robot.cables))
        """Sum of the corrections of every preload [N]."""
        self._unconfirmed = np.zeros_like(self._changed)
        """Standard deviation that they keep since only one load cell shows them [N]."""
        self.waiting = WaitingMeasurements(
            ensemble.model.robot, self.sensors.quantities, takes_efforts=track_preload
        )
        """The readings of these sensors."""
        self._adopt(ensemble)

    def _adopt(self, ensemble: Ensemble) -> None:
        """Prepare for the members of an ensemble."""
        self.ensemble, self.model = ensemble, ensemble.model
        robot = self.model.robot
        self._preloads = Preloads(ensemble)
        self.waiting.robot = robot
        self._past = PastEstimates(ensemble.columns)
        self._friction = MotorFriction(robot)

    def use(self, ensemble: Ensemble) -> None:
        """Continue with other numbers of the robot; what is known of sensors and preloads stays."""
        known = self._preloads.known
        ensemble.keep_preloads(self.ensemble)
        self._adopt(ensemble)
        self._preloads.known = known
        self._preloads.show_at_least(self._unconfirmed)
        self._compare_anew()

    # --- what is known of sensors and preloads ----------------------------------------------------

    def reset(self) -> None:
        """Discard all measurements; every sensor is on trial again."""
        self.sensors.health.clear()
        self.forget()

    def restart(self, *, known: bool) -> None:
        """Begin anew, as the estimate does.

        Args:
            known: whether what is known of preloads and sensors is kept.  While friction is unknown
                nothing contradicts a sensor, so that all are on trial again; those dropped stay so.
        """
        self.waiting.forget()
        if known:
            self._compare_anew()
            self.sensors.try_again()
        else:
            dropped = self.sensors.faults()
            self.reset()
            self.sensors.drop(dropped)

    def forget(self) -> None:
        """Discard all measurements and corrections, but keep which sensors are trusted or dropped.

        The ensemble starts anew, with preloads as uncertain as at first.
        """
        self._forget_readings()
        self.sensors.states.clear()
        self._changed[:] = self._unconfirmed[:] = 0.0
        self._preloads.show_at_least(self._unconfirmed)
        self._preloads.restore()

    def _compare_anew(self) -> None:
        """Compare readings to come with estimates to come only."""
        self._forget_readings()
        self.sensors.pause()

    def _forget_readings(self) -> None:
        """Forget the latest estimates and when sensors were read; the next ones begin anew."""
        self._past.forget()
        self._friction.forget()
        self.sensors.forget_readings()

    def undo(self, name: str) -> None:
        """Forget all corrections and waiting measurements, because a sensor was wrong.

        Sensors that are still trusted then correct anew.  What the wrong one said last may be right
        all the same: the preloads are at least that uncertain.
        """
        self.waiting.clear()
        self.forget()
        what = self.sensors.quantities[name]
        residual = self.sensors.health[name].residual
        self._preloads.widen_before_start(residual, what.column, what.cables)

    def memory(self) -> dict[str, Any]:
        """What ``recall`` needs to go on with the sensors of an earlier run, as JSON."""
        return {
            **self.sensors.memory(),
            "changed": self._changed.tolist(),
            "unconfirmed": self._unconfirmed.tolist(),
            "known": self._preloads.known.tolist(),
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take up ``memory``; the ensemble is that of the earlier run, too.

        Raises:
            KeyError, TypeError, ValueError, AttributeError: it is not one of this robot; nothing
                has changed then.
        """
        cables, members = self._changed.size, len(self.ensemble.states)
        changed, unconfirmed, known = (
            finite(memory[key], cables) for key in ("changed", "unconfirmed", "known")
        )
        self.sensors.recall(memory, members)
        self._changed, self._unconfirmed, self._preloads.known = changed, unconfirmed, known
        self._preloads.show_at_least(self._unconfirmed)

    def start_model(self) -> Model:
        """The robot with the preloads that are known by now, for the first sample."""
        return self._preloads.corrected(self.model)

    def drift_unmeasured(self, seconds: float) -> None:
        """Let the preloads drift over a time without readings [s]."""
        shares = self.sensors.drifts(self._changed.size)
        self._preloads.drift_unmeasured(seconds, shares)

    # --- corrections ------------------------------------------------------------------------------

    def correct(
        self,
        sample: Sample,
        estimate: Estimate,
        uncorrected: Vector,
        state: State,
        corrected_by: set[str],
    ) -> tuple[State, str]:
        """Apply the measurements up to a sample, until a sensor that made corrections is dropped.

        Args:
            sample: the last processed sample.
            estimate: for it.
            uncorrected: its values without corrections, see ``Estimate.values``.
            state: the state after that sample.
            corrected_by: sensors whose corrections the state contains; those that follow are added.

        Returns:
            The corrected state, and the name of the dropped sensor; empty if there is none.
        """
        direction = self._friction.turn(sample.motor_angle)
        self._past.add(estimate.stamp_ns, estimate.values, uncorrected, direction)
        for measured in self.waiting.due(sample.stamp_ns):
            dropped = len(self.sensors.faults())
            corrected = self._correct_with(sample, state, measured)
            if corrected is not state:
                corrected_by.add(measured.name)
            state = corrected
            if len(self.sensors.faults()) != dropped and measured.name in corrected_by:
                return state, measured.name
        return state, ""

    def _correct_with(self, sample: Sample, state: State, measured: Measurement) -> State:
        """Correct the state and the ensemble with one measurement, unless it is refused."""
        value, what = measured.value, self.sensors.quantities[measured.name]
        health = self.sensors.health_of(measured.name)
        found = self._past.expected(measured.stamp_ns, what.column, what.motor)
        if not abs(value) <= LARGEST or found is None or not isfinite(found.uncorrected):
            health.refused += 1
            return state
        now = Estimate(sample.stamp_ns, self._past.last, self.model.layout, True)
        self.ensemble.catch_up(sample, now)
        state = self._use(sample.stamp_ns, state, measured, found)
        if self.ensemble.variance_is_old:
            self.ensemble.renew_variance()
        return state

    def _use(self, stamp_ns: int, state: State, measured: Measurement, found: Expected) -> State:
        """The same with what is expected of the reading, but for the ensemble's variances.

        Args:
            stamp_ns: time of the last processed sample [ns].
            state: after that sample.
            measured: at most ``HISTORY_NS`` before the sample; with a positive ``noise``.
            found: what is expected of it.
        """
        expected, uncorrected, direction, change = found
        name, value, what = measured.name, measured.value, self.sensors.quantities[measured.name]
        health = self.sensors.health[name]
        shares = {c: self.sensors.drift_of(c, stamp_ns) for c in what.cables}
        passed = self.sensors.read(name, stamp_ns)
        self._preloads.drift(passed, shares, self.sensors.lasting())
        own = measured.noise**2 + self._model_error(what, value) ** 2
        own += self._since(what, expected, change)
        sensor = self.sensors.states.get(name)
        if sensor is not None:
            sensor.errors.pass_time(passed, self._draw)
        factors = np.array([1.0, expected, direction])
        error = float(factors @ sensor.errors.error) if sensor is not None else 0.0
        variance = self._variance(what.column, sensor, factors) + own
        usable = health.evaluate(value, expected + error, uncorrected, variance, own)
        if health.dropped:
            self.sensors.states.pop(name, None)
        if not health.trusted or health.dropped:
            return state
        if sensor is None:
            sensor = self.sensors.states[name] = self._new_sensor(what, abs(value - expected))
        if not what.is_effort:
            most = max(sensor.model_error, MODEL_ERROR * max(abs(value), health.largest))
            sensor.model_error = most
        innovation = value - expected - error
        accepted = self._accept(name, sensor, stamp_ns, innovation, variance)
        if not usable:  # counted already
            return state
        if not accepted:
            health.refused += 1
            return state
        health.used += 1
        state = self._apply(what, sensor, Innovation(innovation, own, factors), state)
        sensor.evidence.follow(uncorrected, enough(own, uncorrected))
        self._leave_open(sensor, what)
        self._confirm(what, stamp_ns)
        health.dropped = sensor.errors.wrong(factors, sensor.history_error)
        return state

    def _new_sensor(self, what: Quantity, first: float) -> SensorState:
        """The state of a sensor at its first correction, of size ``first`` [N] or [N m]."""
        scale = self._preloads.scale(what.column, what.cables)
        friction = self._friction.stddev(what.motor, scale) if what.is_effort else 0.0
        kind = EFFORT if what.is_effort else CELL
        errors = LastingError.of(kind, scale, friction, self._draw)
        evidence = PreloadEvidence(first, stddev=FILE_ERROR * scale)
        return SensorState(errors, history_error=HISTORY_ERROR * first, evidence=evidence)

    def _accept(
        self, name: str, sensor: SensorState, stamp_ns: int, innovation: float, variance: float
    ) -> bool:
        """Whether to use a reading; widens what may have changed if several contradict.

        An effort is used in any case: it is often the only sign of a lost preload, and to leave it
        open would leave half of the loss uncorrected.
        """
        what = self.sensors.quantities[name]
        scale = self._preloads.scale(what.column, what.cables)
        share = max(self.sensors.drift_of(c, stamp_ns) for c in what.cables)
        if not what.is_effort:
            sensor.checked_by_effort = self.sensors.is_checked_by_effort(name, stamp_ns)
        gated = sensor.gate(stamp_ns, innovation, variance, (share * scale) ** 2)
        possible = abs(sensor.contradiction) <= (SUDDEN if what.is_effort else START_SHARE) * scale
        if gated == "changed" and possible:
            self._widen(sensor, what)
            self.sensors.health[name].doubt()
        return what.is_effort or gated == "agrees" or (gated == "changed" and possible)

    def _apply(
        self, what: Quantity, sensor: SensorState, innovation: Innovation, state: State
    ) -> State:
        """Correct the state and the ensemble, and note by how much."""
        values = state.values
        gain = self._preloads.update(what, sensor, innovation, self.sensors.lasting(), values)
        for c in what.cables:
            index = self._preloads.indices[c]
            self._changed[c] += float(gain[index.elements] @ index.weight) * innovation.size
        self._past.corrected = self._past.corrected + gain * innovation.size
        return State(state.stamp_ns, values)

    def _widen(self, sensor: SensorState, what: Quantity) -> None:
        """Leave open by which preloads readings have changed; by a load cell's error as well."""
        size, ensemble = abs(sensor.contradiction), self.ensemble
        known = self.sensors.lasting()
        known.append(ensemble.deviation[:, what.column])  # a view: it follows the change
        self._preloads.widen(size, what.column, what.cables, known)
        if not what.is_effort:
            bias = sensor.errors.deviation[BIAS]
            bias += size * standard(ensemble.generator, len(ensemble.states), known)
        for one in self.sensors.states.values():
            one.forget()
            if not what.is_effort:
                one.evidence.renew()

    def _leave_open(self, sensor: SensorState, what: Quantity) -> None:
        """Leave open whether a sensor drifts or the preloads creep, (U10)."""
        change = self._preloads.total(self._changed, what)
        size = sensor.evidence.contradicted(change, self._preloads.stddev(what))
        if size > 0.0:
            bias = sensor.errors.deviation[BIAS]
            bias -= self._preloads.exchange(size, what, self.sensors.lasting())

    def _confirm(self, what: Quantity, stamp_ns: int) -> None:
        """Note whether more than one load cell confirms the corrections of cables, (U15).

        An effort shows the difference of cables.  So the corrections of cables without load cell
        that share an effort with one that has a cell follow from that cell's, and an effort alone
        confirms none.
        """
        recent = self.sensors.recent(stamp_ns).values()
        with_cell = [one.cables[0] for one in recent if not one.is_effort]
        if what.is_effort and not set(with_cell).isdisjoint(what.cables):
            return
        for cable in what.cables:
            share = 0.0 if with_cell.count(cable) > 1 else UNCONFIRMED
            for one in recent:
                for c in one.cables if cable in one.cables else ():
                    if c == cable or c not in with_cell:
                        self._unconfirmed[c] = share * self._changed[c]
        self._preloads.show_at_least(self._unconfirmed)

    # --- errors -----------------------------------------------------------------------------------

    def _draw(self, apart: Sequence[Vector]) -> Vector:
        """See ``lasting_error.Draw``."""
        known = [*self.sensors.lasting(), *(one for one in apart if one.any())]
        return standard(self.ensemble.generator, len(self.ensemble.states), known)

    def _variance(self, column: int, sensor: SensorState | None, factors: Vector) -> float:
        """Variance of a quantity together with the lasting error of its sensor."""
        h = self.ensemble.deviation[:, column]
        if sensor is not None:
            h = h + factors @ sensor.errors.deviation
        return float(h @ h) / h.size

    def _model_error(self, what: Quantity, value: float) -> float:
        """Standard deviation of the model's error in one reading [N] or [N m]."""
        if not what.is_effort:
            return MODEL_ERROR * abs(value)
        scale = self._preloads.scale(what.column, what.cables)
        return max(MODEL_ERROR * abs(value), EFFORT_ERROR * scale)

    def _since(self, what: Quantity, expected: float, change: float) -> float:
        """Variance of a reading for what has changed since its time, (U16).

        Args:
            what: the measured quantity.
            expected: of the reading [N] or [N m].
            change: of the estimate since then [N] or [N m].
        """
        scale = max(abs(expected), self._preloads.scale(what.column, what.cables))
        return self._variance(what.column, None, np.empty(0)) * (SINCE * change / scale) ** 2
