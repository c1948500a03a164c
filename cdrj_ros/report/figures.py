"""Figures of one channel: estimate and truth, error, hysteresis loop.

The truth is drawn as a thick grey line and the estimate as a thin coloured line on top of it, with
a band of two standard deviations where these are known.  Vectors are drawn by component, with the
angle between truth and estimate as their error.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from cdrj_ros.evaluation.channels import QUANTITIES, Channel, quantity_of
from cdrj_ros.evaluation.metrics import COVERAGE_SIGMAS, direction_error_deg
from cdrj_ros.evaluation.pulley_friction import PulleyFriction
from cdrj_ros.evaluation.reversals import envelope
from cdrj_ros.foundation.text import printable
from cdrj_ros.report.canvas import (
    BOTTOM,
    BUCKETS,
    FONT_SIZE,
    HEIGHT,
    LEFT,
    PALETTE,
    RIGHT,
    TOP,
    WIDTH,
    Floats,
    Place,
    Sheets,
    add_axes,
    add_stroke,
    add_text,
    draw_line,
    new_figure,
    set_limits,
    set_x_label,
)
from cdrj_ros.report.pictures import Window, gaps, seconds_since
from cdrj_ros.report.table import decimals_for, format_angle, format_number, scale_for

_ERROR_HEIGHT, _BETWEEN = 58, 32
"""Height of the error axes, and the gap between them and the axes of the series [px]."""

_SERIES_HEIGHT = HEIGHT - TOP - BOTTOM - _ERROR_HEIGHT - _BETWEEN

_SERIES: Final[Place] = (HEIGHT - TOP - _SERIES_HEIGHT, _SERIES_HEIGHT)
_ERRORS: Final[Place] = (BOTTOM, _ERROR_HEIGHT)
_LOOP: Final[Place] = (BOTTOM, HEIGHT - TOP - BOTTOM)

USUAL_BANDS: Final = 1.5
"""Largest width of the band that the axes show, in multiples of its median width."""

BAND_IN_VIEW: Final = 4.0
"""Largest band that the error axes show, in multiples of the largest error."""


def over_time(
    channel: Channel,
    origin_ns: int,
    *,
    window: Window | None = None,
    shade: Window | None = None,
    sheets: Sheets | None = None,
) -> Figure:
    """Draw estimate and truth over time, with the error below, of vectors that of the direction.

    Args:
        channel: at least one sample.
        origin_ns: stamp at 0 s of the time axis [ns].
        window: the part to draw, by default everything; its reversal is marked.
        shade: a part to tint, for example the part enlarged in another figure.
        sheets: figures to draw on, whose earlier pictures are no longer needed.
    """
    drawn = _drawn(channel, origin_ns, window)
    figure, (series, errors) = (sheets or Sheets()).blank(_SERIES, _ERRORS)
    for axes in (series, errors):
        _mark(axes, channel, origin_ns, window, shade)
    _draw_series(series, drawn)
    if channel.is_vector:
        _draw_direction(figure, errors, drawn)
    else:
        worst = _draw_error(errors, drawn)
        size, at_s = float(drawn.error[worst]), float(drawn.time[worst])
        largest = f"{format_number(size, decimals_for(abs(size)))} {drawn.unit}"
        _name_error(figure, f"error [{drawn.unit}]", f"largest {largest} at {at_s:.2f} s")
    series.tick_params(labelbottom=False)
    _key(figure, channel, drawn.unit, banded=drawn.half is not None)
    set_x_label(errors, "time [s]")
    return figure


@dataclass(frozen=True)
class _Drawn:
    """The drawn part of a channel, in the unit of its picture."""

    time: Floats
    """[s], shape (n,)."""
    stamp_ns: NDArray[np.int64]
    """[ns], shape (n,)."""
    reference: Floats
    """Shape (n,), of vectors (n, 3)."""
    estimate: Floats
    """Of the shape of ``reference``."""
    half: Floats | None
    """Half width of the band, shape (n,); None if no sample has a standard deviation."""
    breaks: NDArray[np.intp]
    """Samples after which the lines are broken."""
    unit: str
    direction: Floats
    """Angle between estimate and truth [°], NaN where there is none, shape (n,)."""

    @property
    def error(self) -> Floats:
        """Estimate less reference, of their shape."""
        return self.estimate - self.reference


def _drawn(channel: Channel, origin_ns: int, window: Window | None) -> _Drawn:
    part = slice(0, len(channel.stamp_ns)) if window is None else slice(window.begin, window.end)
    stamps = channel.stamp_ns[part]
    factor, unit = _scale(channel)
    half = None if channel.stddev is None else COVERAGE_SIGMAS * factor * channel.stddev[part]
    if half is not None and not np.isfinite(half).any():
        half = None
    return _Drawn(
        seconds_since(stamps, origin_ns),
        stamps,
        factor * channel.reference[part],
        factor * channel.estimate[part],
        half,
        gaps(stamps),
        unit,
        _direction(channel)[part],
    )


def _direction(channel: Channel) -> Floats:
    """Direction error of the whole channel [°], NaN where it has no direction, shape (n,)."""
    if channel.is_vector:
        return direction_error_deg(channel.estimate, channel.reference)
    return np.full(len(channel.stamp_ns), np.nan)


def _draw_series(axes: Axes, drawn: _Drawn) -> None:
    """Draw truth, estimate and band."""
    if drawn.half is not None:
        _draw_band(axes, drawn.time, drawn.estimate, drawn.half, drawn.breaks)
    for values, role in ((drawn.reference, "truth"), (drawn.estimate, "estimate")):
        for component in values.reshape(len(values), -1).T:
            draw_line(axes, drawn.time, component, drawn.breaks, role)
    set_limits(axes, drawn.time, 5)
    if drawn.reference.ndim == 2:
        _name_components(axes, drawn)
    if drawn.half is not None:
        _keep_in_view(axes, (drawn.reference, drawn.estimate), drawn.half)


def _draw_error(axes: Axes, drawn: _Drawn) -> int:
    """Draw error and band about zero, with a dot at the largest error; returns its index."""
    error = drawn.error
    if drawn.half is not None:
        _draw_band(axes, drawn.time, np.zeros_like(error), drawn.half, drawn.breaks)
    axes.axhline(0.0, color=PALETTE["truth"], linewidth=0.8, zorder=1)
    draw_line(axes, drawn.time, error, drawn.breaks, "error")
    worst = int(np.argmax(np.abs(error)))
    _dot(axes, drawn.time[worst], error[worst])
    set_limits(axes, drawn.time, 3)
    _symmetric(axes, error, drawn.half)
    return worst


def _name_components(axes: Axes, drawn: _Drawn) -> None:
    """Write x, y and z above their lines, side by side, as lines may coincide."""
    for k, name in enumerate("xyz"):
        share = 0.90 + 0.04 * k
        at = int(share * (len(drawn.time) - 1))
        above = max(float(drawn.reference[at, k]), float(drawn.estimate[at, k]))
        axes.annotate(
            name, (float(drawn.time[at]), above), xytext=(0, 6), textcoords="offset pixels",
            ha="center", fontsize=FONT_SIZE, color=PALETTE["ink"],
        )  # fmt: skip


def _draw_direction(figure: Figure, axes: Axes, drawn: _Drawn) -> None:
    """Draw the angle between estimate and truth, with a dot at the largest."""
    angle = drawn.direction
    known = np.isfinite(angle)
    if not known.any():
        _name_error(figure, "direction error [°]", "no direction")
        set_limits(axes, drawn.time, 3)
        return
    time, angle = drawn.time[known], angle[known]
    draw_line(axes, time, angle, gaps(drawn.stamp_ns[known]), "error")
    worst = int(np.argmax(angle))
    _dot(axes, time[worst], angle[worst])
    set_limits(axes, drawn.time, 3)
    axes.set_ylim(0.0, max(1.15 * float(angle[worst]), 1e-3))
    largest = f"largest {format_angle(float(angle[worst]))} at {time[worst]:.2f} s"
    _name_error(figure, "direction error [°]", largest)


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
    """Draw a dot, as a line of almost no length with round caps."""
    axes.plot(
        [x, x + 1e-9],
        [y, y],
        color=PALETTE["error"],
        linewidth=4.5,
        solid_capstyle="round",
        clip_on=False,
    )


def _name_error(figure: Figure, name: str, largest: str) -> None:
    """Add the texts above the error axes."""
    above = BOTTOM + _ERROR_HEIGHT + 7
    add_text(figure, LEFT, above, name, "muted")
    add_text(figure, WIDTH - RIGHT, above, largest, "error", align="right")


def hysteresis(channel: Channel, window: Window, *, sheets: Sheets | None = None) -> Figure:
    """Draw estimate and truth over the joint angle.

    Args:
        channel: with a finite angle in at least one sample of the window.
        window: the samples to draw.
        sheets: figures to draw on, whose earlier pictures are no longer needed.
    """
    part = slice(window.begin, window.end)
    present = np.isfinite(channel.angle[part])
    sliding = channel.angle_unit == "m"
    angle = (1e3 if sliding else np.degrees(1.0)) * channel.angle[part][present]
    stamps = channel.stamp_ns[part][present]
    breaks = gaps(stamps)
    factor, unit = _scale(channel)

    figure, (axes,) = (sheets or Sheets()).blank(_LOOP)
    for values, role in ((channel.reference, "truth"), (channel.estimate, "estimate")):
        draw_line(axes, angle, factor * values[part][present], breaks, role, loop=True)
    set_limits(axes, angle, 6)
    axes.margins(x=0.03)
    _key(figure, channel, unit)
    set_x_label(axes, f"{channel.angle_name} [{'mm' if sliding else '°'}]")
    return figure


def _draw_band(
    axes: Axes, x: Floats, centre: Floats, half: Floats, breaks: NDArray[np.intp]
) -> None:
    """Draw the band centre ± half through the envelope of its edges, broken at gaps."""
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
    """Scale the axes to the typical width of the band; wider parts are clipped."""
    low = min(float(line.min()) for line in lines)
    high = max(float(line.max()) for line in lines)
    usual = min(float(np.nanmax(half)), USUAL_BANDS * float(np.nanmedian(half)))
    room = max(high - low, usual, 1e-12)
    axes.set_ylim(low - usual - 0.06 * room, high + usual + 0.06 * room)


def _symmetric(axes: Axes, error: Floats, half: Floats | None = None) -> None:
    """Centre the axes on zero and include the band unless it is wide."""
    largest = float(np.abs(error).max())
    if half is not None:
        usual = min(float(np.nanmax(half)), USUAL_BANDS * float(np.nanmedian(half)))
        largest = max(largest, min(usual, BAND_IN_VIEW * largest))
    if largest > 0.0:
        axes.set_ylim(-1.15 * largest, 1.15 * largest)


def _scale(channel: Channel) -> tuple[float, str]:
    """Factor and unit of all figures of a channel."""
    return scale_for(float(np.abs(channel.reference).max()), channel.unit)


def _key(figure: Figure, channel: Channel, unit: str, *, banded: bool = False) -> None:
    """Add title and unit, and the names of the lines in their colours instead of a legend."""
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
