"""Fusion of measured tensions and efforts by an ensemble Kalman filter, with sensor checks.

A load cell at one element corrects every element of its cable through the covariance of the
members' tensions; a motor's effort corrects all cables on its drum.  The gain is computed from the
ensemble (Evensen 2003; perturbed observations, restricted to the cables concerned).  The corrected
quantity is the material in the elements, which determines elongation, friction history and preload
together.  See docs/uncertainty.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.contest import Answer, Witness
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import Estimate, State
from cdrj_ros.estimation.preloads import DOUBT, SLOW_DRIFT, Preloads, standard
from cdrj_ros.estimation.sensor_health import SensorHealth
from cdrj_ros.robot.description import Winch

Vector = NDArray[np.float64]

MODEL_ERROR: Final = 0.01
"""Standard deviation of the model's error, in addition to the sensor's noise, as a fraction of the
measured value: of a lasting error, and of another one in every reading."""

HISTORY_ERROR: Final = 0.05
"""Standard deviation of what follows from a sensor's first correction, as a fraction of it: the
friction history was formed at another preload."""

HISTORY_NS: Final = 200_000_000
"""Maximum age of a measurement [ns]."""

KEPT: Final = 5_000
"""Maximum number of past estimates kept for late measurements."""

LARGEST: Final = 1e9
"""Measured values of larger magnitude are refused [N or N m]."""


class Fusion:
    """Corrects the estimate and the ensemble with measured tensions and efforts."""

    def __init__(self, spread: Spread, drift: float = SLOW_DRIFT) -> None:
        """Prepare for one robot.

        Args:
            spread: the robot's ensemble, changed by every correction.
            drift: random-walk spread of a preload after one second, as a fraction of the preload.
        """
        model = spread.model
        layout, robot = model.layout, model.robot
        self.spread = spread
        self.model = model
        self._drift = drift
        self._preloads = Preloads(spread, drift)
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
        self._history: deque[tuple[int, Vector, Vector]] = deque(maxlen=KEPT)
        """Stamps, estimates, and the total correction of each column up to then."""
        self._corrected = np.zeros(spread.columns.size)

    def reset(self) -> None:
        """Discard all measurements; every sensor is on trial again."""
        self.health.clear()
        self.forget()

    def restart(self) -> None:
        """Discard all measurements; all sensors but those dropped are on trial again."""
        dropped = self.faults()
        self.reset()
        self.drop(dropped)

    def faults(self) -> dict[str, str]:
        """Why sensors have been dropped, by name."""
        return {name: one.dropped for name, one in self.health.items() if one.dropped}

    def drop(self, faults: Mapping[str, str]) -> None:
        """Drop sensors, for the reasons given by name."""
        for name, why in faults.items():
            self.health[name] = SensorHealth(name, dropped=why)

    def forget(self) -> None:
        """Discard all measurements, but keep which sensors are trusted or dropped."""
        self._history.clear()
        self._preloads.forget()
        self._witnesses.clear()
        self._corrected = np.zeros(self.spread.columns.size)

    @property
    def dropped(self) -> int:
        """Number of dropped sensors."""
        return sum(bool(one.dropped) for one in self.health.values())

    @property
    def contested(self) -> bool:
        """Whether the last reading of a trusted sensor contradicts the estimate."""
        return any(one.contested for one in self._witnesses.values())

    def remember(self, estimate: Estimate) -> None:
        """Store an estimate for late measurements."""
        history = self._history
        history.append((estimate.stamp_ns, estimate.values, self._corrected))
        while estimate.stamp_ns - history[0][0] > HISTORY_NS:
            history.popleft()

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
        return self._correct(sample, state, stamp_ns, element, column, cables, value, noise)

    def motor_effort(
        self, sample: Sample, state: State, stamp_ns: int, motor: str, value: float, noise: float
    ) -> State:
        """Correct with a motor's measured effort [N m]; otherwise as ``tension``."""
        column, cables = self._motor[motor], self._motor_cables[motor]
        return self._correct(sample, state, stamp_ns, motor, column, cables, value, noise)

    def _correct(
        self,
        sample: Sample,
        state: State,
        stamp_ns: int,
        name: str,
        column: int,
        cables: list[int],
        value: float,
        noise: float,
    ) -> State:
        spread = self.spread
        health = self.health.setdefault(name, SensorHealth(name))
        place = int(spread.columns[column])
        expected = self._expected(stamp_ns, place, column)
        if not abs(value) <= LARGEST or expected is None:
            health.refused += 1
            return state
        now = Estimate(sample.stamp_ns, self._history[-1][1], self.model.layout, True)
        spread.catch_up(sample, now)
        errors = [one.deviation for one in self._witnesses.values()]
        self._preloads.drift(name, sample.stamp_ns, cables, errors)
        own = noise**2 + (MODEL_ERROR * value) ** 2
        # A motor's effort is often the only witness of a lost preload, and doubt would leave half
        # of the loss uncorrected: only load cells are contested.
        is_effort = name in self._motor
        witness = self._witnesses.get(name)
        error = witness.error if witness is not None else 0.0
        variance = self._variance(column, witness) + own
        unaided = expected - float(self._corrected[column])
        usable = health.judge(value, expected + error, unaided, variance, own)
        if not health.trusted or health.dropped:
            self._witnesses.pop(name, None)
            return state
        if witness is None:
            witness = self._heed(name, 0.0 if is_effort else abs(value - expected))
        innovation = value - expected - witness.error
        scale = self._preloads.scale(column, cables)
        drift = (self._drift * scale) ** 2
        answer: Answer = "agrees"
        if not is_effort:
            answer = witness.weigh(sample.stamp_ns, innovation, variance, drift)
        possible = abs(witness.surprise) <= DOUBT * scale
        if answer == "changed" and possible:
            self._open(witness, column, cables)
        if not usable:  # counted already
            return state
        if answer == "contested" or (answer == "changed" and not possible):
            health.refused += 1
            return state
        size = 0.0 if is_effort else MODEL_ERROR * max(abs(value), health.largest)
        if size > witness.share:
            witness.deviation += np.sqrt(size**2 - witness.share**2) * self._draw()
            witness.share = size
        health.used += 1
        state = self._teach(witness, state, column, cables, innovation, own)
        health.dropped = witness.wrong
        return state

    def _heed(self, name: str, first: float) -> Witness:
        """Begin to use a sensor; ``first`` is the size of its first correction [N] or [N m]."""
        witness = Witness(np.zeros(len(self.spread.states)), history=HISTORY_ERROR * first)
        self._witnesses[name] = witness
        return witness

    def _variance(self, column: int, witness: Witness | None) -> float:
        """Variance of a quantity and the lasting error of its sensor together."""
        h = self.spread.deviation[:, column]
        if witness is not None:
            h = h + witness.deviation
        return float(h @ h) / h.size

    def _draw(self) -> Vector:
        """Numbers for a lasting error, independent of those of all sensors, shape (members,)."""
        spread = self.spread
        known = [one.deviation for one in self._witnesses.values() if one.deviation.any()]
        return standard(spread.generator, len(spread.states), known)

    def _open(self, witness: Witness, column: int, cables: list[int]) -> None:
        """Leave open whether readings have changed by an error of the sensor or by a preload's."""
        size, spread = abs(witness.surprise), self.spread
        known = [one.deviation for one in self._witnesses.values()]
        self._preloads.loosen(size, column, cables, [*known, spread.deviation[:, column]])
        known.append(spread.deviation[:, column])
        witness.deviation += size * standard(spread.generator, len(spread.states), known)
        for one in self._witnesses.values():
            one.forget()

    def _teach(
        self,
        witness: Witness,
        state: State,
        column: int,
        cables: list[int],
        innovation: float,
        own: float,
    ) -> State:
        """Correct the state and the ensemble, (U2)."""
        spread = self.spread
        deviation = spread.deviation
        members = len(deviation)
        h = deviation[:, column] + witness.deviation
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
            places.stretch(values[None, :], self.model.numbers[None, :], shift[None, :])
            places.stretch(spread.states, spread.numbers, change[:, places.elements])
        own_gain = float(witness.deviation @ h) / (members * variance)
        witness.learn(
            differences * own_gain, own_gain * innovation, float(gain[column]) * innovation
        )
        deviation += change - gain * innovation
        self._corrected = self._corrected + gain * innovation
        spread.variance[:] = (deviation**2).mean(axis=0)
        return State(state.stamp_ns, values)

    def _expected(self, stamp_ns: int, place: int, column: int) -> float | None:
        """The current estimate for the time of a measurement; None outside the stored history.

        It includes the corrections made since then; otherwise late measurements would apply the
        same correction repeatedly.
        """
        history = self._history
        if not history or not history[0][0] <= stamp_ns <= history[-1][0]:
            return None

        def then(k: int) -> float:
            _, values, corrected = history[k]
            return float(values[place] + (self._corrected[column] - corrected[column]))

        after = len(history) - 1
        while after > 0 and history[after - 1][0] >= stamp_ns:
            after -= 1
        stamp = history[after][0]
        if stamp == stamp_ns or after == 0:
            return then(after)
        before = history[after - 1][0]
        share = (stamp_ns - before) / (stamp - before)
        return then(after - 1) + share * (then(after) - then(after - 1))
