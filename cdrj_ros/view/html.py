"""HTML of the page: texts of others as plain text, and the table of tensions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from markupsafe import Markup, escape

from cdrj_ros.foundation.output import printable
from cdrj_ros.model.prepared import Model
from cdrj_ros.model.state import INVALID
from cdrj_ros.report.live_table import SIGMAS, round_scale, status_words
from cdrj_ros.report.scene import Colour
from cdrj_ros.view.history import Snapshot
from cdrj_ros.view.picture import DrawnCable, Picture, cable_numbers


def filled(template: str, *texts: object) -> Markup:
    """A template of HTML with texts in place of every ``{}``, all but ``Markup`` as plain text."""
    return Markup(template).format(*map(plain, texts))


def plain(text: object) -> Markup:
    """A text as HTML that shows its characters; ``Markup`` remains as it is."""
    return text if isinstance(text, Markup) else escape(printable(text))


def paragraphs(texts: Iterable[object]) -> str:
    """HTML with one paragraph for each text, see ``plain``."""
    lines = Markup("").join(filled("<div>{}</div>", text) for text in texts)
    style = "padding:0 .8em;font-size:14px;line-height:1.55;overflow-wrap:anywhere"
    return str(filled(f"<div style='{style}'>{{}}</div>", lines))  # viser sends exact strings only


ROW: Final = (
    "<tr style='{weight}'><td style='white-space:nowrap;max-width:9em;overflow:hidden;"
    "text-overflow:ellipsis'>{name}</td>"
    "<td style='width:100%;padding:0 .5em'><div style='height:.6em;border-radius:.3em;"
    "background:rgba(128,128,128,.2);overflow:hidden'>"
    "<div style='height:100%;width:{share:.0f}%;background:{colour}'></div></div></td>"
    "<td style='text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap'>{value}</td>"
    "<td style='font-size:.8em;white-space:nowrap;padding-left:.5em'>{status}</td></tr>"
)
"""One element."""


def css(colour: Colour) -> str:
    """A colour for CSS."""
    return "rgb({},{},{})".format(*(round(255.0 * part) for part in colour))


def table_of(model: Model, shown: Snapshot, picture: Picture, chosen: str) -> str:
    """Name, bar up to the limit, tension ± 2σ and status of every element.

    Args:
        model: the prepared robot.
        shown: the values.
        picture: gives the colours.
        chosen: name of the element that is printed bold.
    """
    largest = np.nanmax(np.append(shown.tension, 0.0))
    limits = [
        cable.maximum_tension if np.isfinite(cable.maximum_tension) else round_scale(float(largest))
        for cable in model.robot.cables
    ]
    rows = [
        _row(look, shown, e, limits[c], look.name == chosen)
        for e, (look, c) in enumerate(
            zip(picture.cables, cable_numbers(model).tolist(), strict=True)
        )
    ]
    style = "width:100%;border-collapse:collapse;font-size:13px;line-height:1.55"
    return f"<div style='padding:0 .8em'><table style='{style}'>{''.join(rows)}</table></div>"


def _row(look: DrawnCable, shown: Snapshot, e: int, limit: float, chosen: bool) -> str:
    tension, stddev, status = float(shown.tension[e]), shown.stddev[e], int(shown.status[e])
    known = np.isfinite(tension) and not status & INVALID
    spread = f" ± {SIGMAS * stddev:.1f}" if np.isfinite(stddev) else ""
    return ROW.format(
        weight="font-weight:700;" if chosen else "",
        name=plain(look.name),
        share=100.0 * min(max(tension / limit, 0.0), 1.0) if known else 0.0,
        colour=css(look.colour),
        value=f"{tension:.1f}{spread} N" if known else "–",
        status=" ".join(word for word, _ in status_words(status)),
    )
