"""Draw docs/figures/growth.png: cost of an update from one finger to twenty, slow and fast.

python -m bench.growth
"""

from itertools import product

import matplotlib as mpl
import numpy as np

from bench.figures import ROOT, in_turn
from bench.hand import ROUNDS, fed, fingers

mpl.use("Agg")
from matplotlib import pyplot as plt

PICTURE = ROOT / "docs" / "figures" / "growth.png"
FINGERS = (1, 2, 5, 10, 20)
RATES = (1000, 500, 100, 50)
"""Readings per second."""
FREQUENCIES = {0.2: "#0072b2", 1.0: "#009e73", 3.0: "#d55e00"}
"""Of all joints [Hz], and their colours, after Okabe and Ito."""


def main():
    """Measure and draw."""
    models = [fingers(count) for count in FINGERS]
    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    size = (8.4, 2.9)
    figure, panels = plt.subplots(1, len(RATES), figsize=size, sharey=True, layout="constrained")
    for (panel, rate), (hertz, colour) in product(
        zip(panels, RATES, strict=True), FREQUENCIES.items()
    ):
        times = in_turn(ROUNDS, *(fed(model, rate, hertz) for model in models))
        cost = np.median(times, axis=1) * 1e6 / (rate * max(1.0, 1.0 / hertz))
        panel.plot(FINGERS, cost, "o-", color=colour, markersize=3, label=f"{hertz:g} Hz")
        panel.plot(FINGERS, cost[0] * np.array(FINGERS), ":", color=colour, linewidth=0.7)
        panel.set(title=f"read at {rate} Hz", xlabel="fingers", xscale="log", yscale="log")
        panel.set_xticks(FINGERS, map(str, FINGERS))
        panel.minorticks_off()
    panels[0].set_ylabel("one update [µs]")
    panels[0].legend(frameon=False, title="joints at")
    figure.savefig(PICTURE, dpi=150)


if __name__ == "__main__":
    main()
