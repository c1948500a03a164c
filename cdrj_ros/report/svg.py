"""A matplotlib figure as SVG that belongs to its page: the page's font, the page's colours.

What matplotlib writes names fonts and colours of its own and spends most of its bytes on digits
nobody sees.  Here texts stay text in the page's font, the palette's colours become the page's
custom properties (so that a dark page has dark pictures), paths keep a tenth of a pixel.
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
"""Elements that the page has itself."""
_EMPTY: Final = ("g", "defs")
"""Elements that mean nothing without content."""
_MEASURED: Final = ("d", "x", "y", "width", "height")
"""Attributes that hold pixels."""
_COLOURS: Final = {colour: f"var(--{role})" for role, colour in PALETTE.items()}
_FONT_SIZE: Final = re.compile(r"([\d.]+)px")
_STRAIGHT: Final = re.compile(r"M[ML\d\s.e+-]+z?\s*")
_LONG_NUMBER: Final = re.compile(r"-?\d+\.\d{2,}")


def inline_svg(figure: Figure, label: str, key: str) -> str:
    """The figure as an ``<svg>`` element for an HTML page, without any outside reference.

    Args:
        figure: of WIDTH by HEIGHT pixels, or any other size.
        label: what it shows, in words, for readers who cannot see it.
        key: unique on the page; ids inside the picture are made from it.
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
    """Drop what the page has itself, what is empty, and digits that nobody sees."""
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
    """A style with the page's colours and font: of the font, only the size is kept."""
    kept = []
    for declaration in text.split(";"):
        name, _, value = (part.strip() for part in declaration.partition(":"))
        if name == "font" and (size := _FONT_SIZE.search(value)):
            name, value = "font-size", size[0]
        if name and name != "font-family":
            kept.append(f"{name}: {_COLOURS.get(value, value)}")
    return "; ".join(kept)


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
