"""Where a fit starts, and the choice between fits with drums that hold or slip, (I8).

Cable that holds on its drum comes off at the strain at which it went on; cable that slips there
has the strain of the free cable, and loses preload from cycle to cycle.  Both are fitted to the
same recordings, with the same unknowns, and the residuals are compared.  See
docs/identification.md.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from math import log, sqrt
from typing import Final, Literal, NamedTuple

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.identification.observations import samples_by
from cdrj_ros.identification.problem import Loss, Problem, Progress
from cdrj_ros.identification.residual_statistics import (
    independent_states,
    lasting_squares,
    noise_stated,
)
from cdrj_ros.identification.solver import (
    limits,
    minimise,
    prior_residuals,
    robust_weights,
)
from cdrj_ros.robot.description import Robot

SOUGHT: Final = 41
"""Values of a number that is sought over its whole range."""


def sought(problem: Problem, paths: Collection[str]) -> Vector:
    """Coordinates of the start, with some numbers replaced by the best between their bounds.

    Around a wrong zero a cable may be slack throughout, and the cost does not change.

    Args:
        problem: problem whose residuals are compared.
        paths: of the numbers, one of which is varied after the other.
    """
    lower, upper = limits(problem)
    here = np.zeros(lower.size)
    for k, unknown in enumerate(problem.unknowns):
        if not paths or unknown.paths[0] not in paths:
            continue
        points = np.tile(here, (SOUGHT, 1))
        points[:, k] = np.linspace(lower[k], upper[k], SOUGHT)
        costs = [float(np.sum(found**2)) for found in problem.residuals_of([*points])]
        here = points[int(np.argmin(costs))]
    return here


CERTAIN: Final = log(1000.0)
"""Logarithm of the likelihood ratio of the two hypotheses from which one of them is accepted."""

WHOLE_CYCLE: Final = 2
"""Passes of a motor between the outer quarters of its range that make a whole cycle."""


class DrumFinding(NamedTuple):
    """What recordings show of a cable on its drums."""

    drums: Literal["hold", "may_slip"]
    """What ``uncertainty.drums`` says of the cable."""
    comment: str
    """Its reason, for the robot file."""
    sentence: str
    """The same to be printed."""


def doubted(robot: Robot) -> tuple[str, ...]:
    """Cables of which the file does not say that they hold on their drums."""
    return robot.uncertainty.may_slip if robot.uncertainty else ()


def compare_drums(problem: Problem, coordinates: Vector, loss: Loss, say: Progress) -> DrumFinding:
    """Compare drums that hold with drums that slip where the file leaves it open: (I8).

    Args:
        problem: the fit, whose estimates are those of drums that hold.
        coordinates: its solution, shape (p,).
        loss: of both fits; the robust weights at the solution count for both.
        say: called with each progress line.
    """
    if not _whole_cycles(problem):
        return DrumFinding(
            "may_slip", "no whole cycle of every motor was recorded",
            "The recordings do not show whether the cable slips on its drums: this takes a whole "
            "cycle of every motor. drums: may_slip stays.",
        )  # fmt: skip
    say("fitting drums that slip")
    robot = problem.begin.robot
    which = np.array([cable.name in doubted(robot) for cable in robot.cables])
    slipping = Problem(
        problem.document, problem.source, problem.unknowns,
        [replace(one, slipping=which) for one in problem.observations], problem.pool,
    )  # fmt: skip
    slipping.least_variance = problem.least_variance
    weights = robust_weights(problem, loss, problem.residuals(coordinates))
    # numbers fitted with the wrong drums can be far off: those of the file are another start
    slips = _fitted(slipping, (coordinates, np.zeros_like(coordinates)), weights, loss, say)
    problem.evaluations += slipping.evaluations
    holds = _misfit(problem, coordinates, weights)
    if slips.all_squares < holds.all_squares:
        say("fitting drums that hold once more")
        again = _fitted(problem, (slips.coordinates,), weights, loss, say)
        holds = min(holds, again, key=lambda one: one.all_squares)
    return finding(slips, holds, independent_states(problem))


class Misfit(NamedTuple):
    """How far some numbers are from the recordings, and from what was known before."""

    squares: float
    """Weighted sum of squares of the residuals, as of ``lasting_squares``."""
    stated: Vector
    """Weighted residuals whose noise is stated, in units of it."""
    strain: float
    """Sum of squares of the deviations from the priors [their standard deviations squared]."""
    coordinates: Vector

    @property
    def all_squares(self) -> float:
        """Of both, positive."""
        return max(self.squares + float(self.stated @ self.stated), 1e-300)


def _misfit(problem: Problem, coordinates: Vector, weights: Vector) -> Misfit:
    residuals = problem.residuals(coordinates)
    priors, _ = prior_residuals(problem, coordinates)
    residuals = residuals * np.sqrt(weights)
    trusted = independent_states(problem) * problem.least_variance
    return Misfit(
        max(lasting_squares(problem, residuals), trusted), residuals[noise_stated(problem)],
        float(priors @ priors), coordinates,
    )  # fmt: skip


def _fitted(
    problem: Problem, begins: Sequence[Vector], weights: Vector, loss: Loss, say: Progress
) -> Misfit:
    """The best fit from the best of several starts."""
    begin = min(begins, key=lambda one: _misfit(problem, one, weights).all_squares)
    found = minimise(problem, begin, loss, say, settled=np.inf)
    return _misfit(problem, found.coordinates, weights)


def finding(slips: Misfit, holds: Misfit, independent: int) -> DrumFinding:
    """(I8): what the residuals of both hypotheses show.

    Args:
        slips: with slipping cable.
        holds: with cable that holds.
        independent: number of residuals without stated noise that count as independent, at least 1.
    """
    certainty = _log_likelihood(holds, independent) - _log_likelihood(slips, independent)
    ratio = slips.all_squares / holds.all_squares
    if certainty > CERTAIN and ratio > 1.0:
        times = f"{sqrt(ratio):.2g} times"
        return DrumFinding(
            "hold", f"cable that slips makes the residuals {times} as large",
            "The cable holds on its drums: if it slipped there, the residuals would be "
            f"{times} as large. The new file says drums: hold.",
        )  # fmt: skip
    if certainty < -CERTAIN and ratio < 1.0:
        times = f"{sqrt(1.0 / ratio):.2g} times"
        return DrumFinding(
            "may_slip", f"cable that holds makes the residuals {times} as large",
            f"The cable slips on its drums: with cable that holds the residuals are {times} as "
            "large. The estimator assumes that it holds, so its tensions become worse from cycle "
            "to cycle, and the fitted numbers are wrong. drums: may_slip stays.",
        )  # fmt: skip
    return DrumFinding(
        "may_slip", "the recordings do not decide",
        "The recordings do not show whether the cable slips on its drums. drums: may_slip stays, "
        "which widens the standard deviations; state drums: hold if it cannot slip.",
    )  # fmt: skip


def _log_likelihood(one: Misfit, independent: int) -> float:
    """Of a fit, where unknown variances are those that suit it best, but not below stated ones."""
    found = -0.5 * one.strain
    if one.squares > 0.0:
        found -= 0.5 * independent * log(one.squares)
    if one.stated.size:
        variance = max(float(np.mean(one.stated**2)), 1.0)
        found -= 0.5 * (one.stated.size * log(variance) + float(one.stated @ one.stated) / variance)
    return found


def _whole_cycles(problem: Problem) -> bool:
    """Whether every motor with a drum moved back and forth in some recording."""
    robot = problem.begin.robot
    names = [motor.name for motor in robot.motors]
    angles = [samples_by(problem.begin, one).motor_angle for one in problem.observations]
    return all(
        any(_passes(angle[:, names.index(motor)]) >= WHOLE_CYCLE for angle in angles)
        for motor in {name for cable in robot.cables for name in cable.motors}
    )


def _passes(angle: Vector) -> int:
    """How often an angle passed from one outer quarter of its range to the other."""
    low, high = float(angle.min()), float(angle.max())
    quarter = 0.25 * (high - low)
    side = np.where(angle > high - quarter, 1, np.where(angle < low + quarter, -1, 0))
    side = side[side != 0]
    return int(np.count_nonzero(np.diff(side)))
