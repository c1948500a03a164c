"""Figures of the friction at pulleys: its share of the tension, and its loop.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cdrj_ros.foundation.text import printable
from cdrj_ros.judgement.pulley_friction import PulleyFriction
from cdrj_ros.report.canvas import (
    BOTTOM,
    HEIGHT,
    LEFT,
    PALETTE,
    RIGHT,
    TOP,
    WIDTH,
    add_axes,
    add_stroke,
    add_text,
    draw_line,
    new_figure,
    set_limits,
    set_x_label,
)
from cdrj_ros.report.numbers import scale_for

MOST_BARS: Final = 24
"""Largest number of bars that fit in a figure."""

MOST_CABLES: Final = 8
"""Largest number of cables whose names fit below their bars."""


def friction_bars(pulleys: Sequence[PulleyFriction]) -> Figure:
    """Draw friction as a share of the tension: a bar for the mean, a mark at the largest value.

    Args:
        pulleys: at least one, at most MOST_BARS; named "cable/node".
    """
    figure = new_figure()
    below = BOTTOM + 14
    axes = add_axes(figure, below, HEIGHT - TOP - below)
    cables = list(dict.fromkeys(one.name.rpartition("/")[0] for one in pulleys))
    place = [k + 0.9 * cables.index(one.name.rpartition("/")[0]) for k, one in enumerate(pulleys)]
    mean = [100.0 * one.mean_share for one in pulleys]
    most = [100.0 * one.largest_share for one in pulleys]
    axes.bar(place, mean, width=0.62, color=PALETTE["estimate"], linewidth=0)
    axes.vlines(place, mean, most, color=PALETTE["truth"], linewidth=1.2, zorder=2)
    axes.hlines(
        most,
        [x - 0.31 for x in place],
        [x + 0.31 for x in place],
        color=PALETTE["error"],
        linewidth=2.0,
        zorder=3,
    )
    axes.set_xlim(place[0] - 0.7, place[-1] + 0.7)
    axes.set_ylim(0.0, 1.08 * max(*most, 1e-6))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.set_xticks(
        place, [printable(one.name.rpartition("/")[2]) for one in pulleys], parse_math=False
    )
    span = WIDTH - LEFT - RIGHT
    for cable in cables:
        own = [x for x, one in zip(place, pulleys, strict=True) if one.name.startswith(f"{cable}/")]
        middle = 0.5 * (own[0] + own[-1])
        share = (middle - place[0] + 0.7) / (place[-1] - place[0] + 1.4)
        if len(cables) <= MOST_CABLES:
            add_text(figure, LEFT + span * share, 18, cable, "muted", align="center")
    base = HEIGHT - TOP + 11
    add_text(figure, LEFT, base, "share of the tension [%]", "muted")
    right = WIDTH - RIGHT
    for start, name, line in ((right - 112, "mean", "estimate"), (right - 58, "largest", "error")):
        add_stroke(figure, start, base + 3.5, line)
        add_text(figure, start + 17, base, name, line)
    return figure


def friction_loop(one: PulleyFriction) -> Figure:
    """Draw the friction at one pulley over the length of cable that has passed it.

    Args:
        one: the pulley, whose loop has at least one sample.
    """
    if one.passed is None or one.friction is None:
        raise ValueError(f"{one.name} has no loop")
    figure = new_figure()
    axes = add_axes(figure, BOTTOM, HEIGHT - TOP - BOTTOM)
    x, y = 1e3 * one.passed, one.friction
    factor, unit = scale_for(float(np.abs(y).max()), "N")
    draw_line(axes, x, factor * y, np.arange(0), "estimate", loop=True)
    set_limits(axes, x, 6)
    axes.margins(x=0.03)
    add_text(figure, LEFT, HEIGHT - TOP + 11, f"friction at {one.name} [{unit}]", "muted")
    set_x_label(axes, "cable passed [mm]")
    return figure
