"""Common elements of the pictures of a report: colours, sizes, axes, lines and texts.

All pictures have the same size, so that three fit side by side on a desktop screen and one fills a
phone.  One unit of a drawing is one CSS pixel.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, TypeAlias
from xml.etree import ElementTree

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from numpy.typing import NDArray

from cdrj_ros.evaluation.reversals import envelope
from cdrj_ros.foundation.text import printable

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
        parse_math=False,
    )


Place: TypeAlias = "tuple[float, float]"
"""Bottom and height of axes [px]."""


class Sheets:
    """The figures of one report; a picture is valid until the next one with the same axes."""

    def __init__(self) -> None:
        """Begin without figures."""
        self._figures: dict[tuple[Place, ...], Figure] = {}

    def blank(self, *places: Place) -> tuple[Figure, list[Axes]]:
        """A figure with empty axes at these places, from bottom and height [px]."""
        figure = self._figures.get(places)
        if figure is None:
            figure = self._figures[places] = new_figure()
            for bottom, height in places:
                add_axes(figure, bottom, height)
        else:
            _clear(figure)
        return figure, figure.axes


def _clear(figure: Figure) -> None:
    """Remove what was drawn, and let the limits follow what will be."""
    for artist in (*figure.texts, *figure.artists):
        artist.remove()
    for axes in figure.axes:
        for artist in (*axes.lines, *axes.collections, *axes.patches, *axes.texts):
            artist.remove()
        axes.relim()
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        axes.autoscale()


_NO_METADATA: Final = dict.fromkeys(("Creator", "Date", "Format", "Type"))
_NAMESPACE: Final = "{http://www.w3.org/2000/svg}"
_LINK: Final = "{http://www.w3.org/1999/xlink}href"
_DROPPED: Final = ("metadata", "style")
"""Elements that are redundant in the page."""
_EMPTY: Final = ("g", "defs")
"""Elements without effect if they are empty."""
_MEASURED: Final = ("d", "x", "y", "width", "height")
"""Attributes with lengths in pixels."""
_COLOURS: Final = {colour: f"var(--{role})" for role, colour in PALETTE.items()}
_FONT_SIZE: Final = re.compile(r"([\d.]+)px")
_STRAIGHT: Final = re.compile(r"M[ML\d\s.e+-]+z?\s*")
_LONG_NUMBER: Final = re.compile(r"-?\d+\.\d{2,}")


def inline_svg(figure: Figure, label: str, key: str) -> str:
    """The figure as an ``<svg>`` element for an HTML page, without any outside reference.

    Args:
        figure: of WIDTH by HEIGHT pixels, or any other size.
        label: description of the picture for screen readers.
        key: identifier unique on the page, from which the ids in the picture are derived.
    """
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": key}):
        figure.savefig(stream, format="svg", metadata=_NO_METADATA)
    root = ElementTree.fromstring(stream.getvalue())
    _simplify(root)
    width, height = (round(72.0 * float(inches)) for inches in figure.get_size_inches())
    root.attrib = {
        "class": "picture",
        "viewBox": f"0 0 {width} {height}",
        "role": "img",
        "aria-label": printable(label),
    }
    return ElementTree.tostring(root, encoding="unicode")


def _simplify(element: ElementTree.Element) -> None:
    """Remove redundant and empty elements, and round coordinates."""
    element.tag = element.tag.removeprefix(_NAMESPACE)
    _simplify_attributes(element)
    for child in list(element):
        _simplify(child)
        if child.tag in _DROPPED or (child.tag in _EMPTY and not len(child)):
            element.remove(child)
    if element.tag != "text":
        element.text = None
    for child in element:
        child.tail = None


def _simplify_attributes(element: ElementTree.Element) -> None:
    if element.tag == "g":
        element.attrib.pop("id", None)
    if "style" in element.attrib:
        element.set("style", _style(element.attrib["style"]))
    if element.get("transform", "").startswith(("rotate(-0 ", "rotate(0 ")):
        del element.attrib["transform"]
    if _LINK in element.attrib:
        element.set("href", element.attrib.pop(_LINK))
    for name in _MEASURED:
        if name in element.attrib:
            element.set(name, _compact(element.attrib[name]))


def _style(text: str) -> str:
    """Replace a style's colours by those of the page and reduce its font to the size."""
    kept = []
    for declaration in text.split(";"):
        name, _, value = (part.strip() for part in declaration.partition(":"))
        if name == "font" and (size := _FONT_SIZE.search(value)):
            name, value = "font-size", size[0]
        if name and name != "font-family":
            kept.append(f"{name}: {_COLOURS.get(value, value)}")
    return "; ".join(kept)


def _compact(path: str) -> str:
    """Round to a tenth of a pixel; paths of straight lines are rewritten in relative steps."""
    if not _STRAIGHT.fullmatch(path):
        return _LONG_NUMBER.sub(lambda match: _number(round(10.0 * float(match[0]))), path)
    closed = path.rstrip().endswith("z")
    pieces = []
    for piece in path.rstrip().rstrip("z").split("M"):
        numbers = piece.replace("L", " ").split()
        if not numbers:
            continue
        points = np.rint(10.0 * np.array(numbers, dtype=np.float64)).astype(np.int64)
        points = points.reshape(-1, 2)
        steps = np.diff(points, axis=0)
        moving = steps.any(axis=1)
        # A line without length is kept, because its round caps draw a dot.
        steps = steps[moving] if moving.any() else steps[:1]
        start = f"M{_number(int(points[0, 0]))} {_number(int(points[0, 1]))}"
        pieces.append(start + (f"l{_joined(steps.ravel().tolist())}" if len(steps) else ""))
    return "".join(pieces) + ("z" if closed else "")


def _joined(tenths: list[int]) -> str:
    """Join numbers, with a space only before numbers without a minus sign."""
    return " ".join(map(_number, tenths)).replace(" -", "-")


def _number(tenths: int) -> str:
    """A number of tenths in the fewest characters: "12.3", ".4", "-.4", "5"."""
    sign = "-" if tenths < 0 else ""
    whole, tenth = divmod(abs(tenths), 10)
    if tenth == 0:
        return f"{sign}{whole}"
    return f"{sign}{whole or ''}.{tenth}"
