"""Pictures of one channel: estimate on truth, error, hysteresis loop.

Every picture has one size, so that three stand beside each other on a desk and one fills a phone;
one unit of the drawing is one CSS pixel.  Truth is a thick grey line, the estimate a thin coloured
one on top, with a band of two standard deviations where those are known.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from numpy.typing import NDArray

from cdrj_ros.foundation.text import printable
from cdrj_ros.judgement.channels import QUANTITIES, Channel, quantity_of
from cdrj_ros.judgement.metrics import COVERAGE_SIGMAS
from cdrj_ros.judgement.pulley_friction import PulleyFriction
from cdrj_ros.judgement.reversals import envelope
from cdrj_ros.report.numbers import decimals_for, format_number, scale_for
from cdrj_ros.report.series import Window, gaps, seconds_since

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
"""Colours by role; blue and vermilion (Okabe and Ito) differ for colour-blind readers, too."""

WIDTH: Final = 390
"""Width of a picture [px]."""

HEIGHT: Final = 300
"""Height of a picture [px]."""

MOST_BARS: Final = 24
"""Pulleys that fit side by side."""

MOST_CABLES: Final = 8
"""Cables whose names fit below their bars."""

FONT_SIZE: Final = 11.0
"""Size of all text in a picture [px]."""

BUCKETS: Final = 320
"""Buckets of a drawn series: about one for each pixel of its axes."""

_LEFT, _RIGHT, _TOP, _BOTTOM = 50, 8, 26, 38
_ERROR_HEIGHT, _BETWEEN = 58, 32
_LINE_WIDTH: Final = {"truth": 3.4, "estimate": 1.1, "error": 0.8, "band": 8.0}

USUAL_BANDS: Final = 1.5
"""A band up to this many times its median has room around the series."""

BAND_IN_VIEW: Final = 4.0
"""A band up to this many times the largest error is shown whole below the series."""

Floats = NDArray[np.float64]


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

    figure = _figure()
    series_height = HEIGHT - _TOP - _BOTTOM - _ERROR_HEIGHT - _BETWEEN
    series = _axes(figure, HEIGHT - _TOP - series_height, series_height)
    errors = _axes(figure, _BOTTOM, _ERROR_HEIGHT)
    for axes in (series, errors):
        if shade is not None:
            ends = seconds_since(channel.stamp_ns[[shade.begin, shade.end - 1]], origin_ns)
            axes.axvspan(
                float(ends[0]), float(ends[1]), color=PALETTE["shade"], linewidth=0, zorder=0
            )
        if window is not None and window.reversal is not None:
            turn = float(channel.stamp_ns[window.reversal] - origin_ns) * 1e-9
            axes.axvline(turn, color=PALETTE["muted"], linewidth=0.7, dashes=(3, 3), zorder=1)
    if half is not None:
        _draw_band(series, time, estimate, half, breaks)
        _draw_band(errors, time, np.zeros_like(error), half, breaks)
    _draw(series, time, reference, breaks, "truth")
    _draw(series, time, estimate, breaks, "estimate")
    errors.axhline(0.0, color=PALETTE["truth"], linewidth=0.8, zorder=1)
    _draw(errors, time, error, breaks, "error")

    worst = int(np.argmax(np.abs(error)))
    errors.plot(
        [time[worst], time[worst] + 1e-9],
        [error[worst]] * 2,
        color=PALETTE["error"],
        linewidth=4.5,
        solid_capstyle="round",
        clip_on=False,
    )
    _limits(series, time, 5)
    if half is not None:
        _keep_in_view(series, (reference, estimate), half)
    _limits(errors, time, 3)
    _symmetric(errors, error, half)
    series.tick_params(labelbottom=False)
    _key(figure, channel, unit, banded=half is not None)
    size = format_number(float(error[worst]), decimals_for(abs(float(error[worst]))))
    above_error = _BOTTOM + _ERROR_HEIGHT + 7
    _text(figure, _LEFT, above_error, f"error [{unit}]", "muted")
    _text(
        figure,
        WIDTH - _RIGHT,
        above_error,
        f"largest {size} {unit} at {time[worst]:.2f} s",
        "error",
        align="right",
    )
    _x_label(errors, "time [s]")
    return figure


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

    figure = _figure()
    axes = _axes(figure, _BOTTOM, HEIGHT - _TOP - _BOTTOM)
    for values, role in ((channel.reference, "truth"), (channel.estimate, "estimate")):
        _draw(axes, angle, factor * values[part][present], breaks, role, loop=True)
    _limits(axes, angle, 6)
    axes.margins(x=0.03)
    _key(figure, channel, unit)
    _x_label(axes, f"{channel.angle_name} [°]")
    return figure


def friction_bars(pulleys: Sequence[PulleyFriction]) -> Figure:
    """Share of the tension that each pulley's friction holds: bars to the mean, a mark at most.

    Args:
        pulleys: at least one, at most MOST_BARS; named "cable/node".
    """
    figure = _figure()
    below = _BOTTOM + 14
    axes = _axes(figure, below, HEIGHT - _TOP - below)
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
    span = WIDTH - _LEFT - _RIGHT
    for cable in cables:
        own = [x for x, one in zip(place, pulleys, strict=True) if one.name.startswith(f"{cable}/")]
        middle = 0.5 * (own[0] + own[-1])
        share = (middle - place[0] + 0.7) / (place[-1] - place[0] + 1.4)
        if len(cables) <= MOST_CABLES:
            _text(figure, _LEFT + span * share, 18, cable, "muted", align="center")
    base = HEIGHT - _TOP + 11
    _text(figure, _LEFT, base, "share of the tension [%]", "muted")
    right = WIDTH - _RIGHT
    for start, name, line in ((right - 112, "mean", "estimate"), (right - 58, "largest", "error")):
        _stroke(figure, start, base + 3.5, line)
        _text(figure, start + 17, base, name, line)
    return figure


def friction_loop(one: PulleyFriction) -> Figure:
    """Friction at one pulley over the material that has passed it.

    Args:
        one: with its loop, at least one sample.
    """
    if one.passed is None or one.friction is None:
        raise ValueError(f"{one.name} has no loop")
    figure = _figure()
    axes = _axes(figure, _BOTTOM, HEIGHT - _TOP - _BOTTOM)
    x, y = 1e3 * one.passed, one.friction
    factor, unit = scale_for(float(np.abs(y).max()), "N")
    _draw(axes, x, factor * y, np.arange(0), "estimate", loop=True)
    _limits(axes, x, 6)
    axes.margins(x=0.03)
    _text(figure, _LEFT, HEIGHT - _TOP + 11, f"friction at {one.name} [{unit}]", "muted")
    _x_label(axes, "cable passed [mm]")
    return figure


def _figure() -> Figure:
    figure = Figure(figsize=(WIDTH / 72.0, HEIGHT / 72.0), dpi=72.0)
    figure.patch.set_visible(False)
    return figure


def _axes(figure: Figure, bottom: float, height: float) -> Axes:
    """Axes in pixels: no frame, a light horizontal grid, labels without tick marks."""
    axes = figure.add_axes(
        (
            _LEFT / WIDTH,
            bottom / HEIGHT,
            (WIDTH - _LEFT - _RIGHT) / WIDTH,
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


def _draw(
    axes: Axes, x: Floats, y: Floats, breaks: NDArray[np.intp], role: str, *, loop: bool = False
) -> None:
    """A line of a role through the envelope of the samples, broken at the gaps."""
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
        linewidth=_LINE_WIDTH[role],
        solid_joinstyle="round",
        solid_capstyle="round",
        clip_on=False,
        zorder={"truth": 2, "estimate": 3, "error": 3}[role],
    )


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


def _limits(axes: Axes, x: Floats, ticks: int) -> None:
    axes.margins(x=0.0, y=0.06)
    if len(x) and x.min() < x.max():
        # A little more, so that a recording of 59.999 s has its label at 60.
        low, high = float(x.min()), float(x.max())
        axes.set_xlim(low, high + 0.002 * (high - low))
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(ticks))
    formatter = ScalarFormatter(useOffset=False)
    axes.yaxis.set_major_formatter(formatter)


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
    base = HEIGHT - _TOP + 11
    title = QUANTITIES[quantity_of(channel.name)].title.lower()
    _text(figure, _LEFT, base, f"{title} [{unit}]", "muted")
    right = WIDTH - _RIGHT
    for start, name, line, ink in (
        (right - 153 - 30 * banded, "recorded", "truth", "muted"),
        (right - 77 - 30 * banded, f"estimated{' ±2σ' * banded}", "estimate", "estimate"),
    ):
        if banded and line == "estimate":
            _stroke(figure, start, base + 3.5, "band")
        _stroke(figure, start, base + 3.5, line)
        _text(figure, start + 17, base, name, ink)


def _stroke(figure: Figure, x: float, y: float, role: str) -> None:
    """A short sample of a role's line."""
    figure.add_artist(
        Line2D(
            [x / WIDTH, (x + 12) / WIDTH],
            [y / HEIGHT] * 2,
            color=PALETTE[role],
            linewidth=_LINE_WIDTH[role],
            solid_capstyle="butt" if role == "band" else "round",
        )
    )


def _x_label(axes: Axes, text: str) -> None:
    # A name may hold a dollar sign: it is no formula.
    axes.set_xlabel(
        printable(text), fontsize=FONT_SIZE, color=PALETTE["muted"], labelpad=5, parse_math=False
    )


def _text(figure: Figure, x: float, y: float, text: str, role: str, *, align: str = "left") -> None:
    figure.text(
        x / WIDTH,
        y / HEIGHT,
        printable(text),
        color=PALETTE[role],
        fontsize=FONT_SIZE,
        ha=align,
        va="baseline",
    )
