"""Residuals of all reference channels for given parameters.

The residuals use the estimator itself: ``run`` processes the conditioned samples causally from the
first one on.  The estimates are interpolated at the references' stamps as in every comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from math import sqrt
from typing import Final, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.conditioning.whole_recording import condition
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.slipping_drums import run_slipping
from cdrj_ros.foundation.errors import RobotFileError, UsageError
from cdrj_ros.foundation.series import Series
from cdrj_ros.identification.unknowns import Unknown, values_by_path
from cdrj_ros.model.channels import EFFORT, channel_columns
from cdrj_ros.model.prepared import Layout, Model, prepare
from cdrj_ros.robot.document import Document
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Stamps = NDArray[np.int64]

CHUNK: Final = 1024
"""Samples estimated at a time, so that only the compared columns are kept in memory."""

REMEMBERED_BYTES: Final = 128 * 1024 * 1024
"""Size of the residuals that a problem remembers, at least those of its last point."""

CONDITIONING_KEYS: Final = ("clock_offset", "scale", "offset", "period", "correction")
"""Keys of motors and joints that change the conditioned samples."""

Weights = Literal["spread", "noise"]
WEIGHTS: Final[tuple[Weights, ...]] = get_args(Weights)


@dataclass(frozen=True)
class Recorded:
    """One recording: readings and references."""

    name: str
    motors: Mapping[str, Series]
    joints: Mapping[str, Series]
    references: Mapping[str, tuple[Stamps, Vector]]
    """Stamps [ns] and values by channel: ``tension/upper/8``, ``effort/jaw``."""


@dataclass(frozen=True)
class Channel:
    """One fitted reference of one recording."""

    name: str
    column: int
    """Index in the estimate."""
    stamp_ns: Stamps
    """[ns], shape (n,)."""
    reference: Vector
    """[N] or [N m], shape (n,)."""
    sigma: float
    """Divisor of its residuals [N] or [N m]."""


@dataclass(frozen=True)
class Group:
    """Channels with the same stamps, placed between the samples."""

    members: tuple[int, ...]
    """Indices of the channels."""
    columns: NDArray[np.intp]
    """Indices in the estimate, shape (members,)."""
    right: NDArray[np.intp]
    """Index of the sample at or after every reference, at least 1, shape (n,)."""
    share: Vector
    """Position between the sample before and that sample, from 0 to 1, shape (n,)."""


@dataclass(frozen=True)
class Observations:
    """One recording, thinned for a round of the fit."""

    recorded: Recorded
    stride: int
    """Only every n-th sample is estimated."""
    samples: Samples | None
    """Conditioned samples; None if the unknowns change them."""
    channels: tuple[Channel, ...]
    groups: tuple[Group, ...] | None = None
    """The channels by their stamps; None if the unknowns change the samples."""
    drums_slip: bool = False
    """Whether the estimates are those of a robot whose cables slip on their drums."""

    @property
    def size(self) -> int:
        """Number of residuals."""
        return sum(channel.reference.size for channel in self.channels)


def chosen_channels(
    layout: Layout, recordings: Sequence[Recorded], patterns: Sequence[str]
) -> tuple[str, ...]:
    """Channels that are estimated, recorded in at least one bag, and requested.

    Raises:
        UsageError: a pattern matches none of them; the message lists the existing ones.
    """
    recorded = {name for one in recordings for name in one.references}
    there = [name for name in channel_columns(layout) if name in recorded]
    if not there:
        raise UsageError(
            f"the recordings have no reference of this robot; they have "
            f"{', '.join(sorted(recorded)) or 'none at all'}"
        )
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in there):
            raise UsageError(f"no reference is called {pattern}; there are {', '.join(there)}")
    if not patterns:
        return tuple(there)
    return tuple(n for n in there if any(fnmatchcase(n, pattern) for pattern in patterns))


def samples_of(model: Model, recorded: Recorded) -> Samples:
    """The recording's conditioned samples; if the clock jumps, those of the last segment.

    Raises:
        UsageError: that segment has fewer than two samples.
    """
    segments = condition(model.robot, recorded.motors, recorded.joints).segments
    if not segments or segments[-1].stamp_ns.size < 2:
        raise UsageError(
            f"{recorded.name}: fewer than two samples with all motors and joints are acceptable"
        )
    return segments[-1]


def spreads(
    recordings: Sequence[Recorded], channels: Sequence[str], rule: Weights
) -> dict[str, float]:
    """Divisor of every channel's residuals.

    Args:
        recordings: all recordings.
        channels: names of the channels.
        rule: ``spread``: standard deviation of the references of the channel's kind, so that a fit
            explains as much of the variance of each kind as it can; ``noise``: standard deviation
            of the sensor's noise, from second differences.
    """
    values = {
        name: [one.references[name][1] for one in recordings if name in one.references]
        for name in channels
    }
    if rule == "noise":
        return {name: max(map(_noise, listed)) for name, listed in values.items()}
    kinds: dict[str, list[str]] = {}
    for name in channels:  # each motor and joint is its own kind: lever arms differ
        kind = name.split("/", 1)[0]
        kinds.setdefault(name if kind == EFFORT else kind, []).append(name)
    result: dict[str, float] = {}
    for members in kinds.values():
        variance = [float(np.var(np.concatenate(values[name]))) for name in members]
        result |= dict.fromkeys(members, max(float(np.sqrt(np.mean(variance))), 1e-9))
    return result


def _noise(values: Vector) -> float:
    """Standard deviation of white noise on a smooth signal, at least that of the quantisation."""
    steps = np.abs(np.diff(values))
    count = float(steps[steps > 0.0].min()) if np.any(steps > 0.0) else 0.0
    bend = np.abs(np.diff(values, 2))
    white = float(np.median(bend)) / 0.6745 / sqrt(6.0) if bend.size else 0.0
    return max(white, min(count, float(np.std(values))) / sqrt(12.0), 1e-9)


class Pool(Protocol):
    """Computes residuals: threads of this process, or a cluster."""

    def map(
        self,
        function: Callable[[Model, Observations], Vector],
        models: Sequence[Model],
        observed: Sequence[Observations],
        /,
    ) -> Iterable[Vector]:
        """The function's results for all pairs, in order."""


class Problem:
    """Residuals of all recordings as a function of the unknowns' coordinates."""

    def __init__(
        self,
        document: Document,
        source: str,
        unknowns: Sequence[Unknown],
        observations: Sequence[Observations],
        pool: Pool,
    ) -> None:
        self.document = document
        self.source = source
        self.unknowns = tuple(unknowns)
        self.observations = tuple(observations)
        self.begin = prepare(build_robot(document, source))
        """Model of the numbers in the document."""
        self.prior_scale = 1.0
        """Factor of a prior's residual: the standard deviation that a residual would have if all
        residuals were independent."""
        self.evaluations = 0
        """Number of runs over all recordings so far."""
        self.pool = pool
        self._remembered: dict[bytes, Vector] = {}

    @property
    def size(self) -> int:
        """Number of residuals, without those of priors."""
        return sum(one.size for one in self.observations)

    def values(self, coordinates: Vector) -> Vector:
        """The unknowns [SI]."""
        return np.array(
            [u.value(float(x)) for u, x in zip(self.unknowns, coordinates, strict=True)]
        )

    def model(self, coordinates: Vector) -> Model:
        """The estimator's model.

        Raises:
            RobotFileError: the numbers describe no possible robot.
        """
        values = values_by_path(self.unknowns, self.values(coordinates))
        return prepare(build_robot(with_numbers(self.document, values), self.source))

    def residuals(self, coordinates: Vector) -> Vector:
        """All residuals in one row; infinite where the numbers describe no possible robot."""
        return self.residuals_of([coordinates])[0]

    def residuals_of(self, many: Sequence[Vector]) -> list[Vector]:
        """Residuals at several coordinates, computed in parallel."""
        return residuals_together([(self, many)])[0]

    def possible_model(self, coordinates: Vector) -> Model | None:
        """The estimator's model; None if the numbers describe no possible robot."""
        try:
            return self.model(coordinates)
        except RobotFileError:
            return None

    def recall(self, coordinates: Vector) -> Vector | None:
        """The residuals at these coordinates, if they were computed lately.

        A step, the Jacobian there and the standard errors share points: a quarter of all runs.
        """
        return self._remembered.get(coordinates.tobytes())

    def remember(self, coordinates: Vector, residuals: Vector) -> None:
        """Keep the residuals at these coordinates, and forget the oldest beyond the limit."""
        residuals.flags.writeable = False
        self._remembered[coordinates.tobytes()] = residuals
        while len(self._remembered) * residuals.nbytes > REMEMBERED_BYTES:
            if len(self._remembered) == 1:
                break
            self._remembered.pop(next(iter(self._remembered)))


def residuals_together(
    requests: Sequence[tuple[Problem, Sequence[Vector]]],
) -> list[list[Vector]]:
    """Residuals of several problems at several coordinates each, all computed in parallel.

    The long runs of one problem and the short ones of another thus share the processors.
    """
    pool, places = requests[0][0].pool, []
    models: list[Model] = []
    observed: list[Observations] = []
    found: dict[tuple[int, bytes], Vector] = {}
    for problem, many in requests:
        for coordinates in many:
            key = id(problem), coordinates.tobytes()
            known = problem.recall(coordinates)
            if known is not None:
                found[key] = known
            if key in found:
                continue
            model = problem.possible_model(coordinates)
            found[key] = np.full(problem.size, np.inf)
            problem.evaluations += 1
            if model is not None:
                places.append((problem, coordinates, key))
                models += [model] * len(problem.observations)
                observed += problem.observations
    parts = iter(list(pool.map(residuals_of_one, models, observed)))
    for problem, coordinates, key in places:
        found[key] = np.concatenate([next(parts) for _ in problem.observations])
        problem.remember(coordinates, found[key])
    return [[found[id(one), at.tobytes()] for at in many] for one, many in requests]


def residuals_of_one(model: Model, observed: Observations) -> Vector:
    """(estimate - reference) / sigma for every channel of a recording, concatenated."""
    samples, groups = observed.samples, observed.groups
    if samples is None:
        samples = thinned(samples_of(model, observed.recorded), observed.stride)
    if groups is None:
        groups = groups_of(observed.channels, samples.stamp_ns)
    found = [np.empty((group.right.size, len(group.columns))) for group in groups]
    n = samples.stamp_ns.size
    # the estimates of a chunk after the last one before it: 10 % faster than a table of all
    block = np.empty((min(CHUNK, n) + 1, model.layout.size))
    state, advance = initial_state(model), run_slipping if observed.drums_slip else run
    for begin in range(0, n, CHUNK):
        part = slice(begin, min(begin + CHUNK, n))
        count = part.stop - begin
        state, _ = advance(model, state, _slice(samples, part), into=block[1 : count + 1])
        for group, estimates in zip(groups, found, strict=True):
            first, end = np.searchsorted(group.right, (begin, part.stop))
            right = group.right[first:end] - begin
            before, after = (block[np.ix_(at, group.columns)] for at in (right, right + 1))
            share = group.share[first:end, None]
            estimates[first:end] = before + share * (after - before)
        block[0] = block[count]
    columns = {
        k: estimates[:, at]
        for group, estimates in zip(groups, found, strict=True)
        for at, k in enumerate(group.members)
    }
    parts = [
        (columns[k] - channel.reference) / channel.sigma
        for k, channel in enumerate(observed.channels)
    ]
    return np.concatenate(parts) if parts else np.empty(0)


def groups_of(channels: Sequence[Channel], stamp_ns: Stamps) -> tuple[Group, ...]:
    """The channels by their stamps, placed between the samples at ``stamp_ns``."""
    members: dict[int, list[int]] = {}
    for k, channel in enumerate(channels):
        members.setdefault(id(channel.stamp_ns), []).append(k)
    since = int(stamp_ns[0])
    own = (stamp_ns - since).astype(np.float64)
    groups = []
    for listed in members.values():
        wanted = np.clip((channels[listed[0]].stamp_ns - since).astype(np.float64), own[0], own[-1])
        right = np.clip(np.searchsorted(own, wanted), 1, own.size - 1)
        share = (wanted - own[right - 1]) / (own[right] - own[right - 1])
        columns = np.array([channels[k].column for k in listed])
        groups.append(Group(tuple(listed), columns, right, share))
    return tuple(groups)


def _slice(samples: Samples, part: slice) -> Samples:
    return Samples(samples.stamp_ns[part], samples.motor_angle[part], samples.joint_angle[part])


def thinned(samples: Samples, stride: int) -> Samples:
    """Every ``stride``-th sample."""
    if stride == 1:
        return samples
    return Samples(
        np.ascontiguousarray(samples.stamp_ns[::stride]),
        np.ascontiguousarray(samples.motor_angle[::stride]),
        np.ascontiguousarray(samples.joint_angle[::stride]),
    )


def observe(
    model: Model,
    recorded: Recorded,
    whole: Samples,
    sigmas: Mapping[str, float],
    stride: int,
    most_residuals: int,
    settle_s: float,
    moving: bool,
) -> Observations:
    """A recording prepared for the fit.

    Args:
        model: model of the starting values.
        recorded: the recording.
        whole: its conditioned samples.
        sigmas: divisor of the residuals of every fitted channel.
        stride: only every n-th sample is estimated.
        most_residuals: largest number of residuals; references are thinned to stay below it.
        settle_s: time at the beginning that is excluded from the comparison [s].
        moving: whether the unknowns change the samples.

    Raises:
        UsageError: no reference lies within the samples.
    """
    begin = int(whole.stamp_ns[0]) + round(settle_s * 1e9)
    until = int(whole.stamp_ns[-1])
    columns = channel_columns(model.layout)
    inside: dict[int, tuple[NDArray[np.intp], Stamps]] = {}
    found = []
    names = [name for name in sigmas if name in recorded.references]
    for name in names:
        stamps, values = recorded.references[name]
        key = id(stamps)
        finite = bool(np.isfinite(values).all())
        if not finite or key not in inside:
            ok = np.isfinite(values) & (stamps >= begin) & (stamps <= until)
            _, first = np.unique(stamps, return_index=True)
            at = first[ok[first]]
            step = max(1, -(-at.size * len(names) // most_residuals))
            at = at[::step]
            placed = at, np.ascontiguousarray(stamps[at])
            if finite:
                inside[key] = placed
        else:
            placed = inside[key]
        at, chosen = placed
        found.append(Channel(name, columns[name], chosen, values[at], sigmas[name]))
    channels = tuple(channel for channel in found if channel.reference.size)
    if not channels:
        raise UsageError(f"{recorded.name}: no fitted reference lies within its samples")
    if moving:
        return Observations(recorded, stride, None, channels)
    samples = thinned(whole, stride)
    return Observations(recorded, stride, samples, channels, groups_of(channels, samples.stamp_ns))
