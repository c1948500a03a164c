"""Which change explains the readings of one cycle of motion.

The readings stand beside what the file and every changed robot expect.  The residuals of a cycle,
as means over its parts, are explained by as few signatures as possible: a change is added while it
lowers the weighted sum of squares by more than chance does.  See docs/reliability.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.health_changes import Change
from cdrj_ros.foundation.arrays import Table, Vector

TURNED: Final = 0.25
"""A motion has reversed once it has come back by this fraction of its largest swing."""

LEAST_COUNTS: Final = 50.0
"""Smallest swing that counts as motion, in counts of the sensor."""

LEAST_SWING: Final = 1e-3
"""Smallest swing that counts as motion [rad] or [m]."""


WHOLE: Final = 0.6
"""A window must cover this fraction of the largest motion so far: after shorter strokes the far
ends of the cables keep a tension that no model with one contact per pulley gives."""


class Reading(NamedTuple):
    """One measured value with the values that the models expect at its time."""

    measured: float
    noise: float
    """Standard deviation of the sensor."""
    expected: Vector
    """By the robot file, then by every changed robot, shape (1 + changes,)."""
    spread: float
    """Standard deviation of the file's expectation because of its inexact numbers."""
    is_effort: bool
    """Whether it is the effort of a motor [N m], not a tension [N]."""


class Turns:
    """Counts the reversals of one axis."""

    def __init__(self, count: float) -> None:
        """Start at rest; ``count`` is the resolution of the sensor [rad]."""
        self._least = max(LEAST_COUNTS * count, LEAST_SWING)
        self._low = self._high = float("nan")
        self._rising = 0
        self._swing = 0.0
        self.reversals = 0
        self._lowest = self._highest = float("nan")
        self._largest = 0.0
        self._begun = 0

    def add(self, angle: float) -> None:
        """Add an angle [rad]."""
        if not self._low <= self._high:  # NaN: the first angle
            self._low = self._high = angle
        if not self._lowest <= self._highest:
            self._lowest = self._highest = angle
        self._lowest, self._highest = min(self._lowest, angle), max(self._highest, angle)
        self._largest = max(self._largest, self._highest - self._lowest)
        self._low, self._high = min(self._low, angle), max(self._high, angle)
        span = self._high - self._low
        least = max(TURNED * max(self._swing, span), self._least)
        if self._rising >= 0 and self._high - angle >= least:
            self._turn(-1, angle, span)
        elif self._rising <= 0 and angle - self._low >= least:
            self._turn(+1, angle, span)

    def begin(self) -> None:
        """Begin a window here."""
        self._begun = self.reversals
        self._lowest = self._highest = float("nan")

    def forget(self) -> None:
        """Take the motion of this window for the usual one."""
        self._largest = self._highest - self._lowest if self._lowest <= self._highest else 0.0

    @property
    def whole(self) -> bool:
        """Whether the axis has gone to and fro since ``begin``, over most of its usual range."""
        moved = self._highest - self._lowest
        return self.reversals - self._begun >= 2 and moved >= WHOLE * self._largest

    def _turn(self, rising: int, angle: float, span: float) -> None:
        if self._rising:
            self.reversals += 1
            self._swing = span
        self._rising = rising
        if rising > 0:
            self._high = angle
        else:
            self._low = angle


@dataclass
class Window:
    """Readings of one cycle by sensor."""

    rows: dict[str, list[Reading]] = field(default_factory=dict)

    def add(self, channel: str, reading: Reading) -> None:
        """Add a reading of a motor's effort [N m] or of a load cell [N]."""
        self.rows.setdefault(channel, []).append(reading)

    @property
    def size(self) -> int:
        """Number of readings of the sensor that has most."""
        return max((len(rows) for rows in self.rows.values()), default=0)

    def latest(self, count: int) -> Window:
        """The last ``count`` readings of every sensor."""
        return Window({name: rows[-count:] for name, rows in self.rows.items()})


PARTS: Final = 16
"""Parts of a cycle, each with one mean per sensor; the model's error counts once per part."""

MODEL_SHARE: Final = 0.0075
"""Standard deviation of the model's own error, as a fraction of the reading that all preloads
together would give."""

SPREAD_SHARE: Final = 0.5
"""Fraction of the estimate's standard deviation that counts as error of a part; the rest of it
comes from the very numbers whose changes are sought."""

SIGNIFICANT: Final = 25.0
"""A change is added if it lowers the sum of squares by this much (five standard deviations)."""

FURTHER: Final = 0.01
"""A further change must explain this fraction of what is explained already: signatures are straight
lines through what is curved."""

CERTAIN: Final = 100.0
"""With this much, one cycle suffices (ten standard deviations); otherwise three in a row."""

AS_GOOD: Final = 12.0
"""Another change explains the readings as well if the sum of squares differs by less."""

UNEXPLAINED: Final = 9.0
"""Mean square above which no change explains the readings (three times the model's error)."""

PLAIN: Final = 25.0
"""Median square from which one cycle suffices for readings that no change explains: half of the
parts are off by five expected errors, which a few wrong readings cannot cause."""

MOST_CHANGES: Final = 3
"""Largest number of changes at once."""

PRIOR: Final = 20.0
"""Standard deviation of the amount of a change before any reading, in its smallest amounts."""


@dataclass(frozen=True)
class Found:
    """One change with its amount in the cycle."""

    change: Change
    amount: float
    """In the change's unit."""
    stddev: float
    """Standard error of the amount."""
    others: tuple[str, ...] = ()
    """What else would explain the readings as well."""

    @property
    def matters(self) -> bool:
        """Whether it is at least the smallest reported change, and beyond the file's tolerance."""
        return abs(self.amount) >= max(abs(self.change.size), 2.0 * self.change.tolerance)


@dataclass(frozen=True)
class Evaluation:
    """What one cycle shows."""

    found: tuple[Found, ...]
    gain: float
    """Smallest decrease of the sum of squares by one of them, over the remaining mean square."""
    left: float
    """Mean square of what they leave, in squares of the expected error."""
    deviation: Mapping[str, tuple[float, float]]
    """By sensor: root mean square of readings less expectation, and the same of what the changes
    leave, in the sensor's unit."""
    constant: tuple[str, ...] = ()
    """Efforts that never changed, as of a driver that does not measure them."""
    typical: float = 0.0
    """Median square of what the changes leave, in squares of the expected error."""

    @property
    def alarming(self) -> bool:
        """Whether the robot differs from its file."""
        return not self.explained or bool(self.named)

    @property
    def named(self) -> set[str]:
        """The changes that matter."""
        return {one.change.what for one in self.found if one.matters}

    @property
    def explained(self) -> bool:
        """Whether the readings agree with the model with these changes."""
        return self.left <= UNEXPLAINED

    @property
    def certain(self) -> bool:
        """Whether this one cycle suffices."""
        return self.gain >= CERTAIN if self.explained else self.typical >= PLAIN


@dataclass(frozen=True)
class _System:
    """Weighted residuals and signatures of one cycle."""

    residual: Vector
    """Shape (rows,)."""
    signatures: Table
    """Shape (rows, changes)."""
    weight: Vector
    """One over the expected error, shape (rows,)."""
    channels: tuple[str, ...]
    """Sensor of every ``PARTS`` rows."""


def evaluate(
    window: Window, changes: Sequence[Change], sensors: Sequence[Change], scale: Mapping[str, float]
) -> Evaluation | None:
    """Find the changes that explain a cycle.

    Args:
        window: the readings; the expectations are those of the file and of every one of
            ``changes``.
        changes: changes of the robot.
        sensors: errors of the sensors themselves.
        scale: reading that all preloads together would give, by sensor.

    Returns:
        None if no sensor has enough readings.
    """
    system = _system(window, changes, sensors, scale)
    if system is None:
        return None
    constant = tuple(name for name, rows in window.rows.items() if _is_constant(rows))
    everything = [*changes, *sensors]
    broken = [k for k, one in enumerate(everything) if one.kind == "broken"]
    linear = [k for k in range(len(everything)) if k not in broken]
    chosen, left, gain = _select(system, linear)
    for k in broken:
        y = system.residual - system.signatures[:, k]
        squares = float(y @ y)
        before = float(system.residual @ system.residual)
        mean = max(1.0, squares / y.size)
        if squares < min(before - CERTAIN * mean, left + AS_GOOD * mean, UNEXPLAINED * y.size):
            near = [everything[one] for one in chosen] if left <= squares + AS_GOOD * mean else []
            others = tuple(one.what for one in near if one.kind == "sensor")
            one = Found(everything[k], 1.0, 0.0, others)
            rms = _deviation(system, y)
            return Evaluation((one,), (before - squares) / mean, squares / y.size, rms, constant)
    amounts, errors = _amounts(system, chosen)
    rest = system.residual - system.signatures[:, chosen] @ amounts
    mean = max(1.0, left / rest.size)
    found = tuple(
        Found(
            everything[k], float(c) * everything[k].size,
            float(e * np.sqrt(mean)) * abs(everything[k].size),
            _as_good(system, everything, linear, chosen, k, left + AS_GOOD * mean),
        )
        for k, c, e in zip(chosen, amounts, errors, strict=True)
    )  # fmt: skip
    typical = float(np.median(rest**2))
    return Evaluation(found, gain, left / rest.size, _deviation(system, rest), constant, typical)


def _system(
    window: Window, changes: Sequence[Change], sensors: Sequence[Change], scale: Mapping[str, float]
) -> _System | None:
    channels = tuple(
        name for name, rows in window.rows.items() if len(rows) >= PARTS and not _is_constant(rows)
    )
    if not channels:
        return None
    residual, signatures, weight = [], [], []
    for name in channels:
        y, h, g, variance = _parts(window.rows[name])
        own = [
            one.gain * h + one.offset if one.channel == name else np.zeros(PARTS) for one in sensors
        ]
        size = max(scale.get(name, 0.0), float(np.sqrt(np.mean(h**2))))
        w = 1.0 / np.sqrt(variance + (MODEL_SHARE * size) ** 2 + 1e-24)
        residual.append(y * w)
        signatures.append(np.column_stack([g[:, : len(changes)], *own]) * w[:, None])
        weight.append(w)
    return _System(
        np.concatenate(residual), np.concatenate(signatures), np.concatenate(weight), channels
    )


def _is_constant(rows: list[Reading]) -> bool:
    """Whether an effort is not measured; a load cell at a constant 0 N is a broken cable's."""
    return all(row.is_effort and row.measured == rows[0].measured for row in rows)


def _parts(rows: list[Reading]) -> tuple[Vector, Vector, Table, Vector]:
    """Residuals, expectations, signatures and variances of the parts of a cycle."""
    expected = np.array([row.expected for row in rows])
    measured = np.array([row.measured for row in rows])
    noise = np.array([row.noise**2 for row in rows])
    spread = np.array([(SPREAD_SHARE * row.spread) ** 2 for row in rows])
    edges = np.linspace(0, len(rows), PARTS + 1).astype(int)
    counts = np.diff(edges)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = np.add.reduceat(values, edges[:-1], axis=0)
        return np.asarray(sums / (counts if values.ndim == 1 else counts[:, None]))

    base = expected[:, 0]
    return (
        mean(measured - base), mean(base), mean(expected[:, 1:] - base[:, None]),
        mean(noise) / counts + mean(spread),
    )  # fmt: skip


def _amounts(system: _System, chosen: list[int]) -> tuple[Vector, Vector]:
    """Amounts of the chosen changes, in their smallest amounts, and their standard errors."""
    g = system.signatures[:, chosen]
    covariance = np.linalg.inv(g.T @ g + np.eye(len(chosen)) / PRIOR**2)
    return covariance @ (g.T @ system.residual), np.sqrt(np.diag(covariance))


def _decreases(system: _System, chosen: list[int]) -> tuple[float, Vector]:
    """Sum of squares that the chosen changes leave, and its decrease by every further change.

    The prior is a row per change that asks for an amount of zero.
    """
    count = system.signatures.shape[1]
    g = np.concatenate([system.signatures, np.eye(count) / PRIOR])
    y = np.concatenate([system.residual, np.zeros(count)])
    if chosen:
        q = np.linalg.qr(g[:, chosen])[0]
        y = y - q @ (q.T @ y)
        g = g - q @ (q.T @ g)
    return float(y @ y), (g.T @ y) ** 2 / np.maximum((g**2).sum(axis=0), 1e-12)


def _select(system: _System, candidates: list[int]) -> tuple[list[int], float, float]:
    """The fewest changes that explain the residuals.

    Returns:
        The changes, the sum of squares that they leave, and the smallest gain of one of them.
    """
    chosen: list[int] = []
    left, decrease = _decreases(system, chosen)
    gain = float("inf")
    size, whole = system.residual.size, left
    while len(chosen) < min(MOST_CHANGES, len(candidates)):
        if chosen and left <= size:  # what is left is within the model's error
            break
        k = max((one for one in candidates if one not in chosen), key=decrease.__getitem__)
        mean = max(1.0, (left - decrease[k]) / size)
        if decrease[k] < max(SIGNIFICANT * mean, FURTHER * (whole - left)):
            break
        gain = min(gain, float(decrease[k]) / mean)
        chosen.append(k)
        left, decrease = _decreases(system, chosen)
    return chosen, left, gain if chosen else 0.0


def _as_good(
    system: _System,
    changes: Sequence[Change],
    candidates: list[int],
    chosen: list[int],
    k: int,
    limit: float,
) -> tuple[str, ...]:
    """Other changes in the place of one that explain the readings as well, best first."""
    left, decrease = _decreases(system, [one for one in chosen if one != k])
    others = [one for one in candidates if one not in chosen and left - decrease[one] <= limit]
    return tuple(changes[one].what for one in sorted(others, key=lambda one: -decrease[one]))


def _deviation(system: _System, rest: Vector) -> dict[str, tuple[float, float]]:
    found = {}
    for k, name in enumerate(system.channels):
        part = slice(k * PARTS, (k + 1) * PARTS)
        w = system.weight[part]
        before, after = system.residual[part] / w, rest[part] / w
        found[name] = (float(np.sqrt(np.mean(before**2))), float(np.sqrt(np.mean(after**2))))
    return found
