"""HTML of the page in which every text of others is plain text.

Names in a robot file or a bag, a folder's name, diagnostics and answers of services may hold
anything.  The page shows no Markdown, and no HTML but templates of this package: what is not
``Markup`` is escaped where it is handed to the browser.
"""

from __future__ import annotations

from collections.abc import Iterable

from markupsafe import Markup, escape

from cdrj_ros.foundation.text import printable


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
