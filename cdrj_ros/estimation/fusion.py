"""Measured tensions and efforts beside the angles: an ensemble Kalman filter, and who is believed.

A load cell at one element says something of every element of its cable, by how the members'
tensions vary together; a motor's effort says something of all cables on its drum.  The ensemble
knows how much (Evensen 2003; perturbed observations, restricted to the cables concerned).  What is
corrected is the material in the elements: elongation, friction history and the preload in one.
docs/uncertainty.md.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import Estimate, State
from cdrj_ros.model.packing import number_views, plan_views
from cdrj_ros.model.prepared import Model, shape_at
from cdrj_ros.model.state import state_views
from cdrj_ros.robot.description import Winch

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

MODEL_ERROR: Final = 0.01
"""Share of a measured value that the model may miss, beside the sensor's noise."""

SLOW_DRIFT: Final = 0.002
"""Spread that a preload gains in a second beside a load cell, as a share of it."""

FREE_DRIFT: Final = 0.02
"""The same where the preload is tracked from a motor's effort."""

JUDGED: Final = 50
"""Readings over which a sensor is judged."""

TOO_FAR: Final = 9.0
"""A sensor whose squared residuals, over their expected variance, are more on average is wrong."""

OUTLIER: Final = 100.0
"""A reading whose squared residual, over its expected variance, is more is not used."""

STIFF: Final = 4.0
"""A reading that stands still while the estimate moves by more deviations than this is frozen."""

RESPONSE: Final = (0.3, 3.0)
"""A sensor is used once its readings move this many times as far as the estimate does."""

TRIAL_STEP: Final = 0.25
"""Between readings on trial the estimate must move by this share of their deviation."""

PROOF: Final = 0.05
"""A motion must change the estimate by this share of its greatest value to prove a sensor."""

TRIED: Final = 400
"""Latest readings, each after some motion, by which that is found out."""

HISTORY_NS: Final = 200_000_000
"""A measurement may be this old [ns]."""

KEPT: Final = 5_000
"""Estimates kept for measurements that are yet to come, however close they are."""

LARGEST: Final = 1e9
"""Measured values beyond this are none [N or N m]."""


@dataclass
class SensorHealth:
    """Whether one sensor is used: on trial at first, then trusted, dropped for good if it fails."""

    name: str
    dropped: str = ""
    """Why it is not used any more; empty while it is."""
    trusted: bool = False
    """Whether its readings have followed a motion in proportion; before, none is used."""
    used: int = 0
    """Readings used so far."""
    refused: int = 0
    """Readings refused: not finite, too old, far off, or of a sensor that has been dropped."""
    tried: int = 0
    """Readings taken on trial, which correct nothing."""
    _squares: deque[float] = field(default_factory=lambda: deque(maxlen=JUDGED))
    _values: deque[float] = field(default_factory=lambda: deque(maxlen=JUDGED))
    _unaided: deque[float] = field(default_factory=lambda: deque(maxlen=JUDGED))
    _in_motion: int = 0
    """Readings on trial while the estimate moved."""
    _trial: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=TRIED))

    def judge(
        self, value: float, expected: float, unaided: float, variance: float, own: float
    ) -> bool:
        """Take a reading; True where it may be used.

        Args:
            value: measured [N] or [N m].
            expected: estimated for the same time.
            unaided: the same without what was corrected so far: how it moves by itself.
            variance: of value less expected, if all is as assumed.
            own: the sensor's and the model's part of it.
        """
        if self.dropped:
            self.refused += 1
            return False
        self._squares.append((value - expected) ** 2 / variance)
        self._values.append(value)
        self._unaided.append(unaided)
        if len(self._squares) == JUDGED:
            self.dropped = self._fault(value, expected, variance)
        if not self.dropped and not self.trusted:
            return self._try(value, unaided, own)
        if self.dropped or self._squares[-1] > OUTLIER:
            self.refused += 1
            return False
        self.used += 1
        return True

    def _fault(self, value: float, expected: float, variance: float) -> str:
        """What the last ``JUDGED`` readings have against the sensor; empty where nothing."""
        mean = sum(self._squares) / JUDGED
        if max(self._values) == min(self._values) and (
            max(self._unaided) - min(self._unaided) > STIFF * variance**0.5
        ):
            return f"frozen at {value:.4g} while the estimate moves"
        if mean > TOO_FAR:
            return (
                f"{mean**0.5:.1f} standard deviations from the estimate over {JUDGED} readings "
                f"(measured {value:.4g}, expected {expected:.4g})"
            )
        return ""

    def _try(self, value: float, unaided: float, own: float) -> bool:
        """A reading on trial: whether, with those before it, it follows the motion, (U4)."""
        self.tried += 1
        if self._trial and abs(unaided - self._trial[-1][1]) < TRIAL_STEP * own**0.5:
            return False
        self._trial.append((value, unaided))
        pairs = np.array(self._trial)
        moved = pairs[:, 1] - pairs[:, 1].mean()
        large = max(STIFF * own**0.5, PROOF * float(np.abs(pairs[:, 1]).max()))
        if np.ptp(moved) <= large:
            return False
        response = float(moved @ pairs[:, 0] / (moved @ moved))
        self.trusted = RESPONSE[0] <= response <= RESPONSE[1]
        self._in_motion += 1
        if not self.trusted and self._in_motion == TRIED:
            self.dropped = (
                f"moves {response:.2g} times as far as the estimate over {TRIED} readings, "
                f"where {RESPONSE[0]:g} to {RESPONSE[1]:g} is accepted"
            )
        if self.trusted:
            self.tried -= 1
            self.used += 1
            self._trial.clear()
        return self.trusted


class Fusion:
    """Corrects estimate and ensemble by what other sensors say."""

    def __init__(self, spread: Spread, drift: float = SLOW_DRIFT) -> None:
        """Prepare for one robot.

        Args:
            spread: its ensemble, changed by every correction.
            drift: spread that preloads gain in a second, as a share of them.
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
        """Stamps, estimates, and what had been corrected in all by then, by column."""
        self._corrected = np.zeros(spread.columns.size)
        self._last_ns: dict[str, int] = {}

    def reset(self) -> None:
        """Forget what was measured; every sensor is on trial again."""
        self.health.clear()
        self.forget()

    def forget(self) -> None:
        """Forget what was measured, but not which sensors are trusted or dropped."""
        self._history.clear()
        self._last_ns.clear()
        self._corrected = np.zeros(self.spread.columns.size)

    @property
    def dropped(self) -> int:
        """How many sensors have been dropped."""
        return sum(bool(one.dropped) for one in self.health.values())

    def remember(self, estimate: Estimate) -> None:
        """Keep an estimate for measurements that are yet to come."""
        history = self._history
        history.append((estimate.stamp_ns, estimate.values, self._corrected))
        while estimate.stamp_ns - history[0][0] > HISTORY_NS:
            history.popleft()

    def noise_of(self, element: str) -> float:
        """Noise of a load cell whose messages do not give one [N]."""
        return self.model.robot.cables[self._element_cable[element]].sensor_noise

    def knows(self, element: str) -> bool:
        """Whether there is such an element."""
        return element in self._element

    def tension(
        self, sample: Sample, state: State, stamp_ns: int, element: str, value: float, noise: float
    ) -> State:
        """Correct by a measured tension.

        Args:
            sample: the last one taken.
            state: after it.
            stamp_ns: time of the measurement [ns], after ``HISTORY_NS`` before the sample.
            element: ``cable/element``.
            value: measured [N].
            noise: its standard deviation [N], positive.

        Returns:
            The corrected state; the same one where the reading was refused.
        """
        column = self._element[element]
        cables = [self._element_cable[element]]
        return self._correct(sample, state, stamp_ns, element, column, cables, value, noise)

    def motor_effort(
        self, sample: Sample, state: State, stamp_ns: int, motor: str, value: float, noise: float
    ) -> State:
        """Correct by a motor's measured effort [N m]; otherwise as ``tension``."""
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
        """What is now estimated for the time of a measurement; None where that is too long ago.

        What has been corrected since is part of it: measurements that come late would otherwise
        each tell the same news again.
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
        """Let every member's preloads drift by a random walk, since they are not constant."""
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
    """Where one cable's values lie in states, numbers and deviations."""

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
        """Move the tensions of some states by ``shift`` [N], shape (states, elements)."""
        cables: Any = number_views(self._sizes, numbers).cables
        stiffness = cables["axial_stiffness"][:, self._cable, None]
        state = state_views(self._sizes, states)
        length, material = state.length[:, self.elements], state.material[:, self.elements]
        tension = stiffness * (length / material - 1.0) + shift
        material[:] = length / (1.0 + tension / stiffness)
        state.bristle[:, self._own_pulleys] = np.diff(np.maximum(tension, 0.0), axis=1)


def _mean_wrap(model: Model, pulley: int) -> float:
    """Wrap of a pulley in the reference pose [rad]."""
    reference = np.array([joint.reference_angle for joint in model.robot.joints])
    return float(shape_at(model, reference).wrap[pulley])
