"""What a fit compares: samples of a recording, its references between them, and their scales."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from math import sqrt
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.foundation.arrays import Series, Stamps, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.packing import EFFORT, Layout, channel_columns
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot

CONDITIONING_KEYS: Final = ("clock_offset", "scale", "period", "correction")
"""Keys of motors and joints that change the conditioned samples by more than a constant."""


class ScaleReading(NamedTuple):
    """How the readings of one cable on a spring scale err."""

    preload: float
    """What the same scale reads in the reference pose [N]: its gain errs in both alike."""
    noise: float
    """Standard deviation of a reading beside that gain [N]."""


@dataclass(frozen=True)
class Recorded:
    """One recording: readings and references."""

    name: str
    motors: Mapping[str, Series]
    joints: Mapping[str, Series]
    references: Mapping[str, Series]
    """By channel: ``tension/upper/8``, ``effort/jaw``."""
    scales: Mapping[str, ScaleReading] = field(default_factory=dict)
    """Accuracy of the references that were read on a spring scale, by channel."""


class Read(NamedTuple):
    """Stamps at which estimates are compared with references, by single readings or by means."""

    stamp_ns: Stamps
    """[ns], shape (m,)."""
    begin: NDArray[np.intp]
    """Index of the first one of every mean, shape (n,); empty: each is compared by itself."""

    def means(self, stamp_ns: Stamps, values: Vector) -> Vector:
        """Of values at the stamps of samples [ns], between which they are interpolated."""
        read, time = ((one - stamp_ns[0]).astype(float) for one in (self.stamp_ns, stamp_ns))
        at: Vector = np.interp(read, time, values)
        if not self.begin.size:
            return at
        means: Vector = np.add.reduceat(at, self.begin)
        return means / np.diff(np.append(self.begin, at.size))


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
    read: Read
    """Where the estimates are compared."""
    effort_scale: float = 1.0
    """The scale of published efforts that ``reference`` contains, of an axis' effort."""
    scale: ScaleReading | None = None
    """Accuracy of a spring scale that read them."""

    @property
    def averaged(self) -> bool:
        """Whether each reference is a mean; ``sigma`` is then the noise of a mean."""
        return self.read.begin.size > 0

    def residuals(self, robot: Robot, estimates: Vector) -> Vector:
        """What is left of estimates, as a robot reads them whose preload or scale is another.

        They are compared in the units of the readings, which have the noise: in those of the
        estimate a fit would make the residuals small together with the gain.
        """
        if self.scale is not None:
            cable = self.name.split("/")[1]
            preload = next(one.preload for one in robot.cables if one.name == cable)
            ratio = preload / self.scale.preload
        else:
            name = self.name.removeprefix(f"{EFFORT}/")
            ratio = robot.effort_scale.get(name, self.effort_scale) / self.effort_scale
        return (estimates / ratio - self.reference) / self.sigma


@dataclass(frozen=True)
class Observations:
    """One recording, thinned for a round of the fit."""

    recorded: Recorded
    stride: int
    """Only every n-th sample is estimated."""
    samples: Samples | None
    """Conditioned samples; None if the unknowns change them by more than a constant."""
    offsets: tuple[float, ...]
    """Offsets of the sensors of all axes with which they were conditioned [rad]."""
    channels: tuple[Channel, ...]
    slipping: NDArray[np.bool_] | None = None
    """Which cables of the estimated robot slip on their drums, shape (cables,); None: none."""

    @property
    def size(self) -> int:
        """Number of residuals."""
        return sum(channel.reference.size for channel in self.channels)


class Extent(NamedTuple):
    """How much of a recording is compared."""

    stride: int = 1
    """Only every n-th sample is estimated."""
    most_residuals: int = 10**12
    """Largest number of residuals; successive readings are averaged to stay near or below it."""
    settle_s: float = 0.0
    """Time at the beginning that is excluded [s]."""
    mean_s: float = 0.0
    """Time over which estimates and references are averaged before they are compared [s]."""


def observe(
    model: Model,
    recorded: Recorded,
    whole: Samples,
    sigmas: Mapping[str, float],
    extent: Extent,
    moving: bool,
) -> Observations:
    """A recording prepared for the fit.

    Args:
        model: model of the starting values.
        recorded: the recording.
        whole: its conditioned samples.
        sigmas: divisor of the residuals of every fitted channel.
        extent: how much of it is compared.
        moving: whether the unknowns change the samples by more than a constant.

    Raises:
        UsageError: no reference lies within the samples.
    """
    begin = int(whole.stamp_ns[0]) + round(extent.settle_s * 1e9)
    until = int(whole.stamp_ns[-1])
    columns = channel_columns(model.layout)
    found = []
    names = [name for name in sigmas if name in recorded.references]
    for name in names:
        series = recorded.references[name]
        stamps, values = series.stamp_ns, series.value
        ok = np.isfinite(values) & (stamps >= begin) & (stamps <= until)
        chosen = _Chosen(stamps, ok, extent.most_residuals // len(names), extent.mean_s)
        effort_scale = model.robot.effort_scale.get(name.removeprefix(f"{EFFORT}/"), 1.0)
        scale = recorded.scales.get(name)
        sigma = scale.noise if scale else sigmas[name] / chosen.root
        found.append(
            Channel(
                name, columns[name], chosen.stamp_ns, chosen.mean(values), sigma, chosen.read,
                effort_scale, scale,
            )
        )  # fmt: skip
    channels = tuple(channel for channel in found if channel.reference.size)
    if not channels:
        raise UsageError(f"{recorded.name}: no fitted reference lies within its samples")
    offsets = model.robot.offsets
    if moving:
        return Observations(recorded, extent.stride, None, offsets, channels)
    return Observations(recorded, extent.stride, thinned(whole, extent.stride), offsets, channels)


class _Chosen:
    """Readings that are fitted; where they are too many, means over equal steps of time."""

    def __init__(self, stamps: Stamps, usable: NDArray[np.bool_], most: int, mean_s: float) -> None:
        _, first = np.unique(stamps, return_index=True)
        self._at = first[usable[first]]
        own = stamps[self._at]
        self._label = np.arange(own.size)
        width = round(1e9 * mean_s)
        if own.size > most and not width:
            width = max(1, int(own[-1] - own[0]) // max(1, most))
        if width:
            self._label = np.unique((own - own[:1]) // width, return_inverse=True)[1]
        self._count = np.bincount(self._label)
        since = (own - own[:1]).astype(np.float64)
        mean = np.bincount(self._label, since) / self._count
        self.stamp_ns: Stamps = own[:1] + np.round(mean).astype(np.int64)
        begin = np.flatnonzero(np.diff(self._label, prepend=-1))
        together = mean_s > 0.0 and begin.size < own.size
        self.read = Read(own, begin) if together else Read(self.stamp_ns, begin[:0])
        self.root = sqrt(float(np.median(self._count))) if together else 1.0
        """Factor by which the white noise of a mean is smaller than that of a reading."""

    def mean(self, values: Vector) -> Vector:
        """Of the readings at every stamp."""
        return np.asarray(np.bincount(self._label, values[self._at]) / self._count)


def samples_of(model: Model, recorded: Recorded) -> Samples:
    """The recording's conditioned samples; if the clock jumps, those of the last segment.

    Raises:
        UsageError: that segment has fewer than two samples.
    """
    conditioned = condition(model.robot, recorded.motors, recorded.joints)
    segments = [one.whole() for one in conditioned.segments]
    if not segments or segments[-1].stamp_ns.size < 2:
        why = conditioned.shortage(model.robot)
        raise UsageError(
            f"{recorded.name}: fewer than two samples with all motors and joints are acceptable"
            f"{': ' if why else ''}{why}"
        )
    return segments[-1]


def changes_conditioning(paths: Iterable[str]) -> bool:
    """Whether other values of some numbers, given by path, change the samples' differences too."""
    return any(
        path.startswith(("motors.", "joints."))
        and not set(CONDITIONING_KEYS).isdisjoint(path.split("."))
        for path in paths
    )


def samples_by(model: Model, observed: Observations) -> Samples:
    """The samples of a robot's readings, thinned.

    Another zero of a sensor adds a constant to its angles, so they are not conditioned anew.
    """
    if observed.samples is None:
        return thinned(samples_of(model, observed.recorded), observed.stride)
    shift = np.subtract(model.robot.offsets, observed.offsets)
    if not shift.any():
        return observed.samples
    own, motors = observed.samples, len(model.robot.motors)
    return Samples(own.stamp_ns, own.motor_angle + shift[:motors], own.joint_angle + shift[motors:])


def thinned(samples: Samples, stride: int) -> Samples:
    """Every ``stride``-th sample."""
    if stride == 1:
        return samples
    return Samples(
        np.ascontiguousarray(samples.stamp_ns[::stride]),
        np.ascontiguousarray(samples.motor_angle[::stride]),
        np.ascontiguousarray(samples.joint_angle[::stride]),
    )


Weights = Literal["spread", "noise"]


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


def residual_scales(
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
    values: dict[str, list[Vector]] = {}
    result: dict[str, float] = {}
    for name in channels:
        for one in recordings:
            if name in one.scales:  # stated, in place of either rule
                result[name] = one.scales[name].noise
            elif name in one.references:
                values.setdefault(name, []).append(one.references[name].value)
    if rule == "noise":
        return result | {name: max(map(noise_of, listed)) for name, listed in values.items()}
    kinds: dict[str, list[str]] = {}
    for name in values:  # each motor and joint is its own kind: lever arms differ
        kind = name.split("/", 1)[0]
        kinds.setdefault(name if kind == EFFORT else kind, []).append(name)
    for members in kinds.values():
        variance = [float(np.var(np.concatenate(values[name]))) for name in members]
        result |= dict.fromkeys(members, max(float(np.sqrt(np.mean(variance))), 1e-9))
    return result


SINGLE: Final = 1.5
"""Steps up to this many counts are those of the quantisation."""


def noise_of(values: Vector) -> float:
    """Standard deviation of white noise on a smooth signal, at least that of the quantisation.

    Readings that are published more often than they are renewed count once each, but for those of
    a sensor that moves by single counts.
    """
    renewed = values[np.append(True, np.diff(values) != 0.0)]
    steps = np.abs(np.diff(renewed))
    count = float(steps.min(initial=np.inf))
    white = white_noise(values)
    if steps.size and float(np.median(steps)) > SINGLE * count:
        white = max(white, white_noise(renewed))
    return max(white, min(count, float(np.std(values))) / sqrt(12.0), 1e-9)


def white_noise(values: Vector) -> float:
    """Standard deviation of white noise on a smooth series, from its second differences."""
    bend = np.abs(np.diff(values, 2))
    return float(np.median(bend)) / 0.6745 / sqrt(6.0) if bend.size else 0.0
