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
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import Estimate, State
from cdrj_ros.estimation.sensor_health import SensorHealth
from cdrj_ros.model.packing import number_views, plan_views
from cdrj_ros.model.prepared import Model, shape_at
from cdrj_ros.model.state import state_views
from cdrj_ros.robot.description import Winch

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

MODEL_ERROR: Final = 0.01
"""Standard deviation of the model's error, in addition to the sensor's noise, as a fraction of the
measured value."""

SLOW_DRIFT: Final = 0.002
"""Random-walk spread of a preload after 1 s with load cells, as a fraction of the preload."""

FREE_DRIFT: Final = 0.02
"""The same where the preload is tracked by a motor's effort."""

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
        self._cables = [_CablePlaces(model, c) for c in range(len(robot.cables))]
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
        self._history: deque[tuple[int, Vector, Vector]] = deque(maxlen=KEPT)
        """Stamps, estimates, and the total correction of each column up to then."""
        self._corrected = np.zeros(spread.columns.size)
        self._last_ns: dict[str, int] = {}

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
        self._last_ns.clear()
        self._corrected = np.zeros(self.spread.columns.size)

    @property
    def dropped(self) -> int:
        """Number of dropped sensors."""
        return sum(bool(one.dropped) for one in self.health.values())

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
        self._let_drift(name, sample.stamp_ns, cables)
        deviation = spread.deviation
        members = len(deviation)
        h = deviation[:, column].copy()
        own = noise**2 + (MODEL_ERROR * value) ** 2
        variance = float(h @ h) / members + own
        unaided = expected - float(self._corrected[column])
        if not health.judge(value, expected, unaided, variance, own):
            return state
        gain = deviation.T @ h / (members * variance)
        concerned = np.zeros(gain.size, dtype=bool)
        concerned[len(self.model.layout.elements) + len(self.model.layout.pulleys) :] = True
        for c in cables:
            concerned[self._cables[c].elements] = True
            concerned[self._cables[c].pulleys] = True
        gain[~concerned] = 0.0
        errors = np.sqrt(own) * spread.generator.standard_normal(members)
        errors -= errors.mean()
        innovation = value - expected
        change = (innovation - h + errors)[:, None] * gain
        values = state.values.copy()
        for c in cables:
            places = self._cables[c]
            shift = gain[places.elements] * innovation
            places.stretch(values[None, :], self.model.numbers[None, :], shift[None, :])
            places.stretch(spread.states, spread.numbers, change[:, places.elements])
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

    def _let_drift(self, name: str, stamp_ns: int, cables: list[int]) -> None:
        """Add a random walk to every member's preloads, since preloads are not constant."""
        passed = (stamp_ns - self._last_ns.get(name, stamp_ns)) * 1e-9
        self._last_ns[name] = stamp_ns
        if passed <= 0.0:
            return
        spread = self.spread
        for c in cables:
            places = self._cables[c]
            preload = max(self.model.robot.cables[c].preload, 1.0)
            draw = self._drift * preload * np.sqrt(passed)
            normal = spread.generator.standard_normal(len(spread.states))
            shift = np.outer(draw * (normal - normal.mean()), np.ones(places.count))
            places.stretch(spread.states, spread.numbers, shift)
            spread.deviation[:, places.elements] += shift
            spread.deviation[:, places.pulleys] += shift[:, :1] * places.lever
            for column, arm in places.motors:
                spread.deviation[:, column] += arm * shift[:, 0]
        spread.variance[:] = (spread.deviation**2).mean(axis=0)


class _CablePlaces:
    """Indices of one cable's values in states, numbers and deviations."""

    def __init__(self, model: Model, c: int) -> None:
        robot, layout = model.robot, model.layout
        cable = plan_views(model.plan).cables[c]
        first, pulley = cable.first_element, cable.first_pulley
        self.count = int(cable.elements)
        elements = len(layout.elements)
        self.elements = slice(first, first + cable.elements)
        self.pulleys = slice(elements + pulley, elements + pulley + cable.pulleys)
        self._sizes, self._cable = model.sizes, c
        self._own_pulleys = slice(pulley, pulley + cable.pulleys)
        wrap = np.array([_mean_wrap(model, pulley + k) for k in range(cable.pulleys)])
        self.lever = 2.0 * np.sin(0.5 * wrap)
        """Force on every pulley per newton of tension [-]."""
        motors = {motor.name: k for k, motor in enumerate(robot.motors)}
        offset = elements + len(layout.pulleys)
        self.motors = [
            (
                offset + motors[node.motor],
                -robot.motors[motors[node.motor]].effort_sign * node.winding * node.radius,
            )
            for node in (robot.cables[c].nodes[0], robot.cables[c].nodes[-1])
            if isinstance(node, Winch)
        ]

    def stretch(self, states: Table, numbers: Table, shift: Table) -> None:
        """Change the tensions in ``states`` by ``shift`` [N], shape (states, elements)."""
        cables: Any = number_views(self._sizes, numbers).cables
        stiffness = cables["axial_stiffness"][:, self._cable, None]
        state = state_views(self._sizes, states)
        length, material = state.length[:, self.elements], state.material[:, self.elements]
        tension = stiffness * (length / material - 1.0) + shift
        material[:] = length / (1.0 + tension / stiffness)
        state.bristle[:, self._own_pulleys] = np.diff(np.maximum(tension, 0.0), axis=1)


def _mean_wrap(model: Model, pulley: int) -> float:
    """Wrap angle of a pulley in the reference pose [rad]."""
    reference = np.array([joint.reference_angle for joint in model.robot.joints])
    return float(shape_at(model, reference).wrap[pulley])
