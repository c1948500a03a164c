"""Pictures of one channel as inline SVG: estimate and truth over time with the error, and a loop.

The truth is a thick grey line and the estimate a thin coloured line on top of it, with a band of
two standard deviations where these are known. Lines are drawn through the smallest and largest
sample of every pixel column: no peak is lost, and a picture does not grow with the recording.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import matplotlib
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cdrj_ros.evaluation.channels import QUANTITIES, Channel, quantity_of
from cdrj_ros.evaluation.metrics import COVERAGE_SIGMAS, envelope, turning_points
from cdrj_ros.foundation.arrays import Floats, Stamps
from cdrj_ros.foundation.output import format_amount, printable, scale_for

COLOURS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "truth": "#b9b9b5",
        "estimate": "#0072b2",
        "error": "#c94f00",
        "muted": "#62625d",
        "rule": "#e4e4df",
        "shade": "#f1f0ea",
        "band": "#c5dff0",
    }
)
"""Colours by role, variables of the page's style sheet with these values; blue and vermilion (Okabe
and Ito) differ for colour-blind readers too."""

WIDTH, HEIGHT = 390, 300
"""Size of a picture [px]: three fit side by side on a desktop screen and one fills a phone."""

FONT_SIZE: Final = 11.0
"""Size of all text in a picture [px]."""

BUCKETS: Final = 200
"""Number of buckets of a drawn line; each keeps its smallest and its largest sample."""

GAP_STEPS: Final = 5.0
"""A line is broken where two stamps are further apart than this many median steps ..."""

GAP_SHARE: Final = 0.005
"""... and further apart than this share of the drawn time, so that the gap is visible."""

LEAST_ROOM: Final = 0.25
"""Share of the largest value that a band may be wide; where the lines vary by more, as much as they
vary."""

USUAL_BANDS: Final = 1.5
"""Largest width of the band that the axes show, in multiples of its median width."""

LINE_WIDTH: Final = {"truth": 3.4, "estimate": 1.1, "error": 0.8}
"""Line widths by role [px]."""

SERIES: Final = (0.128, 0.427, 0.851, 0.486)
ERRORS: Final = (0.128, 0.127, 0.851, 0.193)
LOOP: Final = (0.128, 0.127, 0.851, 0.786)
"""Left, bottom, width and height of axes, in shares of the picture."""


BAND: Final = f"±{COVERAGE_SIGMAS:g}σ"
"""Name of the band."""


class Picture(NamedTuple):
    """One figure of the page."""

    svg: Markup
    caption: str


def channel_pictures(
    channel: Channel, key: str, origin_ns: int, label: str, *, closer: bool
) -> list[Picture]:
    """Pictures of one channel.

    Args:
        channel: at least one sample.
        key: identifier that is unique on the page.
        origin_ns: stamp at 0 s of the time axes [ns].
        label: of the channel for screen readers.
        closer: whether to draw it also around its largest error, and over its angle.
    """
    worst = around_largest_error(channel)
    time = _seconds(channel, origin_ns)
    span = f"{time[worst][0]:.1f} to {time[worst][-1]:.1f} s"
    if not closer or worst == slice(0, len(channel.stamp_ns)):
        made = [(over_time(channel, origin_ns), "over time", "Whole recording.")]
    else:
        whole = over_time(channel, origin_ns, tinted=worst)
        near = over_time(channel, origin_ns, worst)
        made = [
            (whole, "over time", "Whole recording; the grey part is enlarged."),
            (near, f"over time, {span}", "Around the largest error."),
        ]
    if closer and not channel.is_vector and np.isfinite(channel.angle[worst]).any():
        moved = "position" if channel.angle_unit == "m" else "angle"
        over = f"over the {moved} of {channel.angle_name}"
        made.append((hysteresis(channel, worst), over, f"O{over[1:]}, {span}."))
    return [
        Picture(inline_svg(figure, f"{label}: recorded and estimated {what}", f"{key}-{k}"), text)
        for k, (figure, what, text) in enumerate(made)
    ]


def around_largest_error(channel: Channel) -> slice:
    """Samples from the second reversal before to the second one after the largest error.

    The whole channel where it does not reverse that often.
    """
    turns = turning_points(channel.angle)
    after = int(np.searchsorted(turns, int(np.argmax(channel.error_size))))
    if len(turns) < 4:
        return slice(0, len(channel.stamp_ns))
    begin = min(max(after - 2, 0), len(turns) - 4)
    return slice(int(turns[begin]), int(turns[begin + 3]) + 1)


def over_time(
    channel: Channel, origin_ns: int, part: slice = slice(None), tinted: slice | None = None
) -> Figure:
    """Draw estimate and truth over time, with the error below, of vectors its length.

    Args:
        channel: at least one sample.
        origin_ns: stamp at 0 s of the time axis [ns].
        part: the samples to draw.
        tinted: samples whose time is tinted, such as those enlarged in another picture.
    """
    factor, unit = _scale(channel)
    time, stamps = _seconds(channel, origin_ns)[part], channel.stamp_ns[part]
    reference, estimate = factor * channel.reference[part], factor * channel.estimate[part]
    error = factor * channel.error_size[part] if channel.is_vector else estimate - reference
    figure = _new_figure()
    series, errors = _add_axes(figure, SERIES), _add_axes(figure, ERRORS)
    if tinted is not None:
        begin, *_, end = _seconds(channel, origin_ns)[tinted].tolist() * 2
        for axes in (series, errors):
            axes.axvspan(begin, end, color=COLOURS["shade"], linewidth=0, zorder=0)
    for values, role in ((reference, "truth"), (estimate, "estimate")):
        for component in values.reshape(len(values), -1).T:
            _draw_line(series, time, component, stamps, role)
    errors.axhline(0.0, color=COLOURS["truth"], linewidth=0.8, zorder=1)
    _draw_line(errors, time, error, stamps, "error")
    largest = int(np.argmax(np.abs(error)))
    errors.plot(time[largest], error[largest], ".", color=COLOURS["error"], clip_on=False)
    if channel.stddev is not None and not channel.is_vector:
        half = np.nan_to_num(COVERAGE_SIGMAS * factor * channel.stddev[part])
        room = max(float(np.ptp(series.get_ylim())), LEAST_ROOM * float(np.abs(estimate).max()))
        _draw_band(series, time, estimate, half, room)
        _draw_band(errors, time, np.zeros_like(error), half, room)
    series.set_xticks([])
    for axes, ticks in ((series, 5), (errors, 3)):
        axes.yaxis.set_major_locator(MaxNLocator(ticks))
    _dress(series, channel, unit)
    size = format_amount(float(channel.error_size[part][largest]), channel.unit)
    _title(errors, f"error [{unit}]", "left", "muted")
    _title(errors, f"largest {size} at {time[largest]:.2f} s", "right", "error")
    errors.set_xlabel("time [s]", fontsize=FONT_SIZE, color=COLOURS["muted"])
    return figure


def hysteresis(channel: Channel, part: slice) -> Figure:
    """Draw estimate and truth over the angle.

    Args:
        channel: with a finite angle in at least one sample of the part.
        part: the samples to draw.
    """
    present = np.isfinite(channel.angle[part])
    slides = channel.angle_unit == "m"
    angle = (1e3 if slides else np.degrees(1.0)) * channel.angle[part][present]
    factor, unit = _scale(channel)
    figure = _new_figure()
    axes = _add_axes(figure, LOOP)
    for values, role in ((channel.reference, "truth"), (channel.estimate, "estimate")):
        stamps = channel.stamp_ns[part][present]
        _draw_line(axes, angle, factor * values[part][present], stamps, role)
    axes.margins(x=0.03)
    _dress(axes, channel, unit)
    name = f"{printable(channel.angle_name)} [{'mm' if slides else '°'}]"
    axes.set_xlabel(name, fontsize=FONT_SIZE, color=COLOURS["muted"], parse_math=False)
    return figure


def _new_figure() -> Figure:
    figure = Figure(figsize=(WIDTH / 72.0, HEIGHT / 72.0), dpi=72.0)
    figure.patch.set_visible(False)
    return figure


def _add_axes(figure: Figure, box: tuple[float, float, float, float]) -> Axes:
    """Axes with a light horizontal grid and labels without tick marks."""
    axes = figure.add_axes(box)
    axes.patch.set_visible(False)
    axes.spines[["left", "right", "top"]].set_visible(False)
    axes.spines["bottom"].set(color=COLOURS["truth"], linewidth=0.8)
    axes.tick_params(length=0, pad=5, labelsize=FONT_SIZE, labelcolor=COLOURS["muted"])
    axes.ticklabel_format(useOffset=False)
    axes.grid(axis="y", color=COLOURS["rule"], linewidth=0.8)
    axes.set_axisbelow(True)
    axes.margins(x=0.0, y=0.06)
    return axes


def _dress(axes: Axes, channel: Channel, unit: str) -> None:
    """Add the title, and the names of both lines and of the band in their colours."""
    title = QUANTITIES[quantity_of(channel.name)].title.lower()
    _title(axes, f"{title} [{unit}]", "left", "muted")
    lines = axes.get_lines()[:: max(len(axes.get_lines()) // 2, 1)][:2]
    bands = [one for one in axes.collections if one.get_label() == BAND]
    axes.legend(
        [*lines, *bands], ("recorded", "estimated", BAND)[: 2 + len(bands)],
        loc="lower right", bbox_to_anchor=(1.02, 0.97), ncols=3, frameon=False,
        fontsize=FONT_SIZE, handlelength=1.0, columnspacing=1.0, labelcolor=COLOURS["muted"],
    )  # fmt: skip


def _title(axes: Axes, text: str, where: str, role: str) -> None:
    axes.set_title(text, loc=where, y=1.0, fontsize=FONT_SIZE, color=COLOURS[role], pad=7)  # type: ignore[arg-type]


def _draw_line(axes: Axes, x: Floats, y: Floats, stamp_ns: Stamps, role: str) -> None:
    """Draw a line through the envelope of the samples, broken at gaps."""
    steps = np.diff(stamp_ns, append=stamp_ns[-1:])
    least = max(GAP_STEPS * float(np.median(steps)), GAP_SHARE * float(np.ptp(stamp_ns)))
    gaps = np.flatnonzero(steps > least)
    drawn = (y,) if np.all(x[1:] > x[:-1]) else (x, y)  # of a loop, both have peaks
    kept = np.union1d(envelope(BUCKETS, *drawn), np.concatenate([gaps, gaps + 1]))
    at = np.searchsorted(kept, gaps, side="right")
    axes.plot(
        np.insert(x[kept], at, np.nan), np.insert(y[kept], at, np.nan), color=COLOURS[role],
        linewidth=LINE_WIDTH[role], solid_joinstyle="round", solid_capstyle="round", clip_on=False,
        zorder=2 if role == "truth" else 3,
    )  # fmt: skip


def _draw_band(axes: Axes, x: Floats, centre: Floats, half: Floats, room: float) -> None:
    """Draw the band centre ± half, and limit the axes to its usual width, at most ``room``."""
    low, high = axes.get_ylim()
    usual = min(float(half.max()), USUAL_BANDS * float(np.median(half)), room)
    kept = envelope(BUCKETS // 2, centre - half, centre + half)
    edges = (centre - half)[kept], (centre + half)[kept]
    axes.fill_between(x[kept], *edges, color=COLOURS["band"], linewidth=0, zorder=1.5, label=BAND)
    axes.set_ylim(min(low, float(centre.min()) - usual), max(high, float(centre.max()) + usual))


def _scale(channel: Channel) -> tuple[float, str]:
    """Factor and unit of all pictures of a channel."""
    return scale_for(float(np.abs(channel.reference).max()), channel.unit)


def _seconds(channel: Channel, origin_ns: int) -> Floats:
    """Stamps in seconds after an origin, subtracted as integers before conversion to float."""
    return (channel.stamp_ns - origin_ns).astype(np.float64) * 1e-9


_METADATA: Final = dict.fromkeys(("Creator", "Date", "Format", "Type"))
_REPLACED: Final = (
    (r".*?<svg[^>]*>", ""),  # declarations, and attributes that the page gives
    (r"<metadata>.*?</metadata>|<defs>\s*<style.*?</defs>", ""),
    (r'<g id="[^"]*"', "<g"),  # equal in all pictures
    (r"xlink:href", "href"),
    (r"font: ([\d.]+px)[^;\"]*", r"font-size: \1"),
    (r"font-family: [^;\"]*;?", ""),
    (r"<g/>\s*|(?<=\d) ?\n?L(?= )", ""),  # a step without a letter is a line
    (r"\s*\n\s*", " "),
)
_PATH: Final = re.compile(r' d="[^"]*"')


def inline_svg(figure: Figure, label: str, key: str) -> Markup:
    """The figure as an ``<svg>`` element for an HTML page, without any outside reference.

    Args:
        figure: of any size.
        label: description of the picture for screen readers.
        key: identifier unique on the page, from which the ids in the picture are derived.
    """
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": key}):
        figure.savefig(stream, format="svg", metadata=_METADATA)
    svg = stream.getvalue()
    for pattern, text in _REPLACED:
        svg = re.sub(pattern, text, svg, count=pattern.startswith(".*"), flags=re.DOTALL)
    for role, colour in COLOURS.items():
        svg = svg.replace(colour, f"var(--{role})")
    svg = _PATH.sub(lambda path: re.sub(r"(\.\d)\d+", r"\1", path[0]), svg)
    width, height = (round(72.0 * float(inches)) for inches in figure.get_size_inches())
    box = f'class="picture" viewBox="0 0 {width} {height}" role="img"'
    return Markup('<svg {} aria-label="{}">{}').format(
        Markup(box), escape(printable(label)), Markup(svg)
    )
