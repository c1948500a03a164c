"""A recording on the page: its estimates, as many as a page can show, and the time line."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, isfinite
from time import monotonic
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.conditioner import Conditioned
from cdrj_ros.evaluation.channels import Angle
from cdrj_ros.evaluation.comparison import values_at
from cdrj_ros.evaluation.estimating import pieces_of
from cdrj_ros.evaluation.inputs import require_samples
from cdrj_ros.evaluation.validation import MAX_GAP_NS
from cdrj_ros.foundation.arrays import Series, Vector
from cdrj_ros.model.packing import TENSION
from cdrj_ros.model.prepared import Model
from cdrj_ros.recordings.recording import Recording
from cdrj_ros.view.history import Table
from cdrj_ros.view.page import Page
from cdrj_ros.view.panels import filled

MOST: Final = 20_000
"""Maximum number of pictures of a recording; of longer ones every n-th estimate is kept."""


def recorded_estimates(
    model: Model,
    recording: Recording,
    conditioned: Conditioned,
    progress: Callable[[float], None] | None = None,
) -> Table:
    """Estimate a recording as the validation does, and keep what is shown.

    Args:
        model: the prepared robot.
        recording: its references are shown beside the estimates.
        conditioned: the same recording, at most one segment.
        progress: called with the completed fraction, from 0 to 1.

    Raises:
        BagError: there is no sample.
    """
    require_samples(recording.path, model.robot, conditioned)
    (segment,) = conditioned.segments
    shown = segment.filled(model.robot)
    total = segment.stamp_ns.size
    every = 1 + total // MOST
    layout, parts, done = model.layout, list[Table](), 0
    for piece in pieces_of(model, segment, uncertainty=True):
        kept = slice((-done) % every, None, every)
        stamps, status = piece.stamp_ns[kept], piece.status[kept].astype(np.uint8)
        stddev, force = piece.tension_stddev, (piece.force_x, piece.force_y, piece.force_z)
        references = (recording.references.get(f"{TENSION}/{name}") for name in layout.elements)
        parts.append(
            Table(
                stamps,
                shown.joint_angle[done : done + piece.stamp_ns.size][kept],
                piece.tension[kept],
                np.full(status.shape, np.nan) if stddev is None else stddev[kept],
                np.column_stack([at_stamps(one, stamps) for one in references]),
                status,
                np.stack(force, axis=-1)[kept],
                piece.friction[kept],
                piece.slip_speed[kept],
                layout.pulley_status(status),
            )
        )
        done += piece.stamp_ns.size
        if progress:
            progress(done / total)
    return Table(*map(np.concatenate, zip(*parts, strict=True)))


def at_stamps(series: Series | None, stamps: NDArray[np.int64]) -> Vector:
    """A reference at given stamps, interpolated; NaN outside of it and in its gaps."""
    if series is None or not (fine := np.isfinite(series.value)).any():
        return np.full(stamps.size, np.nan)
    times, first = np.unique(series.stamp_ns[fine], return_index=True)
    return values_at(stamps, Angle("", times, series.value[fine][first]), MAX_GAP_NS)


RATES: Final = ("0.1", "0.25", "0.5", "1", "2", "5", "10")
"""Speeds of the playback, relative to the recording."""

TOUCH_S: Final = 0.2
"""Time after the slider was moved by hand during which it is not moved [s]."""


class Player:
    """Shows the pictures of a recording on a page."""

    def __init__(self, page: Page, estimates: Table, title: str) -> None:
        """Add the time line to the page.

        Args:
            page: where to show them.
            estimates: what to show.
            title: of the recording.
        """
        self.page, self.estimates, self.title = page, estimates, title
        self.time_s = 0.0
        """Time of the picture since the first one [s]."""
        self.playing = True
        self._before_s = monotonic()
        self._touched_s = 0.0
        self._drawn: tuple[Any, ...] = ()
        self._behind = True
        """Whether table and curves have not been updated since the picture changed."""
        gui = page.gui
        digits = 2 if estimates.duration_s >= 10.0 else 3  # more do not fit beside the slider
        self._end_s = max(ceil(estimates.duration_s * 10**digits), 1) / 10**digits
        with page.above:
            self._slider = gui.add_slider("time [s]", 0.0, self._end_s, 10.0**-digits, 0.0)
            self._button = gui.add_button("pause")
            self._rate = gui.add_dropdown("rate", RATES, initial_value="1")
        page.above.visible = True
        self._slider.on_update(self._on_slider)
        self._button.on_click(lambda _: self.play(not self.playing))

    def play(self, wanted: bool) -> None:
        """Play or pause; at the end, start again."""
        if wanted and self.time_s >= self.estimates.duration_s:
            self.time_s = 0.0
        self.playing = wanted
        self._button.label = "pause" if wanted else "play"

    def _on_slider(self, event: Any) -> None:
        wanted = float(self._slider.value)
        if event.client is not None and isfinite(wanted):  # moved by hand
            self._touched_s = monotonic()
            self.time_s = min(max(wanted, 0.0), self.estimates.duration_s)

    def tick(self) -> None:
        """Advance by the time since the last call, and draw if a browser shows the page."""
        now_s = monotonic()
        passed, self._before_s = now_s - self._before_s, now_s
        if not self.page.watched:
            return
        if self.playing and self._rate.value in RATES:
            self.time_s = min(
                self.time_s + passed * float(self._rate.value), self.estimates.duration_s
            )
            if self.time_s >= self.estimates.duration_s:
                self.play(False)
        if now_s - self._touched_s > TOUCH_S:
            self._slider.value = min(self.time_s, self._end_s)
        shown = self.estimates.at(self.time_s)
        state = (shown.stamp_ns, self.page.chosen, self.page.settings())
        if state != self._drawn:
            self._drawn, self._behind = state, True
        if not self._behind:
            return
        self._behind = not self.page.plot_is_due()
        words = (
            filled("<b>{}</b>", self.title),
            f"{self.time_s:.2f} s of {self.estimates.duration_s:.2f} s",
        )
        self.page.show(shown, self.estimates, words, shown.stamp_ns)
