"""What the latest readings say about the present, beyond the unknowns.

No number that lasts explains a reading where the friction history is wide, or a pose badly known
beside stiff cables; but the reading says where the tensions are now.  See docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.beliefs import LASTS_S, NONLINEAR, Beliefs, Heard
from cdrj_ros.foundation.arrays import Table, Vector

WRONG: Final = 0.3
"""What a wrong sensor's reading may be off by: a share of it, or of what preloads contribute."""

USED_S: Final = 0.4
"""For so long a reading also says something about the present [s]."""

FAR: Final = 100.0
"""A squared residual by its variance beyond which a reading says nothing about the present."""

TINY: Final = 1e-30
"""Least variance by which another one is divided."""


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


def present(
    beliefs: Beliefs, stamp_ns: int, h: Vector, slopes: Table, deviation: Table,
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
    latest = _latest(beliefs, stamp_ns, h, deviation, columns, related)
    shifts = beliefs.mean[:, : beliefs.count] @ slopes
    by_unknowns = beliefs.covariance[:, :, : beliefs.count] @ slopes
    variances = np.einsum("nc,bnc->bc", slopes, by_unknowns[:, : beliefs.count])
    bent = NONLINEAR * shifts
    variances += bent**2
    known = np.zeros_like(shifts)
    for b in range(len(shifts) if latest.read else 0):
        shift, known[b], less = _condition(beliefs, b, latest, by_unknowns[b], bent[b])
        shifts[b] += shift
        variances[b] -= less
    mean, left = beliefs.mixture(shifts, np.maximum(variances, 0.0))
    return mean, beliefs.least_weights() @ np.clip(known, 0.0, 1.0), left


def _latest(
    beliefs: Beliefs, stamp_ns: int, h: Vector, deviation: Table, columns: Mapping[int, int],
    related: NDArray[np.bool_],
) -> _Latest:  # fmt: skip
    """The latest readings, for the arguments of ``present``."""
    now = [
        k
        for k, one in enumerate(beliefs.heard)
        if abs(stamp_ns - one.stamp_ns) * 1e-9 <= USED_S
        and one.slopes is not None
        and not one.frozen
    ]
    read = [beliefs.heard[k] for k in now]
    at = [columns[one.sensor.column] for one in read]
    found = [beliefs.expected(one) for one in read]
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
    beliefs: Beliefs, b: int, latest: _Latest, by_unknowns: Table, bent: Vector
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
    wrong = ~beliefs.right[b, latest.sensors]
    noise = [
        _noise(beliefs, b, one, latest.stamp_ns, now, history[i, at[i]], is_wrong=bool(wrong[i]))
        for i, (one, now) in enumerate(zip(latest.read, latest.h.tolist(), strict=True))
    ]
    bends = bent[at, None]
    total = history[:, at] + bends * bent[at] + np.diag(noise)
    total += change @ beliefs.covariance[b] @ change.T
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
    beliefs: Beliefs,
    b: int,
    one: Heard,
    stamp_ns: int,
    now: float,
    history: float,
    *,
    is_wrong: bool,
) -> float:  # fmt: skip
    """Variance of a reading's errors as a statement about the present."""
    assert one.slopes is not None
    shift = float(beliefs.mean[b, : beliefs.count] @ one.slopes)
    true = max(abs(one.h + shift), one.sensor.scale)
    age = (stamp_ns - one.stamp_ns) * 1e-9 / LASTS_S
    moved = 2.0 * (now - one.h) / true
    noise = one.variance + history * (age**2 + moved**2)
    return noise + (WRONG * max(abs(one.value), one.sensor.scale)) ** 2 * is_wrong
