"""The sliding influence rho of a cable from a nodal force and a tension: equation (44).

docs/model.md, section 11.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.propagation import KnownTension, Path, PropagatedTensions, propagate
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Pulley, Robot

Vector = NDArray[np.float64]

FEWEST: Final = 20
"""Samples in which every pulley in between slides, below which nothing is identified."""

MOST_CHOICES: Final = 8
"""Choices of the samples."""

SETTLED: Final = 1e-4
"""Change of rho below which the choice of samples stays."""


@dataclass(frozen=True)
class RhoEstimate:
    """Result of (44) for one cable."""

    cable: str
    rho: float
    """[-]."""
    stddev: float
    """Of rho from the residual's scatter, samples taken as independent [-]."""
    residual: float
    """Res of (44) at its minimum [N^2]."""
    rms: float
    """Of the nodal force at the minimum [N]."""
    samples: int
    """Samples used: those in which every pulley in between slides."""


def with_rho(robot: Robot, cable: str, rho: float) -> Robot:
    """The same robot with another rho at all pulleys of one cable."""
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

    (24) holds only at a pulley that slides.  The samples used are therefore those in which all
    pulleys between sensor and node slide.  With more friction a pulley starts to slide later,
    so the samples depend on rho: they are chosen at the smallest rho and again at every rho found,
    until rho no longer changes.

    Args:
        model: the prepared robot; its rho in this cable does not matter.
        path: of the motion.
        known: readings of a tension sensor, the source's element 8.
        pulley: ``cable/node``, the source's node 3.
        nodal_force: measured magnitude on it [N], shape (n,); NaN where there is no reading.
        bounds: of rho, within [0, 1].

    Raises:
        UsageError: an unknown or foreign pulley, bounds out of [0, 1], or too few samples.
    """
    if not 0.0 <= bounds[0] < bounds[1] <= 1.0:
        raise UsageError(f"the bounds of rho must rise within [0, 1], got {bounds}")
    if np.shape(nodal_force) != path.stamp_ns.shape:
        raise UsageError(
            f"{pulley} has {np.size(nodal_force)} readings for {path.stamp_ns.size} samples"
        )
    name = known.element.rsplit("/", 1)[0]
    first = _propagated(model, path, known, name, bounds[0])
    if pulley not in first.pulleys:
        raise UsageError(f"{known.element} says nothing of {pulley}: they are not in one cable")
    column, place = first.pulleys.index(pulley), first.elements.index(known.element)
    between = slice(min(column, place), max(column + 1, place))
    there = np.isfinite(nodal_force) & np.isfinite(known.tension)
    chosen = there

    def error(rho: float) -> Vector:
        found = _propagated(model, path, known, name, rho).nodal_force[chosen, column]
        return np.asarray(found - nodal_force[chosen])

    rho, residual, count = bounds[0], 0.0, 0
    for _ in range(MOST_CHOICES):
        sliding = _propagated(model, path, known, name, rho).sliding[:, between]
        chosen = there & (sliding != 0).all(axis=1)
        count = int(np.count_nonzero(chosen))
        if count < FEWEST:
            raise UsageError(
                f"all pulleys from {pulley} to {known.element} slide together in {count} samples; "
                f"at least {FEWEST} are needed"
            )
        best = minimize_scalar(
            lambda rho: float(np.sum(error(rho) ** 2)),
            bounds=bounds,
            method="bounded",
            options={"xatol": 1e-5},
        )
        before, rho, residual = rho, float(best.x), float(best.fun)
        if abs(rho - before) < SETTLED:
            break
    step = 1e-3 * (bounds[1] - bounds[0])
    low, high = max(rho - step, bounds[0]), min(rho + step, bounds[1])
    slope = (error(high) - error(low)) / (high - low)
    variance = residual / (count - 1)
    stddev = float(np.sqrt(variance / np.sum(slope**2)))
    return RhoEstimate(name, rho, stddev, residual, float(np.sqrt(residual / count)), count)


def _propagated(
    model: Model, path: Path, known: KnownTension, cable: str, rho: float
) -> PropagatedTensions:
    return propagate(prepare(with_rho(model.robot, cable, rho)), path, [known])
