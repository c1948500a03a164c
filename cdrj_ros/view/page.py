"""The page: the moving robot, a table of tensions, curves over time and settings of the picture."""

from __future__ import annotations

from collections.abc import Sequence
from time import monotonic
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.output import printable
from cdrj_ros.model.prepared import Model
from cdrj_ros.view.drawing import Drawing, Labels
from cdrj_ros.view.history import Snapshot, Table, choices, nothing_known
from cdrj_ros.view.panels import Plots, TimeAxis, paragraphs, table_of
from cdrj_ros.view.picture import Picture, picture_of
from cdrj_ros.view.server import address_of, open_server

FIELD: Final = 0.6
"""Vertical angle of view [rad]."""

MARGIN: Final = 1.15
"""Height of the view over that of the robot [-]."""

ASPECT: Final = 0.85
"""Width over height of a picture between the panels of a usual window [-]."""


def set_camera(camera: Any, size: Vector, flat: bool) -> None:
    """Point the first camera of all browsers at a robot around the origin; "reset view" returns.

    Args:
        camera: of a viser server.
        size: extent of the robot along x, y, z [m], shape (3,).
        flat: whether it is planar, and therefore seen from the front.
    """
    x, y, z = size
    across, up = (x, y) if flat else (np.hypot(x, y), z + 0.5 * np.hypot(x, y))
    height = MARGIN * max(up, across / ASPECT)
    side = np.array([0.12, 0.15, 0.98] if flat else [0.64, -0.64, 0.42])
    camera.up = np.array([0.0, 1.0, 0.0] if flat else [0.0, 0.0, 1.0])
    camera.look_at = np.zeros(3)
    camera.fov = FIELD
    camera.position = height / (2.0 * np.tan(0.5 * FIELD)) * side


PICTURE_HZ: Final = 30.0
"""Maximum rate of pictures [Hz]."""

PLOT_S: Final = 0.25
"""Time between two updates of table and curves [s]."""

SIDE: Final = 330.0
"""Width of the panels on the sides [px]."""

STYLE: Final = (
    "<style>@media (max-width: 576px) {"
    " div[style*='20em'] { width: 100% !important; max-height: 50% !important; }"
    " div:has(> canvas[style*='pointer-events']) { bottom: 50% !important; }"
    " }</style>"
)
"""In a narrow window the panels take the whole width of its lower half, the picture the upper."""


class Page:
    """A page that any number of browsers show.

    ``gui`` may be used to add controls to the panels ``above`` and ``below`` the table.
    """

    def __init__(self, model: Model, host: str, port: int, title: str, axis: TimeAxis) -> None:
        """Start the server and build the page.

        Args:
            model: the prepared robot.
            host: address to listen on; ``0.0.0.0``: the network.
            port: TCP port, or the next free one; 0: any.
            title: heading of the page.
            axis: of the curves over time.

        Raises:
            UsageError: viser is not installed, or this machine does not have the address.
        """
        self.model = model
        self.server = open_server(host, port)
        self.address = address_of(self.server, host)
        self.gui = self.server.gui
        self.chosen = f"element {model.layout.elements[0]}"
        """What is plotted, as ``history.indices_of`` takes it."""
        self.pictures = 0
        """Number of pictures drawn."""
        self._plotted_s = 0.0
        self.gui.set_panel_label(printable(title))
        self.drawing = Drawing(self.server.scene, model, self.choose)
        self._build(axis)
        self._theme(False)
        set_camera(self.server.initial_camera, self.drawing.size, model.robot.planar)
        self.server.on_client_connect(lambda _: self._plots.appear())
        self.show(nothing_known(model), None, ())

    def close(self) -> None:
        """Stop the server."""
        self.server.stop()

    @property
    def watched(self) -> bool:
        """Whether a browser shows the page."""
        return bool(self.server.get_clients())

    def settings(self) -> tuple[object, ...]:
        """What the visitor has set of the picture."""
        return self._labels.value, self._forces.value

    def plot_is_due(self) -> bool:
        """Whether the next ``show`` updates table and curves."""
        return monotonic() - self._plotted_s > PLOT_S

    def choose(self, chosen: str) -> None:
        """Plot an element or a pulley, as ``history.indices_of`` takes it."""
        self.chosen = self._choice.value = chosen
        self._plotted_s = 0.0

    def show(
        self,
        shown: Snapshot,
        table: Table | None,
        words: Sequence[str],
        now_ns: int | None = None,
    ) -> None:
        """Draw a snapshot, at most ``PICTURE_HZ`` times a second.

        Args:
            shown: the values.
            table: values over time; None: the curves stay.
            words: the state in words, one paragraph each, see ``panels.plain``.
            now_ns: time that is marked in the curves [ns]; None for none, whose time is 0 at the
                end.

        Raises:
            CdrjError: the cables have no path at these joint angles.
        """
        picture = picture_of(self.model, shown)
        with self.server.atomic():
            self.drawing.update(picture, self.chosen, self._labels.value, self._forces.value)
        self.words.content = paragraphs(words)
        self.pictures += 1
        if self.plot_is_due() and shown.stamp_ns:  # the first estimate appears everywhere at once
            self._plotted_s = monotonic()
            self._plot(shown, picture, table, now_ns)

    def _plot(
        self, shown: Snapshot, picture: Picture, table: Table | None, now_ns: int | None
    ) -> None:
        _, _, name = self.chosen.partition(" ")
        self._table.content = table_of(self.model, shown, picture, name)
        if table is None:
            return
        zero_ns = int(table.stamp_ns[-1 if now_ns is None else 0])
        curves = table.curves(self.model.layout, self.chosen, zero_ns)
        with self.server.atomic():
            self._plots.show(curves, None if now_ns is None else (now_ns - zero_ns) * 1e-9)

    def _build(self, axis: TimeAxis) -> None:
        gui, layout = self.gui, self.model.layout
        self.words = gui.add_html("")
        """State in words."""
        self.above = gui.add_folder("Time")
        self.above.visible = False
        with gui.add_folder("Tensions"):
            self._table = gui.add_html("")
        self.below = gui.add_folder("Estimator")
        self.below.visible = False
        with gui.add_folder("Picture", expand_by_default=False):
            self._dark = gui.add_checkbox("dark", False)
            self._forces = gui.add_checkbox("forces on pulleys", True)
            wanted: Labels = "chosen"  # those of short elements would cover each other
            self._labels = gui.add_dropdown(
                "labels", ("none", "chosen", "all"), initial_value=wanted
            )
        self._dark.on_update(lambda _: self._theme(self._dark.value))
        panel = gui.add_panel()
        gui.add_html(STYLE)
        with panel.add_tab("Over time"):
            self._choice = gui.add_dropdown("plotted", choices(layout), initial_value=self.chosen)
            self._plots = Plots(gui, axis)
        self._choice.on_update(lambda _: self.choose(self._choice.value))
        gui.main_panel.dock_right()
        panel.dock_left()
        gui.main_panel.set_width(SIDE + 40.0)
        panel.set_width(SIDE)

    def _theme(self, dark: bool) -> None:
        self.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)
