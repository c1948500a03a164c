"""Fusion of measured tensions and efforts by an ensemble Kalman filter, with sensor checks.

A load cell at one element corrects every element of its cable through the covariance of the
members' tensions; a motor's effort corrects all cables on its drum.  The corrected quantity is the
material in the elements, which determines elongation, friction history and preload together.  Here
is decided which readings are used, and with which errors; the correction itself is that of
``cdrj_ros.estimation.kalman``.  See docs/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.claims import HISTORY_ERROR, Claim
from cdrj_ros.estimation.contest import WINDOW_NS, Answer, Witness, finite
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import Estimate, State
from cdrj_ros.estimation.independent_draws import root_mean_square, standard
from cdrj_ros.estimation.kalman import Innovation, update
from cdrj_ros.estimation.motor_friction import FRICTION_DRIFT, MotorFriction
from cdrj_ros.estimation.past import PastEstimates
from cdrj_ros.estimation.preloads import DOUBT, SLOW_DRIFT, Preloads
from cdrj_ros.estimation.quantities import Quantity, quantities_of
from cdrj_ros.estimation.sensor_health import SensorHealth, enough
from cdrj_ros.estimation.waiting import Measurement
from cdrj_ros.model.prepared import Model

Vector = NDArray[np.float64]

MODEL_ERROR: Final = 0.01
"""Standard deviation of the model's error, in addition to the sensor's noise, as a fraction of the
measured value: of a lasting error, and of another one in every reading."""

EFFORT_ERROR: Final = 0.02
"""The same for an effort, as a fraction of the torque of the preloads: an effort is a small
difference of cables, and its errors last over many readings."""

SUDDEN: Final = 0.5
"""Largest sudden change of the preloads that a motor's effort may show, as a fraction of them."""

LARGEST: Final = 1e9
"""Measured values of larger magnitude are refused [N or N m]."""


class Fusion:
    """Corrects the estimate and the ensemble with measured tensions and efforts."""

    def __init__(self, spread: Spread, drift: float = SLOW_DRIFT) -> None:
        """Prepare for one robot.

        Args:
            spread: the robot's ensemble, changed by every correction.
            drift: random-walk spread of a preload after one second, as a fraction of the preload,
                where no load cell measures the cable.
        """
        model = spread.model
        self.spread = spread
        self.model = model
        self._drift = drift
        self._preloads = Preloads(spread)
        self._quantities = quantities_of(model)
        self.health: dict[str, SensorHealth] = {}
        self._witnesses: dict[str, Witness] = {}
        """The trusted sensors whose readings have been used."""
        self._past = PastEstimates(spread.columns)
        self._friction = MotorFriction(model.robot)
        self._changed = np.zeros(len(model.robot.cables))
        """Sum of the corrections of every preload [N]."""

    def reset(self) -> None:
        """Discard all measurements; every sensor is on trial again."""
        self.health.clear()
        self.forget()

    def restart(self) -> None:
        """Discard all measurements; all sensors but those dropped are on trial again."""
        dropped = self.faults()
        self.reset()
        self.drop(dropped)

    def pause(self) -> None:
        """Keep what is known of preloads and sensors, although the estimate starts anew.

        While friction is unknown nothing contradicts a sensor, so that all are on trial again.
        """
        self._compare_anew()
        for health in self.health.values():
            health.try_again()

    def keep(self, other: Fusion) -> None:
        """Take over what is known of preloads and sensors, for other numbers of the same robot."""
        self.health, self._witnesses = other.health, other._witnesses
        self._changed, self._preloads.known = other._changed, other._preloads.known
        self.spread.keep_preloads(other.spread)
        self._compare_anew()

    def _compare_anew(self) -> None:
        """Compare readings to come with estimates to come only."""
        self._forget_readings()
        for health in self.health.values():
            health.pause()
        for witness in self._witnesses.values():
            witness.forget()

    def memory(self) -> dict[str, Any]:
        """What ``recall`` needs to go on with the sensors of an earlier run, as JSON."""
        return {
            "sensors": {name: one.memory() for name, one in self.health.items()},
            "witnesses": {name: one.memory() for name, one in self._witnesses.items()},
            "changed": self._changed.tolist(),
            "known": self._preloads.known.tolist(),
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take up ``memory``; the ensemble is that of the earlier run, too.

        Raises:
            KeyError, TypeError, ValueError, AttributeError: it is not one of this robot; nothing
                has changed then.
        """
        cables, members = self._changed.size, len(self.spread.states)
        health = {str(n): SensorHealth.recalled(n, o) for n, o in memory["sensors"].items()}
        witnesses = {str(n): Witness.recalled(o, members) for n, o in memory["witnesses"].items()}
        if not set(witnesses) <= set(health) <= set(self._quantities):
            raise ValueError("sensors that the robot does not have")
        changed, known = (finite(memory[key], cables) for key in ("changed", "known"))
        self.health, self._witnesses = health, witnesses
        self._changed, self._preloads.known = changed, known

    def beginning(self) -> Model:
        """The robot with the preloads that are known by now, for the first sample."""
        return self._preloads.corrected(self.model)

    def pass_unwatched(self, seconds: float) -> None:
        """Let the preloads drift over a time without readings [s]."""
        heard = [self._quantities[name] for name in self._witnesses]
        measured = {one.cables[0] for one in heard if not one.is_effort}
        cables = range(self._changed.size)
        shares = [min(self._drift, SLOW_DRIFT) if c in measured else self._drift for c in cables]
        self._preloads.pass_unwatched(seconds, shares)

    def take_back(self, name: str) -> None:
        """Forget all corrections, because a sensor that made some was wrong.

        What it said last may be right all the same: the preloads are at least that uncertain.
        """
        self.forget()
        what = self._quantities[name]
        self._preloads.widen(self.health[name].away, what.column, what.cables)

    def faults(self) -> dict[str, str]:
        """Why sensors have been dropped, by name."""
        return {name: one.dropped for name, one in self.health.items() if one.dropped}

    def drop(self, faults: Mapping[str, str]) -> None:
        """Drop sensors, for the reasons given by name."""
        for name, why in faults.items():
            self.health[name] = SensorHealth(name, dropped=why)

    def forget(self) -> None:
        """Discard all measurements and corrections, but keep which sensors are trusted or dropped.

        The ensemble starts anew, with preloads as uncertain as at first.
        """
        self._forget_readings()
        self._witnesses.clear()
        self._changed[:] = 0.0
        self._preloads.restore()

    def _forget_readings(self) -> None:
        """Forget the latest estimates and when sensors were read; the next ones begin anew."""
        self._past.forget()
        self._friction.forget()
        self._preloads.forget()

    @property
    def dropped(self) -> int:
        """Number of dropped sensors."""
        return sum(bool(one.dropped) for one in self.health.values())

    @property
    def contested(self) -> bool:
        """Whether the last reading of a trusted sensor contradicts the estimate."""
        return any(one.contested for one in self._witnesses.values())

    @property
    def motor_friction(self) -> dict[str, tuple[float, float]]:
        """Friction of every tracked motor beyond the robot file's, its standard deviation [N m]."""
        return {
            name: (one.error, root_mean_square(one.deviation))
            for name, one in self._witnesses.items()
            if self._quantities[name].is_effort
        }

    def remember(self, sample: Sample, estimate: Estimate) -> None:
        """Store an estimate for late measurements."""
        direction = self._friction.turn(sample.motor_angle)
        self._past.add(estimate.stamp_ns, estimate.values, direction)

    def noise_of(self, element: str) -> float:
        """Noise of a load cell whose messages give no standard deviation [N]."""
        (cable,) = self._quantities[element].cables
        return self.model.robot.cables[cable].sensor_noise

    def knows(self, element: str) -> bool:
        """Whether the robot has this element."""
        what = self._quantities.get(element)
        return what is not None and not what.is_effort

    def correct(self, sample: Sample, state: State, measured: Measurement) -> State:
        """Judge a measured tension or effort, and correct the state and the ensemble with it.

        Args:
            sample: the last processed sample.
            state: the state after that sample.
            measured: at most ``HISTORY_NS`` before the sample; with a positive ``noise``.

        Returns:
            The corrected state; the same object if the reading was refused.
        """
        name, value, what = measured.name, measured.value, self._quantities[measured.name]
        health = self.health.get(name)
        if health is None:
            health = self.health[name] = SensorHealth(name)
        found = self._past.expected(measured.stamp_ns, what.column, what.motor)
        if not abs(value) <= LARGEST or found is None:
            health.refused += 1
            return state
        now = Estimate(sample.stamp_ns, self._past.last, self.model.layout, True)
        self.spread.catch_up(sample, now)
        state = self._use(sample.stamp_ns, state, measured, *found)
        if self.spread.variance_is_old:
            self.spread.renew_variance()
        return state

    def _use(
        self, stamp_ns: int, state: State, measured: Measurement, expected: float, factor: float
    ) -> State:
        """``correct`` with what is expected of the reading, but for the ensemble's variances.

        Args:
            stamp_ns: time of the last processed sample [ns].
            state: as for ``correct``.
            measured: as for ``correct``.
            expected: current estimate for the time of the measurement [N] or [N m].
            factor: change of ``expected`` per unit of the sensor's lasting error [-].
        """
        name, value, what = measured.name, measured.value, self._quantities[measured.name]
        health = self.health[name]
        errors = [one.deviation for one in self._witnesses.values()]
        shares = {c: self._drift_of(c, stamp_ns) for c in what.cables}
        passed = self._preloads.drift(name, stamp_ns, shares, errors)
        own = measured.noise**2 + self._model_error(what, value) ** 2
        witness = self._witnesses.get(name)
        if witness is not None and what.is_effort:
            share = FRICTION_DRIFT * passed**0.5
            witness.deviation += share * self._unknown(what) * self._draw()
        error = factor * witness.error if witness is not None else 0.0
        variance = self._variance(what.column, witness, factor) + own
        unaided = expected - float(self._past.corrected[what.column])
        usable = health.judge(value, expected + error, unaided, variance, own)
        if health.dropped:
            self._witnesses.pop(name, None)
        if not health.trusted or health.dropped:
            return state
        if witness is None:
            witness = self._heed(name, what, abs(value - expected))
        innovation = value - expected - error
        agrees = self._agrees(name, witness, stamp_ns, innovation, variance)
        if not usable:  # counted already
            return state
        if not agrees:
            health.refused += 1
            return state
        if not what.is_effort:
            self._share(witness, MODEL_ERROR * max(abs(value), health.largest))
        health.used += 1
        state = self._teach(what, witness, Innovation(innovation, own, factor), state)
        if not what.is_effort:
            witness.claim.follow(unaided, enough(own, unaided))
            self._doubt(witness, what)
            health.dropped = witness.wrong
        return state

    def _doubt(self, witness: Witness, what: Quantity) -> None:
        """Leave open whether a load cell drifts or the preload creeps, (U10)."""
        (cable,) = what.cables
        stddev = self._preloads.stddev(cable)
        size = witness.claim.contradicted(float(self._changed[cable]), stddev)
        if size > 0.0:
            known = [one.deviation for one in self._witnesses.values()]
            change = self._preloads.exchange(size, what.column, cable, known)
            witness.deviation -= change

    def _drift_of(self, cable: int, stamp_ns: int) -> float:
        """Random-walk spread of a preload after 1 s, as a fraction of it.

        It is small where a load cell measures the cable: a preload that changes sooner then shows
        as a contradiction, and so does a cell that drifts.
        """
        if self._drift <= SLOW_DRIFT or not self._cells(cable, stamp_ns):
            return self._drift
        return SLOW_DRIFT

    def _heard(self, stamp_ns: int) -> dict[str, Quantity]:
        """The trusted sensors that have been heard lately, and what they measure."""
        return {
            name: self._quantities[name]
            for name in self._witnesses
            if self.health[name].trusted and self._preloads.heard(name, stamp_ns, WINDOW_NS)
        }

    def _cells(self, cable: int, stamp_ns: int) -> list[str]:
        """The trusted load cells of a cable that have been heard lately."""
        heard = self._heard(stamp_ns).items()
        return [name for name, one in heard if not one.is_effort and cable in one.cables]

    def _is_against_effort(self, name: str, stamp_ns: int) -> bool:
        """Whether a load cell is the only one of its cable and a trusted effort acts on it."""
        (cable,) = self._quantities[name].cables
        heard = self._heard(stamp_ns).values()
        efforts = [one for one in heard if one.is_effort and cable in one.cables]
        return bool(efforts) and self._cells(cable, stamp_ns) == [name]

    def _heed(self, name: str, what: Quantity, first: float) -> Witness:
        """Begin to use a sensor.

        Args:
            name: of the sensor.
            what: what it measures.
            first: size of its first correction [N] or [N m].
        """
        if what.is_effort:
            witness = Witness(self._unknown(what) * self._draw())
        else:
            nothing = np.zeros(len(self.spread.states))
            witness = Witness(nothing, history=HISTORY_ERROR * first, claim=Claim(first))
        self._witnesses[name] = witness
        return witness

    def _model_error(self, what: Quantity, value: float) -> float:
        """Standard deviation of the model's error in one reading [N] or [N m]."""
        if not what.is_effort:
            return MODEL_ERROR * abs(value)
        scale = self._preloads.scale(what.column, what.cables)
        return max(MODEL_ERROR * abs(value), EFFORT_ERROR * scale)

    def _unknown(self, what: Quantity) -> float:
        """Standard deviation of the motor's friction before its effort was read [N m]."""
        scale = self._preloads.scale(what.column, what.cables)
        return self._friction.stddev(what.motor, scale)

    def _agrees(
        self, name: str, witness: Witness, stamp_ns: int, innovation: float, variance: float
    ) -> bool:
        """Whether to use a reading; widens what may have changed if several contradict.

        An effort is used in any case: it is often the only witness of a lost preload, and doubt
        would leave half of the loss uncorrected.
        """
        what = self._quantities[name]
        scale = self._preloads.scale(what.column, what.cables)
        share = max(self._drift_of(c, stamp_ns) for c in what.cables)
        drift = (share * scale) ** 2
        if not what.is_effort:
            witness.against_effort = self._is_against_effort(name, stamp_ns)
        answer: Answer = witness.weigh(stamp_ns, innovation, variance, drift)
        possible = abs(witness.surprise) <= (SUDDEN if what.is_effort else DOUBT) * scale
        if answer == "changed" and possible:
            self._open(witness, what)
            self.health[name].changes += 1
        return what.is_effort or answer == "agrees" or (answer == "changed" and possible)

    def _share(self, witness: Witness, size: float) -> None:
        """Let the lasting error of a load cell grow to ``size`` [N] with its largest reading."""
        if size > witness.share:
            witness.deviation += sqrt(size**2 - witness.share**2) * self._draw()
            witness.share = size

    def _variance(self, column: int, witness: Witness | None, factor: float) -> float:
        """Variance of a quantity and ``factor`` times the lasting error of its sensor together."""
        h = self.spread.deviation[:, column]
        if witness is not None:
            h = h + factor * witness.deviation
        return float(h @ h) / h.size

    def _draw(self) -> Vector:
        """Numbers for a lasting error, independent of those of all sensors, shape (members,)."""
        spread = self.spread
        known = [one.deviation for one in self._witnesses.values() if one.deviation.any()]
        return standard(spread.generator, len(spread.states), known)

    def _open(self, witness: Witness, what: Quantity) -> None:
        """Leave open by which preloads readings have changed; by a load cell's error as well."""
        size, spread = abs(witness.surprise), self.spread
        known = [one.deviation for one in self._witnesses.values()]
        known.append(spread.deviation[:, what.column])  # a view: it follows the change
        self._preloads.loosen(size, what.column, what.cables, known)
        if not what.is_effort:
            witness.deviation += size * standard(spread.generator, len(spread.states), known)
        for one in self._witnesses.values():
            one.forget()
            one.claim.renew()

    def _teach(
        self, what: Quantity, witness: Witness, innovation: Innovation, state: State
    ) -> State:
        """Correct the state and the ensemble, and note by how much."""
        lasting = [one.deviation for one in self._witnesses.values()]
        values = state.values.copy()
        gain = update(self.spread, self._preloads, what, witness, innovation, lasting, values)
        for c in what.cables:
            places = self._preloads.places[c]
            self._changed[c] += float(gain[places.elements] @ places.weight) * innovation.size
        self._past.corrected = self._past.corrected + gain * innovation.size
        return State(state.stamp_ns, values)
