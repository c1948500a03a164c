"""Drawing of a robot's cables: their paths and the changes over the joint ranges.

Cables given by positions are drawn to scale, those in space in four views.  Cables given by spans
have no known shape and are drawn unrolled.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cdrj_ros.foundation.files import replacing
from cdrj_ros.inspection.checks import Inspection
from cdrj_ros.report.drawing_style import FONT_SIZE, INK, MUTED
from cdrj_ros.report.pose import cable_line, pose_of
from cdrj_ros.report.scale_drawing import draw_placed, ghost_poses, legend_handles, poses_text
from cdrj_ros.report.spatial_drawing import draw_in_space
from cdrj_ros.report.unrolled_drawing import draw_unrolled

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
            cable_line(inspection.model, pose_of(inspection.model, pose), c)
            for pose in [inspection.poses[0], *ghost_poses(robot)]
            for c in placed
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
