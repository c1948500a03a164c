"""Drawing of cables in space: three orthogonal views and one in perspective.

The reference pose is drawn in full colour, the ends of the joint ranges faded.  Importing this
module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped,unused-ignore]
from numpy.typing import NDArray

from cdrj_ros.inspection.checks import Inspection
from cdrj_ros.model.spatial_paths import paths_in_space
from cdrj_ros.report.scale_drawing import (
    BODY,
    FONT_SIZE,
    GHOST,
    INK,
    MUTED,
    RULE,
    RULE_LIGHT,
    cable_colour,
    ghost_poses,
    poses_text,
)
from cdrj_ros.report.scene import LONG_SPAN, outlines, scene_of, straight_piece
from cdrj_ros.robot.description import Robot

Points = NDArray[np.float64]

SIZE: Final = (980.0, 860.0)
"""Default width and height [px]."""

LINK: Final = 6.0
"""Width of a link [px]."""

VIEWS: Final = (
    ("from above", 90.0, -90.0, "ortho"),
    ("perspective", 24.0, -58.0, "persp"),
    ("from the front (−y)", 0.0, -90.0, "ortho"),
    ("from the right (+x)", 0.0, 0.0, "ortho"),
)
"""Title, elevation and azimuth [deg], and projection of every view."""


def draw_in_space(inspection: Inspection, size: tuple[float, float] | None = None) -> Figure:
    """Draw the cables in space of a robot; cables given by spans have no known shape.

    Args:
        inspection: of ``cdrj_ros.inspection.ranges``.
        size: width and height [px].
    """
    model, robot = inspection.model, inspection.model.robot
    width, height = size or SIZE
    figure = Figure(figsize=(width / 72.0, height / 72.0), dpi=72.0)
    figure.patch.set_facecolor("white")
    reference = np.array([joint.reference_angle for joint in robot.joints])
    ghosts = [paths_in_space(model, pose) for pose in ghost_poses(robot)]
    paths = paths_in_space(model, reference)
    shortened = _shorten(paths, ghosts)
    scene = scene_of(model, reference)
    bodies = [
        line
        for body in scene.bodies
        if not (shortened and body.kind == "winch")
        for line in outlines(body)
    ]
    box = _box([*ghosts, paths], bodies)
    for k, (title, elevation, azimuth, projection) in enumerate(VIEWS):
        with rc_context({"grid.color": RULE_LIGHT, "grid.linewidth": 0.6}):
            axes: Any = figure.add_subplot(2, 2, k + 1, projection="3d")
        axes.view_init(elev=elevation, azim=azimuth)
        axes.set_proj_type(projection)
        for ghost in ghosts:
            _draw(axes, ghost, bold=False)
        for ends in scene.links:
            axes.plot(*ends.T, color=BODY, linewidth=LINK, solid_capstyle="round", zorder=0)
        for line in bodies:
            axes.plot(*line.T, color=MUTED, linewidth=0.7)
        _draw(axes, paths, bold=True)
        _draw_contacts(axes, inspection, paths)
        _number(axes, paths)
        _dress(axes, title, box, k)
    rows = _add_legend(figure, robot)
    unrolled = [cable.name for cable in robot.cables if not cable.spatial]
    figure.text(
        16.0 / width, 1.0 - 12.0 / height, robot.name, fontsize=FONT_SIZE + 3, color=INK,
        weight="bold", va="top", parse_math=False,
    )  # fmt: skip
    said = poses_text(robot, width)
    if shortened:
        said += "; the long spans at the ends are drawn shorter"
    if unrolled:
        said += f"; not drawn, since given by spans: {', '.join(unrolled)}"
    figure.text(
        16.0 / width, 1.0 - 34.0 / height, said, fontsize=FONT_SIZE - 1, color=MUTED, va="top",
        parse_math=False,
    )  # fmt: skip
    figure.subplots_adjust(
        left=0.0, right=1.0, top=1.0 - 62.0 / height, bottom=(16.0 + 20.0 * rows) / height,
        wspace=0.02, hspace=0.14,
    )  # fmt: skip
    return figure


def _add_legend(figure: Figure, robot: Robot) -> int:
    """Add a legend of the cables and contacts; returns its number of rows."""
    handles = [
        Line2D([], [], color=cable_colour(c), linewidth=2.2, label=f"{c + 1}  {cable.name}")
        for c, cable in enumerate(robot.cables)
        if cable.spatial
    ]
    handles.append(
        Line2D([], [], marker="o", markersize=5, color=INK, linestyle="none", label="contact")
    )
    handles.append(
        Line2D(
            [], [], marker="x", markersize=6, color=INK, linestyle="none", label="lifted off",
        )
    )  # fmt: skip
    handles.append(Line2D([], [], color=MUTED, linewidth=1.0, label="pulley or body"))
    legend = figure.legend(
        handles=handles, loc="lower center", ncols=min(len(handles), 6), frameon=False,
        fontsize=FONT_SIZE - 1,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)
    return -(-len(handles) // min(len(handles), 6))


def _shorten(paths: list[list[Points]], ghosts: list[list[list[Points]]]) -> bool:
    """Draw the spans at the ends shorter if they are so long that the rest would not be visible."""
    inner = [_line(pieces[1:-1]) for pieces in paths if any(map(len, pieces[1:-1]))]
    if not inner:
        return False
    size = float(np.ptp(np.vstack(inner), axis=0).max())
    shortened = False
    for one in (paths, *ghosts):
        for pieces in one:
            for end, order in ((0, 1), (-1, -1)):
                near = next((piece for piece in pieces[::order][1:] if len(piece)), None)
                if near is None:
                    continue
                to = near[0] if order == 1 else near[-1]
                way = pieces[end] - to
                long = float(np.linalg.norm(way[-1 if order == 1 else 0]))
                if size > 0.0 and long > LONG_SPAN * size:
                    pieces[end] = to + way * (size / long)
                    shortened = True
    return shortened


def _line(pieces: list[Points]) -> Points:
    return np.vstack([piece for piece in pieces if len(piece)])


def _draw(axes: Axes3D, paths: list[list[Points]], bold: bool) -> None:
    for c, pieces in enumerate(paths):
        if pieces:
            axes.plot(
                *_line(pieces).T, color=cable_colour(c), linewidth=1.9 if bold else 0.8,
                alpha=1.0 if bold else GHOST,
            )  # fmt: skip


def _draw_contacts(axes: Any, inspection: Inspection, paths: list[list[Points]]) -> None:
    """Mark contacts: a dot at every point, a heavy line on every arc; a cross where it lifted."""
    for c, (cable, pieces) in enumerate(zip(inspection.model.robot.cables, paths, strict=True)):
        for k, piece in enumerate(pieces):
            node = cable.nodes[k]
            if len(piece) == 0:
                before = next(p[-1] for p in reversed(pieces[:k]) if len(p))
                after = next(p[0] for p in pieces[k + 1 :] if len(p))
                axes.plot(*(0.5 * (before + after))[:, None], "x", color=INK, markersize=6)
            elif len(piece) == 1:
                end = k in (0, len(pieces) - 1)
                axes.plot(
                    *piece.T, "s" if end else "o", color=cable_colour(c), markersize=5,
                    markeredgecolor=INK, markeredgewidth=0.7,
                )  # fmt: skip
            else:
                dashes = (0, (2, 1)) if node.space and node.space.kind == "sheath" else "-"
                axes.plot(
                    *piece.T, color=INK, linewidth=3.6, alpha=0.55, linestyle=dashes,
                    solid_capstyle="butt",
                )  # fmt: skip


def _number(axes: Any, paths: list[list[Points]]) -> None:
    """Number every cable at the middle of its longest straight piece."""
    for c, pieces in enumerate(paths):
        if not pieces:
            continue
        begin, end = straight_piece(_line(pieces))
        axes.text(
            *(begin + (0.35 + 0.06 * (c % 4)) * (end - begin)), str(c + 1),
            fontsize=FONT_SIZE - 1, color=cable_colour(c), weight="bold", ha="center", va="center",
            path_effects=[withStroke(linewidth=4.0, foreground="white")],
        )  # fmt: skip


def _box(poses: list[list[list[Points]]], bodies: list[Points]) -> tuple[Points, float]:
    """Middle and half width of a cube around all paths and bodies [m]."""
    points = np.vstack([_line(pieces) for paths in poses for pieces in paths if pieces] + bodies)
    low, high = points.min(axis=0), points.max(axis=0)
    return 0.5 * (low + high), 0.5 * float(max(np.max(high - low), 1e-3))


def _dress(axes: Any, title: str, box: tuple[Points, float], view: int) -> None:
    """Equal scales, ticks in millimetres, and no labels along the line of sight."""
    middle, half = box
    for axis, name, centre in zip("xyz", ("x [mm]", "y [mm]", "z [mm]"), middle, strict=True):
        getattr(axes, f"set_{axis}lim")(centre - half, centre + half)
        getattr(axes, f"set_{axis}label")(name, fontsize=FONT_SIZE - 2, color=MUTED)
        ticks = getattr(axes, f"{axis}axis")
        ticks.set_major_formatter(lambda value, _: f"{1e3 * value:.0f}")
        ticks.set_tick_params(labelsize=FONT_SIZE - 4, labelcolor=MUTED)
        ticks.set_pane_color((1.0, 1.0, 1.0, 0.0))
        ticks.line.set_color(RULE)
        ticks.get_major_locator().set_params(nbins=5)
    sight = {0: "z", 2: "y", 3: "x"}.get(view)
    if sight:
        getattr(axes, f"set_{sight}ticks")([])
        getattr(axes, f"set_{sight}label")("")
    axes.set_box_aspect((1, 1, 1), zoom=1.3 if sight else 1.1)
    axes.set_title(title, fontsize=FONT_SIZE - 1, color=MUTED, pad=-2)
