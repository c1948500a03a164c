"""Tensions of a cable from one known tension: (22), (E18), (E19), and the nodal forces (38).

docs/model.md, section 10.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.outputs import nodal_force_magnitude

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


@dataclass(frozen=True)
class Readings:
    """Readings of the sensors in one cable."""

    tension: Table
    """[N], shape (n, sensors); 0 where there is no reading."""
    weight: Table
    """1 / stddev^2 [1/N^2], shape (n, sensors); 0 where there is no reading."""
    places: list[int]
    """Element of every sensor, counted within the cable."""

    @property
    def mean(self) -> Vector:
        """Weighted mean of the readings of every sample [N], NaN where there is none."""
        with np.errstate(invalid="ignore", divide="ignore"):
            weighted: Vector = np.sum(self.weight * self.tension, axis=1) / self.weight.sum(axis=1)
        return weighted


def chain_from(start: int, share: Table, loss: Table, drag: Vector) -> tuple[Table, Table]:
    """(22), (E18): slope and offset of t_j = slope_j t_start + offset_j, shape (n, elements).

    Args:
        start: the element whose tension is known.
        share: friction of every pulley as a share of its bound, in [-1, 1], positive where the
            element after the pulley pulls, shape (n, pulleys).
        loss: 1 - eta, shape (n, pulleys).
        drag: no-load friction of every pulley [N], shape (pulleys,).
    """
    n, pulleys = loss.shape
    slope, offset = np.ones((n, pulleys + 1)), np.zeros((n, pulleys + 1))
    for p in range(start - 1, -1, -1):  # towards the first node
        slope[:, p], offset[:, p] = _past(
            slope[:, p + 1], offset[:, p + 1], share[:, p], loss[:, p], drag[p]
        )
    for p in range(start, pulleys):
        slope[:, p + 1], offset[:, p + 1] = _past(
            slope[:, p], offset[:, p], -share[:, p], loss[:, p], drag[p]
        )
    return slope, offset


def _past(
    slope: Vector, offset: Vector, share: Vector, loss: Vector, drag: float
) -> tuple[Vector, Vector]:
    """(22) at one pulley; the known side pulls where share > 0 and holds where share < 0."""
    pulls = share > 0.0
    kept = 1.0 - np.abs(share) * loss  # eta where it slides
    factor = np.where(pulls, kept, 1.0 / kept)
    torque = np.abs(share) * drag
    return slope * factor, np.where(pulls, offset * kept - torque, (offset + torque) / kept)


def least_squares(slope: Table, offset: Table, readings: Readings) -> tuple[Table, Table]:
    """(E19): tensions and their standard deviation [N] from all sensors, shape (n, elements)."""
    c, a = slope[:, readings.places], offset[:, readings.places]
    information = np.sum(readings.weight * c * c, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        start = np.sum(readings.weight * c * (readings.tension - a), axis=1) / information
        spread = 1.0 / np.sqrt(information)
    spread = np.where(information > 0.0, spread, np.nan)
    return np.maximum(slope * start[:, None] + offset, 0.0), slope * spread[:, None]


def tension_bounds(
    tension: Table, readings: Readings, sliding: Table, loss: Table, drag: Vector
) -> tuple[Table, Table]:
    """Lower and upper tension [N] with stuck pulleys anywhere within their bounds.

    Every sensor gives an interval; the result is their intersection, widened to hold ``tension``.
    """
    lower, upper = np.zeros_like(tension), np.full_like(tension, np.inf)
    for m, place in enumerate(readings.places):
        seen = readings.weight[:, m] > 0.0
        ends = []
        for way in (-1.0, 1.0):
            share = np.where(sliding == 0.0, way, sliding)
            # friction of one sign raises the tensions before the sensor and lowers those after it
            share[:, place:] = np.where(sliding == 0.0, -way, sliding)[:, place:]
            slope, offset = chain_from(place, share, loss, drag)
            ends.append(np.maximum(slope * readings.tension[:, m, None] + offset, 0.0))
        lower[seen] = np.maximum(lower, ends[1])[seen]
        upper[seen] = np.minimum(upper, ends[0])[seen]
    nothing = np.isnan(tension)
    lower, upper = np.minimum(lower, tension), np.maximum(upper, tension)
    return np.where(nothing, np.nan, lower), np.where(nothing, np.nan, upper)


def nodal_force(tension: Table, wrap: Table) -> tuple[Table, Table, Table]:
    """(38) with phi = pi - beta [N], and its derivatives by the tensions before and after it."""
    before, after, cosine = tension[:, :-1], tension[:, 1:], np.cos(wrap)
    force = nodal_force_magnitude(before, after, cosine)
    safe = np.where(force > 0.0, force, 1.0)
    return force, (before - after * cosine) / safe, (after - before * cosine) / safe


def nodal_bounds(lower: Table, upper: Table, wrap: Table) -> tuple[Table, Table]:
    """Least and largest force (38) over the intervals of both tensions [N], shape (n, pulleys).

    The force is convex in the tensions: its largest value lies at a corner, its least on one of the
    lower edges.
    """
    cosine = np.cos(wrap)
    sides = (lower[:, :-1], upper[:, :-1]), (lower[:, 1:], upper[:, 1:])
    corners = [nodal_force_magnitude(a, b, cosine) for a in sides[0] for b in sides[1]]
    most = np.max(corners, axis=0)
    (low_a, high_a), (low_b, high_b) = sides
    least = np.minimum(
        nodal_force_magnitude(low_a, np.clip(low_a * cosine, low_b, high_b), cosine),
        nodal_force_magnitude(np.clip(low_b * cosine, low_a, high_a), low_b, cosine),
    )
    return least, most
