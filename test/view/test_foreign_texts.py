"""Texts of others reach the page as plain text, through whichever door they come."""

from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest
from support.browser import chromium
from support.html import Html, shown

from cdrj_ros.model.prepared import load_model
from cdrj_ros.view.history import Curves, nothing_known
from cdrj_ros.view.page import Page
from cdrj_ros.view.panels import Controls, Plots, TimeAxis, table_of
from cdrj_ros.view.picture import picture_of
from cdrj_ros.view.recorded import Player

PAYLOADS = (
    "<script>ran()</script>",
    "<iframe srcdoc='<script>parent.ran()</script>'></iframe>",
    '<iframe src="javascript:parent.ran()"></iframe>',
    "<img src=x onerror=ran()>",
    "<svg onload=ran()>",
    "<svg><script>ran()</script></svg>",
    "<math><mtext></p><img src=x onerror=ran()>",
    "<details open ontoggle=ran()>x</details>",
    "<style>@import 'http://192.0.2.1/';</style>",
    "<link rel=stylesheet href=http://192.0.2.1/>",
    "<meta http-equiv=refresh content='0;url=http://192.0.2.1/'>",
    "<base href=http://192.0.2.1/>",
    "<form action=http://192.0.2.1/><button>x</button></form>",
    "<object data='data:text/html,<script>parent.ran()</script>'></object>",
    "</div></td></table><b onclick=ran()>x",
    "<!--><img src=x onerror=ran()>-->",
    "&lt;img src=x onerror=ran()&gt;&#60;b&#62;",
    "[x](javascript:ran()) ![x](http://192.0.2.1/) http://192.0.2.1/ `{ran()}` **x**",
    "{0.__class__} {} {texts[0]} %s",
    "'\" onmouseover=ran() \x1b[31m\u202e\x00</b>",
)
TAGS = {"div", "b", "small", "table", "tr", "td", "style"}
"""All that the page's own HTML consists of."""


NOTED = []
"""HTML that has been added to a page."""


def read(handles):
    assert all(type(one.content) is str for one in handles), "viser cannot send others"
    return Html("".join(one.content for one in handles))


@pytest.fixture(scope="module")
def page():
    """A page without Markdown, whose HTML is noted."""
    viser = pytest.importorskip("viser")
    add = viser.GuiApi.add_html

    def noted(gui, content):
        NOTED.append(add(gui, content))
        return NOTED[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(viser.GuiApi, "add_html", noted)
        patch.setattr(viser.GuiApi, "add_markdown", None)
        one = Page(load_model("finger"), "localhost", 0, "title", TimeAxis("t", 0.0, 1.0))
        yield one
    one.close()


@pytest.fixture(scope="module")
def own(page):
    """The HTML of the page alone."""
    return list(NOTED)


def assert_plain(read, payload):
    assert read.tags <= TAGS
    assert read.attributes <= {"style"}
    assert shown(payload) in read.text


@pytest.mark.parametrize("payload", PAYLOADS)
def test_every_door_of_the_page_shows_a_payload_as_its_characters(page, own, payload):
    nothing = nothing_known(page.model)
    player = Player(MagicMock(watched=True), MagicMock(duration_s=1.0), payload)
    player.page.gui.add_slider.return_value.max = 1.0
    player.page.gui.add_dropdown.return_value.value = "1"
    player.tick()
    (_, _, words, _), _ = player.page.show.call_args
    for texts in ((payload,), words):
        page.show(nothing, None, texts)
        assert_plain(read(own), payload)
    NOTED.clear()
    Controls(page.server.gui, (), lambda *_: None, {}).answer(payload)
    assert_plain(read(NOTED), payload)
    NOTED.clear()
    column = np.zeros(3)
    Plots(page.server.gui, TimeAxis("t", 0.0, 1.0)).show(
        Curves(payload, payload, np.arange(3.0), *[column] * 5), None
    )
    assert read(NOTED).text.count(shown(payload)) == 2
    assert read(NOTED).tags <= TAGS
    picture = picture_of(page.model, nothing)
    odd = replace(picture, cables=(picture.cables[0]._replace(name=payload), *picture.cables[1:]))
    assert_plain(Html(table_of(page.model, nothing, odd, payload)), payload)


def test_no_payload_runs_in_a_browser(page, tmp_path):
    with chromium(tmp_path, 1100, 620) as browser:
        browser.get(page.address)
        words = [f"{k}: {payload}" for k, payload in enumerate(PAYLOADS)]
        browser.execute_script("window.count = 0; window.ran = () => { window.count += 1; };")
        page.show(nothing_known(page.model), None, words)
        wait = "const done = arguments[arguments.length - 1]; const look = () => "
        wait += "document.body.innerText.includes('19: ') ? setTimeout(done, 500, window.count) "
        wait += ": setTimeout(look, 50); look();"
        assert browser.execute_async_script(wait) == 0
        text = browser.execute_script("return document.body.innerText")
        for payload in PAYLOADS:
            assert shown(payload) in text
