"""Drawing of a robot's cables: their paths and the changes over the joint ranges.

Cables given by positions are drawn to scale, those in space in four views.  Cables given by spans
have no known shape and are drawn unrolled.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees
from typing import Final

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle
from numpy.typing import NDArray

from cdrj_ros.foundation.files import replacing
from cdrj_ros.inspection.checks import CableCheck, Extent, Inspection
from cdrj_ros.report.scale_drawing import (
    FONT_SIZE,
    INK,
    MUTED,
    RULE,
    cable_colour,
    draw_placed,
    ghost_poses,
    legend_handles,
    poses_text,
)
from cdrj_ros.report.scene import by_cable, scene_of
from cdrj_ros.report.spatial_drawing import draw_in_space
from cdrj_ros.robot.description import Anchor, Cable, Winch

Vector = NDArray[np.float64]

_NODE: Final = 13.0
"""Radius of a pulley in an unrolled drawing [px]."""

_LEAST: Final = 66.0
"""Least drawn length of an element, given by the width of its label [px]."""


def draw_unrolled(axes: Axes, inspection: Inspection, cables: Sequence[int]) -> None:
    """Draw every cable as a straight line, with spans to scale if their labels fit."""
    robot = inspection.model.robot
    box = axes.get_window_extent()
    axes.set_xlim(0.0, box.width)
    axes.set_ylim(0.0, box.height)
    axes.axis("off")
    left, right = 16.0, 16.0
    pitch = box.height / max(len(cables), 1)
    to_scale = True
    for row, c in enumerate(cables):
        check = inspection.cables[c]
        y = box.height - pitch * (row + 0.5) - 16.0
        spans = [0.5 * (element.span.low + element.span.high) for element in check.elements]
        lengths, exact = _laid_out(spans, box.width - left - right)
        to_scale &= exact
        x = left + np.concatenate([[0.0], np.cumsum(lengths)])
        axes.plot([x[0], x[-1]], [y, y], color=cable_colour(c), linewidth=2.2, zorder=2)
        axes.text(
            left - 16.0, y + 44.0, robot.cables[c].name, fontsize=FONT_SIZE + 1,
            color=cable_colour(c), weight="bold", parse_math=False,
        )  # fmt: skip
        _unrolled_elements(axes, check, x, y, cable_colour(c))
        _unrolled_nodes(axes, robot.cables[c], check, x, y, cable_colour(c))
    scale = ", to scale" if to_scale else ", short ones drawn longer"
    note = f"unrolled; below the line free spans [mm]{scale}; above it wrap angles"
    if 0.55 * FONT_SIZE * len(note) > box.width:
        note = "unrolled; free spans [mm], wrap angles"
    axes.text(
        box.width, box.height + 18.0, note, fontsize=FONT_SIZE - 1,
        color=MUTED, ha="right",
    )  # fmt: skip


def _laid_out(spans: Sequence[float], room: float) -> tuple[Vector, bool]:
    """Drawn lengths that fill ``room`` [px], and whether all are to scale.

    Lengths are at least as long as their labels if ``room`` permits.
    """
    wanted = np.maximum(np.array(spans), 0.0)
    least = min(_LEAST, room / len(spans))
    short = np.zeros(wanted.size, dtype=bool)
    while True:
        rest = room - least * short.sum()
        total = wanted[~short].sum()
        drawn = np.where(short, least, wanted * (rest / total if total > 0.0 else 0.0))
        more = (drawn < least - 1e-9) & ~short
        if not more.any():
            return drawn, not short.any()
        short |= more


def _range_text(low: float, high: float, decimals: int) -> str:
    """A range as text; a single number if both ends round to the same value."""
    a, b = f"{low:.{decimals}f}", f"{high:.{decimals}f}"
    return a if a == b else f"{a}–{b}"


def _unrolled_elements(axes: Axes, check: CableCheck, x: Vector, y: float, colour: str) -> None:
    """Add the number and the range of the free span of every element."""
    for e, element in enumerate(check.elements):
        middle = 0.5 * (x[e] + x[e + 1])
        span = _range_text(1e3 * element.span.low, 1e3 * element.span.high, 0)
        moves = "–" in span
        number = axes.text(
            middle, y, str(e + 1), fontsize=FONT_SIZE - 1, color=colour, weight="bold",
            ha="center", va="center", zorder=4,
        )  # fmt: skip
        number.set_path_effects([patheffects.withStroke(linewidth=4.0, foreground="white")])
        axes.text(
            middle, y - 24.0, span, fontsize=FONT_SIZE - 1, color=INK if moves else MUTED,
            weight="bold" if moves else "normal", ha="center", va="center",
        )  # fmt: skip


def _unrolled_nodes(
    axes: Axes, cable: Cable, check: CableCheck, x: Vector, y: float, colour: str
) -> None:
    """Draw winches with the names of their motors, anchors and pulleys."""
    pulley = 0
    for k, node in enumerate(cable.nodes):
        if isinstance(node, Winch):
            axes.add_patch(
                Circle((x[k], y), _NODE, facecolor="white", edgecolor=INK, linewidth=1.8, zorder=3)
            )
            axes.add_patch(Circle((x[k], y), 0.35 * _NODE, facecolor=INK, zorder=3))
            inward = "left" if k == 0 else "right"
            edge = x[k] - _NODE if k == 0 else x[k] + _NODE
            axes.text(
                edge, y + 22.0, node.motor, fontsize=FONT_SIZE - 1, color=MUTED, ha=inward,
                parse_math=False,
            )  # fmt: skip
        elif isinstance(node, Anchor):
            axes.plot(
                [x[k]], [y], marker="s", markersize=9, color=colour, markeredgecolor=INK, zorder=3
            )
        else:
            _unrolled_pulley(axes, (float(x[k]), y), k + 1, check.pulleys[pulley].wrap, colour)
            pulley += 1


def _unrolled_pulley(
    axes: Axes, centre: tuple[float, float], number: int, wrap: Extent, colour: str
) -> None:
    """Draw a pulley with its node number, its wrapped arc and the wrap angle above it."""
    axes.add_patch(
        Circle(centre, _NODE, facecolor="white", edgecolor=RULE, linewidth=1.2, zorder=3)
    )
    # the arc is symmetric about the top: faded at the largest wrap, opaque at the smallest
    for angle, alpha in ((wrap.high, 0.35), (wrap.low, 1.0)):
        half = min(0.5 * degrees(angle), 180.0)
        axes.add_patch(
            Arc(
                centre, 2.0 * _NODE, 2.0 * _NODE, theta1=90.0 - half, theta2=90.0 + half,
                color=colour, linewidth=3.2, alpha=alpha, zorder=3.5,
            )
        )  # fmt: skip
    text = _range_text(degrees(wrap.low), degrees(wrap.high), 1)
    axes.text(
        centre[0], centre[1] + 24.0, f"{text}°", fontsize=FONT_SIZE - 1,
        color=INK if "–" in text else MUTED, weight="bold" if "–" in text else "normal",
        ha="center", va="center",
    )  # fmt: skip
    axes.text(
        *centre, str(number), fontsize=FONT_SIZE - 2, color=MUTED, ha="center", va="center",
        zorder=4,
    )  # fmt: skip


LARGEST: Final = (900.0, 720.0)
"""Largest width and height of the cables in a drawing [px]."""

NARROWEST: Final = 480.0
"""Width of a drawing below which its legend does not fit [px]."""

_TITLE: Final = 34.0
_LEGEND_COLUMN: Final = 128.0
_UNROLLED_HEAD: Final = 34.0
_UNROLLED_ROW: Final = 128.0


def draw_robot(inspection: Inspection, size: tuple[float, float] | None = None) -> Figure:
    """Draw a robot's cables: those given by positions to scale, those given by spans unrolled.

    Args:
        inspection: of ``cdrj_ros.inspection.ranges``.
        size: width and height [px]; by default chosen such that everything fits.  Below about
            600 px the labels of long cables overlap.
    """
    robot = inspection.model.robot
    if any(cable.spatial for cable in robot.cables):
        return draw_in_space(inspection, size)
    placed = [c for c, cable in enumerate(robot.cables) if cable.routed]
    unrolled = [c for c, cable in enumerate(robot.cables) if not cable.routed]
    below = _UNROLLED_ROW * len(unrolled) + _UNROLLED_HEAD if unrolled else 0.0
    if size is None:
        size = _fitting_size(inspection, placed, below)
    width, height = size
    figure = Figure(figsize=(width / 72.0, height / 72.0), dpi=72.0)
    figure.patch.set_facecolor("white")
    if placed and unrolled:
        below *= min(1.0, 0.5 * height / below)
    elif unrolled:
        below = height - _TITLE
    if placed:
        handles = legend_handles(robot, placed)
        columns = max(2, int(width // _LEGEND_COLUMN))
        head = _TITLE + 20.0 + 19.0 * -(-len(handles) // columns)
        axes = _axes(figure, (64.0, below + 46.0, width - 78.0, height - below - 46.0 - head))
        draw_placed(axes, inspection, placed, handles, columns)
        figure.text(
            16.0 / width, 1.0 - _TITLE / height, poses_text(robot, width), fontsize=FONT_SIZE - 1,
            color=MUTED, va="top", parse_math=False,
        )  # fmt: skip
    if unrolled:
        axes = _axes(figure, (14.0, 4.0, width - 28.0, below - _UNROLLED_HEAD))
        draw_unrolled(axes, inspection, unrolled)
    figure.text(
        16.0 / width, 1.0 - 12.0 / height, robot.name, fontsize=FONT_SIZE + 3, color=INK,
        weight="bold", va="top", parse_math=False,
    )  # fmt: skip
    return figure


def _axes(figure: Figure, box: tuple[float, float, float, float]) -> Axes:
    """Add axes at a box (left, bottom, width, height) in pixels."""
    width, height = 72.0 * figure.get_size_inches()
    left, bottom, wide, high = box
    wide, high = max(wide, 10.0), max(high, 10.0)
    return figure.add_axes((left / width, bottom / height, wide / width, high / height))


def _fitting_size(
    inspection: Inspection, placed: Sequence[int], below: float
) -> tuple[float, float]:
    """Width and height [px]: the largest within LARGEST that keep the cables' proportions."""
    widest, tallest = LARGEST
    if not placed:
        return widest, below + _TITLE
    robot = inspection.model.robot
    points = np.vstack(
        [
            path[:, :2]
            for pose in [inspection.poses[0], *ghost_poses(robot)]
            for c, (paths, _) in enumerate(by_cable(robot, scene_of(inspection.model, pose)))
            for path in paths
            if c in placed
        ]
    )
    across, up = np.maximum(np.ptp(points, axis=0), 1e-6)
    scale = min(widest / across, tallest / up)
    return max(NARROWEST, scale * across + 78.0), scale * up + 130.0 + below


def write_png(figure: Figure, path: str) -> None:
    """Write a drawing at twice its resolution; an existing file is kept on failure.

    Raises:
        OSError: the file cannot be written.
    """
    with replacing(path) as stream:
        figure.savefig(stream, format="png", dpi=144.0)
