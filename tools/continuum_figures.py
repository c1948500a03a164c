#!/usr/bin/env python3
"""Print the held-out figures of docs/validation.md and draw its pictures.

    python tools/continuum_figures.py BAGS --other LATER/test/2024-12-06-… --out docs/figures

BAGS and LATER, of another session, are what tools/convert_continuum.py has written.  Per run and
wire: R², RMSE and the share of samples within two standard deviations, with the robot file as it is
and after a tare: ``identify`` finds the screws' zeros in the run's first ten seconds, and only what
follows them is compared.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cdrj_ros.evaluation.channels import BagComparison, Channel  # noqa: E402
from cdrj_ros.evaluation.metrics import ChannelError, pooled_errors  # noqa: E402
from cdrj_ros.evaluation.validation import validate_bag  # noqa: E402
from cdrj_ros.foundation.arrays import Series  # noqa: E402
from cdrj_ros.identification.fit import identify  # noqa: E402
from cdrj_ros.identification.observations import Recorded  # noqa: E402
from cdrj_ros.identification.unknowns import parse_unknowns  # noqa: E402
from cdrj_ros.model.prepared import Model, prepare  # noqa: E402
from cdrj_ros.recordings.recording import Topics, read_recording  # noqa: E402
from cdrj_ros.robot.parameters import with_numbers  # noqa: E402
from cdrj_ros.robot.reader import build_robot, load_document  # noqa: E402

mpl.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

ROBOT = ROOT / "config" / "robots" / "continuum.yaml"
HELD_OUT: Final = (
    "train/2024-11-15-10-55-14_sinewave_random",
    "train/2024-11-15-10-58-56_-50",
    "train/2024-11-15-11-05-21_-20",
    "train/2024-11-15-11-14-56_+20",
    "train/2024-11-15-11-16-51_+60",
    "test/2024-11-15-11-20-13_testset_dynamic",
)
TARE_S: Final = 10.0
WIRES: Final = ("wire_0", "wire_1")
MEASURED, ESTIMATED = "#222222", "#D55E00"


def model_with(zeros: Mapping[str, float]) -> Model:
    """The robot with the screws' zeros moved [rad]."""
    document, source = load_document(ROBOT)
    numbers = {f"motors.{wire}.reference_angle": zero for wire, zero in zeros.items()}
    return prepare(build_robot(with_numbers(document, numbers), source))


def compared(bag: Path, model: Model, *, uncertainty: bool = False) -> BagComparison:
    """The comparison that `validate` makes."""
    return validate_bag(model, str(bag), Topics(), uncertainty=uncertainty)


def part(comparison: BagComparison, first_s: float, last_s: float) -> BagComparison:
    """The samples of a stretch of every channel."""
    channels = []
    for channel in comparison.channels:
        time = (channel.stamp_ns - channel.stamp_ns[0]) * 1e-9
        inside = (time >= first_s) & (time < last_s)
        arrays = {
            name: value[inside]
            for name, value in vars(channel).items()
            if isinstance(value, np.ndarray) and value.shape == time.shape
        }
        channels.append(replace(channel, **arrays))
    return replace(comparison, channels=tuple(channels))


def channel_of(comparison: BagComparison, wire: str) -> Channel:
    """The tension at the drive of a wire."""
    return next(one for one in comparison.channels if one.name == f"tension/{wire}/1")


def tared(bag: Path) -> dict[str, float]:
    """Zero of each screw [rad] that ``identify`` finds in the first ten seconds."""
    run = read_recording(str(bag), Topics())
    references = {}
    for name, series in run.references.items():
        first = series.stamp_ns < series.stamp_ns[0] + round(TARE_S * 1e9)
        references[name] = Series(*(one[first] for one in vars(series).values()))
    document, source = load_document(ROBOT)
    unknowns = parse_unknowns(document, "motors.{*}.reference_angle")
    found = identify(
        document, source, unknowns, [Recorded(bag.name, run.motors, run.joints, references)]
    )
    return dict(zip(WIRES, found.values.tolist(), strict=True))


def cells(errors: Mapping[str, ChannelError]) -> str:
    """R², RMSE and coverage of both wires, as cells of a table."""
    shown = []
    for wire in WIRES:
        one = errors[f"tension/{wire}/1"]
        share = "–" if one.coverage is None else f"{100.0 * one.coverage:.0f} %"
        shown.append(f"{one.r2:.3f} | {one.rmse:.2f} N | {share}")
    return " | ".join(shown)


def time_figure(as_it_is: Sequence[BagComparison], path: Path, wire: str, title: str) -> None:
    """Estimate and its band against the load cell over time, one axis per run."""
    fig, axes = plt.subplots(len(as_it_is), 1, figsize=(9, 2.5 * len(as_it_is)), squeeze=False)
    for axis, comparison in zip(axes[:, 0], as_it_is, strict=True):
        channel = channel_of(comparison, wire)
        time = (channel.stamp_ns - channel.stamp_ns[0]) * 1e-9
        if channel.stddev is not None:
            low, high = (channel.estimate + sign * 2.0 * channel.stddev for sign in (-1.0, 1.0))
            axis.fill_between(time, low, high, color=ESTIMATED, alpha=0.2, lw=0, label="±2σ")
        axis.plot(time, channel.reference, color=MEASURED, lw=1.2, label="load cell")
        axis.plot(time, channel.estimate, color=ESTIMATED, lw=1.0, label="estimate")
        axis.set(ylabel="tension [N]", xlim=(0.0, time[-1]))
        axis.set_title(f"{Path(comparison.path).name}, {wire}", fontsize=9, loc="left")
    axes[0, 0].legend(
        ncols=3, fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False
    )
    axes[-1, 0].set_xlabel("time [s]")
    save(fig, path, title)


def loop_figure(bag: Path, comparison: BagComparison, path: Path) -> None:
    """Tension over the wire that is pulled in, measured and estimated."""
    recording = read_recording(str(bag), Topics())
    fig, axes = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True)
    for axis, wire in zip(axes, WIRES, strict=True):
        channel = channel_of(comparison, wire)
        screw = recording.motors[wire]
        pulled_mm = np.interp(channel.stamp_ns, screw.stamp_ns, screw.value) / np.pi
        axis.plot(pulled_mm, channel.reference, ".", ms=2, color=MEASURED, label="load cell")
        axis.plot(pulled_mm, channel.estimate, ".", ms=2, color=ESTIMATED, label="estimate")
        axis.set_xlabel(f"{wire} pulled in [mm]")
    axes[0].set_ylabel("tension [N]")
    axes[0].legend(fontsize=8, markerscale=4)
    save(fig, path, f"{bag.name}, held out")


def save(fig: Any, path: Path, title: str) -> None:
    """Write a picture as the pages show it."""
    fig.suptitle(title, fontsize=10)
    fig.tight_layout()
    fig.savefig(path, dpi=110)
    plt.close(fig)


def print_tables(bags: Sequence[Path], plain: Sequence[BagComparison]) -> None:
    """Figures of every run as identified, and after a tare."""
    print("as identified")
    for comparison in plain:
        print(f"| {Path(comparison.path).name} | {cells(pooled_errors([comparison]))} |")
    print(f"| all | {cells(pooled_errors(plain))} |")
    after = []
    print("after a tare")
    for bag in bags:
        zeros = tared(bag)
        after.append(part(compared(bag, model_with(zeros), uncertainty=True), TARE_S, np.inf))
        moved = ", ".join(f"{zero / np.pi:+.2f} mm" for zero in zeros.values())
        print(f"| {bag.name} | {moved} | {cells(pooled_errors([after[-1]]))} |")
    print(f"| all | | {cells(pooled_errors(after))} |")


def main() -> int:
    """Print the tables, then draw the pictures."""
    parser = argparse.ArgumentParser(description="Figures of docs/validation.md")
    parser.add_argument("bags", type=Path, help="the folder with train and test")
    parser.add_argument("--other", type=Path, help="a bag of another session")
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures")
    asked = parser.parse_args()
    bags = [asked.bags / name for name in HELD_OUT]
    plain = [compared(bag, model_with({}), uncertainty=True) for bag in bags]
    print_tables(bags, plain)
    asked.out.mkdir(parents=True, exist_ok=True)
    shown = [plain[0], plain[2]]
    time_figure(shown, asked.out / "continuum_time.png", "wire_0", "Held-out runs")
    failed = [plain[4], plain[5]]
    time_figure(failed, asked.out / "continuum_failure.png", "wire_1", "Held-out runs that fail")
    loop_figure(bags[0], plain[0], asked.out / "continuum_loops.png")
    if asked.other is not None:
        other = compared(asked.other, model_with({}), uncertainty=True)
        print_tables([asked.other], [other])
        path = asked.out / "continuum_session.png"
        time_figure([other], path, "wire_0", "Another session, nothing fitted")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
