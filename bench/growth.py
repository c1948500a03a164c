"""Cost of an update from one finger to twenty, slow and fast: a row, and docs/figures/growth.png.

python -m bench.growth draws the picture
"""

from __future__ import annotations

from itertools import product

import matplotlib as mpl
import numpy as np

from bench.figures import ROOT, Row, compared, in_turn
from bench.hand import fed, fingers

PICTURE = ROOT / "docs" / "figures" / "growth.png"
FINGERS = (1, 2, 5, 10, 20)
RATES = (1000, 500, 100, 50)
"""Readings per second."""
FREQUENCIES = {0.2: "#0072b2", 1.0: "#009e73", 3.0: "#d55e00"}
"""Of all joints [Hz], and their colours, after Okabe and Ito."""
ROUNDS = 3

Case = tuple[int, float]
"""Rate and frequency."""


def costs(counts: tuple[int, ...]) -> dict[Case, np.ndarray]:
    """Processor time of an update with standard deviations [µs], shape (counts, ROUNDS)."""
    models, found = [fingers(count) for count in counts], {}
    for rate, frequency in product(RATES, FREQUENCIES):
        samples = rate * max(1.0, 1.0 / frequency)
        updates = [fed(model, rate, frequency) for model in models]
        times = in_turn(ROUNDS, *updates)
        found[rate, frequency] = np.array(times) * 1e6 / samples
    return found


def measure() -> list[Row]:
    """Twenty fingers beside twenty times one [µs], where the ratio is the largest."""
    found = costs((1, 20))
    rate, frequency = max(found, key=lambda case: float(np.median(found[case][1] / found[case][0])))
    one, twenty = found[rate, frequency]
    what = f"an update of twenty fingers, joints at {frequency:g} Hz read at {rate} Hz"
    return [compared(what, "µs", twenty, "twenty times that of one", 20.0 * one, "linear")]


def main() -> None:
    """Draw the picture."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    figure, panels = plt.subplots(
        1, len(RATES), figsize=(8.4, 2.9), sharey=True, layout="constrained"
    )
    for (rate, frequency), times in costs(FINGERS).items():
        panel, cost = panels[RATES.index(rate)], np.median(times, axis=1)
        colour = FREQUENCIES[frequency]
        panel.plot(FINGERS, cost, "o-", color=colour, markersize=3, label=f"{frequency:g} Hz")
        panel.plot(FINGERS, cost[0] * np.array(FINGERS), ":", color=colour, linewidth=0.7)
        panel.set(title=f"read at {rate} Hz", xlabel="fingers", xscale="log", yscale="log")
        panel.set_xticks(FINGERS, map(str, FINGERS))
        panel.minorticks_off()
    panels[0].set_ylabel("one update [µs]")
    panels[0].legend(frameon=False, title="joints at")
    figure.savefig(PICTURE, dpi=150)


if __name__ == "__main__":
    main()
