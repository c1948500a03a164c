#!/usr/bin/env python3
"""Draw estimates beside references, over time or over the angle, as in docs/validation.md.

    python tools/draw_bags.py BAG... --robot R.yaml --channels effort/spindle,effort/jaw --out P.png

A column of pictures a recording, a row a channel; `--over angle` draws loops.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

from cdrj_ros.evaluation.channels import unit_of
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Topics

mpl.use("Agg")
import matplotlib.pyplot as plt

MEASURED, ESTIMATED = "#222222", "#D55E00"
"""Colours that the colour-blind can tell apart (Okabe, Ito)."""

LOOPS_FROM = 0.25
"""Share of a recording before which loops are not drawn: the friction history is not yet known."""


def draw(axes, channel, over, until_s):
    """Reference and estimate; over time with twice its standard deviation, else over the angle."""
    time = (channel.stamp_ns - channel.stamp_ns[0]) * 1e-9
    x, kept = time, time <= until_s
    if over == "angle":
        x, kept = channel.angle, np.arange(time.size) >= LOOPS_FROM * time.size
    x, reference, estimate = x[kept], channel.reference[kept], channel.estimate[kept]
    width = 1.2 if over == "time" else 0.7
    axes.plot(x, reference, color=MEASURED, lw=width, label="measured")
    axes.plot(x, estimate, color=ESTIMATED, lw=0.8 * width, label="estimated")
    if over == "time" and channel.stddev is not None:
        band = 2.0 * channel.stddev[kept]
        axes.fill_between(
            x, estimate - band, estimate + band, color=ESTIMATED, alpha=0.2, lw=0, label="±2σ"
        )
        margin = 0.35 * np.ptp(reference)
        axes.set_ylim(reference.min() - margin, reference.max() + margin)


def main():
    """Draw one picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bags", nargs="+")
    parser.add_argument("--robot", required=True)
    parser.add_argument("--channels", required=True, help="names as `validate` prints them")
    parser.add_argument("--over", choices=("time", "angle"), default="time")
    parser.add_argument("--until", type=float, default=np.inf, help="end of the time axis [s]")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    model, names = load_model(asked.robot), asked.channels.split(",")
    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    size = (max(2.3 * len(asked.bags), 7.0), 2.3 * len(names))
    figure, axes = plt.subplots(
        len(names), len(asked.bags), figsize=size, sharex="col", squeeze=False, layout="constrained"
    )
    for place, name in zip(axes[:, 0], names, strict=True):
        place.set_ylabel(f"{name} [{unit_of(name)}]")
    for column, bag in zip(axes.T, asked.bags, strict=True):
        found = validate_bag(model, bag, Topics(), uncertainty=asked.over == "time")
        channels = {channel.name: channel for channel in found.channels}
        for place, name in zip(column, names, strict=True):
            channel = channels[name]
            draw(place, channel, asked.over, asked.until)
        angle = f"{channel.angle_name} [{channel.angle_unit}]"
        column[-1].set_xlabel("time [s]" if asked.over == "time" else angle)
        column[0].set_title(Path(bag).name, fontsize=9)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, ncols=3, loc="outside lower center")
    figure.savefig(asked.out, dpi=110)


if __name__ == "__main__":
    main()
