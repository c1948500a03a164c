"""From a known tension to all others of its cable: (22), (24), (38), transmissions (37)-(43).

Where a tension sensor sits in a cable neither preload, stiffness nor winch need to be known.  Which
way the cable slips over every pulley follows from the lengths behind it, and a slipping pulley ties
its two tensions by its transmission: every element is a known multiple of the measured one.  A
pulley that has not slipped far enough since its last reversal leaves an interval.

docs/model.md, section 10.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.cable import PulleyNumbers
from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.friction import BOUND_FLOOR, blended_loss, stribeck_share
from cdrj_ros.model.outputs import nodal_force_magnitude
from cdrj_ros.model.packing import number_views, plan_views
from cdrj_ros.model.prepared import Model, shape_at
from cdrj_ros.model.records import Rows
from cdrj_ros.robot.description import Anchor

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

CERTAIN: Final = 3.0
"""Standard deviations of a sensor's noise that count as motion."""


WINDOW_S: Final = 0.1
"""Time before and after a sample within which a sliding pulley must be seen to move [s]."""


@dataclass(frozen=True)
class Path:
    """Geometry of a motion, the same for every tension and every friction."""

    stamp_ns: NDArray[np.int64]
    """Increasing [ns], shape (n,)."""
    length: Table
    """Of all elements with their share of the arcs [m], shape (n, elements)."""
    length_by_joint: NDArray[np.float64]
    """Derivatives by the joint angles, shape (n, elements, joints)."""
    wrap: Table
    """Of all pulleys [rad], shape (n, pulleys)."""
    wound: Table
    """Cable that the winch at the last node of every cable has drawn in [m], shape (n, cables)."""


@dataclass(frozen=True)
class KnownTension:
    """Readings of one tension sensor."""

    element: str
    """``cable/element``, as in ``Layout.elements``."""
    tension: Vector
    """[N], shape (n,); NaN where there is no reading."""
    stddev: float
    """Of a reading [N], positive."""


@dataclass(frozen=True)
class PropagatedTensions:
    """One cable's tensions from its sensors.

    ``lower`` and ``upper`` bound the tensions beyond pulleys that may be stuck; ``stddev`` is the
    additional effect of the sensors' noise.
    """

    stamp_ns: NDArray[np.int64]
    """[ns], shape (n,)."""
    elements: tuple[str, ...]
    """Names of the cable's elements."""
    pulleys: tuple[str, ...]
    """Names of the cable's pulleys."""
    tension: Table
    """[N], shape (n, elements)."""
    lower: Table
    """[N], shape (n, elements)."""
    upper: Table
    """[N], shape (n, elements)."""
    stddev: Table
    """[N], shape (n, elements)."""
    nodal_force: Table
    """Magnitude (38) [N], shape (n, pulleys)."""
    nodal_force_lower: Table
    """[N], shape (n, pulleys)."""
    nodal_force_upper: Table
    """[N], shape (n, pulleys)."""
    nodal_force_stddev: Table
    """[N], shape (n, pulleys)."""
    sliding: NDArray[np.int8]
    """+1 where a pulley certainly slips towards the last node, -1 towards the first, 0 where it may
    be stuck, shape (n, pulleys)."""


def path_of(
    model: Model,
    stamp_ns: NDArray[np.int64],
    joint_angle: Table,
    motor_angle: Table | None = None,
) -> Path:
    """Lengths and wraps along a motion.

    Args:
        model: the prepared robot.
        stamp_ns: increasing [ns], shape (n,).
        joint_angle: [rad], shape (n, joints).
        motor_angle: [rad], shape (n, motors); needed only for cables with a winch at either end.

    Raises:
        UsageError: a pose in which a cable cannot run.
    """
    count = stamp_ns.size
    robot, sizes = model.robot, model.sizes
    length, wrap = np.empty((count, sizes.elements)), np.empty((count, sizes.pulleys))
    by_joint = np.empty((count, sizes.elements, sizes.joints))
    for k in range(count):
        shape = shape_at(model, joint_angle[k])
        if not shape.possible:
            raise UsageError(f"no cable can run so at the joint angles {joint_angle[k]}")
        length[k], wrap[k], by_joint[k] = shape.length, shape.wrap, shape.length_by_joint
    wound = np.zeros((count, len(robot.cables)))
    for c, cable in enumerate(robot.cables):
        last = cable.nodes[-1]
        if isinstance(last, Anchor) or isinstance(cable.nodes[0], Anchor):
            continue
        if motor_angle is None:
            raise UsageError(f"cable {cable.name} has two winches: its motor angles are needed")
        motor = model.layout.motors.index(last.motor)  # type: ignore[union-attr]
        wound[:, c] = last.radius * last.winding * motor_angle[:, motor]  # type: ignore[union-attr]
    return Path(stamp_ns, length, by_joint, wrap, wound)


def propagate(
    model: Model, path: Path, known: Sequence[KnownTension], window_s: float = WINDOW_S
) -> PropagatedTensions:
    """All tensions of one cable from one or more sensors in it.

    Every element is an affine function of the measured tension (linear but for bearing torque
    without load), so several sensors are combined by weighted least squares, sample by sample.
    Slips include the cable's elasticity at the tensions found, hence the few passes.

    Args:
        model: the prepared robot; it gives friction and axial stiffness.
        path: of the motion.
        known: sensors, all in one cable.
        window_s: a pulley slides only where its cable has visibly moved on within this time
            before and after [s].

    Raises:
        UsageError: no sensor, an unknown element, two cables, or a shape that does not fit.
    """
    c, places = _cable_of(model, path, known)
    cable = model.robot.cables[c]
    plan = plan_views(model.plan)
    own, count = plan.cables[c], int(plan.cables[c].elements)
    columns = slice(own.first_element, own.first_element + own.elements)
    pulleys = slice(own.first_pulley, own.first_pulley + own.pulleys)
    length, wrap = path.length[:, columns], path.wrap[:, pulleys]
    constants = _constants(model, pulleys, cable.law == "none")
    stribeck = int(plan.pulleys[own.first_pulley].stribeck) if own.pulleys else 0
    kinetic, static = _losses(wrap, constants, stribeck)
    held_last = isinstance(cable.nodes[-1], Anchor) or not isinstance(cable.nodes[0], Anchor)
    dt = np.diff(path.stamp_ns, prepend=path.stamp_ns[:1]) * 1e-9
    arc = constants["radius"] * wrap / cable.axial_stiffness
    unseen = _unseen(model, path, known, columns, held_last, cable.axial_stiffness)

    reading = np.stack([sensor.tension for sensor in known], axis=1)
    spread = np.array([sensor.stddev for sensor in known])
    weight = np.where(np.isfinite(reading), 1.0 / spread**2, 0.0)
    reading = np.nan_to_num(reading)
    with np.errstate(invalid="ignore", divide="ignore"):
        everywhere = np.sum(weight * reading, axis=1) / weight.sum(axis=1)
    tension = np.repeat(everywhere[:, None], count, axis=1)
    # the lagged speed uses the known tension everywhere: a jump of a guess is not slip
    even = length / (1.0 + np.nan_to_num(tension) / cable.axial_stiffness)
    loss_now = _lagging_losses(
        _slips(even, path.wound[:, c], held_last), dt, kinetic, static, constants
    )
    sliding, loss = np.zeros(wrap.shape), kinetic + static
    lower, upper = _bounds(tension, reading, weight, places, sliding, loss, constants)
    for _ in range(count + 1):  # every pass settles at least one more pulley
        before, known_before = tension, sliding
        material = length / (1.0 + np.nan_to_num(tension) / cable.axial_stiffness)
        slip = _slips(material, path.wound[:, c], held_last)
        elastic = np.nan_to_num(upper - lower) * length / cable.axial_stiffness
        hidden = unseen + np.abs(_slips(elastic, np.zeros(1), held_last))
        pull = np.nan_to_num(np.maximum(tension[:, :-1], tension[:, 1:]))
        low, high = _contacts(slip, loss_now, pull, arc, hidden, constants)
        sliding = np.where(low == high, np.trunc(low), 0.0)
        sliding *= _moving(path.stamp_ns, slip, sliding, hidden, round(window_s * 1e9))
        low, high = _contacts(slip, loss_now, pull, arc, unseen, constants)
        share = np.where(sliding == 0.0, 0.5 * (low + high), sliding)
        slope, offset = _chain(places[0], share, loss_now, constants["drag"])
        # a pulley that may be stuck may hold all of its static friction
        loss = np.where(sliding == 0.0, kinetic + static, loss_now)
        tension, stddev = _least_squares(slope, offset, reading, weight, places)
        lower, upper = _bounds(tension, reading, weight, places, sliding, loss, constants)
        change = np.nanmax(np.abs(tension - before), initial=0.0)
        if change < 1e-9 and np.array_equal(sliding, known_before):
            break
    force, by_before, by_after = _nodal_force(tension, wrap)
    least, most = _nodal_bounds(lower, upper, wrap)
    # all tensions of a cable follow from one number: their errors are correlated
    force_spread = np.abs(by_before * stddev[:, :-1] + by_after * stddev[:, 1:])
    return PropagatedTensions(
        path.stamp_ns,
        cable.element_names,
        cable.pulley_names,
        tension,
        lower,
        upper,
        stddev,
        force,
        np.minimum(least, force),
        np.maximum(most, force),
        force_spread,
        sliding.astype(np.int8),
    )


def _cable_of(model: Model, path: Path, known: Sequence[KnownTension]) -> tuple[int, list[int]]:
    """Number of the sensors' cable and the sensors' elements within it."""
    if not known:
        raise UsageError("a tension must be known in the cable")
    for sensor in known:
        if sensor.element not in model.layout.elements:
            raise UsageError(
                f"there is no element {sensor.element}; the robot has "
                f"{', '.join(model.layout.elements)}"
            )
        if np.shape(sensor.tension) != path.stamp_ns.shape:
            raise UsageError(
                f"{sensor.element} has {np.size(sensor.tension)} readings for "
                f"{path.stamp_ns.size} samples"
            )
        if not sensor.stddev > 0.0:
            raise UsageError(f"the stddev of {sensor.element} must be positive")
    for c, cable in enumerate(model.robot.cables):
        names = cable.element_names
        if known[0].element in names:
            others = [sensor.element for sensor in known if sensor.element not in names]
            if others:
                raise UsageError(f"{others[0]} and {known[0].element} are not in one cable")
            return c, [names.index(sensor.element) for sensor in known]
    raise AssertionError(known[0].element)  # pragma: no cover


def _constants(model: Model, pulleys: slice, frictionless: bool) -> Any:
    """Constants of a cable's pulleys, a structured array of ``PulleyNumbers``, shape (pulleys,)."""
    every: Any = number_views(model.sizes, model.numbers).pulleys
    rows = every[pulleys].copy()
    if frictionless:
        for field in ("mu_c", "mu_s", "bearing_ratio", "drag"):
            rows[field] = 0.0
    return rows


def _slips(material: Table, wound: Vector, held_last: bool) -> Table:
    """Material past every pulley towards the last node [m], shape (n, pulleys), from a held end.

    What passes a pulley is what the elements behind it take up.  Without elasticity that is the
    rate of their geometric length.
    """
    if not held_last:
        return -np.cumsum(material[:, :-1], axis=1)
    behind = np.cumsum(material[:, :0:-1], axis=1)[:, ::-1]
    return behind + wound[:, None]


def _unseen(
    model: Model,
    path: Path,
    known: Sequence[KnownTension],
    columns: slice,
    held_last: bool,
    axial_stiffness: float,
) -> Table:
    """Slip that the joints' and the tension's resolution may hide [m], shape (n, pulleys)."""
    step = np.array([j.sensor.resolution + CERTAIN * j.sensor.noise for j in model.robot.joints])
    rates = path.length_by_joint[:, columns]
    behind = _slips_by(rates, held_last)
    hidden = np.abs(behind) @ step if step.size else np.zeros(behind.shape[:2])
    noise = CERTAIN * min(sensor.stddev for sensor in known) / axial_stiffness
    reach = np.abs(_slips(path.length[:, columns], np.zeros(1), held_last))
    return hidden + noise * reach


def _slips_by(rates: NDArray[np.float64], held_last: bool) -> NDArray[np.float64]:
    """As ``_slips``, for derivatives of shape (n, elements, joints)."""
    if not held_last:
        return -np.cumsum(rates[:, :-1], axis=1)
    return np.cumsum(rates[:, :0:-1], axis=1)[:, ::-1]


@compiled
def _losses(wrap: Table, constants: Rows[PulleyNumbers], stribeck: int) -> tuple[Table, Table]:
    """``blended_loss`` of every pulley at every sample: kinetic and static, shape (n, pulleys)."""
    kinetic, static = np.empty(wrap.shape), np.empty(wrap.shape)
    for p in range(wrap.shape[1]):
        row = constants[p]
        for k in range(wrap.shape[0]):
            kinetic[k, p], static[k, p] = blended_loss(
                row.rho,
                row.mu_c,
                row.mu_s,
                wrap[k, p],
                row.bearing_ratio,
                stribeck,
                row.cells,
            )
    return kinetic, static


@compiled
def _lagging_losses(
    slip: Table, dt: Vector, kinetic: Table, static: Table, constants: Rows[PulleyNumbers]
) -> Table:
    """Loss 1 - eta of every pulley, static friction lagging behind its slip speed (E10)."""
    loss = np.empty(slip.shape)
    for p in range(slip.shape[1]):
        row = constants[p]
        lag, lagged = row.stribeck_lag, 0.0
        for k in range(slip.shape[0]):
            share = stribeck_share(lagged, row.stribeck_speed)
            loss[k, p] = kinetic[k, p] + static[k, p] * share
            if k > 0 and dt[k] > 0.0:
                lagged = (lag * lagged + slip[k, p] - slip[k - 1, p]) / (lag + dt[k])
    return loss


@compiled
def _contacts(
    slip: Table,
    loss: Table,
    pull: Table,
    arc: Table,
    hidden: Table,
    constants: Rows[PulleyNumbers],
) -> tuple[Table, Table]:
    """The share of its bound that a pulley's friction may have, least and most (E20).

    The share moves by slip / reach between -1 and +1, as an elastic, perfectly plastic contact
    does; its reach is the slip from no friction to all of it: bristles, the arc's own strain, and
    what is hidden from the sensors.  Nothing is known at the start, so it runs from both ends;
    where they have met at +-1, the pulley has slipped far enough.
    """
    low, high = np.empty(slip.shape), np.empty(slip.shape)
    for p in range(slip.shape[1]):
        row = constants[p]
        least, most = -1.0, 1.0
        for k in range(slip.shape[0]):
            change = slip[k, p] - slip[k - 1, p] if k > 0 else 0.0
            bound = loss[k, p] * pull[k, p] + row.drag + BOUND_FLOOR
            reach = bound * (1.0 / row.bristle_stiffness + arc[k, p]) + hidden[k, p]
            least = min(max(least + change / reach, -1.0), 1.0)
            most = min(max(most + change / reach, -1.0), 1.0)
            low[k, p], high[k, p] = least, most
    return low, high


def _moving(
    stamp_ns: NDArray[np.int64], slip: Table, way: Table, hidden: Table, window_ns: int
) -> Table:
    """1 where the slip goes on in its direction both before and after a sample, else 0.

    At rest friction may turn without any visible slip, when the winch does: (24) holds only while
    slipping.
    """
    before = np.searchsorted(stamp_ns, stamp_ns - window_ns)
    after = np.searchsorted(stamp_ns, stamp_ns + window_ns, side="right") - 1
    gone, ahead = (slip - slip[before]) * way, (slip[after] - slip) * way
    seen = (gone > np.maximum(hidden, hidden[before])) & (ahead > np.maximum(hidden, hidden[after]))
    return seen.astype(np.float64)


def _chain(start: int, share: Table, loss: Table, drag: Vector) -> tuple[Table, Table]:
    """(22), pulley by pulley outwards: t_j = slope_j t_start + offset_j.

    ``share`` in [-1, 1] of the bound that friction has, positive where the element after a pulley
    pulls.  Shapes (n, pulleys); results (n, elements).
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
    """Tension beyond a pulley whose known side pulls (share > 0) or holds (share < 0)."""
    pulls = share > 0.0
    kept = 1.0 - np.abs(share) * loss  # eta where it slides
    factor = np.where(pulls, kept, 1.0 / kept)
    torque = np.abs(share) * drag
    return slope * factor, np.where(pulls, offset * kept - torque, (offset + torque) / kept)


def _least_squares(
    slope: Table, offset: Table, reading: Table, weight: Table, places: list[int]
) -> tuple[Table, Table]:
    """Tensions and their standard deviation from all sensors, weighted by their noise."""
    c, a = slope[:, places], offset[:, places]
    information = np.sum(weight * c * c, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        start = np.sum(weight * c * (reading - a), axis=1) / information
        spread = 1.0 / np.sqrt(information)
    spread = np.where(information > 0.0, spread, np.nan)
    return np.maximum(slope * start[:, None] + offset, 0.0), slope * spread[:, None]


def _bounds(
    tension: Table,
    reading: Table,
    weight: Table,
    places: list[int],
    sliding: Table,
    loss: Table,
    constants: Any,
) -> tuple[Table, Table]:
    """Tensions that stuck pulleys permit: the intervals from all sensors, intersected."""
    drag = constants["drag"]
    lower, upper = np.zeros_like(tension), np.full_like(tension, np.inf)
    for m, place in enumerate(places):
        seen = weight[:, m] > 0.0
        ends = []
        for way in (-1.0, 1.0):
            share = np.where(sliding == 0.0, way, sliding)
            # beyond the sensor friction that raises a tension is friction that lowers it before
            share[:, place:] = np.where(sliding == 0.0, -way, sliding)[:, place:]
            slope, offset = _chain(place, share, loss, drag)
            ends.append(np.maximum(slope * reading[:, m, None] + offset, 0.0))
        lower[seen] = np.maximum(lower, ends[1])[seen]
        upper[seen] = np.minimum(upper, ends[0])[seen]
    nothing = np.isnan(tension)
    lower, upper = np.minimum(lower, tension), np.maximum(upper, tension)
    return np.where(nothing, np.nan, lower), np.where(nothing, np.nan, upper)


def _nodal_force(tension: Table, wrap: Table) -> tuple[Table, Table, Table]:
    """(38) with phi = pi - beta, and its derivatives by the tensions before and after."""
    before, after, cosine = tension[:, :-1], tension[:, 1:], np.cos(wrap)
    force = nodal_force_magnitude(before, after, cosine)
    safe = np.where(force > 0.0, force, 1.0)
    return force, (before - after * cosine) / safe, (after - before * cosine) / safe


def _nodal_bounds(lower: Table, upper: Table, wrap: Table) -> tuple[Table, Table]:
    """Least and largest (38) over the intervals of both tensions.

    It is convex in them: the largest value lies in a corner, the least on one of the lower edges.
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
