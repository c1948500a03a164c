"""Learned corrections of efforts and tensions on top of the model: (I10) in docs/identification.md.

A ridge regression of what the estimates leave over, for each output by itself.  What it depends on
is computed by the core, as at run time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import residual_products
from cdrj_ros.estimation.ensemble import Ensemble, stddev_columns
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.model_error import stiffness
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.identification.observations import Extent, Recorded, observe, samples_of
from cdrj_ros.identification.residual_statistics import ENOUGH, model_error
from cdrj_ros.model.packing import TENSION
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.description import RESIDUAL_ROWS, Residual, residual_shape

FEWEST_BAGS: Final = 3
"""Without which nothing is corrected."""

MOST_ROWS: Final = 2000
"""References of one output that are used of every bag, evenly distributed."""

PENALTIES: Final = np.logspace(-4.0, 1.0, 11)
"""Of the squares of the weights, for products with a mean square of 1."""

WORTH: Final = 0.05
"""Share of the squared error on bags left out that a correction must remove."""

SMALLEST: Final = 0.01
"""Root mean square up to which a product counts as small, so that no weight becomes large."""


class _Bag(NamedTuple):
    """A recording as the correction of one output sees it."""

    inputs: Table
    """The output without correction, then the angles on which it depends, at every sample."""
    dt: Vector
    right: NDArray[np.intp]
    """The sample at or after every reference."""
    share: Vector
    """Position of the reference between the sample before and that one."""
    missing: Vector
    """Reference less output."""
    stddev: Vector
    """Of the output at the references, without the model's error."""

    def at_references(self, values: Table) -> Table:
        """Values at the references, from those at the samples."""
        share = self.share.reshape(-1, *[1] * (values.ndim - 1))
        between: Table = (1.0 - share) * values[self.right - 1] + share * values[self.right]
        return between

    def products(self, ranges: Table) -> tuple[Table, Vector]:
        """Products of (R1) and trust at the references."""
        products, trust = residual_products(self.inputs, self.dt, ranges)
        return self.at_references(products), self.at_references(trust)


@dataclass(frozen=True)
class Learned:
    """The correction of one output, and its effect on bags that were left out."""

    output: str
    residual: Residual | None
    """None where no correction lowers the errors on these bags enough."""
    before: float
    """Root mean square error without it [N] or [N m]."""
    after: float
    """With it."""


def learn(
    model: Model, recordings: Sequence[Recorded], channels: Sequence[str], settle_s: float
) -> Iterator[Learned]:
    """Learn the corrections of some outputs.

    Args:
        model: the robot without corrections.
        recordings: at least ``FEWEST_BAGS``; each is left out once.
        channels: ``effort/NAME`` or ``tension/CABLE/ELEMENT``; those recorded in fewer bags are
            left alone.
        settle_s: time at the beginning of every recording that is not used [s].
    """
    known = model.robot.uncertainty
    stated = dict(known.model_error) if known else {}
    if known:  # the spread of the numbers alone
        robot = replace(model.robot, uncertainty=replace(known, model_error=()))
        model = prepare(robot, check_range=False)
    bags: dict[str, list[_Bag]] = {name: [] for name in channels}
    axes = {name: _axes_of(model, name) for name in channels}
    for recorded in recordings:
        for name, bag in _bags_of(model, recorded, axes, settle_s):
            bags[name].append(bag)
    names = [axis.name for axis in model.robot.axes]
    for name, own in bags.items():
        if len(own) >= FEWEST_BAGS:
            inputs = (name, *(names[k] for k in axes[name]))
            yield _learned(inputs, own, stated.get(name))


def _axes_of(model: Model, channel: str) -> NDArray[np.intp]:
    """The axes that move the cables to which an output belongs, and its own."""
    robot = model.robot
    moves = stiffness(robot, shape_at(model, robot.reference_pose)) != 0.0
    kind, name = channel.split("/", 1)
    if kind == TENSION:
        (cable,) = [c for c, one in enumerate(robot.cables) if name in one.element_names]
        return np.flatnonzero(moves[cable])
    own = [axis.name for axis in robot.axes].index(name)
    return np.flatnonzero(moves[moves[:, own]].any(axis=0) | (np.arange(moves.shape[1]) == own))


def _bags_of(
    model: Model, recorded: Recorded, axes: dict[str, NDArray[np.intp]], settle_s: float
) -> Iterator[tuple[str, _Bag]]:
    """A recording for every output of which it has references."""
    samples = samples_of(model, recorded)
    ensemble = Ensemble(model)
    estimates = ensemble.follow(samples, run(model, initial_state(model), samples)[1])
    assert estimates.stddev is not None
    observed = observe(
        model, recorded, samples, dict.fromkeys(axes, 1.0), Extent(settle_s=settle_s), moving=False
    )
    angles = np.hstack([samples.motor_angle, samples.joint_angle])
    dt = np.diff(samples.stamp_ns, prepend=samples.stamp_ns[:1]) * 1e-9
    columns = stddev_columns(model.layout).tolist()
    time = samples.stamp_ns - samples.stamp_ns[0]
    for channel in observed.channels:
        some = slice(None, None, -(-channel.reference.size // MOST_ROWS))
        at = channel.stamp_ns[some] - samples.stamp_ns[0]
        right = np.clip(np.searchsorted(time, at), 1, time.size - 1)
        share = (at - time[right - 1]) / (time[right] - time[right - 1])
        own = estimates.values[:, channel.column]
        inputs = np.column_stack([own, angles[:, axes[channel.name]]])
        bag = _Bag(inputs, dt, right, share, np.empty(0), np.empty(0))
        deviation = estimates.stddev[:, columns.index(channel.column)]
        yield (
            channel.name,
            bag._replace(
                missing=channel.reference[some] - bag.at_references(own),
                stddev=bag.at_references(deviation),
            ),
        )


def _learned(names: tuple[str, ...], bags: Sequence[_Bag], stated: float | None) -> Learned:
    """Choose products, penalty and factor with the least error on bags left out, and fit.

    ``names`` are those of the inputs, first the output itself.
    """
    output, count = names[0], len(names)
    choices = [_products_of(count, columns) for columns in (1, 2, 1 + count)]
    left = [_left_out(bags, k, choices) for k in range(len(bags))]
    missing = np.concatenate([bag.missing for bag in bags])
    found = np.concatenate(left, axis=2)  # by choices, penalties and references
    factor = np.clip((found @ missing) / np.maximum((found**2).sum(axis=2), 1e-300), 0.0, 1.0)
    errors = ((missing - factor[:, :, None] * found) ** 2).mean(axis=2)
    choice, penalty = np.unravel_index(int(errors.argmin()), errors.shape)
    best, share = float(errors[choice, penalty]), float(factor[choice, penalty])
    before = float(np.mean(missing**2))
    if not best < (1.0 - WORTH) * before:
        return Learned(output, None, before**0.5, best**0.5)
    rest = [b.missing - share * one[choice, penalty] for b, one in zip(bags, left, strict=True)]
    if stated is None:
        stated = model_error([bag.missing for bag in bags], [bag.stddev for bag in bags])
    error = stated * min(_bound_of(np.concatenate(rest)) / _bound_of(missing), 1.0)
    ranges = _ranges(bags)
    products = np.concatenate([bag.products(ranges)[0] for bag in bags])
    used = choices[choice]
    weights = np.zeros(used.size)
    weights[used] = share * _ridge(products[:, used], missing)[penalty]
    seen = {name: (low, high) for name, (low, high) in zip(names, ranges.tolist(), strict=True)}
    bound = float(np.abs(products @ weights).max())
    residual = Residual(output, bound, error, seen, weights.reshape(residual_shape(count)))
    return Learned(output, residual, before**0.5, best**0.5)


def _bound_of(errors: Vector) -> float:
    """What 95 % of the errors do not exceed in magnitude."""
    return float(np.quantile(np.abs(errors), ENOUGH))


def _products_of(inputs: int, columns: int) -> NDArray[np.bool_]:
    """Which products have a weight, shape (weights,).

    Those of second degree in the inputs, and those of every stop operator and last motion with the
    first ``columns`` columns.
    """
    used = np.zeros(residual_shape(inputs), dtype=np.bool_)
    used[:, :columns] = True
    used[::RESIDUAL_ROWS] = np.triu(np.ones((inputs, 1 + inputs), dtype=np.bool_), 1)  # once each
    used[::RESIDUAL_ROWS, 0] = True
    return used.ravel()


def _ranges(bags: Sequence[_Bag]) -> Table:
    """Lowest and highest value of every input, shape (inputs, 2); none is empty."""
    values = np.concatenate([bag.inputs for bag in bags])
    low, high = values.min(axis=0), values.max(axis=0)
    return np.column_stack([low, np.maximum(high, low + 1e-6 + 1e-6 * np.abs(low))])


def _left_out(bags: Sequence[_Bag], out: int, choices: Sequence[NDArray[np.bool_]]) -> Table:
    """Corrections of a bag, fitted to the others, shape (choices, penalties, references)."""
    others = [bag for k, bag in enumerate(bags) if k != out]
    ranges = _ranges(others)
    products = np.concatenate([bag.products(ranges)[0] for bag in others])
    missing = np.concatenate([bag.missing for bag in others])
    there, trust = bags[out].products(ranges)
    found = []
    for used in choices:
        weights = _ridge(products[:, used], missing).T
        bound = np.abs(products[:, used] @ weights).max(axis=0)
        found.append((np.clip(there[:, used] @ weights, -bound, bound) * trust[:, None]).T)
    return np.stack(found)


def _ridge(products: Table, missing: Vector) -> Table:
    """Weights for every penalty, shape (penalties, products)."""
    scale = np.maximum(np.sqrt(np.mean(products**2, axis=0)), SMALLEST)
    scaled = products / scale
    values, vectors = np.linalg.eigh(scaled.T @ scaled / missing.size)
    along = vectors.T @ (scaled.T @ missing) / missing.size
    weights: Table = (vectors @ (along[:, None] / (values[:, None] + PENALTIES))).T / scale
    return weights
