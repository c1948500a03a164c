"""Common elements of the pictures of a report: colours, sizes, axes, lines and texts.

All pictures have the same size, so that three fit side by side on a desktop screen and one fills a
phone.  One unit of a drawing is one CSS pixel.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from numpy.typing import NDArray

from cdrj_ros.foundation.text import printable
from cdrj_ros.judgement.reversals import envelope

Floats = NDArray[np.float64]

PALETTE: Final[Mapping[str, str]] = MappingProxyType(
    {
        "truth": "#b9b9b5",
        "estimate": "#0072b2",
        "error": "#c94f00",
        "ink": "#1c1c1a",
        "muted": "#62625d",
        "rule": "#e4e4df",
        "shade": "#f1f0ea",
        "band": "#c5dff0",
    }
)
"""Colours by role; blue and vermilion (Okabe and Ito) differ for colour-blind readers too."""

WIDTH: Final = 390
"""Width of a picture [px]."""

HEIGHT: Final = 300
"""Height of a picture [px]."""

FONT_SIZE: Final = 11.0
"""Size of all text in a picture [px]."""

BUCKETS: Final = 320
"""Number of buckets of a drawn series: about one per pixel of the axes."""

LEFT, RIGHT, TOP, BOTTOM = 50, 8, 26, 38
"""Margins around the axes [px]."""

LINE_WIDTH: Final = {"truth": 3.4, "estimate": 1.1, "error": 0.8, "band": 8.0}
"""Line widths by role [px]."""


def new_figure() -> Figure:
    """A transparent figure of WIDTH by HEIGHT."""
    figure = Figure(figsize=(WIDTH / 72.0, HEIGHT / 72.0), dpi=72.0)
    figure.patch.set_visible(False)
    return figure


def add_axes(figure: Figure, bottom: float, height: float) -> Axes:
    """Axes in pixels: no frame, a light horizontal grid, labels without tick marks."""
    axes = figure.add_axes(
        (
            LEFT / WIDTH,
            bottom / HEIGHT,
            (WIDTH - LEFT - RIGHT) / WIDTH,
            height / HEIGHT,
        )
    )
    axes.patch.set_visible(False)
    for side in ("left", "right", "top"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set(color=PALETTE["truth"], linewidth=0.8)
    axes.tick_params(
        length=0, pad=5, labelsize=FONT_SIZE, labelcolor=PALETTE["muted"], which="both"
    )
    axes.grid(axis="y", color=PALETTE["rule"], linewidth=0.8)
    axes.set_axisbelow(True)
    return axes


def draw_line(
    axes: Axes, x: Floats, y: Floats, breaks: NDArray[np.intp], role: str, *, loop: bool = False
) -> None:
    """Draw a line in the style of a role through the envelope of the samples, broken at gaps."""
    kept = envelope(BUCKETS, x, y) if loop else envelope(BUCKETS, y)
    if len(breaks):
        kept = np.union1d(kept, np.concatenate([breaks, breaks + 1]))
        at = np.searchsorted(kept, breaks, side="right")
        x_drawn, y_drawn = np.insert(x[kept], at, np.nan), np.insert(y[kept], at, np.nan)
    else:
        x_drawn, y_drawn = x[kept], y[kept]
    axes.plot(
        x_drawn,
        y_drawn,
        color=PALETTE[role],
        linewidth=LINE_WIDTH[role],
        solid_joinstyle="round",
        solid_capstyle="round",
        clip_on=False,
        zorder={"truth": 2, "estimate": 3, "error": 3}[role],
    )


def set_limits(axes: Axes, x: Floats, ticks: int) -> None:
    """Set limits that fit the data, and at most ``ticks`` ticks on the ordinate."""
    axes.margins(x=0.0, y=0.06)
    if len(x) and x.min() < x.max():
        # A small margin, so that a recording of 59.999 s has a label at 60 s.
        low, high = float(x.min()), float(x.max())
        axes.set_xlim(low, high + 0.002 * (high - low))
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(ticks))
    formatter = ScalarFormatter(useOffset=False)
    axes.yaxis.set_major_formatter(formatter)


def add_stroke(figure: Figure, x: float, y: float, role: str) -> None:
    """Draw a short line in the style of a role, as in a legend."""
    figure.add_artist(
        Line2D(
            [x / WIDTH, (x + 12) / WIDTH],
            [y / HEIGHT] * 2,
            color=PALETTE[role],
            linewidth=LINE_WIDTH[role],
            solid_capstyle="butt" if role == "band" else "round",
        )
    )


def set_x_label(axes: Axes, text: str) -> None:
    """Label the abscissa."""
    # A dollar sign in a name must not start a formula.
    axes.set_xlabel(
        printable(text), fontsize=FONT_SIZE, color=PALETTE["muted"], labelpad=5, parse_math=False
    )


def add_text(
    figure: Figure, x: float, y: float, text: str, role: str, *, align: str = "left"
) -> None:
    """Add text at a place in pixels from the lower left, in the colour of a role."""
    figure.text(
        x / WIDTH,
        y / HEIGHT,
        printable(text),
        color=PALETTE[role],
        fontsize=FONT_SIZE,
        ha=align,
        va="baseline",
    )
