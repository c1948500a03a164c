"""Sliding influence rho of a cable from a nodal force and a tension: equation (44).

docs/model.md, section 11; examples/paper/equations.py.
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
Mask = NDArray[np.bool_]

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
