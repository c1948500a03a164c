"""Conversion of a matplotlib figure to inline SVG with the page's font and colours.

The SVG written by matplotlib sets its own fonts and colours, and most of its size is digits far
below a pixel.  Here, text is kept as text in the page's font, the colours of the palette are
replaced by the page's custom properties (so that pictures follow dark mode), and paths are rounded
to a tenth of a pixel.
"""

from __future__ import annotations

import io
import re
from typing import Final
from xml.etree import ElementTree

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from cdrj_ros.report.canvas import PALETTE

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
        "aria-label": label,
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
