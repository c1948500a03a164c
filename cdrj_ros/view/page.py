"""The page: the moving robot, a table of tensions, curves over time and settings of the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import monotonic, sleep
from typing import Any, Final

import numpy as np

from cdrj_ros.model.prepared import Model
from cdrj_ros.view.drawing import Drawing, Labels
from cdrj_ros.view.history import History, Table, choices
from cdrj_ros.view.looks import Picture, picture_of
from cdrj_ros.view.plots import Plots, TimeAxis
from cdrj_ros.view.server import address_of, open_server
from cdrj_ros.view.snapshot import Snapshot, nothing_known
from cdrj_ros.view.table import table_of

PICTURE_HZ: Final = 30.0
"""Maximum rate of pictures [Hz]."""

PLOT_S: Final = 0.25
"""Time between two updates of table and curves [s]."""

FEW: Final = 6
"""Number of elements up to which all of them have labels at first."""

FIELD: Final = 0.6
"""Angle of view [rad]."""

SIDE: Final = 330.0
"""Width of the panels on the sides [px]."""


NARROW: Final = 576.0
"""Width of a window below which viser puts the panels at its bottom [px]."""

WIDE: Final = 1000.0
"""Width of a window that has space for a panel on either side [px]."""

SHEET: Final = 0.5
"""Share of a narrow window that the panels cover."""

SETTLED_S: Final = 1.0
"""Time after which a browser has put the panels in place [s]."""

STYLE: Final = (
    "<style>@media (max-width: 576px) {"
    " div[style*='20em'] { width: 100% !important; max-height: 50% !important; }"
    " }</style>"
)
"""Uses the whole width of a narrow window."""


@dataclass(frozen=True)
class Place:
    """Where the page is served and how it looks at first."""

    host: str = "localhost"
    port: int = 8080
    """TCP port; the next free one is used if it is taken."""
    dark: bool = False


class Page:
    """A page that any number of browsers show.

    ``gui`` may be used to add controls to the panels ``above`` and ``below`` the table.
    """

    def __init__(self, model: Model, place: Place, title: str, axis: TimeAxis) -> None:
        """Start the server and build the page.

        Args:
            model: the prepared robot.
            place: where to serve it.
            title: heading of the page.
            axis: of the curves over time.

        Raises:
            UsageError: viser is not installed, or this machine does not have the address.
        """
        self.model = model
        self.server = open_server(place.host, place.port)
        self.address = address_of(self.server, place.host)
        self.gui = self.server.gui
        self.chosen = f"element {model.layout.elements[0]}"
        """What is plotted, as ``history.place_of`` takes it."""
        self.pictures = 0
        """Number of pictures drawn."""
        self._plotted_s = 0.0
        self._flat = not any(cable.spatial for cable in model.robot.cables)
        self.gui.set_panel_label(title)
        self.drawing = Drawing(self.server.scene, model, self.choose)
        self._build(place.dark, axis)
        self._theme(place.dark)
        self.server.on_client_connect(self._aim)
        self.show(nothing_known(model), History(model.layout, 1).table(), ())

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
        """Plot an element or a pulley, as ``history.place_of`` takes it."""
        self.chosen = self._choice.value = chosen
        self._plotted_s = 0.0

    def show(
        self, shown: Snapshot, table: Table, words: Sequence[str], now_ns: int | None = None
    ) -> None:
        """Draw a snapshot, at most ``PICTURE_HZ`` times a second.

        Args:
            shown: the values.
            table: values over time.
            words: the state in words, one paragraph of Markdown each.
            now_ns: time that is marked in the curves [ns]; None for none, whose time is 0 at the
                end.

        Raises:
            CdrjError: the cables have no path at these joint angles.
        """
        picture = picture_of(self.model, shown)
        with self.server.atomic():
            self.drawing.update(picture, self.chosen, self._labels.value, self._forces.value)
        self.words.content = "\n\n".join(words)
        self.pictures += 1
        if self.plot_is_due():
            self._plotted_s = monotonic()
            self._plot(shown, picture, table, now_ns)

    def _plot(self, shown: Snapshot, picture: Picture, table: Table, now_ns: int | None) -> None:
        _, _, name = self.chosen.partition(" ")
        self._table.content = table_of(self.model, shown, picture, name)
        if not len(table.stamp_ns):
            return
        zero_ns = int(table.stamp_ns[-1 if now_ns is None else 0])
        curves = table.curves(self.model.layout, self.chosen, zero_ns)
        with self.server.atomic():
            self._plots.show(curves, None if now_ns is None else (now_ns - zero_ns) * 1e-9)

    def _build(self, dark: bool, axis: TimeAxis) -> None:
        gui, layout = self.gui, self.model.layout
        self.words = gui.add_markdown("")
        """State in words."""
        self.above = gui.add_folder("Time")
        self.above.visible = False
        with gui.add_folder("Tensions"):
            self._table = gui.add_html("")
        self.below = gui.add_folder("Estimator")
        self.below.visible = False
        with gui.add_folder("Picture", expand_by_default=False):
            self._dark = gui.add_checkbox("dark", dark)
            self._forces = gui.add_checkbox("forces on pulleys", True)
            wanted: Labels = "all" if len(layout.elements) <= FEW else "chosen"
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

    def _aim(self, client: Any) -> None:
        """Point the camera of a new browser at the robot, again once its panels are in place."""
        for wait_s in (0.0, SETTLED_S):
            sleep(wait_s)
            self._point(client.camera, client)
        self._plots.appear()

    def _point(self, camera: Any, client: Any) -> None:
        """Fit the robot into the visible part of the window, from the front if it is planar."""
        wide, high = float(max(camera.image_width, 1)), float(max(camera.image_height, 1))
        hidden = SHEET if wide < NARROW else 0.0
        if wide > WIDE:  # a browser reports the width without the panels only once it is resized
            wide -= 2.0 * SIDE + 40.0
        x, y, z = self.drawing.size
        across, up = (x, y) if self._flat else (np.hypot(x, y), z + 0.5 * np.hypot(x, y))
        view = 1.15 * max(up / (1.0 - hidden), across * high / wide)  # height of the whole window
        away, below = view / (2.0 * np.tan(0.5 * FIELD)), 0.5 * hidden * view
        if self._flat:
            upwards, side = np.array([0.0, 1.0, 0.0]), np.array([0.12, 0.15, 0.98])
        else:
            upwards, side = np.array([0.0, 0.0, 1.0]), np.array([0.64, -0.64, 0.42])
        with client.atomic():
            camera.fov = FIELD
            camera.up_direction = upwards
            camera.position = away * side - below * upwards
            camera.look_at = -below * upwards
