"""Figures that carry one picture after another.

Making axes and their ticks takes a third of the time of a picture; here they are made once.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from typing import TypeAlias

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cdrj_ros.report.canvas import add_axes, new_figure

Place: TypeAlias = "tuple[float, float]"
"""Bottom and height of axes [px]."""


class Sheets:
    """The figures of one report; a picture is valid until the next one with the same axes."""

    def __init__(self) -> None:
        """Begin without figures."""
        self._figures: dict[tuple[Place, ...], Figure] = {}

    def blank(self, *places: Place) -> tuple[Figure, list[Axes]]:
        """A figure with empty axes at these places, from bottom and height [px]."""
        figure = self._figures.get(places)
        if figure is None:
            figure = self._figures[places] = new_figure()
            for bottom, height in places:
                add_axes(figure, bottom, height)
        else:
            _clear(figure)
        return figure, figure.axes


def _clear(figure: Figure) -> None:
    """Remove what was drawn, and let the limits follow what will be."""
    for artist in (*figure.texts, *figure.artists):
        artist.remove()
    for axes in figure.axes:
        for artist in (*axes.lines, *axes.collections, *axes.patches, *axes.texts):
            artist.remove()
        axes.relim()
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        axes.autoscale()
