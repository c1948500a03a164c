"""Drawing of a robot's cables to scale, in the reference pose and faded at the ends of its ranges.

A robot in the plane is drawn from above, one in space also from two sides and obliquely. Cables
given by spans have no known shape and are drawn as straight lines.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from itertools import accumulate
from math import degrees, pi
from typing import Any, Final

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cdrj_ros.foundation.arrays import Points, Vector
from cdrj_ros.foundation.files import replacing
from cdrj_ros.foundation.output import printable
from cdrj_ros.inspection.ranges import Inspection
from cdrj_ros.model.prepared import Model
from cdrj_ros.report.figures import COLOURS
from cdrj_ros.report.scene import LONG_SPAN, Body, Scene, by_cable, inner_size, middle_of, scene_of
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.groups import connected_cables

CABLE_COLOURS: Final = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#5e4fa2", "#7f7f7f",
)  # fmt: skip
"""Colours of cables after Okabe and Ito, distinguishable for colour-blind readers; they repeat if
there are more."""

INK: Final = "#1c1c1a"
MUTED: Final = COLOURS["muted"]
LINK: Final = "#e9e7df"
SHADE: Final = "#bdb9ab"

POINT: Final[dict[str, Any]] = {"marker": "o", "markersize": 4.0}
ANCHOR: Final[dict[str, Any]] = {"marker": "s", "markersize": 6.0}
"""Marks of eyelets, of drums without an axis, and of anchors."""

FONT_SIZE: Final = 12.0
"""Size of text [px]."""

SIZE: Final = (900.0, 720.0)
"""Largest width and height of a drawing [px]."""

LEAST: Final = (480.0, 360.0)
"""Least width and height of a drawing [px]."""

FADED: Final = 0.28
"""Opacity of poses other than the reference."""

MOST_JOINTS: Final = 6
"""Largest number of joints for which the ends of the range are drawn."""

MOST_CABLES: Final = 20
"""Largest number of cables that have colours of their own, and whose elements are numbered; of more
cables, those that depend on each other have one colour."""

CIRCLE_POINTS: Final = 49
"""Points of a drawn circle, the first one twice."""

GENERATORS: Final = 6
"""Lines along a drawn cylinder."""

PLANE: Final = (("x", "y", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), ""),)
SPACE: Final = (
    (*PLANE[0][:4], "from above"),
    ("", "", (0.85, 0.53, 0.0), (-0.22, 0.35, 0.91), "obliquely"),
    ("x", "z", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), "from the front (−y)"),
    ("y", "z", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), "from the right (+x)"),
)
"""Names of the axes, their directions in the base, and title of every view."""


def draw_robot(inspection: Inspection) -> Figure:
    """Draw a robot's cables.

    Args:
        inspection: of ``cdrj_ros.inspection.ranges``.
    """
    model, robot = inspection.model, inspection.model.robot
    reference = robot.reference_pose
    scenes = [scene_of(model, pose) for pose in (reference, *_end_poses(robot))]
    views = PLANE if robot.planar else SPACE
    room = _room(model, scenes[0])
    cut = _long_ends(robot, scenes, room)
    width, height = SIZE if len(views) > 1 else _fitting_size(scenes)
    figure = Figure(figsize=(width / 72.0, height / 72.0), dpi=72.0, layout="constrained")
    side = 2 if len(views) > 1 else 1
    for axes, view in zip(np.ravel(figure.subplots(side, side)), views, strict=True):
        _draw_view(axes, robot, scenes, view, room, cut)
    said = f"{robot.name}: reference pose{_ranges(robot)}"
    if cut:
        said += "; long spans at the ends are cut off"
    figure.suptitle(printable(said), fontsize=FONT_SIZE, color=INK, parse_math=False, wrap=True)
    handles = _legend(robot)
    column = FONT_SIZE * (4.0 + 0.6 * max(len(str(one.get_label())) for one in handles))
    legend = figure.legend(
        handles=handles, loc="outside lower center", ncols=max(1, min(6, int(width / column))),
        frameon=False, fontsize=FONT_SIZE - 1, labelcolor=MUTED,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure


def write_png(figure: Figure, path: str) -> None:
    """Write a drawing at twice its resolution; an existing file is kept on failure.

    Raises:
        OSError: the file cannot be written.
    """
    with replacing(path) as stream:
        figure.savefig(stream, format="png", dpi=144.0)


def coloured(robot: Robot) -> list[tuple[str, Sequence[int]]]:
    """Name and cables of everything that has a colour: a cable, or a part such as a finger."""
    if len(robot.cables) <= MOST_CABLES:
        return [(cable.name, (c,)) for c, cable in enumerate(robot.cables)]
    return [(_common_name(robot, group), group) for group in connected_cables(robot, branches=True)]


def _common_name(robot: Robot, group: Sequence[int]) -> str:
    """What the names of some cables have in common, or the names themselves."""
    names = [robot.cables[c].name for c in group]
    shared = [one for one in accumulate(names[0]) if all(name.startswith(one) for name in names)]
    return shared[-1].rstrip("_") if shared else ", ".join(names)


def _colours(robot: Robot) -> list[str]:
    """Colour of every cable."""
    colours = [""] * len(robot.cables)
    for k, (_, group) in enumerate(coloured(robot)):
        for c in group:
            colours[c] = CABLE_COLOURS[k % len(CABLE_COLOURS)]
    return colours


def _end_poses(robot: Robot) -> Iterator[Vector]:
    """Poses with one joint at an end of its range and the others at the reference."""
    for j, joint in enumerate(robot.joints[:MOST_JOINTS]):
        for end in {joint.lower, joint.upper} - {joint.reference_angle}:
            pose = robot.reference_pose
            pose[j] = end
            yield pose


def _room(model: Model, scene: Scene) -> float:
    """Length to which spans at the ends are cut off that would hide the rest of the cables [m]."""
    size = inner_size(model, scene)
    spans = [float(np.ptp(path, axis=0).max()) for path in scene.elements]
    return size if not model.robot.planar and 0.0 < LONG_SPAN * size < max(spans) else float("inf")


def _fitting_size(scenes: Sequence[Scene]) -> tuple[float, float]:
    """Width and height [px] that keep the proportions of a robot in the plane."""
    points = np.concatenate([path[:, :2] for scene in scenes for path in scene.elements])
    across, up = np.maximum(np.ptp(points, axis=0), 1e-6)
    scale = min(SIZE[0] / across, SIZE[1] / up)
    return max(LEAST[0], scale * across), max(LEAST[1], scale * up + 100.0)


def _draw_view(
    axes: Axes, robot: Robot, scenes: Sequence[Scene], view: tuple[Any, ...], room: float,
    cut: Set[tuple[int, int]],
) -> None:  # fmt: skip
    """Draw all poses, the reference pose last and on top."""
    across, up, *directions, title = view
    colours = _colours(robot)
    projection = np.array(directions).T
    for scene in scenes[::-1]:
        bold = scene is scenes[0]
        alpha = 1.0 if bold else FADED
        _draw_shapes(axes, scene, projection, alpha)
        for c, (paths, bodies) in enumerate(by_cable(robot, scene)):
            if bold:
                shown = bodies[(c, 0) in cut : len(bodies) - ((c, -1) in cut)]
                _draw_bodies(axes, shown, projection, colours[c])
            for end in (0, -1):
                if (c, end) in cut:
                    paths[end] = _cut_off(paths[end], end, room)
            for e, path in enumerate(paths):
                line = path @ projection
                axes.plot(
                    *line.T, color=colours[c], linewidth=1.9 if bold else 1.0, alpha=alpha,
                    zorder=4 if bold else 3,
                )  # fmt: skip
                if bold and len(robot.cables) <= MOST_CABLES:
                    _number(axes, line, str(e + 1), colours[c])
    axes.set_aspect("equal", adjustable="datalim")
    axes.spines[["right", "top"]].set_visible(False)
    axes.tick_params(labelsize=FONT_SIZE - 2, labelcolor=MUTED)
    for axis, name in ((axes.xaxis, across), (axes.yaxis, up)):
        axis.set_major_formatter(lambda value, _: f"{round(1e3 * value, 6) + 0.0:g}")
        axis.set_label_text(f"{name} [mm]" if name else "", fontsize=FONT_SIZE - 1, color=MUTED)
        axis.set_visible(bool(name))
    axes.set_title(title, fontsize=FONT_SIZE - 1, color=MUTED)


def _draw_bodies(axes: Axes, bodies: Sequence[Body], projection: Points, colour: str) -> None:
    """Draw what a cable passes, and its ends."""
    for body in bodies:
        for line in outlines(body):
            edge = INK if body.kind == "winch" else MUTED
            axes.plot(*(line @ projection).T, color=edge, linewidth=0.8, zorder=2)
        if body.kind == "anchor" or body.shape == "point":
            mark = ANCHOR if body.kind == "anchor" else POINT
            axes.plot(*(body.centre @ projection), **mark, color=colour, zorder=5)


def _draw_shapes(axes: Axes, scene: Scene, projection: Points, alpha: float) -> None:
    """Draw the shapes of the bodies, or the links where they have none."""
    for visual in scene.visuals:
        outline = _silhouette(visual.points @ projection)
        axes.fill(
            *outline.T, facecolor=LINK, edgecolor=SHADE, linewidth=0.7, alpha=0.8 * alpha, zorder=0
        )
    for link in scene.links:
        axes.plot(*(link @ projection).T, color=LINK, linewidth=6.0, alpha=alpha, zorder=1)


def _silhouette(points: Points) -> Points:
    """Corners of the convex hull of points in the plane, shape (n, 2)."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices]) if len(points) > 2 else points
    except QhullError:  # all in one line
        return points[:0]


def _long_ends(robot: Robot, scenes: Sequence[Scene], room: float) -> frozenset[tuple[int, int]]:
    """Cables, and 0 for their first span or -1 for the last, which is long in any pose."""
    return frozenset(
        (c, end)
        for scene in scenes
        for c, (paths, _) in enumerate(by_cable(robot, scene))
        for end in (0, -1)
        if np.linalg.norm(paths[end][0] - paths[end][-1]) > LONG_SPAN * room
    )


def _cut_off(path: Points, end: int, room: float) -> Points:
    """The first path of a cable (``end`` 0) or the last (-1), no longer than ``room`` [m]."""
    order = -1 if end == 0 else 1
    path = path[::order]  # away from the rest of the cable
    length = float(np.linalg.norm(path[-1] - path[0]))
    if length > room:
        path = np.vstack([path[:-1], path[-2] + (path[-1] - path[-2]) * (room / length)])
    return path[::order]


def _number(axes: Axes, line: Points, number: str, colour: str) -> None:
    """Write the number of an element on the middle of its longest straight piece."""
    x, y = middle_of(line).tolist()
    axes.text(
        x, y, number, fontsize=FONT_SIZE - 2, color=colour,
        weight="bold", ha="center", va="center", zorder=6, clip_on=True,
        path_effects=[patheffects.withStroke(linewidth=2.5, foreground="white")],
    )  # fmt: skip


def _legend(robot: Robot) -> list[Line2D]:
    colours = _colours(robot)
    handles = [
        Line2D([], [], color=colours[group[0]], linewidth=2.2, label=printable(name))
        for name, group in coloured(robot)
    ]
    handles.append(Line2D([], [], color=INK, linewidth=1.0, label="winch"))
    handles.append(Line2D([], [], color=MUTED, linewidth=1.0, label="pulley or body"))
    handles.append(Line2D([], [], color=INK, linestyle="", **POINT, label="eyelet"))
    handles.append(Line2D([], [], color=INK, linestyle="", **ANCHOR, label="anchor"))
    return handles


def _ranges(robot: Robot) -> str:
    """The joint ranges whose ends are drawn faded."""
    ranges = [
        f"{joint.name} {joint.lower:g} to {joint.upper:g} m"
        if joint.name in robot.prismatic_joints
        else f"{joint.name} {degrees(joint.lower):.4g} to {degrees(joint.upper):.4g}°"
        for joint in robot.joints[:MOST_JOINTS]
    ]
    count = len(robot.joints)
    some = f", the first {len(ranges)} of {count} joints" if count > len(ranges) else ""
    return f"; faded: {', '.join(ranges)}{some}" if ranges else ""


def outlines(body: Body) -> list[Points]:
    """Lines that show a body, each of shape (points, 3) [m]; none of a point.

    A disc is a circle, a sphere three great circles; a cylinder has lines along its side.
    """
    if body.shape == "point":
        return []
    x, y = across(body.axis)
    if body.shape == "sphere":
        return [
            _circle(body, body.centre, u, v) for u, v in ((x, y), (y, body.axis), (body.axis, x))
        ]
    half = 0.5 * body.length * body.axis
    ends = [_circle(body, body.centre + end, x, y) for end in (-half, half)]
    if body.shape == "disc":
        return ends[:1]
    step = (CIRCLE_POINTS - 1) // GENERATORS
    return [*ends, *(np.array([ends[0][k], ends[1][k]]) for k in range(0, CIRCLE_POINTS - 1, step))]


def across(axis: Vector) -> tuple[Vector, Vector]:
    """Two unit vectors at right angles to an axis and to each other, shape (3,) each."""
    least = np.eye(3)[int(np.argmin(np.abs(axis)))]
    one = np.cross(axis, least)
    one /= np.linalg.norm(one)
    return one, np.cross(axis, one)


def _circle(body: Body, centre: Vector, u: Vector, v: Vector) -> Points:
    angles = np.linspace(0.0, 2.0 * pi, CIRCLE_POINTS)[:, None]
    return np.asarray(centre + body.radius * (np.cos(angles) * u + np.sin(angles) * v))
