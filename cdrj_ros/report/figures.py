"""Pictures of one channel: estimate on truth, error, hysteresis loop.

Truth is a thick grey line, the estimate a thin coloured one on top, with a band of two standard
deviations where those are known.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cdrj_ros.judgement.channels import QUANTITIES, Channel, quantity_of
from cdrj_ros.judgement.metrics import COVERAGE_SIGMAS
from cdrj_ros.judgement.reversals import envelope
from cdrj_ros.report.canvas import (
    BOTTOM,
    BUCKETS,
    HEIGHT,
    LEFT,
    PALETTE,
    RIGHT,
    TOP,
    WIDTH,
    Floats,
    add_axes,
    add_stroke,
    add_text,
    draw_line,
    new_figure,
    set_limits,
    set_x_label,
)
from cdrj_ros.report.numbers import decimals_for, format_number, scale_for
from cdrj_ros.report.series import Window, gaps, seconds_since

_ERROR_HEIGHT, _BETWEEN = 58, 32
"""Of the axes of the error, and between them and those of the series [px]."""

USUAL_BANDS: Final = 1.5
"""A band up to this many times its median has room around the series."""

BAND_IN_VIEW: Final = 4.0
"""A band up to this many times the largest error is shown whole below the series."""


def over_time(
    channel: Channel, origin_ns: int, *, window: Window | None = None, shade: Window | None = None
) -> Figure:
    """Estimate on truth over time, the error below it.

    Args:
        channel: at least one sample.
        origin_ns: stamp that is second 0 of the time axis [ns].
        window: the part to draw, everything by default; its reversal is marked.
        shade: a part to tint, for example the one another picture enlarges.
    """
    part = slice(0, len(channel.stamp_ns)) if window is None else slice(window.begin, window.end)
    stamps = channel.stamp_ns[part]
    time = seconds_since(stamps, origin_ns)
    factor, unit = _scale(channel)
    reference, estimate = factor * channel.reference[part], factor * channel.estimate[part]
    error = estimate - reference
    breaks = gaps(stamps)
    half = None if channel.stddev is None else COVERAGE_SIGMAS * factor * channel.stddev[part]
    if half is not None and not np.isfinite(half).any():
        half = None

    figure = new_figure()
    series_height = HEIGHT - TOP - BOTTOM - _ERROR_HEIGHT - _BETWEEN
    series = add_axes(figure, HEIGHT - TOP - series_height, series_height)
    errors = add_axes(figure, BOTTOM, _ERROR_HEIGHT)
    for axes in (series, errors):
        _mark(axes, channel, origin_ns, window, shade)
    if half is not None:
        _draw_band(series, time, estimate, half, breaks)
        _draw_band(errors, time, np.zeros_like(error), half, breaks)
    draw_line(series, time, reference, breaks, "truth")
    draw_line(series, time, estimate, breaks, "estimate")
    errors.axhline(0.0, color=PALETTE["truth"], linewidth=0.8, zorder=1)
    draw_line(errors, time, error, breaks, "error")

    worst = int(np.argmax(np.abs(error)))
    _dot(errors, time[worst], error[worst])
    set_limits(series, time, 5)
    if half is not None:
        _keep_in_view(series, (reference, estimate), half)
    set_limits(errors, time, 3)
    _symmetric(errors, error, half)
    series.tick_params(labelbottom=False)
    _key(figure, channel, unit, banded=half is not None)
    _name_error(figure, unit, float(error[worst]), float(time[worst]))
    set_x_label(errors, "time [s]")
    return figure


def _mark(
    axes: Axes, channel: Channel, origin_ns: int, window: Window | None, shade: Window | None
) -> None:
    """Tint the shaded part, and mark the reversal of the window."""
    if shade is not None:
        ends = seconds_since(channel.stamp_ns[[shade.begin, shade.end - 1]], origin_ns)
        axes.axvspan(float(ends[0]), float(ends[1]), color=PALETTE["shade"], linewidth=0, zorder=0)
    if window is not None and window.reversal is not None:
        turn = float(channel.stamp_ns[window.reversal] - origin_ns) * 1e-9
        axes.axvline(turn, color=PALETTE["muted"], linewidth=0.7, dashes=(3, 3), zorder=1)


def _dot(axes: Axes, x: float, y: float) -> None:
    """A dot: the round caps of a line of almost no length."""
    axes.plot(
        [x, x + 1e-9],
        [y, y],
        color=PALETTE["error"],
        linewidth=4.5,
        solid_capstyle="round",
        clip_on=False,
    )


def _name_error(figure: Figure, unit: str, largest: float, at_s: float) -> None:
    """Texts above the axes of the error."""
    size = format_number(largest, decimals_for(abs(largest)))
    above = BOTTOM + _ERROR_HEIGHT + 7
    add_text(figure, LEFT, above, f"error [{unit}]", "muted")
    text = f"largest {size} {unit} at {at_s:.2f} s"
    add_text(figure, WIDTH - RIGHT, above, text, "error", align="right")


def hysteresis(channel: Channel, window: Window) -> Figure:
    """Estimate on truth over the joint angle.

    Args:
        channel: its angle finite for at least one sample of the window.
        window: the samples to draw.
    """
    part = slice(window.begin, window.end)
    present = np.isfinite(channel.angle[part])
    angle = np.degrees(channel.angle[part][present])
    stamps = channel.stamp_ns[part][present]
    breaks = gaps(stamps)
    factor, unit = _scale(channel)

    figure = new_figure()
    axes = add_axes(figure, BOTTOM, HEIGHT - TOP - BOTTOM)
    for values, role in ((channel.reference, "truth"), (channel.estimate, "estimate")):
        draw_line(axes, angle, factor * values[part][present], breaks, role, loop=True)
    set_limits(axes, angle, 6)
    axes.margins(x=0.03)
    _key(figure, channel, unit)
    set_x_label(axes, f"{channel.angle_name} [°]")
    return figure


def _draw_band(
    axes: Axes, x: Floats, centre: Floats, half: Floats, breaks: NDArray[np.intp]
) -> None:
    """The band centre ± half, as wide as it gets anywhere in a bucket, broken at the gaps."""
    known = np.isfinite(half)
    low = np.where(known, centre - half, centre)
    high = np.where(known, centre + half, centre)
    kept = envelope(BUCKETS // 2, low, high)
    kept = np.union1d(kept, np.concatenate([breaks, breaks + 1]).astype(kept.dtype))
    shown = known[kept]
    at = np.searchsorted(kept, breaks, side="right")
    axes.fill_between(
        np.insert(x[kept], at, np.nan),
        np.insert(low[kept], at, np.nan),
        np.insert(high[kept], at, np.nan),
        where=np.insert(shown, at, values=False).tolist(),
        color=PALETTE["band"],
        linewidth=0,
        zorder=1.5,
    )


def _keep_in_view(axes: Axes, lines: Sequence[Floats], half: Floats) -> None:
    """Scale the axes to the usual band; a wide one, as at the start, is cut off."""
    low = min(float(line.min()) for line in lines)
    high = max(float(line.max()) for line in lines)
    usual = min(float(np.nanmax(half)), USUAL_BANDS * float(np.nanmedian(half)))
    room = max(high - low, usual, 1e-12)
    axes.set_ylim(low - usual - 0.06 * room, high + usual + 0.06 * room)


def _symmetric(axes: Axes, error: Floats, half: Floats | None = None) -> None:
    """Put zero in the middle of the axes; show the band unless it is wide."""
    largest = float(np.abs(error).max())
    if half is not None:
        usual = min(float(np.nanmax(half)), USUAL_BANDS * float(np.nanmedian(half)))
        largest = max(largest, min(usual, BAND_IN_VIEW * largest))
    if largest > 0.0:
        axes.set_ylim(-1.15 * largest, 1.15 * largest)


def _scale(channel: Channel) -> tuple[float, str]:
    """Factor and unit in which all of a channel's pictures are drawn."""
    return scale_for(float(np.abs(channel.reference).max()), channel.unit)


def _key(figure: Figure, channel: Channel, unit: str, *, banded: bool = False) -> None:
    """What is drawn, and the lines' names in the lines' colours instead of a legend."""
    base = HEIGHT - TOP + 11
    title = QUANTITIES[quantity_of(channel.name)].title.lower()
    add_text(figure, LEFT, base, f"{title} [{unit}]", "muted")
    right = WIDTH - RIGHT
    for start, name, line, ink in (
        (right - 153 - 30 * banded, "recorded", "truth", "muted"),
        (right - 77 - 30 * banded, f"estimated{' ±2σ' * banded}", "estimate", "estimate"),
    ):
        if banded and line == "estimate":
            add_stroke(figure, start, base + 3.5, "band")
        add_stroke(figure, start, base + 3.5, line)
        add_text(figure, start + 17, base, name, ink)
