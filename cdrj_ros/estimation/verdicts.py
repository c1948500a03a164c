"""Which change of the robot or of a sensor explains what the sensors of a group read.

The latest readings (B5) are explained by as few changes as possible, beside the numbers that the
file leaves open.  A change of amount a along a direction v of the unknowns has the log odds

    ln O = (b^2 / (k + 1 / J^2) - ln(1 + k J^2)) / 2,     b = v' u',   k = v' M' v            (B6)

against none, where M' and u' are the evidence with all else that is open integrated out, and J is
how large a change may be.  See docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import exp, inf
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.sensors import EFFORT, Sensor
from cdrj_ros.estimation.unknowns import AXIS, MODE, Kind, Unknown
from cdrj_ros.foundation.arrays import Table, Vector

OFF: Final = ("{what} is {size} too high", "{what} is {size} too low")

GAIN: Final = Kind("gain", "scale of {}", 1.0, reported=0.05, said=OFF)
"""Error of a sensor's gain."""

BIAS: Final = Kind("bias", "zero of {}", 1.0, reported=0.06, said=OFF)
"""Error of a sensor's zero, by what the preloads contribute."""

ALL_EFFORTS: Final = "scale of all efforts"
"""Name of the change that a wrong unit of them is."""

LARGE: Final = 20.0
"""How large a change may be, J of (B6), in the smallest that is reported."""

CERTAIN: Final = 12.5
"""Log odds from which a change is taken up: five standard deviations."""

FURTHER: Final = 0.02
"""A further change must explain so much of what is explained already: signatures are straight lines
through what is curved."""

AS_GOOD: Final = 6.0
"""Another change explains the readings as well if its log odds are lower by no more."""

UNEXPLAINED: Final = 9.0
"""Mean square of what is left, beyond which no change explains the readings: three times the
expected errors."""

LEAST_NUMBER: Final = 6.0
"""Least number of independent readings, as counted by the evidence."""

PUSHED: Final = 1.0 / 3.0
"""Share of what the preloads contribute, beyond which a mean reading of the wrong sign is no zero,
and by which two mean readings are off that may be swapped."""

ALIKE: Final = 0.1
"""Share within which each of these then fits the other sensor."""

TIMES: Final = 5.0
"""Efforts that are more than so many times what is expected, and unexplained, have another unit."""

CLEARLY: Final = 2.0
"""An amount is impossible if it is out of bounds by more than so many standard deviations."""

SELDOM: Final = 0.1
"""How much less likely a change of a sensor is than one of the robot, whose cables settle, slip and
are mounted anew: it is named after one that explains the readings as well."""

MOST: Final = 3
"""Largest number of changes at once."""


class Heard(NamedTuple):
    """A sensor that was heard, and what its latest readings show, (B5)."""

    sensor: Sensor
    frozen: bool
    """Whether it repeats its readings while the estimate moves."""
    right: float
    """See ``Beliefs.probability_right``."""
    parts: Table
    """See ``Sensor.parts_of``."""
    sums: Table
    """M of (B5), bordered by u and the sum of squares; of the unknowns, bias, gain and reading."""
    number: float
    """Of independent readings."""
    recent: Vector
    """Sums of squares of the last readings without each cable of the sensor; by how much they would
    be greater with the preloads; with all cables; then their number."""

    def squares(self, mean: Vector) -> float:
        """What unknowns leave of the readings, in squares of the expected errors."""
        left = np.append(-mean, 1.0)
        return max(float(left @ self.sums @ left), 0.0)

    def rms(self, squares: float) -> float:
        """Of deviations, from their squares by the expected errors."""
        return float(np.sqrt(squares / self.sums[-3, -3]))

    def mean(self, of: int) -> float:
        """Mean slope of an unknown; -2: of what is expected; -1: of the deviation from it."""
        return float(self.sums[-3, of] / self.sums[-3, -3])

    @property
    def expected(self) -> float:
        """Mean of what the model expects."""
        return self.mean(-2)

    @property
    def read(self) -> float:
        """Mean of the readings."""
        return self.expected + self.mean(-1)


@dataclass(frozen=True)
class Change:
    """A way in which the robot or a sensor may differ from the robot file."""

    what: str
    """``preload of upper``."""
    kind: Kind
    unit: str
    """Of its amount in words."""
    factor: float
    """Amount in words per unit along ``places``."""
    least: float
    """Smallest amount that is reported, along ``places``."""
    places: tuple[int, ...]
    """Unknowns that all change by this amount."""
    probability: float = 1.0
    """Before any reading, by that of a change of the robot."""


@dataclass(frozen=True)
class Finding:
    """A change that the readings show."""

    change: Change
    amount: float
    stddev: float
    """Of the amount, both in the change's unit."""
    others: tuple[str, ...]
    """What else would explain the readings as well, the likeliest first."""
    margin: float
    """Logarithm of how much likelier it is than the likeliest other change."""

    @property
    def matters(self) -> bool:
        """Whether it is as large as the smallest change that is reported."""
        return abs(self.amount) >= self.change.least * self.change.factor


class Explanation(NamedTuple):
    """What a few changes say about the robot."""

    probability: float
    """By that of the likeliest."""
    mean: Vector
    """Of the robot's unknowns."""
    covariance: Table


@dataclass(frozen=True)
class Verdict:
    """What the readings of one group's sensors show."""

    found: tuple[Finding, ...] = ()
    broken: str = ""
    """A cable that carries nothing; empty for none."""
    left: float = 0.0
    """Mean square of what the findings leave, in squares of the expected errors."""
    unexplained: float = 1.0
    """The same, at least 1, with every sensor weighed by how probably it is right, (B7)."""
    explanations: tuple[Explanation, ...] = ()
    """By the findings, and by what would explain the readings as well; none if nothing that matters
    is found."""
    deviation: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Of every sensor's readings from the file, and from it with the findings (RMS)."""
    opposite: tuple[str, ...] = ()
    """Sensors that read what only a cable that pushes would give."""
    swapped: tuple[str, ...] = ()
    """Two sensors of which each reads what the other should; or none."""
    times: float = 1.0
    """How many times what is expected all efforts read, at least; 1 for less than ``TIMES``."""

    @property
    def named(self) -> tuple[str, ...]:
        """The changes that matter."""
        return tuple(one.change.what for one in self.found if one.matters)

    @property
    def explained(self) -> bool:
        """Whether the readings agree with the file with the findings, whatever is broken."""
        return self.left <= UNEXPLAINED and not (self.opposite or self.swapped)


def judge(
    unknowns: Sequence[Unknown],
    every: Sequence[Heard],
    cables: Sequence[str],
    before: Verdict | None = None,
) -> Verdict | None:
    """What the sensors of a group show.

    Args:
        unknowns: of the robot.
        every: sensors that were heard.
        cables: names of all cables of the robot.
        before: the last verdict, whose changes are named while no other is clearly likelier.

    Returns:
        None if there are too few readings.  Frozen sensors tell nothing but a cable without load.
    """
    read = [one for one in every if one.number > 0.0]
    heard = [one for one in read if not one.frozen]
    # an effort that never changes is not measured; a load cell may be without load
    gone = _broken([one for one in read if not one.frozen or one.sensor.axis < 0])
    broken = cables[gone] if gone >= 0 else ""
    if sum(one.number for one in heard) < LEAST_NUMBER:
        return Verdict(broken=broken) if any(one.frozen for one in every) else None
    fit = _Fit(unknowns, heard)
    chosen = fit.select([one.change for one in before.found] if before is not None else ())
    mean, _, left = fit.solve(chosen)
    squares = [one.squares(mean[fit.places(k)]) for k, one in enumerate(heard)]
    deviation = {
        one.sensor.name: (one.rms(float(one.sums[-1, -1])), one.rms(own))
        for one, own in zip(heard, squares, strict=True)
    }
    independent = sum(one.right * one.number for one in heard)
    weighed = sum(one.right * own for one, own in zip(heard, squares, strict=True))
    unexplained = max(1.0, weighed / max(independent, 1.0))
    opposite = tuple(one.sensor.name for one in heard if _is_opposite(one, unknowns))
    swapped = _swapped(heard)
    instead = {one: fit.instead(chosen, one) for one in chosen}
    found = tuple(fit.finding(chosen, one, odds) for one, odds in instead.items())
    explanations = fit.explanations(instead) if any(one.matters for one in found) else ()
    return Verdict(
        found, "" if opposite or swapped else broken, left, unexplained, tuple(explanations),
        deviation, opposite, swapped, _times(heard),
    )  # fmt: skip


# --- signs, names and breaks ----------------------------------------------------------------------


def _is_opposite(one: Heard, unknowns: Sequence[Unknown]) -> bool:
    """Whether a sensor reads the contrary of what any tensions give.

    The friction of its axis may be as large as what the preloads contribute.
    """
    signs, sensor = np.sign(one.parts), one.sensor
    if not signs.any() or abs(signs.sum()) != np.abs(signs).sum():
        return False  # no sign, or that of the difference of two cables
    of_axis = AXIS.what.format(sensor.name)
    rubs = sum(one.mean(k) for k, own in enumerate(unknowns) if own.name == of_axis)
    allowed = PUSHED * sensor.scale + abs(rubs) / AXIS.unit
    return bool(one.read * np.sign(signs.sum()) < -allowed)


def _swapped(heard: Sequence[Heard]) -> tuple[str, ...]:
    """Two sensors of one kind of which each reads what the model expects of the other."""
    off = [one for one in heard if abs(one.mean(-1)) > PUSHED * one.sensor.scale]
    for one, two in combinations(off, 2):
        of_one = abs(two.read - one.expected) < ALIKE * one.sensor.scale
        of_two = abs(one.read - two.expected) < ALIKE * two.sensor.scale
        if of_one and of_two and (one.sensor.axis < 0) == (two.sensor.axis < 0):
            return one.sensor.name, two.sensor.name
    return ()


def _times(heard: Sequence[Heard]) -> float:
    """How many times what is expected all efforts read, at least; 1 for less than ``TIMES``.

    Their readings must follow what is expected, but for ``ALIKE`` of the squares.
    """
    times = []
    for one in heard:
        (own, across), squares = one.sums[-2, -2:], one.sums[-1, -1]
        if one.sensor.axis < 0:
            continue
        if not across**2 > (1.0 - ALIKE) * own * squares:
            return 1.0
        times.append(1.0 + float(across / own))
    least = min(times, default=1.0)
    return least if least > TIMES else 1.0


def _broken(heard: Sequence[Heard]) -> int:
    """The number of the cable that carries nothing by the last readings; -1 if none does.

    Readings of what the preloads give say nothing of it, whatever the estimate expects.
    """
    squares, number = (sum(float(one.recent[k]) for one in heard) for k in (-2, -1))
    least, found = min(squares - 2.0 * CERTAIN, UNEXPLAINED * number), -1
    for c in sorted({c for one in heard for c in one.sensor.cables}):
        of_cable = [(one.recent, one.sensor.cables) for one in heard if c in one.sensor.cables]
        others = squares - sum(float(recent[-2]) for recent, _ in of_cable)
        without = others + sum(float(recent[own.index(c)]) for recent, own in of_cable)
        odds = sum(float(recent[len(own) + own.index(c)]) for recent, own in of_cable)
        if without < least and odds > 2.0 * CERTAIN:
            least, found = without, c
    return found


# --- changes --------------------------------------------------------------------------------------


def _of_robot(unknowns: Sequence[Unknown]) -> Iterator[Change]:
    """Of one unknown, and of all preloads, friction or slips by the same share."""
    kinds = dict.fromkeys(one.kind for one in unknowns if one.kind.reported)
    for kind in kinds:
        own = [k for k, one in enumerate(unknowns) if one.kind == kind]
        unit, factor = kind.words
        for k in own:
            amount = factor * unknowns[k].unit
            yield Change(unknowns[k].name, kind, unit, amount, kind.reported, (k,))
        if kind.alike and len(own) > 1:
            share = 100.0 * kind.unit
            yield Change(kind.alike, kind, "%", share, kind.reported, tuple(own))


def _of_sensors(count: int, heard: Sequence[Heard]) -> Iterator[Change]:
    """Of gain and zero of every sensor; of all efforts by a wrong unit, unless one was compared."""
    efforts = [k for k, one in enumerate(heard) if one.sensor.axis >= 0]
    if len(efforts) > 1:
        gains = tuple(count + 2 * k + 1 for k in efforts)
        known = any(heard[k].sensor.gain < EFFORT.gain for k in efforts)
        likely = SELDOM if known else 1.0
        yield Change(ALL_EFFORTS, GAIN, "%", 100.0, GAIN.reported, gains, likely)
    for k, one in enumerate(heard):
        own, bias = one.sensor, count + 2 * k
        scale, zero = (kind.what.format(own.title) for kind in (GAIN, BIAS))
        yield Change(scale, GAIN, "%", 100.0, GAIN.reported, (bias + 1,), SELDOM)
        yield Change(zero, BIAS, own.unit, 1.0, BIAS.reported * own.scale, (bias,), SELDOM)


# --- selection ------------------------------------------------------------------------------------


class _Fit:
    """(B5) of all sensors together, in what the file leaves open and all candidate changes."""

    def __init__(self, unknowns: Sequence[Unknown], heard: Sequence[Heard]) -> None:
        self.count = len(unknowns)
        size = self.count + 2 * len(heard) + 1
        sums = np.zeros((size, size))
        for k, one in enumerate(heard):
            at = [*self.places(k), size - 1]
            sums[np.ix_(at, at)] += one.sums
        self.number = sum(one.number for one in heard)
        self.changes = [*_of_robot(unknowns), *_of_sensors(self.count, heard)]
        self.modes = [k for k, one in enumerate(unknowns) if one.kind is MODE]
        places = [(k,) for k in self.modes] + [one.places for one in self.changes]
        self.basis = np.zeros((size, len(places) + 1))
        for k, own in enumerate(places):
            self.basis[own, k] = 1.0
        self.basis[-1, -1] = 1.0
        self.sums = self.basis.T @ sums @ self.basis
        changes = [LARGE * one.least for one in self.changes]
        self.prior = np.array([unknowns[k].kind.start for k in self.modes] + changes) ** 2
        self.likely = {one: np.log(one.probability) for one in self.changes}

    def places(self, k: int) -> list[int]:
        """Indices of the unknowns of a sensor's sums among all."""
        own = self.count + 2 * k
        return [*range(self.count), own, own + 1]

    def _at(self, chosen: Sequence[Change]) -> list[int]:
        """Coordinates of what is open, and of these changes."""
        first = len(self.modes)
        return [*range(first), *(first + self.changes.index(one) for one in chosen)]

    def _without(self, at: Sequence[int]) -> tuple[Vector, Table, Table]:
        """Amounts of some coordinates, their covariance, and the sums without them."""
        across = self.sums[:, at]
        matrix = across[at] + np.diag(1.0 / self.prior[at])
        scale = 1.0 / np.sqrt(np.diag(matrix))  # the unknowns have different units
        inverse = np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)
        gain = across @ inverse
        return gain[-1], inverse, self.sums - gain @ across.T

    def solve(self, chosen: Sequence[Change]) -> tuple[Vector, Table, float]:
        """All unknowns by these changes, their covariance, and the mean square that is left."""
        at = self._at(chosen)
        (amounts, inverse, rest), basis = self._without(at), self.basis[:-1, at]
        left = max(float(rest[-1, -1]), 0.0) / self.number
        return basis @ amounts, basis @ inverse @ basis.T, left

    def _odds(self, rest: Table, some: Sequence[Change]) -> tuple[Vector, Vector]:
        """By how much every change lowers the sum of squares, and its log odds by (B6).

        Errors that turn out greater than expected lower the odds.
        """
        at = self._at(some)[len(self.modes) :]
        large, b, k = self.prior[at], rest[-1, at], np.maximum(np.diag(rest)[at], 0.0)
        gains = b**2 / (k + 1.0 / large)
        mean_square = np.maximum((rest[-1, -1] - gains) / self.number, 1.0)
        return gains, 0.5 * (gains / mean_square - np.log1p(k * large / mean_square))

    def select(self, before: Sequence[Change]) -> list[Change]:
        """The fewest changes that explain the evidence, those of ``before`` if they do as well."""
        likely = {one: own + AS_GOOD * (one in before) for one, own in self.likely.items()}
        chosen: list[Change] = []
        refused: list[Change] = []
        while len(chosen) < MOST:
            _, _, rest = self._without(self._at(chosen))
            others = [one for one in self.changes if one not in chosen and one not in refused]
            gains, odds = self._odds(rest, others)
            best = int(np.argmax(odds + [likely[one] for one in others]))
            explained = self.sums[-1, -1] - rest[-1, -1] + gains[best]
            if odds[best] < CERTAIN or gains[best] < FURTHER * explained:
                break
            to = chosen if self._possible([*chosen, others[best]]) else refused
            to.append(others[best])
        return chosen

    def _possible(self, some: Sequence[Change]) -> bool:
        """Whether changes are possible together: no friction drives, no drum gives cable back."""
        amounts, inverse, rest = self._without(self._at(some))
        stddev = np.sqrt(np.diag(inverse) * max(1.0, rest[-1, -1] / self.number))
        highest = (amounts + CLEARLY * stddev)[len(self.modes) :]
        return bool((highest >= [one.kind.lowest for one in some]).all())

    def instead(self, chosen: Sequence[Change], change: Change) -> dict[Change, float]:
        """Log odds against a chosen change of every other in its place, the likeliest first."""
        _, _, without = self._without(self._at([one for one in chosen if one is not change]))
        instead = [change, *(one for one in self.changes if one not in chosen)]
        _, odds = self._odds(without, instead)
        odds += [self.likely[one] for one in instead]
        return {instead[i]: float(odds[i] - odds[0]) for i in 1 + np.argsort(-odds[1:])}

    def finding(
        self, chosen: Sequence[Change], change: Change, odds: Mapping[Change, float]
    ) -> Finding:
        """A chosen change, and what would explain the readings in its place, by its ``instead``."""
        amounts, inverse, rest = self._without(self._at(chosen))
        k = len(self.modes) + list(chosen).index(change)
        stddev = np.sqrt(inverse[k, k] * max(1.0, rest[-1, -1] / self.number))
        others = tuple(one.what for one, own in odds.items() if own >= -AS_GOOD)
        return Finding(
            change, float(amounts[k]) * change.factor, float(stddev) * change.factor, others,
            -max(odds.values(), default=-inf),
        )  # fmt: skip

    def explanations(
        self, instead: Mapping[Change, Mapping[Change, float]]
    ) -> Iterator[Explanation]:
        """The chosen changes, and those with another one in the place of one of them."""
        found = [(list(instead), 0.0)]
        for change, others in instead.items():
            rest = [one for one in instead if one is not change]
            found += [([*rest, other], odds) for other, odds in others.items() if odds >= -AS_GOOD]
        possible = [one for one in found if self._possible(one[0])]
        likeliest, own = max((odds for _, odds in possible), default=0.0), slice(self.count)
        for some, odds in possible:
            mean, covariance, left = self.solve(some)
            sizes = max(left, 1.0) * covariance[own, own]
            yield Explanation(exp(odds - likeliest), mean[own], sizes)
