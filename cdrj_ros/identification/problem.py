"""The residuals of a fit as a function of the unknowns, over thinned or all samples.

The residuals use the estimator itself: ``run`` processes the conditioned samples causally from the
first one on.  The estimates are interpolated at the references' stamps as in every comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.arrays import Stamps, Vector
from cdrj_ros.foundation.errors import RobotFileError, UsageError
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.identification.observations import (
    Extent,
    Observations,
    Recorded,
    Weights,
    changes_conditioning,
    observe,
    samples_by,
)
from cdrj_ros.identification.unknowns import Unknown, values_by_path
from cdrj_ros.model.packing import SLACK
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.groups import Owners
from cdrj_ros.robot.parameters import find_number, writer_of
from cdrj_ros.robot.reader import build_robot

Loss = Literal["linear", "huber"]
LOSSES: Final[tuple[Loss, ...]] = get_args(Loss)

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Settings:
    """Choices of the fit."""

    channels: tuple[str, ...] = ()
    """Patterns of the references to fit; if empty, all are fitted."""
    weights: Weights = "spread"
    """Rule for the divisor of a channel's residuals, see ``residual_scales``."""
    loss: Loss = "linear"
    """Loss of the residuals after the first round."""
    settle_s: float = 0.0
    """Time at the beginning of each recording that is excluded from the comparison [s]."""
    mean_s: float = 0.0
    """Time over which estimates and references are averaged before they are compared [s]; 0: each
    reference is compared by itself.  Only with ``weights`` of ``noise``."""
    coarse: bool = False
    """Whether to skip the last round, which uses all samples."""
    samples: int = 20_000
    """Samples of the first rounds, over all recordings; friction hardly depends on the rate."""
    sought: tuple[str, ...] = ()
    """Paths of numbers that are first sought over their whole range."""
    compares_drums: bool = False
    """Whether to judge if the cable slips on its drums, where the file leaves it open."""


def check(unknowns: Sequence[Unknown], recordings: Sequence[Recorded], settings: Settings) -> None:
    """Refuse an impossible fit.

    Raises:
        UsageError: there is nothing to fit or to fit to, or a setting is out of range.
    """
    if not unknowns:
        raise UsageError("there are no unknowns to fit")
    if not recordings:
        raise UsageError("there is no recording to fit to")
    if settings.loss not in LOSSES:
        raise UsageError(f"the loss must be one of {', '.join(LOSSES)}, got {settings.loss!r}")


def refuse_hidden(robot: Robot) -> None:
    """Refuse joints without encoder, whose angles no fit knows.

    Raises:
        UsageError: with what to do.
    """
    if hidden := [robot.joints[j].name for j in robot.unmeasured]:
        raise UsageError(
            f"fits need the angles of all joints: record {', '.join(hidden)} by a sensor lent for "
            "it, and take measured: false out of the robot file meanwhile"
        )


CHUNK: Final = 1024
"""Samples estimated at a time, so that only the compared columns are kept in memory."""

REMEMBERED_BYTES: Final = 128 * 1024 * 1024
"""Size of the residuals that a problem remembers, at least those of its last point."""


class Problem:
    """Residuals of all recordings as a function of the unknowns' coordinates."""

    def __init__(
        self,
        document: Document,
        source: str,
        unknowns: Sequence[Unknown],
        observations: Sequence[Observations],
        pool: ThreadPoolExecutor,
        stiffness: float = 1.0,
    ) -> None:
        self.stiffness = stiffness
        """Share of their axial stiffness that the cables have."""
        self.document = document
        self.source = source
        self.unknowns = tuple(unknowns)
        self.observations = tuple(observations)
        paths = values_by_path(self.unknowns, [0.0] * len(self.unknowns))
        self.numbers_alone: Document = {**document, "uncertainty": {"others": "exact"}}
        """The document without what it knows of its numbers, which would be read at every trial."""
        numbers = [find_number(document, path) for path in paths]
        self._written = writer_of(self.numbers_alone, numbers)
        self.begin = prepare(build_robot(document, source))
        """Model of the numbers in the document."""
        self.least_variance = 0.0
        """Variance of a residual below which the fit does not trust it, if all residuals were
        independent: by reading errors, (I11), or by what (I6) found."""
        self.evaluations = 0
        """Number of runs over all recordings so far."""
        self.pool = pool
        self._remembered: dict[bytes, Vector] = {}

    @cached_property
    def moved(self) -> NDArray[np.bool_]:
        """The cables that each unknown changes, shape (p, cables)."""
        robot = self.begin.robot
        every = range(len(robot.cables))
        owners, found = Owners(robot, tuple((c,) for c in every)), []
        for one in self.unknowns:
            own = [owners.groups(path) for path in one.paths]
            many = changes_conditioning(one.paths) or robot.residuals or not all(own)
            found.append([bool(many) or any(c in some for some in own) for c in every])
        return np.array(found)

    @property
    def size(self) -> int:
        """Number of residuals, without those of priors."""
        return sum(one.size for one in self.observations)

    def values(self, coordinates: Vector) -> Vector:
        """The unknowns [SI]."""
        return np.array(
            [u.value(float(x)) for u, x in zip(self.unknowns, coordinates, strict=True)]
        )

    def slopes(self, coordinates: Vector) -> Vector:
        """Derivatives of the unknowns by their coordinates [SI]."""
        return np.array(
            [u.slope(float(x)) for u, x in zip(self.unknowns, coordinates, strict=True)]
        )

    def model(self, coordinates: Vector) -> Model:
        """The estimator's model.

        Raises:
            RobotFileError: the numbers describe no possible robot.
        """
        values = values_by_path(self.unknowns, self.values(coordinates))
        robot = build_robot(self._written(tuple(values.values())), self.source)
        if self.stiffness < 1.0:
            soft = [replace(one, axial_stiffness=self.stiffness * one.axial_stiffness)
                    for one in robot.cables]  # fmt: skip
            robot = replace(robot, cables=tuple(soft))
        return prepare(robot)

    def softer(self, stiffness: float) -> Problem:
        """The same problem with cables that have this share of their axial stiffness."""
        return Problem(
            self.document, self.source, self.unknowns, self.observations, self.pool, stiffness
        )

    def slackens(self, coordinates: Vector) -> bool:
        """Whether a cable is slack at times: its tension then does not depend on the unknowns."""
        model = self.model(coordinates)
        begin = initial_state(model)
        runs = (run(model, begin, samples_by(model, one))[1] for one in self.observations)
        return any(np.any(found.status == SLACK) for found in runs)

    def residuals(self, coordinates: Vector) -> Vector:
        """All residuals in one row; infinite where the numbers describe no possible robot."""
        return self.residuals_of([coordinates])[0]

    def residuals_of(
        self, many: Sequence[Vector], chosen: Sequence[NDArray[np.bool_]] = ()
    ) -> list[Vector]:
        """Residuals at several coordinates, computed in parallel unless they were lately.

        A step, the Jacobian there and the standard errors share points: a quarter of all runs.

        Args:
            many: coordinates.
            chosen: the cables that are computed for each, as for ``run``; empty: all.
        """
        found, running = dict[bytes, Vector](), dict[bytes, list[Future[Vector]]]()
        every = np.ones(len(self.begin.robot.cables), dtype=np.bool_)
        points = list(zip(many, chosen or [every] * len(many), strict=True))
        keys = [coordinates.tobytes() + cables.tobytes() for coordinates, cables in points]
        for key, (coordinates, cables) in zip(keys, points, strict=True):
            if key in self._remembered:
                found[key] = self._remembered[key]
            if key in found:
                continue
            self.evaluations += 1
            found[key] = np.full(self.size, np.inf)
            with suppress(RobotFileError):
                model = self.model(coordinates)
                running[key] = [
                    self.pool.submit(residuals_of_one, model, one, cables)
                    for one in self.observations
                ]
        for key, parts in running.items():
            found[key] = residuals = np.concatenate([part.result() for part in parts])
            residuals.flags.writeable = False
            self._remembered[key] = residuals
            if len(self._remembered) > max(1, REMEMBERED_BYTES // residuals.nbytes):
                self._remembered.pop(next(iter(self._remembered)))
        return [found[key] for key in keys]


def residuals_of_one(
    model: Model, observed: Observations, chosen: NDArray[np.bool_] | None = None
) -> Vector:
    """(estimate - reference) / sigma for every channel of a recording, concatenated.

    ``chosen`` as for ``run``.
    """
    samples = samples_by(model, observed)
    n, columns = samples.stamp_ns.size, [channel.column for channel in observed.channels]
    found = np.empty((len(columns), n))
    block = np.empty((min(CHUNK, n), model.layout.size))
    state = initial_state(model)
    for begin in range(0, n, CHUNK):
        part = slice(begin, min(begin + CHUNK, n))
        into = block[: part.stop - begin]
        state, _ = run(
            model, state, samples.part(part), into, slipping=observed.slipping, chosen=chosen
        )
        found[:, part] = into[:, columns].T
    return np.concatenate(
        [
            channel.residuals(model.robot, channel.read.means(samples.stamp_ns, estimates))
            for channel, estimates in zip(observed.channels, found, strict=True)
        ]
    )


LOWEST_RATE: Final = 100.0
"""About the lowest sampling rate in those rounds [Hz]."""

MOST_RESIDUALS: Final = 400_000
"""Largest number of residuals of a round."""


@dataclass(frozen=True)
class Rounds:
    """Data shared by the rounds of one fit."""

    document: Document
    source: str
    unknowns: tuple[Unknown, ...]
    recordings: tuple[Recorded, ...]
    settings: Settings
    model: Model
    """Model of the starting values."""
    samples: tuple[Samples, ...]
    """The conditioned samples of every recording, with the starting values."""
    sigmas: Mapping[str, float]
    """Unit of the residuals of every channel."""
    pool: ThreadPoolExecutor
    say: Progress

    def problem(self, *, coarse: bool, sparser: int = 1) -> Problem:
        """The problem of a round, over thinned samples or over all samples.

        Args:
            coarse: whether the samples are thinned, see ``Settings.samples``.
            sparser: further divisor of the samples, and cubed of the largest number of residuals.
        """
        moving = changes_conditioning(path for one in self.unknowns for path in one.paths)
        total = sum(samples.stamp_ns.size for samples in self.samples)
        most = MOST_RESIDUALS // (sparser**3 * len(self.recordings))

        def extent(one: Samples) -> Extent:
            stride = sparser * _stride(one.stamp_ns, total, self.settings.samples) if coarse else 1
            return Extent(stride, most, self.settings.settle_s, self.settings.mean_s)

        observations = [
            observe(self.model, one, samples, self.sigmas, extent(samples), moving)
            for one, samples in zip(self.recordings, self.samples, strict=True)
        ]
        return Problem(self.document, self.source, self.unknowns, observations, self.pool)


def sample_count(problem: Problem) -> int:
    """Number of samples that a problem estimates."""

    def samples(one: Observations) -> int:
        if one.samples is not None:
            return one.samples.stamp_ns.size
        longest = max(
            r.stamp_ns.size for r in {**one.recorded.motors, **one.recorded.joints}.values()
        )
        return longest // one.stride

    return sum(samples(one) for one in problem.observations)


def _stride(stamp_ns: Stamps, total: int, wanted: int) -> int:
    """Thinning factor of a recording's samples in those rounds, which keeps ``LOWEST_RATE``."""
    duration = max(float(stamp_ns[-1] - stamp_ns[0]) * 1e-9, 1e-9)
    rate = stamp_ns.size / duration
    return max(1, min(round(total / wanted), round(rate / LOWEST_RATE)))
