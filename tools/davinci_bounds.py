#!/usr/bin/env python3
"""How much better estimates of the da Vinci jaw could be: figures of docs/validation.md.

python tools/davinci_bounds.py DATA    DATA holds the folders train and validate

1. Every cycle predicted by the mean torque in the other cycles of the same run, at the same count
   of the spindle in the same direction, which is that of its last count.
2. A correction of any form, fitted to the residuals of train: ridge regression on random features,
   whose width and penalty are chosen by loads left out.
3. The share of the squared error while the spindle's encoder stands still, and the share within
   two standard deviations then.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cdrj_ros.estimation.estimator import initial_state, run  # noqa: E402
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs  # noqa: E402
from cdrj_ros.evaluation.validation import validate_bag  # noqa: E402
from cdrj_ros.model.prepared import Model, load_model  # noqa: E402
from cdrj_ros.recordings.recording import Topics  # noqa: E402

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

COUNT: Final = 2.0 * np.pi / 8192.0
"""Resolution of the spindle's encoder [rad]."""
STILL_S: Final = 0.02
"""Time without a count after which the encoder stands still [s]."""
FEATURES: Final = 400
THINNING: Final = 5
WIDTHS: Final = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Scales of the random weights, for inputs of unit variance."""
PENALTIES: Final = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
"""Per residual, of coefficients of features of unit size."""


class Run(NamedTuple):
    """One run: what was measured and estimated, in columns spindle and jaw."""

    load: str
    """Last digit of its name."""
    time: Vector
    """[s], shape (n,)."""
    angle: Table
    """[rad], shape (n, 2)."""
    measured: Table
    """Torques [N m], shape (n, 2)."""
    estimated: Table
    """Torques [N m], shape (n, 2)."""


def read(model: Model, bag: Path) -> Run:
    """Readings, references and estimates of a run."""
    recording = read_inputs(str(bag), Topics(), model)
    (samples,) = condition_recording(model, recording).segments
    found = run(model, initial_state(model), samples)[1].values
    stamps = samples.stamp_ns
    torques = [recording.references[f"effort/{name}"] for name in ("spindle", "jaw")]
    measured = [np.interp(stamps, one.stamp_ns, one.value) for one in torques]
    own = [model.layout.motor_effort.start, model.layout.joint_effort.start]
    angle = np.hstack([samples.motor_angle, samples.joint_angle])
    return Run(
        bag.name[-1], (stamps - stamps[0]) * 1e-9, angle, np.column_stack(measured), found[:, own]
    )


def last_of(events: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Index of the last event at every sample, 0 before the first, shape (n,)."""
    return np.maximum.accumulate(np.where(events, np.arange(events.size), 0))


def direction(one: Run) -> Vector:
    """Sign of the spindle's last count, shape (n,)."""
    change = np.diff(one.angle[:, 0], prepend=one.angle[0, 0])
    return np.sign(change[last_of(change != 0.0)])


def r2(true: Table, error: Table) -> Vector:
    """Of spindle and jaw, over all samples."""
    squares: Vector = 1.0 - (error**2).sum(axis=0) / ((true - true.mean(axis=0)) ** 2).sum(axis=0)
    return squares


def other_cycles(one: Run) -> Table:
    """Mean torques of the other cycles at the same count and in the same direction, or NaN."""
    way = direction(one)
    spectrum = np.abs(np.fft.rfft(one.angle[:, 0] - one.angle[:, 0].mean()))
    period = one.time[-1] / int(spectrum.argmax())
    cycle = (one.time / period).astype(np.int64)
    place = np.round(one.angle[:, 0] / COUNT).astype(np.int64)
    _, state = np.unique(np.column_stack([place, way]), axis=0, return_inverse=True)
    state = state.ravel()
    _, own = np.unique(np.column_stack([state, cycle]), axis=0, return_inverse=True)
    own = own.ravel()
    columns = []
    for torque in one.measured.T:
        total, count = np.bincount(state, torque)[state], np.bincount(state)[state]
        mine, few = np.bincount(own, torque)[own], np.bincount(own)[own]
        with np.errstate(invalid="ignore", divide="ignore"):
            columns.append(np.where(count > few, (total - mine) / (count - few), np.nan))
    return np.column_stack(columns)


def since_last(events: NDArray[np.bool_], values: Vector) -> Vector:
    """Change of some values since the last event, shape (n,)."""
    return values - values[last_of(events)]


def since_count(one: Run) -> Vector:
    """Time since the spindle's last count [s], shape (n,)."""
    return since_last(np.diff(one.angle[:, 0], prepend=one.angle[0, 0]) != 0.0, one.time)


def inputs(one: Run) -> Table:
    """What a correction may depend on, shape (n, 8)."""
    way = direction(one)
    turned = np.diff(way, prepend=way[0]) != 0
    return np.column_stack(
        [
            one.angle, one.estimated, way, since_last(turned, one.angle[:, 0]),
            since_last(turned, one.time), np.minimum(since_count(one), 0.2),
        ]
    )  # fmt: skip


class Features:
    """Random cosines of standardised inputs."""

    def __init__(self, runs: Sequence[Run], width: float) -> None:
        every = np.concatenate([inputs(one) for one in runs])
        self.centre, self.scale = every.mean(axis=0), every.std(axis=0)
        generator = np.random.default_rng(0)
        self.weight = width * generator.standard_normal((every.shape[1], FEATURES))
        self.phase = generator.uniform(0.0, 2.0 * np.pi, FEATURES)

    def of(self, runs: Sequence[Run], step: int = 1) -> Table:
        """Shape (n, FEATURES + 1)."""
        given = np.concatenate([(inputs(one) - self.centre)[::step] / self.scale for one in runs])
        cosines = np.sqrt(2.0) * np.cos(given @ self.weight + self.phase)
        return np.column_stack([cosines, np.ones(len(given))])


def joined(runs: Sequence[Run], step: int = 1) -> tuple[Table, Table]:
    """Measured torques, and what is missing from the estimates, of several runs."""
    true = np.concatenate([one.measured[::step] for one in runs])
    return true, true - np.concatenate([one.estimated[::step] for one in runs])


def ridge(square: Table, product: Table, size: int, penalty: float) -> Table:
    """Coefficients of both corrections, shape (FEATURES + 1, 2)."""
    found: Any = np.linalg.solve(square + penalty * size * np.eye(len(square)), product)
    return np.asarray(found, dtype=np.float64)


def left_out(train: Sequence[Run], width: float) -> Table:
    """R² of corrected loads that were left out, shape (penalties, 2)."""
    features = Features(train, width)
    parts = {}
    for load in sorted({one.load for one in train}):
        own = [one for one in train if one.load == load]
        table, (true, missing) = features.of(own, THINNING), joined(own, THINNING)
        parts[load] = (table, true, missing, table.T @ table, table.T @ missing)
    true = np.concatenate([part[1] for part in parts.values()])
    rows = []
    for penalty in PENALTIES:
        errors = []
        for load, (table, _, missing, _, _) in parts.items():
            others = [part for other, part in parts.items() if other != load]
            square, product = (np.sum([part[k] for part in others], axis=0) for k in (3, 4))
            size = sum(len(part[1]) for part in others)
            errors.append(missing - table @ ridge(square, product, size, penalty))
        rows.append(r2(true, np.concatenate(errors)))
    return np.array(rows)


def corrected(train: Sequence[Run], held_out: Sequence[Run]) -> None:
    """Print R² with a correction of any form."""
    judged = {width: left_out(train, width) for width in WIDTHS}
    true, missing = joined(held_out)
    print(f"as it is: {r2(true, missing).round(4)}")
    for column, name in enumerate(("spindle", "jaw")):
        width = max(WIDTHS, key=lambda one: float(judged[one][:, column].max()))
        penalty = PENALTIES[int(judged[width][:, column].argmax())]
        features = Features(train, width)
        table = features.of(train, THINNING)
        _, target = joined(train, THINNING)
        found = ridge(table.T @ table, table.T @ target, len(table), penalty)
        error = missing - features.of(held_out) @ found
        print(
            f"{name} corrected: loads left out {judged[width][:, column].max():.4f}, held out "
            f"{r2(true, error)[column]:.4f} (width {width}, penalty {penalty:g})"
        )


def standing(held_out: Sequence[Run]) -> None:
    """Print what happens while the spindle's encoder stands still."""
    still = np.concatenate([since_count(one) >= STILL_S for one in held_out])
    if not still.any():
        print(f"the spindle's encoder never stands still for {STILL_S * 1e3:.0f} ms")
        return
    squares = joined(held_out)[1][:, 0] ** 2
    share = squares[still].sum() / squares.sum()
    changes = []
    for one in held_out:
        torque, waits = one.measured[:, 0], since_count(one)
        events = np.diff(one.angle[:, 0], prepend=one.angle[0, 0]) != 0.0
        change = np.abs(since_last(events, torque))
        changes.append(change[waits >= STILL_S])
    largest = np.quantile(np.concatenate(changes), (0.9, 1.0)) * 1e3
    print(
        f"no count for {STILL_S * 1e3:.0f} ms: {still.mean():.0%} of the time, {share:.0%} of the "
        f"spindle's squared error; since the last count its torque has changed by up to "
        f"{largest[1]:.0f} mN m, in a tenth of that time by more than {largest[0]:.0f} mN m"
    )


def covered(model: Model, bags: Sequence[Path], runs: Sequence[Run]) -> None:
    """Print how the band of the spindle's torque holds while its encoder stands still."""
    inside, stddev, still = [], [], []
    for bag, one in zip(bags, runs, strict=True):
        channels = validate_bag(model, str(bag), Topics(), uncertainty=True).channels
        torque = next(channel for channel in channels if channel.name == "effort/spindle")
        assert torque.stddev is not None
        inside.append(np.abs(torque.estimate - torque.reference) <= 2.0 * torque.stddev)
        stddev.append(torque.stddev)
        time = (torque.stamp_ns - torque.stamp_ns[0]) * 1e-9
        still.append(np.interp(time, one.time, since_count(one)) >= STILL_S)
    hits, sigma, stands = np.concatenate(inside), np.concatenate(stddev), np.concatenate(still)
    for when, these in (("standing", stands), ("moving", ~stands)):
        print(
            f"spindle {when}: {hits[these].mean():.0%} within 2 sigma, of "
            f"{1e3 * sigma[these].mean():.1f} mN m on average"
        )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("data", type=Path, metavar="DATA")
    data = parser.parse_args().data
    model = load_model(str(ROOT / "config" / "robots" / "davinci_jaw.yaml"))
    bags = [sorted((data / part).iterdir()) for part in ("train", "validate")]
    train, held_out = ([read(model, bag) for bag in part] for part in bags)
    true = np.concatenate([one.measured for one in held_out])
    error = np.concatenate([other_cycles(one) - one.measured for one in held_out])
    there = np.isfinite(error).all(axis=1)
    print(f"mean of the other cycles: {r2(true[there], error[there]).round(4)}, "
          f"{there.mean():.1%} of the samples")  # fmt: skip
    corrected(train, held_out)
    standing(held_out)
    covered(model, bags[1], held_out)


if __name__ == "__main__":
    main()
