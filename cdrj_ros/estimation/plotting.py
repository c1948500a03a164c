"""A figure of estimated tensions over time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from cdrj_ros.foundation.errors import UsageError

if TYPE_CHECKING:
    from cdrj_ros.estimation.estimator import Estimates


def draw_tensions(found: Estimates, elements: Iterable[str] | None) -> Any:
    """See ``Estimates.plot``."""
    from matplotlib.figure import Figure

    names = found.layout.elements
    chosen = list({name.rpartition("/")[0]: name for name in names}.values())
    if elements is not None:
        chosen = list(elements)
    if unknown := [name for name in chosen if name not in names]:
        raise UsageError(f"there is no element {', '.join(unknown)}, only {', '.join(names)}")
    time_s = (found.stamp_ns - found.stamp_ns[:1]) * 1e-9
    figure = Figure(figsize=(9.0, 1.2 + 1.9 * len(chosen)), layout="constrained")
    rows = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
    for axes, name in zip(rows, chosen, strict=True):
        k = names.index(name)
        tension, flagged = found.tension[:, k], found.status[:, k] != 0
        if found.tension_stddev is not None:
            band = 2.0 * found.tension_stddev[:, k]
            axes.fill_between(time_s, tension - band, tension + band, alpha=0.25, label="± 2σ")
        (line,) = axes.plot(time_s, np.where(flagged, np.nan, tension), label="estimate, status 0")
        if flagged.any():
            axes.plot(
                time_s, np.where(flagged, tension, np.nan), ":", color=line.get_color(),
                label="estimate, with a status flag",
            )  # fmt: skip
        # bands of an unknown friction history would hide the tensions
        known = tension[np.isfinite(tension)]
        if known.size:
            margin = 0.2 * float(np.ptp(known)) + 0.05 * float(np.abs(known).max())
            axes.set_ylim(float(known.min()) - margin, float(known.max()) + margin)
        axes.set_ylabel(f"{name} [N]")
    rows[0].legend(ncols=3, frameon=False)
    rows[-1].set_xlabel("time [s]")
    return figure
