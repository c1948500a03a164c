#!/usr/bin/env python3
"""Compare the da Vinci jaw's robot file with a regression from the same recordings.

    pip install scikit-learn lightgbm
    python tools/baseline.py BAGS
    python tools/baseline.py BAGS --robot 1=one.yaml --robot 10=config/robots/davinci_jaw.yaml
    python tools/baseline.py BAGS --correct --robot 10=config/robots/davinci_jaw.yaml

BAGS holds all runs of one mounting, as `tools/convert_davinci.py` writes them.  The regression is
what one would fit without a model of the cables: a ridge regression of both torques on features of
both angles, causal like the estimator, and a small LightGBM on its residual.  It is fitted to the
first 1, 2, 5 and 10 of the runs of TRAINING and compared on those runs that are not among them.
`--robot N=FILE` adds the row of a robot file that was identified from the first N, and `--correct`
the row of a ridge regression on what it leaves over in these.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cdrj_ros.evaluation.estimating import estimate  # noqa: E402
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs  # noqa: E402
from cdrj_ros.model.loading import load_model  # noqa: E402
from cdrj_ros.model.prepared import Model, channel_columns  # noqa: E402
from cdrj_ros.recordings import Topics  # noqa: E402

Table = NDArray[np.float64]

TRAINING: Final = ("04", "28", "00", "08", "20", "24", "02", "06", "22", "26")
"""Runs to fit to, in the order in which they are added."""
COUNTS: Final = (1, 2, 5, 10)
CHANNELS: Final = ("effort/spindle", "effort/jaw")
STEP: Final = 10
"""Every n-th reading is fitted and compared: 100 Hz."""
THRESHOLDS: Final = (0.002, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.3)
"""Of the stop operators [rad]."""
CENTRE: Final = (0.52, 0.70)
"""Angles in the middle of the motion [rad]."""
TORQUES: Final = (0.2, 0.1)
"""Large ones [N m]."""
ALPHAS: Final = np.logspace(-7, 3, 11)
SCORED: Final = "neg_mean_squared_error"
PENALTIES: Final = np.logspace(-5, 1, 7)
"""Of the correction, per reading."""
FADED: Final = 0.25
"""Distance from what was fitted at which the correction is 0, as a fraction of its range."""
FEWEST_LOADS: Final = 3
"""Without which nothing is corrected."""
BOOSTED: Final = {
    "n_estimators": 200, "learning_rate": 0.05, "num_leaves": 15, "min_child_samples": 100,
    "subsample": 0.7, "subsample_freq": 1, "colsample_bytree": 0.5, "seed": 0, "verbose": -1,
}  # fmt: skip


class Run:
    """Both angles and both torques of a recording at 100 Hz."""

    def __init__(self, path: Path, model: Model) -> None:
        """Read a bag."""
        self.name = path.name[-2:]
        recording = read_inputs(str(path), Topics(), model)
        samples = condition_recording(model, recording).segments[0]
        # the readings themselves, without the file's corrections of the angles
        angles = [recording.motors["spindle"], recording.joints["jaw"]]
        torques = [recording.references[name] for name in CHANNELS]
        self.stamp_ns = samples.stamp_ns[::STEP]
        self.angle, self.torque = (
            np.stack([np.interp(self.stamp_ns, one.stamp_ns, one.value) for one in series], axis=1)
            for series in (angles, torques)
        )
        self.features = features(self.angle)

    def loads(self) -> NDArray[np.int64]:
        """Its load at every reading."""
        return np.full(len(self.angle), int(self.name[1]))


def stops(angle: NDArray[np.float64]) -> Table:
    """Stop operators of an angle: elastic up to their thresholds, then sliding."""
    threshold, now = np.array(THRESHOLDS), np.zeros(len(THRESHOLDS))
    found = np.empty((angle.size, threshold.size))
    for k, change in enumerate(np.diff(angle, prepend=angle[0])):
        now = np.clip(now + change, -threshold, threshold)
        found[k] = now
    return found / threshold


def velocities(angle: Table) -> Table:
    """Velocity of both angles, causal, with a lag of 50 ms [rad/s]."""
    velocity = np.diff(angle, axis=0, prepend=angle[:1]) * 100.0
    for k in range(1, len(velocity)):
        velocity[k] = velocity[k - 1] + 0.2 * (velocity[k] - velocity[k - 1])
    return velocity


def features(angle: Table) -> Table:
    """Polynomials of both angles, stop operators, their products, and velocities."""
    s, j = (angle - CENTRE).T
    polynomials = [s, j, s * s, s * j, j * j, s**3, s * s * j, s * j * j, j**3]
    both = np.hstack([stops(s), stops(j)])
    velocity = velocities(angle)
    fast = np.hstack([velocity, np.tanh(velocity / 0.05)])
    return np.hstack(
        [np.stack(polynomials, axis=1), both, both * s[:, None], both * j[:, None],
         both[:, :8] * both[:, 8:], fast, fast[:, 2:] * s[:, None], fast[:, 2:] * j[:, None]]
    )  # fmt: skip


def states(run: Run, estimated: Table) -> Table:
    """What the correction depends on: the angles' history, and estimated torques and frictions.

    The products let it grow with the load, and depend on the pose.
    """
    from sklearn.preprocessing import PolynomialFeatures

    pose = np.hstack([run.angle - CENTRE, estimated[:, : len(CHANNELS)] / TORQUES])
    change = np.diff(run.angle, axis=0, prepend=run.angle[:1])
    order = np.arange(len(change))[:, None]
    last = np.maximum.accumulate(np.where(np.abs(change) > 1e-9, order, 0))
    way = np.sign(np.take_along_axis(change, last, axis=0))  # of the last count
    waited = np.minimum(order - last, 20) / 10.0
    velocity = velocities(run.angle)
    history = np.hstack([stops(angle) for angle in pose[:, :2].T])
    history = np.hstack([history, velocity, np.tanh(velocity / 0.05), way, way * waited])
    products = [history * one[:, None] for one in pose.T]
    polynomials = PolynomialFeatures(3, include_bias=False).fit_transform(pose)
    return np.hstack([polynomials, estimated[:, len(CHANNELS) :], history, *products])


def places(run: Run, estimated: Table) -> Table:
    """Angles, velocities and estimated torques, outside of whose range nothing is corrected."""
    return np.hstack([run.angle, velocities(run.angle), estimated[:, : len(CHANNELS)]])


def predictions(fitted: Sequence[Run], asked: Sequence[Run]) -> dict[str, list[Table]]:
    """Torques of the runs to compare with, by kind of regression."""
    from lightgbm import LGBMRegressor
    from sklearn.linear_model import RidgeCV
    from sklearn.model_selection import GroupKFold
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    x = np.vstack([run.features for run in fitted])
    y = np.vstack([run.torque for run in fitted])
    # by loads; a single run is divided in time
    loads = np.concatenate([run.loads() for run in fitted])
    if len(set(loads)) == 1:
        loads = np.arange(len(x)) * 4 // len(x)
    folds = list(GroupKFold(len(set(loads))).split(x, groups=loads))
    ridge = make_pipeline(StandardScaler(), RidgeCV(ALPHAS, cv=folds, scoring=SCORED))
    there = np.vstack([run.features for run in asked])
    linear, rest = np.empty((len(there), len(CHANNELS))), np.empty((len(there), len(CHANNELS)))
    for c in range(len(CHANNELS)):
        linear[:, c] = ridge.fit(x, y[:, c]).predict(there)
        boosted = LGBMRegressor(**BOOSTED).fit(x, y[:, c] - ridge.predict(x))
        rest[:, c] = boosted.predict(there)
    ends = np.cumsum([len(run.angle) for run in asked])[:-1]
    return {
        "ridge": np.split(linear, ends),
        "ridge + LightGBM": np.split(linear + rest, ends),
    }


def estimates(model: Model, paths: Mapping[str, Path], asked: Sequence[Run]) -> list[Table]:
    """Torques of the estimator with a robot file, and its frictions at the pulleys."""
    columns = [channel_columns(model.layout)[name] for name in CHANNELS]
    columns += range(model.layout.friction.start, model.layout.friction.stop)
    found = []
    for run in asked:
        recording = read_inputs(str(paths[run.name]), Topics(), model)
        estimated = estimate(model, condition_recording(model, recording))
        series = estimated.values[:, columns].T
        found.append(
            np.stack([np.interp(run.stamp_ns, estimated.stamp_ns, one) for one in series], axis=1)
        )
    return found


def corrections(
    fitted: Sequence[Run], own: Sequence[Table], asked: Sequence[Run], theirs: Sequence[Table]
) -> list[Table]:
    """What a ridge regression adds to the estimates `theirs`, from the residuals of `own`.

    It is not larger than in the fitted runs and fades outside of their `places`.  Penalty and a
    factor of at most 1 are those with the least error on loads that were left out.
    """
    from sklearn.linear_model import Ridge
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    both = len(CHANNELS)
    loads = np.concatenate([run.loads() for run in fitted])
    if len(set(loads)) < FEWEST_LOADS:
        return [np.zeros_like(run.torque) for run in asked]
    x = np.vstack([states(run, one) for run, one in zip(fitted, own, strict=True)])
    place = np.vstack([places(run, one) for run, one in zip(fitted, own, strict=True)])
    missing = np.vstack([r.torque - e[:, :both] for r, e in zip(fitted, own, strict=True)])

    def predict(penalty: float, of: Table, at: Table, known: NDArray[np.bool_]) -> Table:
        alpha = penalty * int(known.sum())
        ridge = make_pipeline(StandardScaler(), Ridge(alpha)).fit(x[known], missing[known])
        largest = np.abs(ridge.predict(x[known])).max(axis=0)
        low, high = place[known].min(axis=0), place[known].max(axis=0)
        outside = (np.maximum(low - at, at - high) / (high - low)).max(axis=1)
        weight = np.clip(1.0 - outside / FADED, 0.0, 1.0)
        return np.clip(ridge.predict(of), -largest, largest) * weight[:, None]

    there = np.vstack([states(run, one) for run, one in zip(asked, theirs, strict=True)])
    at = np.vstack([places(run, one) for run, one in zip(asked, theirs, strict=True)])
    found, least = np.zeros((len(there), both)), (missing**2).sum(axis=0)
    for penalty in PENALTIES:
        left = np.empty_like(missing)
        for load in set(loads):
            out = loads == load
            left[out] = predict(penalty, x[out], place[out], ~out)
        factor = np.clip((left * missing).sum(axis=0) / (left**2).sum(axis=0), 0.0, 1.0)
        error = ((missing - factor * left) ** 2).sum(axis=0)
        better = error < least
        found[:, better] = (factor * predict(penalty, there, at, loads >= 0))[:, better]
        least = np.where(better, error, least)
    return np.split(found, np.cumsum([len(run.angle) for run in asked])[:-1])


def squared_errors(asked: Sequence[Run], predicted: Sequence[Table]) -> Table:
    """Sum over every run, shape (runs, channels)."""
    return np.array(
        [((run.torque - one) ** 2).sum(axis=0) for run, one in zip(asked, predicted, strict=True)]
    )


def row(name: str, count: int, asked: Sequence[Run], errors: Table, other: Table | None) -> str:
    """A row of the table: R² over all runs, and in how many runs it is better than another."""
    torque = np.vstack([run.torque for run in asked])
    explained = 1.0 - errors.sum(axis=0) / ((torque - torque.mean(axis=0)) ** 2).sum(axis=0)
    better = ["", ""] if other is None else [f"{n}" for n in (errors < other).sum(axis=0)]
    cells = [name, str(count), str(len(asked))]
    cells += [f"{r:.4f}" for r in explained] + better
    return "| " + " | ".join(cells) + " |"


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("bags", type=Path, help="folder of all runs")
    parser.add_argument("--robot", action="append", default=[], metavar="N=FILE")
    parser.add_argument("--correct", action="store_true", help="also correct its estimates")
    arguments = parser.parse_args(argv)
    own = load_model(str(ROOT / "config" / "robots" / "davinci_jaw.yaml"))
    paths = {path.name[-2:]: path for path in sorted(arguments.bags.iterdir())}
    runs = {name: Run(path, own) for name, path in paths.items()}
    asked = [run for name, run in runs.items() if name not in TRAINING]
    given = dict(text.split("=", 1) for text in arguments.robot)
    print("| | fitted runs | compared runs | spindle R² | jaw R² | better: spindle | jaw |")
    print("|---|---|---|---|---|---|---|")
    for count in COUNTS:
        fitted = [runs[name] for name in TRAINING[:count]]
        found = predictions(fitted, asked)
        errors = {name: squared_errors(asked, one) for name, one in found.items()}
        for name, one in errors.items():
            print(row(name, count, asked, one, None), flush=True)
        if str(count) in given:
            model, other = load_model(given[str(count)]), errors["ridge + LightGBM"]
            theirs = estimates(model, paths, asked)
            torques = [one[:, : len(CHANNELS)] for one in theirs]
            ours = squared_errors(asked, torques)
            print(row("`identify`", count, asked, ours, other), flush=True)
            if arguments.correct:
                added = corrections(fitted, estimates(model, paths, fitted), asked, theirs)
                torques = [one + more for one, more in zip(torques, added, strict=True)]
                ours = squared_errors(asked, torques)
                print(row("`identify`, corrected", count, asked, ours, other), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
