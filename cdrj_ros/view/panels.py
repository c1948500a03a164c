"""Panels of the page: curves over time, controls of an estimator, tensions and texts of others."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any, Final, NamedTuple

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from cdrj_ros.foundation.output import printable
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import Model
from cdrj_ros.report.status import SIGMAS, round_scale, severity, status_words
from cdrj_ros.view.drawing import rgb
from cdrj_ros.view.history import Curves, Snapshot
from cdrj_ros.view.picture import DrawnCable, Picture, tension_words

TENSION: Final = "#2f9e44"
BAND: Final = "rgba(47, 158, 68, 0.25)"
REFERENCE: Final = "#ae3ec9"
FRICTION: Final = "#e8590c"
SLIP: Final = "#1c7ed6"
NOW: Final = "#e03131"

HEIGHT: Final = 190
"""Height of a plot [px]."""

POINTS: Final = 900
"""Maximum number of points of a curve; more are not visible."""

SETTLED_S: Final = 2.0
"""Time after which a browser has laid out a plot that has appeared [s]."""

MOST_LINES: Final = 40
"""Elements that the table shows on one screen."""

MARGIN: Final = 0.08
"""Space above and below the curves, as a share of their range."""


class TimeAxis(NamedTuple):
    """Of plots over time."""

    label: str
    start_s: float
    """[s]."""
    end_s: float
    """[s], more than ``start_s``."""


class Plots:
    """Three plots, of which those without values are hidden."""

    def __init__(self, gui: Any, axis: TimeAxis) -> None:
        """Add the plots where ``gui`` stands.

        Args:
            gui: of a viser server.
            axis: of all plots.
        """
        self._build_s = math.inf
        self._words = gui.add_html("")
        line: dict[str, Any] = {"width": 2, "points": {"show": False}}
        hidden: dict[str, Any] = {"stroke": "transparent", "width": 0, "points": {"show": False}}
        time = {"label": "t"}
        now = {"label": "now", "stroke": NOW, "width": 0, "points": {"show": True, "size": 8}}
        self._tension = self._plot(
            gui, axis, "tension [N]",
            (
                time,
                {"label": "+2σ", **hidden},
                {"label": "-2σ", **hidden},
                {"label": "tension", "stroke": TENSION, **line},
                {"label": "reference", "stroke": REFERENCE, **line, "dash": (5, 5)},
                now,
            ),
            bands=({"series": (1, 2), "fill": BAND},),
        )  # fmt: skip
        self._friction = self._plot(
            gui, axis, "friction [N]",
            (time, {"label": "friction", "stroke": FRICTION, **line}, now),
        )  # fmt: skip
        self._slip = self._plot(
            gui, axis, "slip [mm/s]",
            (time, {"label": "slip speed", "stroke": SLIP, **line}, now),
        )  # fmt: skip

    def _plot(
        self, gui: Any, time: TimeAxis, label: str, series: tuple[dict[str, Any], ...], **more: Any
    ) -> Any:
        # Without a range, viser 1.1 shows another part of the time if data come before the first
        # drawing.
        axis: dict[str, Any] = {"labelSize": 18, "labelGap": 0, "size": 52}
        range_s = (time.start_s, time.end_s)
        nothing = np.full(2, np.nan)
        return gui.add_uplot(
            (np.array(range_s), *(nothing for _ in series[1:])), series, height=HEIGHT,
            scales={"x": {"time": False, "range": range_s}, "y": {"range": (0.0, 1.0)}},
            axes=({**axis, "label": time.label, "size": 28}, {**axis, "label": label}),
            legend={"show": False}, visible=False, padding=(8, 12, 0, 0), **more,
        )  # fmt: skip

    def appear(self) -> None:
        """Build the plots again as soon as a browser has laid them out.

        A plot of viser 1.1 has no axis of time if its width and new data arrive at once.
        """
        self._build_s = monotonic() + SETTLED_S

    def show(self, curves: Curves, now_s: float | None) -> None:
        """Draw curves.

        Args:
            curves: what to draw.
            now_s: time that is marked by a point [s]; None for none.
        """
        thin = slice(None, None, 1 + len(curves.time_s) // POINTS)
        kept = Curves(curves.element, curves.pulley, *(column[thin] for column in curves[2:]))
        if len(kept.time_s) < 2:
            self._words.content = paragraphs(["Waiting for values."])
            self._set_visible(False, False)
            return
        self._set_visible(True, bool(kept.pulley))
        at = None if now_s is None else int(np.argmin(np.abs(kept.time_s - now_s)))
        t, spread = kept.time_s, SIGMAS * kept.stddev
        compared = " · dashed: reference" if np.isfinite(kept.reference).any() else ""
        beside = (
            filled(" · friction and slip at pulley <b>{}</b>", kept.pulley) if kept.pulley else ""
        )
        words = filled("Element <b>{}</b> ± 2σ{}{}", kept.element, compared, beside)
        self._words.content = paragraphs([words])
        _show(self._tension, (
            t, kept.tension + spread, kept.tension - spread, kept.tension, kept.reference,
            _point(kept.tension, at),
        ))  # fmt: skip
        if kept.pulley:
            _show(self._friction, (t, kept.friction, _point(kept.friction, at)))
            slip = 1e3 * kept.slip_speed
            _show(self._slip, (t, slip, _point(slip, at)))
        if monotonic() > self._build_s:
            self._build_s = math.inf
            for plot in (self._tension, self._friction, self._slip):
                low, high = plot.scales["y"]["range"]
                _set_height(plot, low, high + 1e-6 * (high - low))  # viser builds it anew

    def _set_visible(self, tension: bool, pulley: bool) -> None:
        """Show the plots that have values."""
        if (self._tension.visible, self._slip.visible) != (tension, pulley):
            self._tension.visible = tension
            self._friction.visible = self._slip.visible = pulley
            self.appear()


def _show(plot: Any, data: tuple[NDArray[np.float64], ...]) -> None:
    """Set the curves and, if they leave it or fill little of it, the range of the axis.

    uPlot determines no range from values of which some are NaN.
    """
    plot.data = data
    values = np.concatenate(data[1:])
    values = values[np.isfinite(values)]
    if values.size:
        low, high = float(values.min()), float(values.max())
        before = plot.scales["y"]["range"]
        height = before[1] - before[0]
        if not (before[0] <= low and high <= before[1] and high - low > 0.3 * height):
            room = max(MARGIN * (high - low), 0.02 * abs(high), 0.1)
            if (low - room, high + room) != before:
                _set_height(plot, low - room, high + room)


def _set_height(plot: Any, low: float, high: float) -> None:
    """Set the range of the axis of values."""
    plot.scales = {**plot.scales, "y": {"range": (low, high)}}


def _point(values: NDArray[np.float64], at: int | None) -> NDArray[np.float64]:
    """A curve of one point."""
    point = np.full(len(values), np.nan)
    if at is not None:
        point[at] = values[at]
    return point


HELD_S: Final = 1.5
"""Time after a change by hand during which a slider does not follow the value in force [s]."""

STEPS: Final = 200
"""Approximate number of positions of a slider, whose steps are round."""


@dataclass(frozen=True)
class SliderRange:
    """A number that a slider sets."""

    name: str
    """Of the parameter."""
    label: str
    description: str
    unit: str
    low: float
    high: float
    start: float


class Controls:
    """Sliders and buttons in a folder of the page."""

    def __init__(
        self,
        gui: Any,
        ranges: Sequence[SliderRange],
        on_change: Callable[[str, float], None],
        buttons: Mapping[str, tuple[str, Callable[[], None]]],
    ) -> None:
        """Add the controls where ``gui`` stands.

        Args:
            gui: of a viser server.
            ranges: what the sliders set.
            on_change: called with a slider's name and value, in a thread of the server.
            buttons: label, and explanation and function of every button.
        """
        self._on_change = on_change
        self._ranges = {limits.name: limits for limits in ranges}
        self._touched = dict.fromkeys(self._ranges, -HELD_S)
        self._buttons = []
        for label, (hint, press) in buttons.items():
            button = gui.add_button(label, hint=hint)
            button.on_click(lambda _, press=press: press())
            self._buttons.append(button)
        self._answer = gui.add_html("")
        self._sliders = {limits.name: self._slider(gui, limits) for limits in ranges}
        self.enable(False)

    def _slider(self, gui: Any, limits: SliderRange) -> Any:
        step = float(f"{(limits.high - limits.low) / STEPS:.1g}")
        label = printable(limits.label) + (limits.unit and f" [{limits.unit}]")
        slider = gui.add_slider(
            label, limits.low, limits.high, step, short(limits.start, limits),
            hint=limits.description,
        )  # fmt: skip

        @slider.on_update  # type: ignore[untyped-decorator]
        def _(event: Any) -> None:
            if event.client is not None:  # not set by this program
                self._touched[limits.name] = monotonic()
                self._on_change(limits.name, float(slider.value))

        return slider

    def enable(self, able: bool) -> None:
        """Enable or disable everything."""
        for one in (*self._buttons, *self._sliders.values()):
            one.disabled = not able

    def answer(self, words: str) -> None:
        """Show the estimator's answer, see ``plain``."""
        self._answer.content = paragraphs([words] if words else [])

    def release(self, name: str) -> None:
        """Let a slider return to the value in force, because a change was refused."""
        self._touched[name] = -HELD_S

    def in_force(self, values: Mapping[str, float]) -> None:
        """Show the values in force."""
        for name, value in values.items():
            slider, shown = self._sliders[name], short(value, self._ranges[name])
            if monotonic() - self._touched[name] > HELD_S and slider.value != shown:
                slider.value = shown


def short(value: float, limits: SliderRange) -> float:
    """A value within a slider's range, with the characters that its number box has room for: 5."""
    return min(max(round(float(f"{value:.3g}"), 3), limits.low), limits.high)


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
    "<tr style='{weight}'><td style='white-space:nowrap;max-width:130px;overflow:hidden;"
    "text-overflow:ellipsis;font-size:{size:.2f}em'>{name}</td>"
    "<td style='width:100%;padding:0 .5em'><div style='height:.6em;border-radius:.3em;"
    "background:rgba(128,128,128,.2);overflow:hidden'>"
    "<div style='height:100%;width:{share:.0f}%;background:{colour}'></div></div></td>"
    "<td style='text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap'>{value}</td>"
    "<td style='font-size:.8em;white-space:nowrap;padding-left:.5em'>{status}</td></tr>"
)
"""One element."""

WHOLE_NAME: Final = 16
"""Characters of a name that fit into its column; longer names are smaller,"""

SMALLEST: Final = 0.7
"""down to this share of the size of the others."""


def table_of(model: Model, shown: Snapshot, picture: Picture, chosen: str) -> str:
    """Name, bar up to the limit, tension ± 2σ and status of every element.

    Of more than ``MOST_LINES`` elements, the worst of every cable is shown, and all of the chosen
    element's cable; cables are sorted by the severity of their status, which changes rarely.

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
    limit = model.robot.per_element(limits)
    looks = picture.cables
    names = [look.name for look in looks]
    rows = [
        _row(looks[e], shown, e, float(limit[e]), names[e] == chosen)
        for e in _lines(model, shown, np.nan_to_num(shown.tension / limit), names, chosen)
    ]
    style = "width:100%;border-collapse:collapse;font-size:13px;line-height:1.55"
    return f"<div style='padding:0 .8em'><table style='{style}'>{''.join(rows)}</table></div>"


def _lines(
    model: Model, shown: Snapshot, share: NDArray[np.float64], names: Sequence[str], chosen: str
) -> list[int]:
    """Indices of the elements that have a line; ``share`` is of the limits."""
    if len(names) <= MOST_LINES:
        return list(range(len(names)))
    grade = [severity(int(status)) for status in shown.status]
    cables = []
    for part in model.robot.parts:
        own = list(range(part.start, part.stop))
        worst = min(own, key=lambda e: (grade[e], -share[e]))
        cables.append((grade[worst], own if chosen in names[part] else [worst]))
    return [e for _, own in sorted(cables, key=lambda one: one[0]) for e in own]


def _row(look: DrawnCable, shown: Snapshot, e: int, limit: float, chosen: bool) -> str:
    tension, stddev, status = float(shown.tension[e]), shown.stddev[e], int(shown.status[e])
    known = np.isfinite(tension) and not status & INVALID
    return ROW.format(
        weight="font-weight:700;" if chosen else "",
        name=plain(look.name),
        size=min(max(WHOLE_NAME / len(look.name), SMALLEST), 1.0),
        share=100.0 * min(max(tension / limit, 0.0), 1.0) if known else 0.0,
        colour=f"rgb{rgb(look.colour)}",
        value=tension_words(tension, stddev) if known else "–",
        status=" ".join(word for word, _ in status_words(status)),
    )
