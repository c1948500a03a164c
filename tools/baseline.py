#!/usr/bin/env python3
"""Compare the da Vinci jaw's robot file with a regression from the same recordings.

    pip install scikit-learn lightgbm
    python tools/baseline.py BAGS
    python tools/baseline.py BAGS --robot 1=one.yaml --robot 10=config/robots/davinci_jaw.yaml

BAGS holds all runs of one mounting, as `tools/convert.py` writes them.  The regression is
what one would fit without a model of the cables: a ridge regression of both torques on features of
both angles, causal like the estimator, and a small LightGBM on its residual.  It is fitted to the
first 1, 2, 5 and 10 of the runs of TRAINING and compared on those runs that are not among them.
`--robot N=FILE` adds the row of a robot file that was identified from the first N; it may be given
several times.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.model.packing import channel_columns
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.recordings.recording import Topics

ROOT = Path(__file__).resolve().parents[1]

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
ALPHAS: Final = np.logspace(-7, 3, 11)
SCORED: Final = "neg_mean_squared_error"
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
    """Torques of the estimator with a robot file."""
    columns = [channel_columns(model.layout)[name] for name in CHANNELS]
    found = []
    for run in asked:
        recording = read_inputs(str(paths[run.name]), Topics(), model)
        estimated = estimate(model, condition_recording(model, recording))
        series = estimated.values[:, columns].T
        found.append(
            np.stack([np.interp(run.stamp_ns, estimated.stamp_ns, one) for one in series], axis=1)
        )
    return found


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
    arguments = parser.parse_args(argv)
    own = load_model(str(ROOT / "config" / "robots" / "davinci_jaw.yaml"))
    paths = {path.name[-2:]: path for path in sorted(arguments.bags.iterdir())}
    runs = {name: Run(path, own) for name, path in paths.items()}
    asked = [run for name, run in runs.items() if name not in TRAINING]
    given = [text.split("=", 1) for text in arguments.robot]
    print("| | fitted runs | compared runs | spindle R² | jaw R² | better: spindle | jaw |")
    print("|---|---|---|---|---|---|---|")
    for count in COUNTS:
        fitted = [runs[name] for name in TRAINING[:count]]
        found = predictions(fitted, asked)
        errors = {name: squared_errors(asked, one) for name, one in found.items()}
        for name, one in errors.items():
            print(row(name, count, asked, one, None), flush=True)
        for name in (name for number, name in given if number == str(count)):
            ours = squared_errors(asked, estimates(load_model(name), paths, asked))
            print(row(f"`{Path(name).name}`", count, asked, ours, errors["ridge + LightGBM"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
