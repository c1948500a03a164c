#!/usr/bin/env python3
"""Draw the figure of docs/validation.md from recordings of a real instrument.

python tools/encoderless_figure.py BAG... --robot ROBOT.yaml --out docs/figures/encoderless.png

The robot file has one joint without encoder, whose angle and torque the bags hold as references.
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

from cdrj_ros.evaluation.validation import validate_bag  # noqa: E402
from cdrj_ros.model.prepared import load_model  # noqa: E402
from cdrj_ros.recordings.recording import Topics  # noqa: E402

mpl.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

MEASURED, ESTIMATED = "#222222", "#D55E00"
SHOWN_S = 10.0
"""Time that is drawn [s]."""


def draw(axes: Any, channel: Any, scale: float, unit: str) -> None:
    """One channel over time, with twice its standard deviation."""
    time = (channel.stamp_ns - channel.stamp_ns[0]) * 1e-9
    shown = time <= SHOWN_S
    time, estimate = time[shown], scale * channel.estimate[shown]
    band = 2.0 * scale * channel.stddev[shown]
    axes.fill_between(time, estimate - band, estimate + band, color=ESTIMATED, alpha=0.2, lw=0)
    axes.plot(time, scale * channel.reference[shown], color=MEASURED, lw=1.2, label="measured")
    axes.plot(time, estimate, color=ESTIMATED, lw=1.0, label="from the motor alone, ±2σ")
    low, high = (f(scale * channel.reference[shown]) for f in (np.min, np.max))
    margin = 0.35 * (high - low)
    axes.set_ylim(low - margin, high + margin)
    axes.set_ylabel(unit)


def main(argv: Sequence[str] | None = None) -> int:
    """Draw one column of two pictures for every bag."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bags", nargs="+")
    parser.add_argument("--robot", required=True)
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args(argv)
    model = load_model(arguments.robot)
    (joint,) = (model.layout.joints[j] for j in model.robot.unmeasured)
    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    figure, axes = plt.subplots(
        2, len(arguments.bags), figsize=(9, 4.4), sharex=True, squeeze=False
    )
    for column, bag in zip(axes.T, arguments.bags, strict=True):
        channels = {
            c.name: c for c in validate_bag(model, bag, Topics(), uncertainty=True).channels
        }
        draw(column[0], channels[f"angle/{joint}"], 180.0 / np.pi, f"{joint} angle [°]")
        draw(column[1], channels[f"effort/{joint}"], 1e3, f"{joint} torque [mN·m]")
        column[0].set_title(Path(bag).name.rpartition("_")[2], fontsize=9)
        column[1].set_xlabel("time [s]")
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.95))
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, fontsize=8, ncols=2, loc="upper center")
    figure.savefig(arguments.out, dpi=110)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
