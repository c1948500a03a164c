#!/usr/bin/env python3
"""Draw the figures of docs/validation.md from the recordings of a real instrument.

python tools/davinci_figures.py DATA --pose-robot POSE.yaml --out docs/figures

DATA holds the folders train, validate and other_wrist_pose (see config/robots/davinci_jaw.yaml for
their origin), POSE.yaml the same robot with the jaw zeroed for the last of them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cdrj_ros.evaluation.inputs import condition_recording, read_inputs  # noqa: E402
from cdrj_ros.evaluation.metrics import pooled_errors  # noqa: E402
from cdrj_ros.evaluation.validation import Validation  # noqa: E402
from cdrj_ros.model.prepared import Model, prepare  # noqa: E402
from cdrj_ros.recordings.recording import Topics  # noqa: E402
from cdrj_ros.robot.parameters import with_numbers  # noqa: E402
from cdrj_ros.robot.reader import build_robot, load_document  # noqa: E402

mpl.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

ROBOT = ROOT / "config" / "robots" / "davinci_jaw.yaml"
MEASURED, ESTIMATED, THIRD = (
    "#222222",
    "#D55E00",
    "#0072B2",
)  # safe for the colour-blind (Okabe, Ito)
CHANNELS = ("effort/spindle", "effort/jaw")
WIDE = {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "figure.dpi": 110}


class Run:
    """One recording and its estimate."""

    def __init__(self, path: Path, model: Model) -> None:
        recording = read_inputs(str(path), Topics(), model)
        conditioned = condition_recording(model, recording)
        self.name = path.name.removeprefix("Tool_4_Maryland_L_")
        validation = Validation(model, str(path), recording, conditioned)
        for _ in validation.pieces():
            pass
        self.comparison = validation.result()
        self.channel = {channel.name: channel for channel in self.comparison.channels}
        self.samples = conditioned.segments[-1]

    def angle(self, channel: str) -> Any:
        """Spindle or jaw angle at the channel's stamps [rad]."""
        values = self.samples.motor_angle if channel == CHANNELS[0] else self.samples.joint_angle
        since = self.samples.stamp_ns[0]
        return np.interp(
            self.channel[channel].stamp_ns - since, self.samples.stamp_ns - since, values[:, 0]
        )


def runs_of(folder: Path, model: Model) -> list[Run]:
    """Every bag of a folder."""
    return [Run(bag, model) for bag in sorted(folder.iterdir()) if bag.is_dir()]


def loops(runs: Sequence[Run], path: Path) -> None:
    """Both torques over their angles, without the first quarter of each run."""
    fig, axes = plt.subplots(2, len(runs), figsize=(2.35 * len(runs), 4.6), sharey="row")
    for column, run in zip(axes.T, runs, strict=True):
        for axis, name in zip(column, CHANNELS, strict=True):
            channel = run.channel[name]
            late = slice(len(channel.stamp_ns) // 4, None, 5)
            angle = run.angle(name)[late]
            axis.plot(angle, channel.reference[late], color=MEASURED, lw=0.7, label="measured")
            axis.plot(angle, channel.estimate[late], color=ESTIMATED, lw=0.7, label="estimated")
            axis.set_xlabel(f"{name[7:]} angle [rad]")
        column[0].set_title(f"run {run.name}")
    for axis, name in zip(axes[:, 0], CHANNELS, strict=True):
        axis.set_ylabel(f"{name[7:]} torque [N·m]")
    axes[1, 0].legend(frameon=False, fontsize=8, loc="lower left")
    finish(fig, path)


def series(run: Run, path: Path) -> None:
    """Both torques and their errors over time."""
    fig, axes = plt.subplots(2, 2, figsize=(7.6, 4.2), sharex=True, height_ratios=[2.2, 1])
    for column, name in zip(axes.T, CHANNELS, strict=True):
        channel = run.channel[name]
        time = (channel.stamp_ns - channel.stamp_ns[0]) * 1e-9
        column[0].plot(time, channel.reference, color=MEASURED, lw=0.8, label="measured")
        column[0].plot(time, channel.estimate, color=ESTIMATED, lw=0.8, label="estimated")
        column[0].set_ylabel(f"{name[7:]} torque [N·m]")
        error = 1e3 * (channel.estimate - channel.reference)
        column[1].plot(time, error, color=THIRD, lw=0.6)
        column[1].axhline(0.0, color="#999999", lw=0.6)
        column[1].set_ylabel("error [mN·m]")
        column[1].set_xlabel("time [s]")
        limit = 1.2 * float(np.quantile(np.abs(error), 0.998))
        column[1].set_ylim(-limit, limit)
    axes[0, 0].legend(frameon=False, fontsize=8, loc="upper right", ncols=2)
    axes[0, 0].set_ylim(top=axes[0, 0].get_ylim()[1] * 1.15)
    finish(fig, path)


def per_run(groups: dict[str, Sequence[Run]], path: Path) -> None:
    """RMSE of every run."""
    fig, axes = plt.subplots(2, 1, figsize=(7.6, 4.2), sharex=True)
    colours = {"fitted": "#999999", "held out": ESTIMATED, "other pose, by --from": THIRD}
    for axis, name in zip(axes, CHANNELS, strict=True):
        at, ticks = 0, []
        for group, runs in groups.items():
            values = [1e3 * _rmse([run], name) for run in runs]
            axis.bar(
                range(at, at + len(runs)), values, color=colours[group], label=group, width=0.7
            )
            ticks += [run.name.replace("Pitch_3_00", "pose ") for run in runs]
            at += len(runs) + 1
            ticks.append("")
        axis.set_ylabel(f"{name[7:]} RMSE\n[mN·m]")
        axis.set_xticks(range(len(ticks) - 1), ticks[:-1], rotation=60, fontsize=8)
        axis.tick_params(axis="x", length=0)
    axes[0].legend(frameon=False, fontsize=8, loc="upper left", ncols=3)
    axes[0].set_ylim(top=1.25 * axes[0].get_ylim()[1])
    finish(fig, path)


def correction(model: Model, before: Sequence[Run], after: Sequence[Run], path: Path) -> None:
    """Mean error of the jaw torque with and without corrections, and the corrections."""
    fig, (left, middle, right) = plt.subplots(
        1, 3, figsize=(9.6, 2.9), width_ratios=(1.3, 1, 1), layout="constrained"
    )
    for runs, colour, label in ((before, MEASURED, "set to 0"), (after, ESTIMATED, "as fitted")):
        for k, run in enumerate(runs):
            left.plot(*_mean_errors(run), color=colour, lw=0.8, alpha=0.7,
                      label=None if k else label)  # fmt: skip
    left.axhline(0.0, color="#999999", lw=0.6)
    left.set_xlabel("jaw angle [rad]")
    left.set_ylabel("mean error of jaw torque [mN·m]")
    left.legend(frameon=False, fontsize=8, title="corrections", title_fontsize=8)
    for axis, name, sensor in (
        (middle, "joints.jaw", model.robot.joints[0].sensor),
        (right, "motors.spindle", model.robot.motors[0].sensor),
    ):
        at, value = np.array(sensor.corrected_at), 1e3 * np.array(sensor.correction)
        spread = 1e3 * _stddev(model, name, at.size)
        axis.fill_between(
            at, value - 2.0 * spread, value + 2.0 * spread, color=THIRD, alpha=0.2, lw=0
        )
        axis.plot(at, value, "o-", color=THIRD, ms=3.5, lw=1)
        axis.axhline(0.0, color="#999999", lw=0.6)
        axis.set_xlabel(f"{name.rpartition('.')[2]} angle [rad]")
    middle.set_ylabel("correction, ±2σ [mrad]")
    write(fig, path)


def _mean_errors(run: Run) -> tuple[Any, list[float]]:
    """Middles of ranges of the jaw's angle [rad], and the mean error of its torque [mN m]."""
    channel = run.channel[CHANNELS[1]]
    edges = np.linspace(0.16, 1.26, 45)
    bins = np.digitize(run.angle(CHANNELS[1]), edges)
    error = 1e3 * (channel.estimate - channel.reference)
    return 0.5 * (edges[1:] + edges[:-1]), [
        float(error[bins == b].mean()) if np.count_nonzero(bins == b) > 50 else float("nan")
        for b in range(1, edges.size)
    ]


def _stddev(model: Model, axis: str, count: int) -> Any:
    """Standard deviations of an axis's correction [rad]; 0 where it was not fitted."""
    known = model.robot.uncertainty
    found = np.zeros(count)
    if known is not None:
        stddev = dict(zip(known.parameters, np.sqrt(np.diag(known.covariance)), strict=True))
        names = [f"{axis}.correction.value.{k + 1}" for k in range(count)]
        found[:] = [stddev.get(name, 0.0) for name in names]
    return found


def _rmse(runs: Sequence[Run], channel: str) -> float:
    return float(pooled_errors([run.comparison for run in runs])[channel].rmse or 0.0)


def finish(fig: Any, path: Path) -> None:
    """Arrange and write a figure."""
    fig.tight_layout()
    write(fig, path)


def write(fig: Any, path: Path) -> None:
    """Write a figure."""
    fig.savefig(path, dpi=130)
    plt.close(fig)
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


def main(argv: Sequence[str] | None = None) -> int:
    """Draw all figures; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("data", type=Path, help="folder with train, validate, other_wrist_pose")
    parser.add_argument("--pose-robot", required=True, help="robot file for other_wrist_pose")
    parser.add_argument("--out", type=Path, required=True, help="folder of the figures")
    arguments = parser.parse_args(argv)
    arguments.out.mkdir(parents=True, exist_ok=True)
    plt.rcParams.update(WIDE)
    document, source = load_document(ROBOT)
    model = prepare(build_robot(document, source))
    without = {
        f"{name}.correction.value.{k + 1}": 0.0
        for name, axis in (("joints.jaw", document["joints"][0]),
                           ("motors.spindle", document["motors"][0]))
        for k in range(len(axis["correction"]["value"]))
    }  # fmt: skip
    plain = prepare(build_robot(with_numbers(document, without), source))
    train = runs_of(arguments.data / "train", model)
    held_out = runs_of(arguments.data / "validate", model)
    zeroed = prepare(build_robot(*load_document(arguments.pose_robot)))
    other = runs_of(arguments.data / "other_wrist_pose", zeroed)
    loops([held_out[k] for k in (0, 1, 2, -1)], arguments.out / "davinci_loops.png")
    series(held_out[len(held_out) // 2], arguments.out / "davinci_time.png")
    per_run(
        {"fitted": train, "held out": held_out, "other pose, by --from": other},
        arguments.out / "davinci_runs.png",
    )
    correction(
        model, runs_of(arguments.data / "train", plain), train,
        arguments.out / "davinci_correction.png",
    )  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
