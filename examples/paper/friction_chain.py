"""Friction along a cable whose motion and one tension are known: (22), (E17) to (E20), (38).

examples/paper/derivation.md, section 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import BOUND_FLOOR, Stribeck, blended_loss, stribeck_share
from cdrj_ros.model.laws import Elasticity, modulus_at, strain_at

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


@dataclass(frozen=True)
class CableMotion:
    """One cable along a motion: its geometry and friction, without its tensions."""

    stamp_ns: NDArray[np.int64]
    """Increasing [ns], shape (n,)."""
    length: Table
    """Lengths of the elements with their share of the arcs [m], shape (n, elements)."""
    wrap: Table
    """Wrap angles of the pulleys [rad], shape (n, pulleys)."""
    track: Table
    """Places of the middles of the arcs along their bodies [m], (E26), shape (n, pulleys)."""
    wound: Vector
    """Cable drawn in by a winch at the last node [m], shape (n,)."""
    held_last: bool
    """Whether slips are counted from the last node, otherwise from the first."""
    elastic: Elasticity
    """Tension-strain law of the cable."""
    constants: Any
    """Constants of the pulleys, a structured array of ``PulleyConstants``, shape (pulleys,)."""
    stribeck: Stribeck
    """Form of static friction."""

    def slips(self, tension: Table) -> Table:
        """(E17): slip against every pulley towards the last node [m], shape (n, pulleys).

        Args:
            tension: tensions of the elements [N], shape (n, elements); NaN counts as 0.
        """
        stretch = 1.0 + strain_at(self.elastic, np.nan_to_num(tension))
        laid = self.track / (0.5 * (stretch[:, :-1] + stretch[:, 1:]))
        return slips_of(self.length / stretch, self.wound, self.held_last) + laid

    def hidden_slips(self, lower: Table, upper: Table) -> Table:
        """Uncertainty of the slip due to the intervals of tension [m], shape (n, pulleys).

        Args:
            lower, upper: ends of the elements' intervals [N], shape (n, elements); NaN counts as
                an interval without width.  A cable that stiffens is softest at the lower end.
        """
        modulus = modulus_at(self.elastic, np.nan_to_num(lower))
        elastic = np.nan_to_num(upper - lower) * self.length / modulus
        return np.abs(slips_of(elastic, np.zeros(1), self.held_last))

    def losses(self) -> tuple[Table, Table]:
        """(43): kinetic and static loss of every pulley at every sample, shape (n, pulleys)."""
        rho, mu_c, mu_s, ratio = (
            self.constants[name] for name in ("rho", "mu_c", "mu_s", "bearing_ratio")
        )
        kinetic, static = _LOSSES(rho, mu_c, mu_s, self.wrap, ratio, self.stribeck)
        return kinetic, static

    def lagging_losses(self, tension: Table, kinetic: Table, static: Table) -> Table:
        """(E10): loss 1 - eta at the slip speeds that follow from ``tension``."""
        if not static.any():
            return kinetic
        dt = np.diff(self.stamp_ns) * 1e-9
        moved = np.diff(self.slips(tension), axis=0)
        lag, speed = self.constants["stribeck_lag"], np.zeros_like(kinetic)
        for k in range(1, len(dt)):  # the speed of a sample acts on the next one
            speed[k + 1] = (lag * speed[k] + moved[k - 1]) / (lag + dt[k - 1])
        share = _SHARES(speed, self.constants["stribeck_speed"])
        return np.asarray(kinetic + static * share)


_SHARES: Final = np.vectorize(stribeck_share, otypes=[float])
_LOSSES: Final = np.vectorize(blended_loss, otypes=[float, float])


def slips_of(material: Table, wound: Vector, held_last: bool) -> Table:
    """Material past every pulley towards the last node [m], shape (n, pulleys).

    The material past a pulley equals the material taken up by the elements between the pulley and
    the end that holds the cable.
    With the geometric length as ``material`` the cable is inextensible.
    """
    if not held_last:
        return -np.cumsum(material[:, :-1], axis=1)
    behind = np.cumsum(material[:, :0:-1], axis=1)[:, ::-1]
    return behind + wound[:, None]


def slip_rates(rates: NDArray[np.float64], held_last: bool) -> NDArray[np.float64]:
    """As ``slips_of``, for derivatives of shape (n, elements, joints)."""
    if not held_last:
        return -np.cumsum(rates[:, :-1], axis=1)
    return np.cumsum(rates[:, :0:-1], axis=1)[:, ::-1]


def friction_shares(
    motion: CableMotion, slip: Table, tension: Table, loss: Table, hidden: Table
) -> tuple[Table, Table]:
    """(E20): least and largest share of its bound that a pulley's friction may have.

    Args:
        motion: motion of the cable.
        slip: ``motion.slips`` at these tensions [m], shape (n, pulleys).
        tension: tensions of the elements [N], shape (n, elements); NaN counts as 0.
        loss: 1 - eta of the pulleys, shape (n, pulleys).
        hidden: slip that the sensors cannot resolve [m], shape (n, pulleys).

    Returns:
        Two shares in [-1, 1], shape (n, pulleys), positive where the cable slips towards the last
        node.
    """
    constants = motion.constants
    pull = np.nan_to_num(np.maximum(tension[:, :-1], tension[:, 1:]))
    arc = constants["radius"] * motion.wrap / modulus_at(motion.elastic, pull)
    bound = loss * pull + constants["drag"] + BOUND_FLOOR
    # slip from no friction to the full bound: of bristles and arc, and what is not resolved
    reach = bound * (1.0 / constants["bristle_stiffness"] + arc) + hidden
    return limited_sums(np.diff(slip, axis=0, prepend=slip[:1]) / reach)


def limited_sums(steps: Table) -> tuple[Table, Table]:
    """Sums that every step leaves within [-1, 1], from -1 and from +1, shape (n, pulleys).

    A step with its limits maps x to clip(x + shift, low, high), and so do several in a row:
    doubling their number gives the maps from the start to every sample.
    """
    shift, low, high = steps.copy(), np.full_like(steps, -1.0), np.ones_like(steps)
    count = 1
    while count < len(steps):
        limits = low[count:].copy(), high[count:].copy()
        low[count:] = np.clip(low[:-count] + shift[count:], *limits)
        high[count:] = np.clip(high[:-count] + shift[count:], *limits)
        shift[count:] = shift[:-count] + shift[count:]
        count *= 2
    return np.clip(shift - 1.0, low, high), np.clip(shift + 1.0, low, high)


def sliding_directions(
    motion: CableMotion, slip: Table, shares: tuple[Table, Table], hidden: Table, window_ns: int
) -> Table:
    """Direction in which every pulley slides, 0 where it may be stuck, shape (n, pulleys).

    A pulley slides where both shares of ``friction_shares`` have met at -1 or +1 and slip is
    detected before and after the sample.
    """
    low, high = shares
    sliding = np.where(low == high, np.trunc(low), 0.0)
    sliding *= _moving(motion.stamp_ns, slip, sliding, hidden, window_ns)
    return sliding


def _moving(
    stamp_ns: NDArray[np.int64], slip: Table, way: Table, hidden: Table, window_ns: int
) -> Table:
    """1 where slip in direction ``way`` is detected before and after a sample, 0 elsewhere.

    (24) holds only during slip.  At rest the winch can reverse the friction with a slip too small
    for the sensors to resolve.
    """
    before = np.searchsorted(stamp_ns, stamp_ns - window_ns)
    after = np.searchsorted(stamp_ns, stamp_ns + window_ns, side="right") - 1
    gone, ahead = (slip - slip[before]) * way, (slip[after] - slip) * way
    seen = (gone > np.maximum(hidden, hidden[before])) & (ahead > np.maximum(hidden, hidden[after]))
    return seen.astype(np.float64)


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


def nodal_force_magnitude(before: Table, after: Table, cosine: Table) -> Table:
    """(38), phi = pi - beta: force of a cable on a pulley [N], from its tensions and cos beta."""
    squared = before**2 + after**2 - 2.0 * before * after * cosine
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)))


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
