"""Fusion of measured tensions and efforts by an ensemble Kalman filter, with sensor checks.

A load cell at one element corrects every element of its cable through the covariance of the
members' tensions; a motor's effort corrects all cables on its drum.  The gain is computed from the
ensemble (Evensen 2003; perturbed observations, restricted to the cables concerned).  The corrected
quantity is the material in the elements, which determines elongation, friction history and preload
together.  See docs/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.claims import HISTORY_ERROR, Claim
from cdrj_ros.estimation.contest import WINDOW_NS, Answer, Witness, finite
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import Estimate, State
from cdrj_ros.estimation.motor_friction import FRICTION_DRIFT, MotorFriction
from cdrj_ros.estimation.past import PastEstimates
from cdrj_ros.estimation.preloads import DOUBT, SLOW_DRIFT, Preloads, standard
from cdrj_ros.estimation.sensor_health import SensorHealth, enough
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Winch

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


class _Reading(NamedTuple):
    """One measurement."""

    name: str
    column: int
    """Column of the measured quantity in the spread."""
    cables: list[int]
    """The cables that it corrects."""
    motor: int
    """Index of the motor whose effort it is; -1 for a load cell."""
    stamp_ns: int
    value: float
    noise: float
    """Standard deviation of its noise [N] or [N m]."""


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
        layout, robot = model.layout, model.robot
        self.spread = spread
        self.model = model
        self._drift = drift
        self._preloads = Preloads(spread)
        self._element_cable = {
            name: c for c, cable in enumerate(robot.cables) for name in cable.element_names
        }
        self._element = {name: k for k, name in enumerate(layout.elements)}
        first_motor = len(layout.elements) + len(layout.pulleys)
        self._motor = {name: first_motor + k for k, name in enumerate(layout.motors)}
        self._motor_cables = {
            motor: [
                c
                for c, cable in enumerate(robot.cables)
                if any(isinstance(n, Winch) and n.motor == motor for n in cable.nodes)
            ]
            for motor in layout.motors
        }
        self.health: dict[str, SensorHealth] = {}
        self._witnesses: dict[str, Witness] = {}
        """The trusted sensors whose readings have been used."""
        self._past = PastEstimates(spread.columns)
        self._friction = MotorFriction(robot)
        self._changed = np.zeros(len(robot.cables))
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
        if not set(witnesses) <= set(health) <= {*self._element, *self._motor}:
            raise ValueError("sensors that the robot does not have")
        changed, known = (finite(memory[key], cables) for key in ("changed", "known"))
        self.health, self._witnesses = health, witnesses
        self._changed, self._preloads.known = changed, known

    def beginning(self) -> Model:
        """The robot with the preloads that are known by now, for the first sample."""
        return self._preloads.corrected(self.model)

    def pass_unwatched(self, seconds: float) -> None:
        """Let the preloads drift over a time without readings [s]."""
        measured = {self._element_cable.get(name) for name in self._witnesses}
        cables = range(self._changed.size)
        shares = [min(self._drift, SLOW_DRIFT) if c in measured else self._drift for c in cables]
        self._preloads.pass_unwatched(seconds, shares)

    def take_back(self, name: str) -> None:
        """Forget all corrections, because a sensor that made some was wrong.

        What it said last may be right all the same: the preloads are at least that uncertain.
        """
        self.forget()
        column = self._element[name] if name in self._element else self._motor[name]
        cables = self._motor_cables.get(name) or [self._element_cable[name]]
        self._preloads.widen(self.health[name].away, column, cables)

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
            name: (one.error, float(np.sqrt((one.deviation**2).mean())))
            for name, one in self._witnesses.items()
            if name in self._motor
        }

    def remember(self, sample: Sample, estimate: Estimate) -> None:
        """Store an estimate for late measurements."""
        direction = self._friction.turn(sample.motor_angle)
        self._past.add(estimate.stamp_ns, estimate.values, direction)

    def noise_of(self, element: str) -> float:
        """Noise of a load cell whose messages give no standard deviation [N]."""
        return self.model.robot.cables[self._element_cable[element]].sensor_noise

    def knows(self, element: str) -> bool:
        """Whether the robot has this element."""
        return element in self._element

    def tension(
        self, sample: Sample, state: State, stamp_ns: int, element: str, value: float, noise: float
    ) -> State:
        """Correct the state and the ensemble with a measured tension.

        Args:
            sample: the last processed sample.
            state: the state after that sample.
            stamp_ns: time of the measurement [ns], at most ``HISTORY_NS`` before the sample.
            element: ``cable/element``.
            value: measured tension [N].
            noise: standard deviation of the measurement [N], positive.

        Returns:
            The corrected state; the same object if the reading was refused.
        """
        column = self._element[element]
        cables = [self._element_cable[element]]
        reading = _Reading(element, column, cables, -1, stamp_ns, value, noise)
        return self._correct(sample, state, reading)

    def motor_effort(
        self, sample: Sample, state: State, stamp_ns: int, motor: str, value: float, noise: float
    ) -> State:
        """Correct with a motor's measured effort [N m]; otherwise as ``tension``."""
        column, cables = self._motor[motor], self._motor_cables[motor]
        index = self.model.layout.motors.index(motor)
        reading = _Reading(motor, column, cables, index, stamp_ns, value, noise)
        return self._correct(sample, state, reading)

    def _correct(self, sample: Sample, state: State, reading: _Reading) -> State:
        """Judge a reading and use it."""
        spread, column, value = self.spread, reading.column, reading.value
        health = self.health.setdefault(reading.name, SensorHealth(reading.name))
        found = self._past.expected(reading.stamp_ns, column, reading.motor)
        if not abs(value) <= LARGEST or found is None:
            health.refused += 1
            return state
        expected, factor = found
        now = Estimate(sample.stamp_ns, self._past.last, self.model.layout, True)
        spread.catch_up(sample, now)
        errors = [one.deviation for one in self._witnesses.values()]
        shares = {c: self._drift_of(c, sample.stamp_ns) for c in reading.cables}
        passed = self._preloads.drift(reading.name, sample.stamp_ns, shares, errors)
        own = reading.noise**2 + self._model_error(reading) ** 2
        witness = self._witnesses.get(reading.name)
        if witness is not None and reading.motor >= 0:
            share = FRICTION_DRIFT * passed**0.5
            witness.deviation += share * self._unknown(reading) * self._draw()
        error = factor * witness.error if witness is not None else 0.0
        variance = self._variance(column, witness, factor) + own
        unaided = expected - float(self._past.corrected[column])
        usable = health.judge(value, expected + error, unaided, variance, own)
        if health.dropped:
            self._witnesses.pop(reading.name, None)
        if not health.trusted or health.dropped:
            return state
        if witness is None:
            witness = self._heed(reading, abs(value - expected))
        innovation = value - expected - error
        agrees = self._agrees(witness, reading, sample.stamp_ns, innovation, variance)
        if not usable:  # counted already
            return state
        if not agrees:
            health.refused += 1
            return state
        if reading.motor < 0:
            self._share(witness, MODEL_ERROR * max(abs(value), health.largest))
        health.used += 1
        state = self._teach(witness, factor, state, reading, innovation, own)
        if reading.motor < 0:
            witness.claim.follow(unaided, enough(own, unaided))
            self._doubt(witness, reading)
            health.dropped = witness.wrong
        return state

    def _doubt(self, witness: Witness, reading: _Reading) -> None:
        """Leave open whether a load cell drifts or the preload creeps, (U10)."""
        (cable,) = reading.cables
        stddev = self._preloads.stddev(cable)
        size = witness.claim.contradicted(float(self._changed[cable]), stddev)
        if size > 0.0:
            known = [one.deviation for one in self._witnesses.values()]
            change = self._preloads.exchange(size, reading.column, cable, known)
            witness.deviation -= change

    def _drift_of(self, cable: int, stamp_ns: int) -> float:
        """Random-walk spread of a preload after 1 s, as a fraction of it.

        It is small where a load cell measures the cable: a preload that changes sooner then shows
        as a contradiction, and so does a cell that drifts.
        """
        return min(self._drift, SLOW_DRIFT) if self._cells(cable, stamp_ns) else self._drift

    def _cells(self, cable: int, stamp_ns: int) -> list[str]:
        """The trusted load cells of a cable that have been heard lately."""
        return [
            name
            for name in self._witnesses
            if self._element_cable.get(name) == cable
            and self.health[name].trusted
            and self._preloads.heard(name, stamp_ns, WINDOW_NS)
        ]

    def _is_against_effort(self, reading: _Reading, stamp_ns: int) -> bool:
        """Whether a load cell is the only one of its cable and a trusted effort acts on it."""
        (cable,) = reading.cables
        efforts = [
            name
            for name in self._witnesses
            if cable in self._motor_cables.get(name, ())
            and self.health[name].trusted
            and self._preloads.heard(name, stamp_ns, WINDOW_NS)
        ]
        return bool(efforts) and self._cells(cable, stamp_ns) == [reading.name]

    def _heed(self, reading: _Reading, first: float) -> Witness:
        """Begin to use a sensor.

        Args:
            reading: its first reading that is used.
            first: size of its first correction [N] or [N m].
        """
        members = len(self.spread.states)
        if reading.motor < 0:
            witness = Witness(np.zeros(members), history=HISTORY_ERROR * first, claim=Claim(first))
        else:
            witness = Witness(self._unknown(reading) * self._draw())
        self._witnesses[reading.name] = witness
        return witness

    def _model_error(self, reading: _Reading) -> float:
        """Standard deviation of the model's error in one reading [N] or [N m]."""
        if reading.motor < 0:
            return MODEL_ERROR * abs(reading.value)
        scale = self._preloads.scale(reading.column, reading.cables)
        return max(MODEL_ERROR * abs(reading.value), EFFORT_ERROR * scale)

    def _unknown(self, reading: _Reading) -> float:
        """Standard deviation of the motor's friction before its effort was read [N m]."""
        scale = self._preloads.scale(reading.column, reading.cables)
        return self._friction.stddev(reading.motor, scale)

    def _agrees(
        self,
        witness: Witness,
        reading: _Reading,
        stamp_ns: int,
        innovation: float,
        variance: float,
    ) -> bool:
        """Whether to use a reading; widens what may have changed if several contradict.

        An effort is used in any case: it is often the only witness of a lost preload, and doubt
        would leave half of the loss uncorrected.
        """
        scale = self._preloads.scale(reading.column, reading.cables)
        share = max(self._drift_of(c, stamp_ns) for c in reading.cables)
        drift = (share * scale) ** 2
        if reading.motor < 0:
            witness.against_effort = self._is_against_effort(reading, stamp_ns)
        answer: Answer = witness.weigh(stamp_ns, innovation, variance, drift)
        is_effort = reading.motor >= 0
        possible = abs(witness.surprise) <= (SUDDEN if is_effort else DOUBT) * scale
        if answer == "changed" and possible:
            self._open(witness, reading.column, reading.cables, doubted=not is_effort)
            self.health[reading.name].changes += 1
        return is_effort or answer == "agrees" or (answer == "changed" and possible)

    def _share(self, witness: Witness, size: float) -> None:
        """Let the lasting error of a load cell grow to ``size`` [N] with its largest reading."""
        if size > witness.share:
            witness.deviation += np.sqrt(size**2 - witness.share**2) * self._draw()
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

    def _open(self, witness: Witness, column: int, cables: list[int], *, doubted: bool) -> None:
        """Leave open by which preloads readings have changed, or if ``doubted`` by the sensor."""
        size, spread = abs(witness.surprise), self.spread
        known = [one.deviation for one in self._witnesses.values()]
        self._preloads.loosen(size, column, cables, [*known, spread.deviation[:, column]])
        if doubted:
            known.append(spread.deviation[:, column])
            witness.deviation += size * standard(spread.generator, len(spread.states), known)
        for one in self._witnesses.values():
            one.forget()
            one.claim.renew()

    def _teach(
        self,
        witness: Witness,
        factor: float,
        state: State,
        reading: _Reading,
        innovation: float,
        own: float,
    ) -> State:
        """Correct the state and the ensemble, (U2); ``factor`` as for ``_variance``."""
        spread, column, cables = self.spread, reading.column, reading.cables
        deviation = spread.deviation
        members = len(deviation)
        h = deviation[:, column] + factor * witness.deviation
        variance = float(h @ h) / members + own
        gain = deviation.T @ h / (members * variance)
        concerned = np.zeros(gain.size, dtype=bool)
        concerned[len(self.model.layout.elements) + len(self.model.layout.pulleys) :] = True
        for c in cables:
            concerned[self._preloads.places[c].elements] = True
            concerned[self._preloads.places[c].pulleys] = True
        gain[~concerned] = 0.0
        lasting = [one.deviation for one in self._witnesses.values()]
        errors = np.sqrt(own) * standard(spread.generator, members, lasting)
        differences = innovation - h + errors
        change = differences[:, None] * gain
        values = state.values.copy()
        for c in cables:
            places = self._preloads.places[c]
            shift = gain[places.elements] * innovation
            self._changed[c] += float(gain[places.elements] @ places.weight) * innovation
            self._preloads.correct(c, values, shift, change[:, places.elements])
        own_gain = float(witness.deviation @ h) / (members * variance)
        heard = float(gain[column]) + (own_gain if witness.against_effort else 0.0)
        witness.learn(differences * own_gain, own_gain * innovation, heard * innovation)
        deviation += change - gain * innovation
        self._past.corrected = self._past.corrected + gain * innovation
        spread.variance[:] = (deviation**2).mean(axis=0)
        return State(state.stamp_ns, values)
