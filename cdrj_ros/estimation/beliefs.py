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
from typing import Any, Final, NamedTuple

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

WRONG: Final = 0.3
"""What a wrong sensor's reading may be off by: a share of it, or of what preloads contribute."""

OUTLIER: Final = 0.02
"""Probability of a stray reading of a good sensor, and that another one follows it."""

STRAY: Final = 3.0
"""How far a stray reading, or one of a wrong sensor, is off, by what the preloads contribute."""

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

USED_S: Final = 0.4
"""For so long a reading also says something about the present [s]."""

FAR: Final = 100.0
"""A squared residual by its variance beyond which a reading says nothing about the present."""

EQUAL: Final = 3
"""A sensor is frozen if more readings than this are equal,"""

STIFF: Final = 2.0
"""while the estimate moves by more than this number of their standard deviations."""

LEAST_WEIGHT: Final = 1e-6
"""Least weight of a hypothesis, so that it can recover."""

FROZEN: Final = -50.0
"""Log likelihood of a frozen sensor's readings if it is right."""

TINY: Final = 1e-30
"""Least variance by which another one is divided."""

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
    strays: int = 0
    """How many of the latest were stray if all sensors are right."""

    @property
    def frozen(self) -> bool:
        """Whether equal readings contradict the motion."""
        moved = self.highest - self.lowest
        return self.equal >= EQUAL and moved > STIFF * float(self.variance) ** 0.5


class _Latest(NamedTuple):
    """The latest readings of a group's sensors, as statements about the present."""

    sensors: list[int]
    """Indices of the sensors that have one."""
    read: list[Heard]
    at: list[int]
    """Indices of the quantities that they read."""
    stamp_ns: int
    """Now."""
    h: Vector
    """What the model says of these quantities now."""
    rest: Table
    """Readings less what is expected of them, shape (sensors, hypotheses)."""
    change: list[Table]
    """Change of every reading per unknown, shape (hypotheses, unknowns) each."""
    history: Table
    """Covariance of these quantities and all by the members, shape (sensors, columns)."""
    spread: Vector
    """Variance of all quantities by the members, shape (columns,)."""
    parts: NDArray[np.bool_]
    """Sensors that contribute to the quantities of every part, shape (parts, sensors)."""
    part_of: NDArray[np.int64]
    """Part of every quantity, shape (columns,)."""


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
        expected, change = self._expected(one)
        rest = value - expected
        bent = (NONLINEAR * (self.mean[:, : self.count] @ slopes)) ** 2
        across = np.einsum("bij,bj->bi", self.covariance, change)
        variance = np.einsum("bi,bi->b", across, change) + noise**2 + lasting + bent
        jumps = float(slopes**2 @ self._jump)
        sudden = FIRST_JUMP if first else min(JUMP_RATE * passed, FIRST_JUMP)
        stray = (STRAY * one.sensor.scale) ** 2
        quiet = log(1.0 - sudden) + _log_likelihood(rest, variance)
        jumped = log(sudden) + _log_likelihood(rest, variance + jumps)
        if one.frozen:
            quiet, jumped = quiet + FROZEN, jumped + FROZEN
        changed = np.logaddexp(quiet, jumped)
        wrong = _log_likelihood(rest, variance + stray)
        strayed = (1 + one.strays) * log(OUTLIER) + wrong
        right = np.logaddexp(changed, strayed)
        used = self.right[:, k] & (strayed < changed)
        one.strays = 0 if used[0] else one.strays + 1
        self._widen(used, np.exp(jumped - changed), across, change)
        lasts = max(1.0, LASTS_S / passed)
        self._update(used, rest, across, change, noise**2 + (lasting + bent) * lasts)
        score = np.where(self.right[:, k], right, wrong)
        self.weight *= np.exp(min(1.0, passed / INDEPENDENT_S) * (score - score.max()))
        self._fail(k, passed)

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

    def _expected(self, one: Heard) -> tuple[Vector, Table]:
        """What every hypothesis expects of a sensor's last reading, and its change per unknown."""
        assert one.slopes is not None
        bias, gain, friction = self.mean[:, one.first : one.first + 3].T
        true = one.h + self.mean[:, : self.count] @ one.slopes
        change = np.zeros_like(self.mean)
        change[:, : self.count] = (1.0 + gain)[:, None] * one.slopes
        change[:, one.first], change[:, one.first + 1] = 1.0, true
        change[:, one.first + 2] = one.direction
        return (1.0 + gain) * true + bias + one.direction * friction, change

    def _widen(self, used: NDArray[np.bool_], share: Vector, across: Table, change: Table) -> None:
        """Add the variance of a sudden change by its probability: two Gaussians become one."""
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

    def widen(self, size: Vector) -> None:
        """Add to the variances of the robot's unknowns, shape (count,), under all hypotheses."""
        robot = np.arange(self.count)
        self.covariance[:, robot, robot] += size

    # --- the estimate -----------------------------------------------------------------------------

    def correction(
        self, stamp_ns: int, h: Vector, slopes: Table, deviation: Table,
        columns: Mapping[int, int], related: NDArray[np.bool_],
    ) -> tuple[Vector, Vector, Vector]:  # fmt: skip
        """What the sensors say about the present.

        The unknowns shift all quantities by their signatures.  The latest readings say, beyond
        that, where the friction history has led, through the covariance of the members:

            t <- t + C_tz (C_zz + R)^-1 (z - expected).                                      (B4)

        Args:
            stamp_ns: now [ns].
            h: the model's quantities now, shape (columns,).
            slopes: their signatures, shape (unknowns, columns).
            deviation: of the members from h by their histories, shape (members, columns).
            columns: of the quantities that sensors read, by ``Sensor.column``.
            related: whether a sensor's cables contribute to a quantity, shape (sensors, columns).
                The others change it by their unknowns alone: few members cannot tell more.

        Returns:
            Changes of all quantities; the shares of the variances of their histories that the
            readings take away; and the variances that the unknowns leave.
        """
        latest = self._latest(stamp_ns, h, deviation, columns, related)
        shifts = self.mean[:, : self.count] @ slopes
        by_unknowns = self.covariance[:, :, : self.count] @ slopes
        variances = np.einsum("nc,bnc->bc", slopes, by_unknowns[:, : self.count])
        bent = NONLINEAR * shifts
        variances += bent**2
        known = np.zeros_like(shifts)
        for b in range(len(shifts) if latest.read else 0):
            shift, known[b], less = self._condition(b, latest, by_unknowns[b], bent[b])
            shifts[b] += shift
            variances[b] -= less
        mean, left = self._mixture(shifts, np.maximum(variances, 0.0))
        return mean, self._least_weights() @ np.clip(known, 0.0, 1.0), left

    def _latest(
        self, stamp_ns: int, h: Vector, deviation: Table, columns: Mapping[int, int],
        related: NDArray[np.bool_],
    ) -> _Latest:  # fmt: skip
        """The latest readings, for the arguments of ``correction``."""
        now = [
            k
            for k, one in enumerate(self.heard)
            if abs(stamp_ns - one.stamp_ns) * 1e-9 <= USED_S
            and one.slopes is not None
            and not one.frozen
        ]
        read = [self.heard[k] for k in now]
        at = [columns[one.sensor.column] for one in read]
        found = [self._expected(one) for one in read]
        spread = np.einsum("mc,mc->c", deviation, deviation) / len(deviation)
        parts, part_of = np.unique(related[now], axis=1, return_inverse=True)
        return _Latest(
            now, read, at, stamp_ns, h[at],
            np.array([one.value - e for one, (e, _) in zip(read, found, strict=True)]),
            [change for _, change in found],
            deviation[:, at].T @ deviation / len(deviation), np.maximum(spread, TINY),
            parts.T, part_of.ravel(),
        )  # fmt: skip

    def _condition(
        self, b: int, latest: _Latest, by_unknowns: Table, bent: Vector
    ) -> tuple[Vector, Vector, Vector]:
        """(B4) under one hypothesis.

        Args:
            b: the hypothesis.
            latest: the readings.
            by_unknowns: covariance of its unknowns and all quantities, shape (unknowns, columns).
            bent: standard deviation of what signatures do not say, shape (columns,).

        Returns:
            Changes of all quantities, shares of their histories' variances, and what is taken from
            the variances that the unknowns leave.
        """
        at, history = latest.at, latest.history
        change = np.array([rows[b] for rows in latest.change])
        wrong = ~self.right[b, latest.sensors]
        noise = [
            self._noise(b, one, latest.stamp_ns, now, history[i, at[i]], is_wrong=bool(wrong[i]))
            for i, (one, now) in enumerate(zip(latest.read, latest.h.tolist(), strict=True))
        ]
        bends = bent[at, None]
        total = history[:, at] + bends * bent[at] + np.diag(noise)
        total += change @ self.covariance[b] @ change.T
        # sensors that are right have told the unknowns before, by their lasting part
        with_all = history + bends * bent + wrong[:, None] * (change @ by_unknowns)
        near = latest.rest[:, b] ** 2 <= FAR * np.diag(total)
        shift, known, less = np.zeros((3, bent.size))
        for k, part in enumerate(latest.parts):
            own, there = np.flatnonzero(part & near), np.flatnonzero(latest.part_of == k)
            across = with_all[np.ix_(own, there)]
            gain = np.linalg.solve(total[np.ix_(own, own)], across)
            shift[there] = latest.rest[own, b] @ gain
            of_history = np.einsum("sc,sc->c", gain, history[np.ix_(own, there)])
            known[there] = of_history / latest.spread[there]
            less[there] = np.einsum("sc,sc->c", gain, across) - of_history
        return shift, known, less

    def _noise(
        self, b: int, one: Heard, stamp_ns: int, now: float, history: float, *, is_wrong: bool
    ) -> float:
        """Variance of a reading's errors as a statement about the present."""
        assert one.slopes is not None
        shift = float(self.mean[b, : self.count] @ one.slopes)
        true = max(abs(one.h + shift), one.sensor.scale)
        age = (stamp_ns - one.stamp_ns) * 1e-9 / LASTS_S
        moved = 2.0 * (now - one.h) / true
        noise = one.variance + history * (age**2 + moved**2)
        return noise + (WRONG * max(abs(one.value), one.sensor.scale)) ** 2 * is_wrong

    def _mixture(self, shifts: Table, variances: Table) -> tuple[Vector, Vector]:
        """Mean and variance over all hypotheses; none weighs too little in the variance."""
        mean = self.weight @ shifts
        return mean, self._least_weights() @ (variances + (shifts - mean) ** 2)

    def _least_weights(self) -> Vector:
        """Weights of the hypotheses in variances: none less than what its sensors keep."""
        faulty = np.array([one.faulty for one in self.heard])
        weight = np.maximum(self.weight, np.where(self.right, 1.0, faulty).prod(axis=1))
        return np.asarray(weight / weight.sum())

    def moments(self) -> tuple[Vector, Vector]:
        """Mean and standard deviation of all unknowns over all hypotheses."""
        mean, variance = self._mixture(self.mean, np.einsum("bii->bi", self.covariance))
        return mean, np.sqrt(variance)

    def moment_of(self, share: Vector) -> tuple[float, float]:
        """Mean and standard deviation of a sum of the robot's unknowns, over all hypotheses."""
        means = self.mean[:, : self.count] @ share
        variances = np.einsum("i,bij,j->b", share, self.covariance[:, : self.count, : self.count],
                              share)  # fmt: skip
        mean, variance = self._mixture(means[:, None], variances[:, None])
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
