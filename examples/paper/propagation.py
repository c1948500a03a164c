"""All tensions of a cable from one known tension, and its rho by equation (44).

With a tension sensor in the cable, neither preload nor winch angle is needed, except the angle of
one winch where there is one at either end.  The direction in which the cable slips over every
pulley follows from the lengths behind it, and the transmission of a slipping pulley is the ratio of
its two tensions: every element is a known multiple of the measured one.  A pulley that has not
slipped far enough since its last reversal leaves an interval.

examples/paper/derivation.md, sections 2 and 3; examples/paper/equations.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.laws import elasticity_of, modulus_at, stribeck_of
from cdrj_ros.model.packing import constant_views, topology_views
from cdrj_ros.model.prepared import Course, Model, prepare
from cdrj_ros.robot.description import Anchor, Pulley, Robot
from cdrj_ros.simulation.assembly import course
from examples.paper.friction_chain import (
    CableMotion,
    Readings,
    chain_from,
    friction_shares,
    least_squares,
    nodal_bounds,
    nodal_force,
    sliding_directions,
    slip_rates,
    slips_of,
    tension_bounds,
)

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Mask = NDArray[np.bool_]


CERTAIN: Final = 3.0
"""A change of more than this many standard deviations of a sensor's noise counts as motion."""

WINDOW_S: Final = 0.1
"""Time before and after a sample within which the slip of a sliding pulley must be seen [s]."""


@dataclass(frozen=True)
class Path:
    """Geometry of a motion; it does not depend on tensions or friction."""

    stamp_ns: NDArray[np.int64]
    """Increasing [ns], shape (n,)."""
    course: Course
    """Of all cables over these stamps."""
    wound: Table
    """Cable drawn in by the winch at the last node of every cable with two winches [m], shape
    (n, cables); 0 for other cables."""


@dataclass(frozen=True)
class KnownTension:
    """Readings of one tension sensor."""

    element: str
    """``cable/element``, as in ``Layout.elements``."""
    tension: Vector
    """[N], shape (n,); NaN where there is no reading."""
    stddev: float
    """Standard deviation of a reading [N], positive."""


@dataclass(frozen=True)
class PropagatedTensions:
    """Tensions of one cable from its sensors.

    ``lower`` and ``upper`` bound the tension where pulleys may be stuck; ``stddev`` is the
    contribution of the sensors' noise, which the bounds do not include.
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
    """+1 where the cable certainly slips over the pulley towards the last node, -1 towards the
    first, 0 where it may be stuck, shape (n, pulleys)."""


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
        UsageError: a cable path is geometrically impossible in some pose.
    """
    count, robot = stamp_ns.size, model.robot
    wound = np.zeros((count, len(robot.cables)))
    for c, cable in enumerate(robot.cables):
        last = cable.nodes[-1]
        if isinstance(last, Anchor) or isinstance(cable.nodes[0], Anchor):
            continue
        if motor_angle is None:
            raise UsageError(f"cable {cable.name} has two winches: its motor angles are needed")
        motor = model.layout.motors.index(last.motors[0][0])  # type: ignore[union-attr]
        wound[:, c] = last.reel * last.winding * motor_angle[:, motor]  # type: ignore[union-attr]
    return Path(stamp_ns, course(model, joint_angle), wound)


def propagate(
    model: Model, path: Path, known: Sequence[KnownTension], window_s: float = WINDOW_S
) -> PropagatedTensions:
    """All tensions of one cable from one or more sensors in it.

    Every element is an affine function of the measured tension (linear where bearings have no
    torque without load), so several sensors are combined by weighted least squares, sample by
    sample.  Slips include the elasticity of the cable at the tensions found, which takes a few
    passes.

    Args:
        model: the prepared robot; its friction and axial stiffness are used.
        path: geometry of the motion.
        known: readings of the sensors, all in one cable.
        window_s: a pulley counts as sliding only where slip of its cable is detected within this
            time before and after the sample [s].

    Raises:
        UsageError: no sensor, an unknown element, two cables, or a shape that does not fit.
    """
    c, places = _cable_of(model, path, known)
    motion = _motion_of(model, path, c)
    found = _settled(
        motion,
        _readings(known, places),
        _unseen(model, path, motion, c, known),
        round(window_s * 1e9),
    )
    force, by_before, by_after = nodal_force(found.tension, motion.wrap)
    least, most = nodal_bounds(found.lower, found.upper, motion.wrap)
    # all tensions of a cable depend on one number, so their errors are fully correlated
    force_spread = np.abs(by_before * found.stddev[:, :-1] + by_after * found.stddev[:, 1:])
    cable = model.robot.cables[c]
    return PropagatedTensions(
        path.stamp_ns,
        cable.element_names,
        cable.pulley_names,
        found.tension,
        found.lower,
        found.upper,
        found.stddev,
        force,
        np.minimum(least, force),
        np.maximum(most, force),
        force_spread,
        found.sliding.astype(np.int8),
    )


@dataclass(frozen=True)
class _Solution:
    """Result of one pass over the motion."""

    tension: Table
    """[N], shape (n, elements)."""
    stddev: Table
    """[N], shape (n, elements)."""
    lower: Table
    """[N], shape (n, elements)."""
    upper: Table
    """[N], shape (n, elements)."""
    sliding: Table
    """Direction in which a pulley slides, 0 where it may be stuck, shape (n, pulleys)."""


def _settled(motion: CableMotion, readings: Readings, unseen: Table, window_ns: int) -> _Solution:
    """Repeat passes until the tensions and the set of sliding pulleys no longer change."""
    count = motion.length.shape[1]
    losses = motion.losses()
    sliding = np.zeros(motion.wrap.shape)
    tension = np.repeat(readings.mean[:, None], count, axis=1)
    # the lagging slip speed uses the known tension, as corrections between passes are not slip
    loss = motion.lagging_losses(tension, *losses)
    drag = motion.constants["drag"]
    bounds = tension_bounds(tension, readings, sliding, losses[0] + losses[1], drag)
    found = _Solution(tension, np.full_like(tension, np.nan), *bounds, sliding)
    for _ in range(count + 1):  # every pass settles at least one more pulley
        before = found
        found = _pass(motion, readings, before, loss, losses[0] + losses[1], unseen, window_ns)
        change = np.nanmax(np.abs(found.tension - before.tension), initial=0.0)
        if change < 1e-9 and np.array_equal(found.sliding, before.sliding):
            break
    return found


def _pass(
    motion: CableMotion,
    readings: Readings,
    before: _Solution,
    loss: Table,
    stuck_loss: Table,
    unseen: Table,
    window_ns: int,
) -> _Solution:
    """Tensions and sliding pulleys for the slips computed from the previous tensions.

    Args:
        motion: motion of the cable.
        readings: readings of its sensors.
        before: solution of the previous pass.
        loss: loss of sliding pulleys, shape (n, pulleys).
        stuck_loss: loss of pulleys that may be stuck, with full static friction.
        unseen: slip that the sensors cannot resolve [m], shape (n, pulleys).
        window_ns: as ``window_s`` of ``propagate`` [ns].
    """
    drag = motion.constants["drag"]
    hidden = unseen + motion.hidden_slips(before.lower, before.upper)
    slip = motion.slips(before.tension)
    shares = friction_shares(motion, slip, before.tension, loss, hidden)
    sliding = sliding_directions(motion, slip, shares, hidden, window_ns)
    low, high = friction_shares(motion, slip, before.tension, loss, unseen)
    share = np.where(sliding == 0.0, 0.5 * (low + high), sliding)
    slope, offset = chain_from(readings.places[0], share, loss, drag)
    tension, stddev = least_squares(slope, offset, readings)
    most_loss = np.where(sliding == 0.0, stuck_loss, loss)
    lower, upper = tension_bounds(tension, readings, sliding, most_loss, drag)
    return _Solution(tension, stddev, lower, upper, sliding)


def _cable_of(model: Model, path: Path, known: Sequence[KnownTension]) -> tuple[int, list[int]]:
    """Index of the sensors' cable and of the sensors' elements within it."""
    if not known:
        raise UsageError("propagation needs at least one tension sensor")
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


def _motion_of(model: Model, path: Path, c: int) -> CableMotion:
    """One cable's share of a path, with its friction constants."""
    cable, topology = model.robot.cables[c], topology_views(model.topology)
    own = topology.cables[c]
    elements = slice(own.first_element, own.first_element + own.elements)
    pulleys = slice(own.first_pulley, own.first_pulley + own.pulleys)
    return CableMotion(
        stamp_ns=path.stamp_ns,
        length=path.course.length[:, elements],
        wrap=path.course.wrap[:, pulleys],
        track=path.course.track[:, pulleys],
        wound=path.wound[:, c],
        held_last=isinstance(cable.nodes[-1], Anchor) or not isinstance(cable.nodes[0], Anchor),
        elastic=elasticity_of(cable),
        constants=_constants(model, pulleys, cable.law == "none"),
        stribeck=stribeck_of(cable),
    )


def _readings(known: Sequence[KnownTension], places: list[int]) -> Readings:
    """Readings and weights of the sensors, side by side."""
    reading = np.stack([sensor.tension for sensor in known], axis=1)
    spread = np.array([sensor.stddev for sensor in known])
    weight = np.where(np.isfinite(reading), 1.0 / spread**2, 0.0)
    return Readings(np.nan_to_num(reading), weight, places)


def _constants(model: Model, pulleys: slice, frictionless: bool) -> Any:
    """Rows of ``PulleyConstants`` of a cable's pulleys, shape (pulleys,)."""
    every: Any = constant_views(model.sizes, model.constants).pulleys
    rows = every[pulleys].copy()
    if frictionless:
        for field in ("mu_c", "mu_s", "bearing_ratio", "drag"):
            rows[field] = 0.0
    return rows


def _unseen(
    model: Model, path: Path, motion: CableMotion, c: int, known: Sequence[KnownTension]
) -> Table:
    """Slip below the resolution of joint and tension sensors [m], shape (n, pulleys)."""
    step = np.array([j.sensor.resolution + CERTAIN * j.sensor.noise for j in model.robot.joints])
    own = topology_views(model.topology).cables[c]
    rates = path.course.lever_arm[:, own.first_element : own.first_element + own.elements]
    behind = slip_rates(rates, motion.held_last)
    hidden = np.abs(behind) @ step if step.size else np.zeros(behind.shape[:2])
    sharpest = min(known, key=lambda sensor: sensor.stddev)
    modulus = modulus_at(motion.elastic, np.nan_to_num(sharpest.tension))
    noise = (CERTAIN * sharpest.stddev / modulus)[:, None]
    reach = np.abs(slips_of(motion.length, np.zeros(1), motion.held_last))
    return hidden + noise * reach


FEWEST: Final = 20
"""Smallest number of samples, with all pulleys in between sliding, for an identification of rho."""

MOST_CHOICES: Final = 8
"""Largest number of times that the samples are selected."""

SETTLED: Final = 1e-4
"""Change of rho below which the samples are not selected again."""


@dataclass(frozen=True)
class RhoEstimate:
    """Result of (44) for one cable."""

    cable: str
    rho: float
    """Identified sliding influence [-]."""
    stddev: float
    """Standard deviation of rho from the residuals' scatter, assuming independent samples [-]."""
    residual: float
    """Res of (44) at its minimum [N^2]."""
    rms: float
    """Root mean square error of the nodal force at the minimum [N]."""
    samples: int
    """Number of samples used: those in which every pulley in between slides."""


def with_rho(robot: Robot, cable: str, rho: float) -> Robot:
    """A copy of the robot with ``rho`` at every pulley of one cable."""
    cables = tuple(
        replace(
            one,
            nodes=tuple(
                replace(node, friction=replace(node.friction, rho=rho))
                if isinstance(node, Pulley)
                else node
                for node in one.nodes
            ),
        )
        if one.name == cable
        else one
        for one in robot.cables
    )
    return replace(robot, cables=cables)


def identify_rho(
    model: Model,
    path: Path,
    known: KnownTension,
    pulley: str,
    nodal_force: Vector,
    bounds: tuple[float, float] = (0.0, 1.0),
) -> RhoEstimate:
    """(44): the rho for which the known tension, propagated, gives the measured nodal force.

    (24) holds only at a pulley that slides, so only samples are used in which all pulleys between
    sensor and node slide.  Larger friction needs more slip to reverse, so these samples depend on
    rho: they are selected at the lower bound, then again at every new rho until it converges.

    Args:
        model: the prepared robot; its rho in this cable does not matter.
        path: geometry of the motion.
        known: readings of a tension sensor; element 8 in the source.
        pulley: ``cable/node``; node 3 in the source.
        nodal_force: measured magnitude on the pulley [N], shape (n,); NaN where there is no
            reading.
        bounds: bounds of rho, within [0, 1].

    Raises:
        UsageError: an unknown pulley or one of another cable, bounds outside [0, 1], or too few
            samples.
    """
    if not 0.0 <= bounds[0] < bounds[1] <= 1.0:
        raise UsageError(f"the bounds of rho must rise within [0, 1], got {bounds}")
    if np.shape(nodal_force) != path.stamp_ns.shape:
        raise UsageError(
            f"{pulley} has {np.size(nodal_force)} readings for {path.stamp_ns.size} samples"
        )
    forces = _Forces(model, path, known, pulley, nodal_force, bounds[0])
    rho, residual, chosen = _minimised(forces, bounds)
    count = int(np.count_nonzero(chosen))
    step = 1e-3 * (bounds[1] - bounds[0])
    low, high = max(rho - step, bounds[0]), min(rho + step, bounds[1])
    slope = (forces.error(high, chosen) - forces.error(low, chosen)) / (high - low)
    variance = residual / (count - 1)
    stddev = float(np.sqrt(variance / np.sum(slope**2)))
    rms = float(np.sqrt(residual / count))
    return RhoEstimate(forces.cable, rho, stddev, residual, rms, count)


class _Forces:
    """Calculated and measured force on one pulley, as functions of rho."""

    def __init__(
        self,
        model: Model,
        path: Path,
        known: KnownTension,
        pulley: str,
        nodal_force: Vector,
        rho: float,
    ) -> None:
        """Propagate once at ``rho`` to locate the pulley and the sensor in their cable."""
        self.cable = known.element.rsplit("/", 1)[0]
        self.pulley, self.element = pulley, known.element
        self._model, self._path, self._known = model, path, known
        self._measured = nodal_force
        self._readable = np.isfinite(nodal_force) & np.isfinite(known.tension)
        first = self._propagated(rho)
        if pulley not in first.pulleys:
            raise UsageError(
                f"the cable of {known.element} has no pulley {pulley}; it has "
                f"{', '.join(first.pulleys)}"
            )
        self._column = first.pulleys.index(pulley)
        place = first.elements.index(known.element)
        self._between = slice(min(self._column, place), max(self._column + 1, place))

    def sliding(self, rho: float) -> Mask:
        """Samples with both readings in which every pulley in between slides, shape (n,)."""
        between = self._propagated(rho).sliding[:, self._between]
        return np.asarray(self._readable & (between != 0).all(axis=1))

    def error(self, rho: float, chosen: Mask) -> Vector:
        """Calculated minus measured force in the chosen samples [N]."""
        found = self._propagated(rho).nodal_force[chosen, self._column]
        return np.asarray(found - self._measured[chosen])

    def _propagated(self, rho: float) -> PropagatedTensions:
        robot = with_rho(self._model.robot, self.cable, rho)
        return propagate(prepare(robot), self._path, [self._known])


def _minimised(forces: _Forces, bounds: tuple[float, float]) -> tuple[float, float, Mask]:
    """Rho at the minimum of (44), the residual there [N^2], and the samples used."""
    rho, residual, chosen = bounds[0], 0.0, np.zeros(0, dtype=np.bool_)
    for _ in range(MOST_CHOICES):
        chosen = forces.sliding(rho)
        count = int(np.count_nonzero(chosen))
        if count < FEWEST:
            raise UsageError(
                f"all pulleys from {forces.pulley} to {forces.element} slide together in {count} "
                f"samples; at least {FEWEST} are needed"
            )
        best = minimize_scalar(
            _residual, args=(forces, chosen), bounds=bounds, method="bounded",
            options={"xatol": 1e-5},
        )  # fmt: skip
        before, rho, residual = rho, float(best.x), float(best.fun)
        if abs(rho - before) < SETTLED:
            break
    return rho, residual, chosen


def _residual(rho: float, forces: _Forces, chosen: Mask) -> float:
    """Res of (44) [N^2]."""
    return float(np.sum(forces.error(rho, chosen) ** 2))
