"""Controls of a running estimator: sliders that show the values in force, and buttons."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any, Final

from cdrj_ros.foundation.text import printable
from cdrj_ros.view.markup import paragraphs

HELD_S: Final = 1.5
"""Time after a change by hand during which a slider does not follow the value in force [s]."""

STEPS: Final = 200
"""Number of positions of a slider."""


@dataclass(frozen=True)
class Knob:
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
        knobs: Sequence[Knob],
        on_change: Callable[[str, float], None],
        buttons: Mapping[str, tuple[str, Callable[[], None]]],
    ) -> None:
        """Add the controls where ``gui`` stands.

        Args:
            gui: of a viser server.
            knobs: what the sliders set.
            on_change: called with a knob's name and value, in a thread of the server.
            buttons: label, and explanation and function of every button.
        """
        self._on_change = on_change
        self._knobs = {knob.name: knob for knob in knobs}
        self._touched = dict.fromkeys(self._knobs, -HELD_S)
        self._setting = False
        self._buttons = []
        for label, (hint, press) in buttons.items():
            button = gui.add_button(label, hint=hint)
            button.on_click(lambda _, press=press: press())
            self._buttons.append(button)
        self._answer = gui.add_html("")
        self._sliders = {knob.name: self._slider(gui, knob) for knob in knobs}
        self.enable(False)

    def _slider(self, gui: Any, knob: Knob) -> Any:
        step = (knob.high - knob.low) / STEPS
        slider = gui.add_slider(
            printable(knob.label), knob.low, knob.high, step, knob.start, hint=knob.description
        )

        @slider.on_update  # type: ignore[untyped-decorator]
        def _(event: Any) -> None:
            if event.client is not None:  # not set by this program
                self._touched[knob.name] = monotonic()
                self._on_change(knob.name, float(slider.value))

        return slider

    def enable(self, able: bool) -> None:
        """Enable or disable everything."""
        for one in (*self._buttons, *self._sliders.values()):
            one.disabled = not able

    def answer(self, words: str) -> None:
        """Show the estimator's answer, see ``markup.plain``."""
        self._answer.content = paragraphs([words] if words else [])

    def release(self, name: str) -> None:
        """Let a slider return to the value in force, because a change was refused."""
        self._touched[name] = -HELD_S

    def in_force(self, values: Mapping[str, float]) -> None:
        """Show the values in force."""
        for name, value in values.items():
            knob, slider = self._knobs[name], self._sliders[name]
            slider.label = f"{printable(knob.label)} = {value:.4g}{knob.unit and ' ' + knob.unit}"
            if monotonic() - self._touched[name] > HELD_S:
                shown = min(max(value, knob.low), knob.high)
                if abs(shown - slider.value) > 1e-9 * max(abs(shown), 1.0):
                    slider.value = shown
