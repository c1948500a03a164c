"""Which change of the robot or of a sensor explains what the sensors of a group read.

The evidence (B5) is explained by as few changes as possible, beside the numbers that the file
leaves open.  A change of amount a along a direction v of the unknowns has the log odds

    ln O = (b^2 / (k + 1 / J^2) - ln(1 + k J^2)) / 2,     b = v' u',   k = v' M' v            (B6)

against none, where M' and u' are the evidence with all else that is open integrated out, and J is
how large a change may be.  See docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import degrees, inf
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.evidence import Sums
from cdrj_ros.estimation.sensors import Sensor
from cdrj_ros.estimation.unknowns import FRICTION, PRELOAD, SLIP, ZERO, ZERO_M, Unknown
from cdrj_ros.foundation.arrays import Table, Vector

GAIN: Final = 0.05
"""Smallest reported error of a sensor's gain."""

BIAS: Final = 0.06
"""Smallest reported error of a sensor's zero, by what the preloads contribute."""

AXIS_FRICTION: Final = 0.03
"""Smallest reported friction of an axis, by what the preloads contribute to its effort."""

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

MOST: Final = 3
"""Largest number of changes at once."""


@dataclass(frozen=True)
class Change:
    """A way in which the robot or a sensor may differ from the robot file."""

    what: str
    """``preload of upper``."""
    kind: str
    """``preload``, ``zero``, ``friction``, ``gain``, ``bias`` or ``axis friction``."""
    unit: str
    """Of its amount in words."""
    factor: float
    """Amount in words per unit along ``direction``."""
    direction: Vector
    """Change of all unknowns, shape (unknowns,)."""
    least: float
    """Smallest amount that is reported, along ``direction``."""

    @property
    def large(self) -> float:
        """J of (B6)."""
        return LARGE * self.least


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


@dataclass(frozen=True)
class Verdict:
    """What the readings of one group's sensors show."""

    found: tuple[Finding, ...]
    broken: str
    """A cable that carries nothing; empty for none."""
    left: float
    """Mean square of what the findings leave, in squares of the expected errors."""
    deviation: Mapping[str, tuple[float, float]]
    """Of every sensor's readings from the file, and from it with the findings (RMS)."""
    left_of: Mapping[str, tuple[float, float]]
    """The same of every sensor, as sum and number of its independent readings."""
    mean: Vector
    """The robot's unknowns by the findings, shape (unknowns,)."""
    covariance: Table
    """Shape (unknowns, unknowns)."""
    opposite: tuple[str, ...] = ()
    """Sensors that read what only a cable that pushes would give."""
    swapped: tuple[str, ...] = ()
    """Two sensors of which each reads what the other should; or none."""

    @property
    def named(self) -> tuple[str, ...]:
        """The changes that matter."""
        return tuple(one.change.what for one in self.found if one.matters)

    @property
    def explained(self) -> bool:
        """Whether the readings agree with the file with the findings, whatever is broken."""
        return self.left <= UNEXPLAINED and not (self.opposite or self.swapped)


@dataclass(frozen=True)
class _Total:
    """(B5) of all sensors together."""

    information: Table
    vector: Vector
    squares: float
    number: float


def judge(
    unknowns: Sequence[Unknown],
    sensors: Sequence[Sensor],
    frozen: Sequence[bool],
    sums: Sequence[Sums],
    cables: Sequence[str],
) -> Verdict | None:
    """What the sensors of a group show.

    Args:
        unknowns: of the robot.
        sensors: that were heard.
        frozen: whether they repeat their readings while the estimate moves.
        sums: (B5) for each.
        cables: names of all cables of the robot.

    Returns:
        None if there are too few readings.  Frozen sensors tell nothing but a cable without load.
    """
    used = [k for k in range(len(sensors)) if not frozen[k]]
    # an effort that never changes is not measured; a load cell may be without load
    loads = [k for k, one in enumerate(sensors) if not frozen[k] or one.axis < 0]
    broken = _broken(sensors, sums, loads)
    total = _total(len(unknowns), len(sensors), sums, used)
    if total.number < LEAST_NUMBER:
        if not any(frozen):
            return None
        none = np.zeros(len(unknowns))
        return Verdict((), cables[broken] if broken >= 0 else "", 0.0, {}, {}, none, np.diag(none))
    prior = np.zeros(total.vector.size)
    prior[: len(unknowns)] = [0.0 if one.kind is not None else one.start**2 for one in unknowns]
    changes = [*_of_robot(unknowns, prior.size), *_of_sensors(len(unknowns), sensors, used)]
    chosen = _select(total, prior, changes)
    solved = _solve(total, prior, chosen)
    deviation, left_of = {}, {}
    for k in used:
        name, own = sensors[k].name, solved.mean[_places(len(unknowns), k)]
        left_of[name] = _squares(sums[k], own), sums[k].number
        deviation[name] = _rms(sums[k], 0.0 * own), _rms(sums[k], own)
    found = [_finding(total, prior, changes, chosen, k) for k in range(len(chosen))]
    opposite = tuple(sensors[k].name for k in used if _is_opposite(sensors[k], sums[k]))
    swapped = _swapped([(sensors[k], *_means(sums[k])) for k in used if sums[k].weight > 0.0])
    gone = cables[broken] if broken >= 0 and not (opposite or swapped) else ""
    left, of_robot = solved.left / total.number, slice(len(unknowns))
    return Verdict(
        tuple(found), gone, left, deviation, left_of, solved.mean[of_robot],
        solved.covariance[of_robot, of_robot] * max(left, 1.0), opposite, swapped,
    )  # fmt: skip


def _means(sums: Sums) -> tuple[float, float, float]:
    """Mean of the readings, of what the model expects of them, and of the axis' direction."""
    expected, direction = (sums.information[-3, -2:] / sums.information[-3, -3]).tolist()
    return float(sums.vector[-3] / sums.information[-3, -3]) + expected, expected, direction


def _is_opposite(sensor: Sensor, sums: Sums) -> bool:
    """Whether a sensor reads the contrary of what any tensions give.

    The friction of its axis may be as large as what the preloads contribute.
    """
    signs = np.sign(sums.contributions)
    if not (signs.any() and sums.weight > 0.0 and abs(signs.sum()) == np.abs(signs).sum()):
        return False  # no sign, or that of the difference of two cables
    read, _, direction = _means(sums)
    friction = abs(direction) if sensor.axis >= 0 else 0.0
    return bool(read * np.sign(signs.sum()) < -(PUSHED + friction) * sensor.scale)


def _swapped(heard: Sequence[tuple[Sensor, float, float, float]]) -> tuple[str, ...]:
    """Two sensors of one kind of which each reads what the model expects of the other."""
    off = [
        (one, read, expected)
        for one, read, expected, _ in heard
        if abs(read - expected) > PUSHED * one.scale
    ]
    for (one, read, expected), (two, other, meant) in combinations(off, 2):
        fits = abs(read - meant) < ALIKE * two.scale and abs(other - expected) < ALIKE * one.scale
        if fits and (one.axis < 0) == (two.axis < 0):
            return one.name, two.name
    return ()


def _total(count: int, sensors: int, sums: Sequence[Sums], used: Sequence[int]) -> _Total:
    size = count + 3 * sensors
    information, vector = np.zeros((size, size)), np.zeros(size)
    for k in used:
        at = _places(count, k)
        information[np.ix_(at, at)] += sums[k].information
        vector[at] += sums[k].vector
    return _Total(
        information, vector, sum(sums[k].squares for k in used), sum(sums[k].number for k in used)
    )


def _places(count: int, k: int) -> NDArray[np.int64]:
    """Indices of the unknowns of a sensor's sums among all."""
    return np.concatenate([np.arange(count), count + 3 * k + np.arange(3)])


def _rms(sums: Sums, mean: Vector) -> float:
    """Of a sensor's readings less what is expected of them with these unknowns."""
    return float(np.sqrt(_squares(sums, mean) / sums.weight))


def _squares(sums: Sums, mean: Vector) -> float:
    """The same as a sum of squares, in squares of the expected errors."""
    squares = sums.squares + float(mean @ (sums.information @ mean - 2.0 * sums.vector))
    return max(squares, 0.0)


# --- changes --------------------------------------------------------------------------------------


def _of_robot(unknowns: Sequence[Unknown], size: int) -> Iterator[Change]:
    """Of one unknown, and of all preloads, friction or slip by the same share."""
    for kind, unit, factor in (
        (PRELOAD, "N", 1.0), (ZERO, "deg", degrees(1.0)), (ZERO_M, "mm", 1e3), (FRICTION, "%", 0.0),
        (SLIP, "%", 0.0),
    ):  # fmt: skip
        of_kind = [k for k, one in enumerate(unknowns) if one.kind == kind]
        share = 100.0 * kind.unit
        for k in of_kind:
            direction = np.zeros(size)
            direction[k] = 1.0
            scale = factor * unknowns[k].unit or share
            yield Change(unknowns[k].name, kind.name, unit, scale, direction, kind.reported)
        if kind not in (ZERO, ZERO_M) and len(of_kind) > 1:
            direction = np.zeros(size)
            direction[of_kind] = 1.0
            yield Change(f"{kind.name} of all cables", kind.name, "%", share, direction,
                         kind.reported)  # fmt: skip


def _of_sensors(count: int, sensors: Sequence[Sensor], used: Sequence[int]) -> Iterator[Change]:
    """Of gain and zero of a sensor, and of the friction of its axis."""
    size = count + 3 * len(sensors)
    efforts = [k for k in used if sensors[k].axis >= 0]
    if len(efforts) > 1:
        direction = np.zeros(size)
        direction[[count + 3 * k + 1 for k in efforts]] = 1.0
        yield Change(ALL_EFFORTS, "gain", "%", 100.0, direction, GAIN)
    for k in used:
        sensor = sensors[k]
        rows = [("gain", f"scale of {sensor.title}", "%", 100.0, 1, GAIN),
                ("bias", f"zero of {sensor.title}", sensor.unit, 1.0, 0,
                 BIAS * sensor.scale)]  # fmt: skip
        if sensor.axis >= 0:
            rows.append(("axis friction", f"friction of the axis {sensor.name}", sensor.unit, 1.0,
                         2, AXIS_FRICTION * sensor.scale))  # fmt: skip
        for kind, what, words, factor, place, least in rows:
            direction = np.zeros(size)
            direction[count + 3 * k + place] = 1.0
            yield Change(what, kind, words, factor, direction, least)


# --- selection ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Solved:
    """What the file leaves open and some changes, fitted to the evidence."""

    mean: Vector
    """Of all unknowns."""
    covariance: Table
    amounts: Vector
    """Of the changes, along their directions."""
    variances: Vector
    """Of the amounts."""
    left: float
    """Sum of squares that is left."""
    vector: Vector
    """u' of (B6)."""
    information: Table
    """M' of (B6)."""


def _solve(total: _Total, prior: Vector, chosen: Sequence[Change]) -> _Solved:
    opened = np.flatnonzero(prior > 0.0)
    basis = np.zeros((prior.size, opened.size + len(chosen)))
    basis[opened, np.arange(opened.size)] = 1.0
    for k, one in enumerate(chosen):
        basis[:, opened.size + k] = one.direction
    across = total.information @ basis
    matrix = basis.T @ across
    matrix += np.diag(1.0 / np.array([*prior[opened], *(one.large**2 for one in chosen)]))
    scale = 1.0 / np.sqrt(np.diag(matrix))  # the unknowns have different units
    inverse = np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)
    given = basis.T @ total.vector
    amounts = inverse @ given
    return _Solved(
        basis @ amounts, basis @ inverse @ basis.T, amounts[opened.size :],
        np.diag(inverse)[opened.size :],
        max(total.squares - float(given @ amounts), 0.0),
        total.vector - across @ amounts, total.information - across @ inverse @ across.T,
    )  # fmt: skip


def _gains(solved: _Solved, changes: Sequence[Change], number: float) -> tuple[Vector, Vector]:
    """By how much every change lowers the sum of squares, and its log odds by (B6).

    Errors that turn out greater than expected lower the odds.
    """
    v = np.array([one.direction for one in changes])
    large = np.array([one.large**2 for one in changes])
    b = v @ solved.vector
    k = np.maximum(np.einsum("ci,ij,cj->c", v, solved.information, v), 0.0)
    gains = b**2 / (k + 1.0 / large)
    mean_square = np.maximum((solved.left - gains) / number, 1.0)
    return gains, 0.5 * (gains / mean_square - np.log1p(k * large / mean_square))


def _select(total: _Total, prior: Vector, changes: Sequence[Change]) -> list[Change]:
    """The fewest changes that explain the evidence."""
    chosen: list[Change] = []
    while len(chosen) < MOST:
        solved = _solve(total, prior, chosen)
        rest = [one for one in changes if one not in chosen]
        gains, odds = _gains(solved, rest, total.number)
        best = int(np.argmax(odds))
        explained = total.squares - solved.left + gains[best]
        if (
            odds[best] < CERTAIN
            or gains[best] < FURTHER * explained
        ):  # fmt: skip
            break
        chosen.append(rest[best])
    return chosen


def _finding(
    total: _Total, prior: Vector, changes: Sequence[Change], chosen: Sequence[Change], k: int
) -> Finding:
    """The chosen change of this index, and what would explain the readings in its place."""
    one, solved = chosen[k], _solve(total, prior, chosen)
    mean_square = max(1.0, solved.left / total.number)
    without = _solve(total, prior, [*chosen[:k], *chosen[k + 1 :]])
    instead = [one, *(other for other in changes if other not in chosen)]
    _, odds = _gains(without, instead, total.number)
    order = 1 + np.argsort(-odds[1:])
    others = tuple(instead[i].what for i in order if odds[i] >= odds[0] - AS_GOOD)
    return Finding(
        one, float(solved.amounts[k]) * one.factor,
        float(np.sqrt(solved.variances[k] * mean_square)) * one.factor,
        others, float(odds[0] - odds[order[0]]) if order.size else inf,
    )  # fmt: skip


def _broken(sensors: Sequence[Sensor], sums: Sequence[Sums], used: Sequence[int]) -> int:
    """The number of the cable that carries nothing by the last readings; -1 if none does."""
    squares = sum(float(sums[k].recent[-2]) for k in used)
    number = sum(float(sums[k].recent[-1]) for k in used)
    least, found = min(squares - 2.0 * CERTAIN, UNEXPLAINED * number), -1
    for c in sorted({c for k in used for c in sensors[k].cables}):
        without = 0.0
        for k in used:
            own = sensors[k].cables
            without += float(sums[k].recent[own.index(c) if c in own else -2])
        if without < least:
            least, found = without, c
    return found
