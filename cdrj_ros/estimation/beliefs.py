"""What sensors tell about a robot's unknowns, and which sensors are right.

Let h be the quantity that a sensor reads, by the model, and s the signatures (B2) of the unknowns x
there.  The sensor reads

    z = (1 + g) (h + s x) + b + F d + v,                                                 (B3)

with a bias b, an error g of its gain and the friction F of its axis in the direction d: three more
unknowns.  The errors v of noise, model and friction history are no unknowns.

A hypothesis says which sensors are right.  For each there is one Kalman filter over all unknowns,
which no sensor that it holds wrong has touched; there is one for all sensors, one for all but each,
and one for none.  The readings weigh them.  See docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, log
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.sensors import Sensor
from cdrj_ros.estimation.unknowns import Unknown
from cdrj_ros.foundation.arrays import Table, Vector

FAULTY: Final = 0.1
"""Prior probability that a sensor is wrong, and what it keeps in the variance whatever it reads."""

VERIFIED: Final = 0.01
"""The same of a sensor that was compared with a spring scale or a known load."""

FAULT_RATE: Final = 1e-3
"""Rate at which a good sensor becomes wrong [1/s]."""

OUTLIER: Final = 0.02
"""Probability of a stray reading of a good sensor, and that another one follows it."""

STRAY: Final = 3.0
"""How far a stray reading, or one of a wrong sensor, is off, by what the preloads contribute."""

STEADY: Final = 0.02
"""How much a wrong sensor's error changes between readings, by what the preloads contribute."""

FIRST_JUMP: Final = 0.1
"""Probability that the robot had changed suddenly before a sensor's first reading."""

JUMP_RATE: Final = 1e-3
"""Rate at which it does so later [1/s]."""

NONLINEAR: Final = 0.1
"""Error of a correction by signatures, as a share of it."""

LASTS_S: Final = 0.2
"""Time for which errors of the model and of the history last [s]."""

INDEPENDENT_S: Final = 0.1
"""Readings within this time weigh as one when hypotheses are compared [s]."""

EQUAL: Final = 3
"""A sensor is frozen if more readings than this are equal,"""

STIFF: Final = 2.0
"""while the estimate moves by more than this number of their standard deviations."""

LEAST_WEIGHT: Final = 1e-6
"""Least weight of a hypothesis, so that it can recover."""

FROZEN: Final = -50.0
"""Log likelihood of a frozen sensor's readings if it is right."""

NEVER: Final = -1


@dataclass
class Heard:
    """A sensor that has been heard, and its last reading."""

    sensor: Sensor
    faulty: float
    """Least weight of it being wrong."""
    first: int
    """Index of its bias among the unknowns; gain and friction follow."""
    stamp_ns: int = NEVER
    value: float = 0.0
    h: float = 0.0
    """What the model said."""
    slopes: Vector | None = None
    """Signatures of the robot's unknowns there."""
    direction: float = 0.0
    variance: float = inf
    """Of the errors v."""
    equal: int = 0
    """How many readings before the last were equal to it,"""
    lowest: float = inf
    highest: float = -inf
    """and the range of h since the first of them."""
    used: int = 0
    """Number of readings."""
    rest: Vector | None = None
    """Last reading less what was expected of it under every hypothesis."""
    strays: int = 0
    """How many of the latest were stray if all sensors are right."""

    @property
    def frozen(self) -> bool:
        """Whether equal readings contradict the motion."""
        moved = self.highest - self.lowest
        return self.equal >= EQUAL and moved > STIFF * float(self.variance) ** 0.5


class Beliefs:
    """The hypotheses about one group of cables, each with a mean and covariance of all unknowns."""

    def __init__(self, unknowns: Sequence[Unknown]) -> None:
        """Begin without sensors.

        Args:
            unknowns: of the robot.
        """
        self.unknowns = unknowns
        self.count = len(unknowns)
        """Number of the robot's unknowns; those of the sensors follow."""
        self.heard: list[Heard] = []
        self._drift = np.array([one.drift for one in unknowns]) ** 2
        self._jump = np.array([one.jump for one in unknowns]) ** 2
        self.mean = np.zeros((1, self.count))
        """Shape (hypotheses, unknowns)."""
        self.covariance = np.diag(np.array([one.start for one in unknowns]) ** 2)[None]
        """Shape (hypotheses, unknowns, unknowns)."""
        self.weight = np.ones(1)
        """Probability of every hypothesis, shape (hypotheses,)."""
        self.right = np.ones((1, 0), dtype=np.bool_)
        """Which sensors each holds right, shape (hypotheses, sensors)."""

    def hear(self, sensor: Sensor) -> Heard:
        """Add a sensor: its errors become unknowns, and hypotheses extend those there are."""
        n, faulty = self.mean.shape[1], VERIFIED if sensor.verified else FAULTY
        heard = Heard(sensor, faulty, n)
        self.heard.append(heard)
        mean = np.pad(self.mean, ((0, 0), (0, 3)))
        covariance = np.pad(self.covariance, ((0, 0), (0, 3), (0, 3)))
        covariance[:, n:, n:] = np.diag(np.square(sensor.prior))
        sensors = len(self.heard)
        right = [np.ones(sensors), *(1.0 - np.eye(sensors))]
        if sensors > 1:
            right.append(np.zeros(sensors))
        now = np.array(right) > 0.0
        before = [self._nearest(one) for one in now[:, :-1]]
        self.mean, self.covariance = mean[before], covariance[before]
        self.weight = self.weight[before] * np.where(now[:, -1], 1.0 - faulty, faulty)
        self.weight /= self.weight.sum()
        self.right = now
        return heard

    def _nearest(self, right: NDArray[np.bool_]) -> int:
        """The hypothesis that holds the same sensors right; or that none is."""
        same = (self.right == right).all(axis=1)
        return int(np.argmax(same)) if same.any() else len(same) - 1

    # --- a reading --------------------------------------------------------------------------------

    def take(
        self, k: int, stamp_ns: int, value: float, noise: float,
        h: float, slopes: Vector, history: float, direction: float,
    ) -> None:  # fmt: skip
        """Take a reading.

        Args:
            k: index of the sensor in ``heard``.
            stamp_ns: its time [ns].
            value: [N] or [N m].
            noise: its standard deviation.
            h: what the model says [N] or [N m].
            slopes: signatures of the robot's unknowns, shape (count,).
            history: standard deviation of h by its friction history.
            direction: change of the reading per unit of the axis' friction.
        """
        one = self.heard[k]
        first = one.stamp_ns == NEVER
        passed = INDEPENDENT_S if first else max((stamp_ns - one.stamp_ns) * 1e-9, 1e-3)
        lasting = one.sensor.model_error(value) ** 2 + history**2
        self._note(one, stamp_ns, value, h, slopes, direction, noise**2 + lasting)
        self._pass_time(one, passed)
        expected, change = self.expected(one)
        rest = value - expected
        bent = (NONLINEAR * (self.mean[:, : self.count] @ slopes)) ** 2
        across = np.einsum("bij,bj->bi", self.covariance, change)
        variance = np.einsum("bi,bi->b", across, change) + noise**2 + lasting + bent
        jumps = slopes**2 * self._jump
        sudden = FIRST_JUMP if first else min(JUMP_RATE * passed, FIRST_JUMP)
        stray = (STRAY * one.sensor.scale) ** 2
        quiet = log(1.0 - sudden) + _log_likelihood(rest, variance)
        # every unknown may have changed alone, all equally likely
        each = _log_likelihood(rest[:, None], variance[:, None] + jumps)
        each += log(sudden) - log(max(int(np.count_nonzero(self._jump)), 1))
        each[:, self._jump == 0.0] = FROZEN
        jumped = np.logaddexp.reduce(each, axis=1)
        if one.frozen:
            quiet, each, jumped = quiet + FROZEN, each + FROZEN, jumped + FROZEN
        changed = np.logaddexp(quiet, jumped)
        wrong = self._wrong(one, rest, variance, stray)
        astray = _log_likelihood(rest, variance + stray)
        strayed = (1 + one.strays) * log(OUTLIER) + astray
        right = np.logaddexp(changed, strayed)
        used = self.right[:, k] & (strayed < changed)
        one.strays = 0 if used[0] else one.strays + 1
        self._widen(used, np.exp(each - changed[:, None]), across, change)
        lasts = max(1.0, LASTS_S / passed)
        self._update(used, rest, across, change, noise**2 + (lasting + bent) * lasts)
        score = np.where(self.right[:, k], right, wrong)
        self.weight *= np.exp(min(1.0, passed / INDEPENDENT_S) * (score - score.max()))
        self._fail(k, passed)

    def _wrong(self, one: Heard, rest: Vector, variance: Vector, stray: float) -> Vector:
        """Log likelihood of a reading if the sensor is wrong: anywhere, or as far off as before."""
        anywhere = _log_likelihood(rest, variance + stray)
        before, one.rest = one.rest, rest
        if before is None or before.shape != rest.shape:
            return anywhere
        steady = 2.0 * one.variance + (STEADY * one.sensor.scale) ** 2
        again = _log_likelihood(rest - before, np.full_like(rest, steady))
        return np.asarray(np.logaddexp(anywhere, again) - log(2.0))

    def _note(
        self, one: Heard, stamp_ns: int, value: float, h: float, slopes: Vector, direction: float,
        variance: float,
    ) -> None:  # fmt: skip
        """Note a sensor's last reading, and whether it repeats the one before."""
        if one.used and value == one.value:
            one.equal += 1
        else:
            one.equal, one.lowest, one.highest = 0, h, h
        one.lowest, one.highest = min(one.lowest, h), max(one.highest, h)
        one.stamp_ns, one.value, one.h, one.slopes = stamp_ns, value, h, slopes
        one.direction, one.variance = direction, variance
        one.used += 1

    def _pass_time(self, one: Heard, passed: float) -> None:
        """Let the unknowns drift over the time since a sensor's last reading [s]."""
        robot = np.arange(self.count)
        self.covariance[:, robot, robot] += self._drift * passed / len(self.heard)
        self.covariance[:, one.first, one.first] += one.sensor.drift**2 * passed

    def expected(self, one: Heard) -> tuple[Vector, Table]:
        """What every hypothesis expects of a sensor's last reading, and its change per unknown."""
        assert one.slopes is not None
        bias, gain, friction = self.mean[:, one.first : one.first + 3].T
        true = one.h + self.mean[:, : self.count] @ one.slopes
        change = np.zeros_like(self.mean)
        change[:, : self.count] = (1.0 + gain)[:, None] * one.slopes
        change[:, one.first], change[:, one.first + 1] = 1.0, true
        change[:, one.first + 2] = one.direction
        return (1.0 + gain) * true + bias + one.direction * friction, change

    def _widen(self, used: NDArray[np.bool_], share: Table, across: Table, change: Table) -> None:
        """Add the variances of sudden changes by their probabilities: many Gaussians become one.

        Args:
            used: the hypotheses that use the reading.
            share: probabilities of changes of the unknowns, shape (hypotheses, count).
            across: covariance of all unknowns and the reading, changed.
            change: of the reading per unknown.
        """
        robot = np.arange(self.count)
        for b in np.flatnonzero(used):
            more = share[b] * self._jump
            self.covariance[b, robot, robot] += more
            across[b, : self.count] += more * change[b, : self.count]

    def _update(
        self, used: NDArray[np.bool_], rest: Vector, across: Table, change: Table, noise: Vector
    ) -> None:
        """The Kalman update of the hypotheses that use a reading."""
        for b in np.flatnonzero(used):
            gain = across[b] / (across[b] @ change[b] + noise[b])
            self.mean[b] += gain * rest[b]
            self.covariance[b] -= np.outer(gain, across[b])

    def _fail(self, k: int, passed: float) -> None:
        """Let a sensor become wrong with a small probability, and keep every hypothesis alive."""
        share = FAULT_RATE * passed
        for b in np.flatnonzero(self.right[:, k]):
            failed = self.right[b].copy()
            failed[k] = False
            moved = share * self.weight[b]
            self.weight[b] -= moved
            self.weight[self._nearest(failed)] += moved
        self.weight = np.maximum(self.weight / self.weight.sum(), LEAST_WEIGHT)
        self.weight /= self.weight.sum()

    def pause(self) -> None:
        """Forget the last readings: the estimates to come have another history."""
        for one in self.heard:
            one.slopes, one.equal, one.lowest, one.highest = None, 0, inf, -inf
            one.rest = None

    def widen(self, size: Vector) -> None:
        """Add to the variances of the robot's unknowns, shape (count,), under all hypotheses."""
        robot = np.arange(self.count)
        self.covariance[:, robot, robot] += size

    # --- all hypotheses together ------------------------------------------------------------------

    def mixture(self, shifts: Table, variances: Table) -> tuple[Vector, Vector]:
        """Mean and variance over all hypotheses; none weighs too little in the variance."""
        mean = self.weight @ shifts
        return mean, self.least_weights() @ (variances + (shifts - mean) ** 2)

    def least_weights(self) -> Vector:
        """Weights of the hypotheses in variances: none less than what its sensors keep."""
        faulty = np.array([one.faulty for one in self.heard])
        weight = np.maximum(self.weight, np.where(self.right, 1.0, faulty).prod(axis=1))
        return np.asarray(weight / weight.sum())

    def moments(self) -> tuple[Vector, Vector]:
        """Mean and standard deviation of all unknowns over all hypotheses."""
        mean, variance = self.mixture(self.mean, np.einsum("bii->bi", self.covariance))
        return mean, np.sqrt(variance)

    def moment_of(self, share: Vector) -> tuple[float, float]:
        """Mean and standard deviation of a sum of the robot's unknowns, over all hypotheses."""
        means = self.mean[:, : self.count] @ share
        variances = np.einsum("i,bij,j->b", share, self.covariance[:, : self.count, : self.count],
                              share)  # fmt: skip
        mean, variance = self.mixture(means[:, None], variances[:, None])
        return float(mean[0]), float(np.sqrt(variance[0]))

    def probability_right(self, k: int) -> float:
        """Probability that a sensor is right."""
        return float(self.weight @ self.right[:, k])

    # --- over a restart ---------------------------------------------------------------------------

    def memory(self) -> dict[str, Any]:
        """What ``recall`` needs to go on, as JSON."""
        return {
            "sensors": [[one.sensor.name, one.stamp_ns] for one in self.heard],
            "mean": self.mean.tolist(),
            "covariance": self.covariance.tolist(),
            "weight": self.weight.tolist(),
        }

    def recall(self, memory: Mapping[str, Any], sensors: Mapping[str, Sensor]) -> None:
        """Take up ``memory``.

        Raises:
            KeyError, TypeError, ValueError: it is not one of this robot; nothing has changed then.
        """
        before = self.__dict__.copy()
        try:
            self.__dict__.update(Beliefs(self.unknowns).__dict__)
            for name, stamp_ns in memory["sensors"]:
                self.hear(sensors[name]).stamp_ns = int(stamp_ns)
            for key in ("mean", "covariance", "weight"):
                there = np.array(memory[key], dtype=np.float64)
                if there.shape != getattr(self, key).shape or not np.isfinite(there).all():
                    raise ValueError(f"not the {key} of this robot's unknowns")
                setattr(self, key, there)
            if (self.weight <= 0.0).any() or (np.einsum("bii->bi", self.covariance) < 0.0).any():
                raise ValueError("a weight or a variance is negative")
        except (KeyError, TypeError, ValueError):
            self.__dict__.update(before)
            raise


def _log_likelihood(rest: Vector, variance: Vector) -> Vector:
    """Of a difference with this variance, up to a constant."""
    return np.asarray(-0.5 * (np.log(variance) + rest**2 / variance))
