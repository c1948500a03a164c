"""Friction along a cable whose motion and one tension are known: (22), (E17) to (E20), (38).

examples/paper/derivation.md, section 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cdrj_ros._core import Stribeck, blended_loss
from cdrj_ros.foundation.arrays import Stamps, Table, Vector
from cdrj_ros.model.laws import Elasticity, modulus_at, strain_at

_LOSSES: Final = np.vectorize(blended_loss, otypes=[float, float])

BOUND_FLOOR: Final = 1e-9
"""Epsilon of (34) [N]."""


@dataclass(frozen=True)
class CableMotion:
    """One cable along a motion: its geometry and friction, without its tensions."""

    stamp_ns: Stamps
    """Increasing [ns], shape (n,)."""
    length: Table
    """Lengths of the elements with their share of the arcs [m], shape (n, elements)."""
    wrap: Table
    """Wrap angles of the pulleys [rad], shape (n, pulleys)."""
    track: Table
    """Places of the middles of the arcs along their bodies [m], (E26), shape (n, pulleys)."""
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
        return taken_up(self.length / stretch) + laid

    def hidden_slips(self, lower: Table, upper: Table) -> Table:
        """Uncertainty of the slip due to the intervals of tension [m], shape (n, pulleys).

        Args:
            lower, upper: ends of the elements' intervals [N], shape (n, elements); NaN counts as
                an interval without width.  A cable that stiffens is softest at the lower end.
        """
        modulus = modulus_at(self.elastic, np.nan_to_num(lower))
        return taken_up(np.nan_to_num(upper - lower) * self.length / modulus)

    def losses(self, tension: Table) -> tuple[Table, Table]:
        """(43), (E10): loss 1 - eta of every pulley, shape (n, pulleys).

        Returns:
            The loss while sliding, at the slip speeds that follow from ``tension``, and the static
            one of pulleys that may be stuck.
        """
        rho, mu_c, mu_s, ratio, lag, speed_scale = (
            self.constants[name]
            for name in ("rho", "mu_c", "mu_s", "bearing_ratio", "stribeck_lag", "stribeck_speed")
        )
        kinetic, static = _LOSSES(rho, mu_c, mu_s, self.wrap, ratio, self.stribeck)
        dt = np.diff(self.stamp_ns) * 1e-9
        moved = np.diff(self.slips(tension), axis=0)
        speed = np.zeros_like(kinetic)
        for k in range(1, len(dt)):  # the speed of a sample acts on the next one
            speed[k + 1] = (lag * speed[k] + moved[k - 1]) / (lag + dt[k - 1])
        return kinetic + static * np.exp(-np.square(speed / speed_scale)), kinetic + static


def taken_up(lengths: Table) -> Table:
    """Sums over the elements behind every pulley, shape (n, elements, ...) to (n, pulleys, ...).

    Of material: what has moved past the pulley towards the anchor at the last node.
    """
    return np.cumsum(lengths[:, :0:-1], axis=1)[:, ::-1]


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

    A pulley slides where both ``shares`` have met at -1 or +1 and slip is seen within the window
    before and after the sample: (24) holds only during slip, and at rest the winch can reverse the
    friction with a slip too small for the sensors to resolve.
    """
    low, high = shares
    way = np.where(low == high, np.trunc(low), 0.0)
    stamp_ns = motion.stamp_ns
    before = np.searchsorted(stamp_ns, stamp_ns - window_ns)
    after = np.searchsorted(stamp_ns, stamp_ns + window_ns, side="right") - 1
    gone, ahead = (slip - slip[before]) * way, (slip[after] - slip) * way
    seen = (gone > np.maximum(hidden, hidden[before])) & (ahead > np.maximum(hidden, hidden[after]))
    return np.where(seen, way, 0.0)


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
    steps = [(p, p + 1, p, 1.0) for p in range(start - 1, -1, -1)]  # towards the first node
    steps += [(p, p, p + 1, -1.0) for p in range(start, pulleys)]
    for p, known, next_one, sign in steps:
        # the known side pulls where its share is positive, and holds where it is negative
        pulls = sign * share[:, p] > 0.0
        kept = 1.0 - np.abs(share[:, p]) * loss[:, p]  # eta where it slides
        torque = np.abs(share[:, p]) * drag[p]
        slope[:, next_one] = slope[:, known] * np.where(pulls, kept, 1.0 / kept)
        offset[:, next_one] = np.where(
            pulls, offset[:, known] * kept - torque, (offset[:, known] + torque) / kept
        )
    return slope, offset


def tension_bounds(
    start: int, known: Vector, sliding: Table, loss: Table, drag: Vector
) -> tuple[Table, Table]:
    """Lower and upper tension [N] with stuck pulleys anywhere within their bounds.

    Args:
        start: the element whose tension is known.
        known: its tension [N], shape (n,).
        sliding: of ``sliding_directions``.
        loss, drag: as for ``chain_from``.
    """
    ends = []
    for way in (1.0, -1.0):
        share = np.where(sliding == 0.0, way, sliding)
        # friction of one sign raises the tensions before the sensor and lowers those after it
        share[:, start:] = np.where(sliding == 0.0, -way, sliding)[:, start:]
        slope, offset = chain_from(start, share, loss, drag)
        ends.append(np.maximum(slope * known[:, None] + offset, 0.0))
    return ends[0], ends[1]


def nodal_force_magnitude(before: Table, after: Table, wrap: Table) -> Table:
    """(38), phi = pi - beta: force of a cable on a pulley [N], from its tensions and beta [rad]."""
    squared = before**2 + after**2 - 2.0 * before * after * np.cos(wrap)
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)))
