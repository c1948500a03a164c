"""All tensions of a cable from one known tension, and its rho by equation (44).

With a tension sensor in the cable, neither preload nor winch angle is needed.  The direction in
which the cable slips over every pulley follows from the lengths behind it, and the transmission of
a slipping pulley is the ratio of its two tensions: every element is a known multiple of the
measured one.  A pulley that has not slipped far enough since its last reversal leaves an interval.

examples/paper/derivation.md, sections 2 and 3; examples/paper/equations.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cdrj_ros.foundation.arrays import Stamps, Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.laws import elasticity_of, modulus_at, stribeck_of
from cdrj_ros.model.packing import constant_views, topology_views
from cdrj_ros.model.prepared import Course, Model, prepare
from cdrj_ros.robot.description import Anchor, Robot
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.simulation.assembly import course
from examples.paper.friction_chain import (
    CableMotion,
    chain_from,
    friction_shares,
    nodal_force_magnitude,
    sliding_directions,
    taken_up,
    tension_bounds,
)

Mask = NDArray[np.bool_]

CERTAIN: Final = 3.0
"""A change of more than this many standard deviations of a sensor's noise counts as motion."""

WINDOW_NS: Final = 100_000_000
"""Time before and after a sample within which the slip of a sliding pulley must be seen [ns]."""

FEWEST: Final = 20
"""Smallest number of samples, with all pulleys in between sliding, for an identification of rho."""

MOST_CHOICES: Final = 8
"""Largest number of times that the samples are selected."""

SETTLED: Final = 1e-4
"""Change of rho below which the samples are not selected again."""


@dataclass(frozen=True)
class Path:
    """Geometry of a motion; it does not depend on tensions or friction."""

    stamp_ns: Stamps
    """Increasing [ns], shape (n,)."""
    course: Course
    """Of all cables over these stamps."""


@dataclass(frozen=True)
class KnownTension:
    """Readings of one tension sensor."""

    element: str
    """``cable/element``, as in ``Layout.elements``."""
    tension: Vector
    """[N], shape (n,); NaN where there is no reading."""
    stddev: float
    """Standard deviation of a reading [N], positive."""

    @property
    def cable(self) -> str:
        """Name of its cable."""
        return self.element.rsplit("/", 1)[0]


@dataclass(frozen=True)
class PropagatedTensions:
    """Tensions of one cable from its sensor.

    ``lower`` and ``upper`` bound the tension where pulleys may be stuck; ``stddev`` is the
    contribution of the sensor's noise, which the bounds do not include.
    """

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
    sliding: Table
    """+1 where the cable certainly slips over the pulley towards the last node, -1 towards the
    first, 0 where it may be stuck, shape (n, pulleys)."""


def path_of(model: Model, stamp_ns: Stamps, joint_angle: Table) -> Path:
    """Lengths and wraps along a motion.

    Args:
        model: the prepared robot.
        stamp_ns: increasing [ns], shape (n,).
        joint_angle: [rad], shape (n, joints).

    Raises:
        UsageError: a cable path is geometrically impossible in some pose.
    """
    return Path(stamp_ns, course(model, joint_angle))


def propagate(model: Model, path: Path, known: KnownTension) -> PropagatedTensions:
    """All tensions of one cable from a sensor in it.

    (22): every element is an affine function of the measured tension (linear where bearings have
    no torque without load), with which the noise grows (E19).  Slips include the elasticity of the
    cable at the tensions found, which takes a few passes.

    Args:
        model: the prepared robot; its friction and axial stiffness are used.
        path: geometry of the motion.
        known: readings of the sensor.

    Raises:
        UsageError: an unknown element, a cable without anchor at its last node, or a shape that
            does not fit.
    """
    c = _cable_of(model, path, known)
    cable = model.robot.cables[c]
    start = cable.element_names.index(known.element)
    motion, unseen = _motion_of(model, path, c), _unseen(model, path, c, known)
    drag = motion.constants["drag"]
    sliding = np.zeros(motion.wrap.shape)
    tension = np.repeat(known.tension[:, None], motion.length.shape[1], axis=1)
    loss, stuck_loss = motion.losses(tension)
    lower, upper = tension_bounds(start, known.tension, sliding, stuck_loss, drag)
    slope = np.full_like(tension, np.nan)
    for _ in range(len(cable.element_names) + 1):  # every pass settles at least one more pulley
        before = tension, sliding
        hidden = unseen + motion.hidden_slips(lower, upper)
        slip = motion.slips(tension)
        shares = friction_shares(motion, slip, tension, loss, hidden)
        sliding = sliding_directions(motion, slip, shares, hidden, WINDOW_NS)
        middle = 0.5 * np.add(*friction_shares(motion, slip, tension, loss, unseen))
        slope, offset = chain_from(start, np.where(sliding == 0.0, middle, sliding), loss, drag)
        tension = np.maximum(slope * known.tension[:, None] + offset, 0.0)
        most = np.where(sliding == 0.0, stuck_loss, loss)
        lower, upper = tension_bounds(start, known.tension, sliding, most, drag)
        change = np.nanmax(np.abs(tension - before[0]), initial=0.0)
        if change < 1e-9 and np.array_equal(sliding, before[1]):
            break
    force = nodal_force_magnitude(tension[:, :-1], tension[:, 1:], motion.wrap)
    return PropagatedTensions(
        cable.element_names, cable.pulley_names, tension, np.minimum(lower, tension),
        np.maximum(upper, tension), slope * known.stddev, force, sliding,
    )  # fmt: skip


def _cable_of(model: Model, path: Path, known: KnownTension) -> int:
    """Index of the sensor's cable."""
    if known.element not in model.layout.elements:
        raise UsageError(
            f"there is no element {known.element}; the robot has {', '.join(model.layout.elements)}"
        )
    if np.shape(known.tension) != path.stamp_ns.shape:
        raise UsageError(
            f"{known.element} has {np.size(known.tension)} readings for "
            f"{path.stamp_ns.size} samples"
        )
    c = model.layout.cables.index(known.cable)
    if not isinstance(model.robot.cables[c].nodes[-1], Anchor):
        raise UsageError(f"the last node of cable {known.cable} is no anchor")
    return c


def _motion_of(model: Model, path: Path, c: int) -> CableMotion:
    """One cable's share of a path, with its friction constants."""
    cable, own = model.robot.cables[c], topology_views(model.topology).cables[c]
    elements = slice(own.first_element, own.first_element + own.elements)
    pulleys = slice(own.first_pulley, own.first_pulley + own.pulleys)
    every: Any = constant_views(model.sizes, model.constants).pulleys
    rows = every[pulleys].copy()
    if cable.law == "none":
        for field in ("mu_c", "mu_s", "bearing_ratio", "drag"):
            rows[field] = 0.0
    return CableMotion(
        path.stamp_ns, path.course.length[:, elements], path.course.wrap[:, pulleys],
        path.course.track[:, pulleys], elasticity_of(cable), rows, stribeck_of(cable),
    )  # fmt: skip


def _unseen(model: Model, path: Path, c: int, known: KnownTension) -> Table:
    """Slip below the resolution of joint and tension sensors [m], shape (n, pulleys)."""
    step = np.array([j.sensor.resolution + CERTAIN * j.sensor.noise for j in model.robot.joints])
    own = topology_views(model.topology).cables[c]
    elements = slice(own.first_element, own.first_element + own.elements)
    by_joints = np.abs(taken_up(path.course.lever_arm[:, elements])) @ step
    modulus = modulus_at(elasticity_of(model.robot.cables[c]), np.nan_to_num(known.tension))
    strain = (CERTAIN * known.stddev / modulus)[:, None]
    return np.asarray(by_joints + strain * taken_up(path.course.length[:, elements]))


@dataclass(frozen=True)
class RhoEstimate:
    """Result of (44) for one cable."""

    rho: float
    """Identified sliding influence [-]."""
    stddev: float
    """Standard deviation of rho from the residuals' scatter, assuming independent samples [-]."""
    rms: float
    """Root mean square error of the nodal force at the minimum [N]."""
    samples: int
    """Number of samples used: those in which every pulley in between slides."""


def with_rho(robot: Robot, cable: str, rho: float) -> Robot:
    """A copy of the robot with ``rho`` at every pulley of one cable."""
    document = with_numbers(dict(robot.document), {f"cables.{cable}.friction.rho": rho})
    return build_robot(document, robot.source)


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
    pulleys = model.robot.cables[_cable_of(model, path, known)].pulley_names
    if pulley not in pulleys:
        raise UsageError(
            f"the cable of {known.element} has no pulley {pulley}; it has {', '.join(pulleys)}"
        )
    column = pulleys.index(pulley)
    place = int(known.element.rsplit("/", 1)[1]) - 1
    between = slice(min(column, place), max(column + 1, place))
    readable = np.isfinite(nodal_force) & np.isfinite(known.tension)

    def found(rho: float) -> PropagatedTensions:
        return propagate(prepare(with_rho(model.robot, known.cable, rho)), path, known)

    def error(rho: float, chosen: Mask) -> Vector:
        """Calculated minus measured force in the chosen samples [N]."""
        return np.asarray(found(rho).nodal_force[chosen, column] - nodal_force[chosen])

    def residual(rho: float, chosen: Mask) -> float:
        """Res of (44) [N^2]."""
        return float(np.sum(error(rho, chosen) ** 2))

    rho, chosen = bounds[0], readable
    for _ in range(MOST_CHOICES):
        chosen = readable & (found(rho).sliding[:, between] != 0.0).all(axis=1)
        if (count := int(np.count_nonzero(chosen))) < FEWEST:
            raise UsageError(
                f"all pulleys from {pulley} to {known.element} slide together in {count} "
                f"samples; at least {FEWEST} are needed"
            )
        options = {"xatol": 1e-5}
        best = minimize_scalar(residual, args=(chosen,), bounds=bounds, options=options)
        before, rho = rho, float(best.x)
        if abs(rho - before) < SETTLED:
            break
    step = 1e-3 * (bounds[1] - bounds[0])
    low, high = max(rho - step, bounds[0]), min(rho + step, bounds[1])
    slope = (error(high, chosen) - error(low, chosen)) / (high - low)
    squares, count = residual(rho, chosen), int(np.count_nonzero(chosen))
    stddev = float(np.sqrt(squares / (count - 1) / np.sum(slope**2)))
    return RhoEstimate(rho, stddev, float(np.sqrt(squares / count)), count)
