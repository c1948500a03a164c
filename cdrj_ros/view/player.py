"""The time line of a recording: play, pause, rate, and a slider."""

from __future__ import annotations

from math import ceil
from time import monotonic
from typing import Any, Final

from cdrj_ros.view.film import Film
from cdrj_ros.view.markup import filled
from cdrj_ros.view.page import Page

RATES: Final = ("0.1", "0.25", "0.5", "1", "2", "5", "10")
"""Speeds of the playback, relative to the recording."""

TOUCH_S: Final = 0.2
"""Time after the slider was moved by hand during which it is not moved [s]."""


class Player:
    """Shows the pictures of a film on a page."""

    def __init__(self, page: Page, film: Film, title: str) -> None:
        """Add the time line to the page.

        Args:
            page: where to show the film.
            film: what to show.
            title: of the recording.
        """
        self.page, self.film, self.title = page, film, title
        self.time_s = 0.0
        """Time of the picture since the first one [s]."""
        self.playing = True
        self._before_s = monotonic()
        self._touched_s = 0.0
        self._drawn: tuple[Any, ...] = ()
        self._behind = True
        """Whether table and curves have not been updated since the picture changed."""
        gui = page.gui
        digits = 2 if film.duration_s >= 10.0 else 3  # more do not fit beside the slider
        end = max(ceil(film.duration_s * 10**digits), 1) / 10**digits
        with page.above:
            self._slider = gui.add_slider("time [s]", 0.0, end, 10.0**-digits, 0.0)
            self._button = gui.add_button("pause")
            self._rate = gui.add_dropdown("rate", RATES, initial_value="1")
        page.above.visible = True
        self._slider.on_update(self._on_slider)
        self._button.on_click(lambda _: self.play(not self.playing))

    def play(self, wanted: bool) -> None:
        """Play or pause; at the end, start again."""
        if wanted and self.time_s >= self.film.duration_s:
            self.time_s = 0.0
        self.playing = wanted
        self._button.label = "pause" if wanted else "play"

    def _on_slider(self, event: Any) -> None:
        if event.client is not None:  # moved by hand
            self._touched_s = monotonic()
            self.time_s = min(float(self._slider.value), self.film.duration_s)

    def tick(self) -> None:
        """Advance by the time since the last call, and draw if a browser shows the page."""
        now_s = monotonic()
        passed, self._before_s = now_s - self._before_s, now_s
        if not self.page.watched:
            return
        if self.playing:
            self.time_s = min(self.time_s + passed * float(self._rate.value), self.film.duration_s)
            if self.time_s >= self.film.duration_s:
                self.play(False)
        if now_s - self._touched_s > TOUCH_S:
            self._slider.value = min(self.time_s, self._slider.max)
        shown = self.film.at(self.time_s)
        state = (shown.stamp_ns, self.page.chosen, self.page.settings())
        if state != self._drawn:
            self._drawn, self._behind = state, True
        if not self._behind:
            return
        self._behind = not self.page.plot_is_due()
        words = (
            filled("<b>{}</b>", self.title),
            f"{self.time_s:.2f} s of {self.film.duration_s:.2f} s",
        )
        self.page.show(shown, self.film.table, words, shown.stamp_ns)
