"""A matplotlib figure as SVG that belongs to its page: the page's font, the page's colours.

What matplotlib writes names fonts, colours, dates and addresses of its own and spends most of its
bytes on digits nobody sees.  Here texts stay text in the page's font, the palette's colours become
the page's custom properties (so that a dark page has dark pictures), paths keep a tenth of a pixel.
"""

from __future__ import annotations

import io
import re
from html import escape
from typing import Final

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from cdrj_ros.report.figures import PALETTE

_BODY: Final = re.compile(r"<svg[^>]*>(.*)</svg>", re.DOTALL)
_NOISE: Final = re.compile(
    r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->|<defs>\s*</defs>", re.DOTALL
)
_GROUP_ID: Final = re.compile(r'<g id="[^"]*"')
_FONT: Final = re.compile(r"font: (?:[a-z]+ |\d+ )*([\d.]+)px [^;\"]*")
_FONT_FAMILY: Final = re.compile(r"font-family: [^;\"]*;? ?")
_NO_ROTATION: Final = re.compile(r' transform="rotate\(-?0 [^)]*\)"')
_SPACE: Final = re.compile(r">\s+<")
_EMPTY: Final = re.compile(r"<g>\s*</g>|<defs>\s*</defs>")
_STRAIGHT: Final = re.compile(r"M[ML\d\s.e+-]+z?\s*")
_ATTRIBUTE: Final = re.compile(r' (d|x|y|width|height)="([^"]*)"')
_LONG_NUMBER: Final = re.compile(r"-?\d+\.\d{2,}")
_COLOURS: Final = {colour: f"var(--{role})" for role, colour in PALETTE.items()}
_COLOUR: Final = re.compile("|".join(_COLOURS))


def inline_svg(figure: Figure, label: str, key: str) -> str:
    """The figure as an ``<svg>`` element for an HTML page, without any outside reference.

    Args:
        figure: of WIDTH by HEIGHT pixels, or any other size.
        label: what it shows, in words, for readers who cannot see it.
        key: unique on the page; ids inside the picture are made from it.
    """
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": key}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    body = _BODY.search(stream.getvalue())
    if body is None:
        raise ValueError("matplotlib wrote no svg element")
    text = _NOISE.sub("", body.group(1))
    text = _GROUP_ID.sub("<g", text)
    text = _FONT.sub(r"font-size:\1px", text)
    text = _FONT_FAMILY.sub("", text)
    text = _NO_ROTATION.sub("", text)
    text = _ATTRIBUTE.sub(lambda match: f' {match[1]}="{_compact(match[2])}"', text)
    text = _COLOUR.sub(lambda match: _COLOURS[match[0]], text)
    text = _SPACE.sub("><", text)
    while (shorter := _EMPTY.sub("", text)) != text:
        text = shorter
    width, height = (round(72.0 * float(inches)) for inches in figure.get_size_inches())
    return (
        f'<svg class="picture" viewBox="0 0 {width} {height}" role="img" '
        f'aria-label="{escape(label)}">{text.strip()}</svg>'
    )


def _compact(path: str) -> str:
    """A path of straight lines in relative steps, anything else as it is, to a tenth of a pixel."""
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
        # A line without length still has to be there: round caps make a dot of it.
        steps = steps[moving] if moving.any() else steps[:1]
        start = f"M{_number(int(points[0, 0]))} {_number(int(points[0, 1]))}"
        pieces.append(start + (f"l{_joined(steps.ravel().tolist())}" if len(steps) else ""))
    return "".join(pieces) + ("z" if closed else "")


def _joined(tenths: list[int]) -> str:
    """Numbers with a separator only where a minus does not separate them already."""
    return " ".join(map(_number, tenths)).replace(" -", "-")


def _number(tenths: int) -> str:
    """A number of tenths in the fewest characters: "12.3", ".4", "-.4", "5"."""
    sign = "-" if tenths < 0 else ""
    whole, tenth = divmod(abs(tenths), 10)
    if tenth == 0:
        return f"{sign}{whole}"
    return f"{sign}{whole or ''}.{tenth}"
