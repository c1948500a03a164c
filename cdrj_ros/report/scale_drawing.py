"""Drawing to scale of cables given by positions.

The reference pose is drawn in full colour, the poses at the ends of every joint's range faded.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import cos, degrees, hypot, pi, sin
from typing import Final

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from cdrj_ros.inspection.checks import Inspection
from cdrj_ros.report.scene import Body, Pose, by_cable, scene_of, straight_piece
from cdrj_ros.robot.description import Robot

CABLE_COLOURS: Final = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#5e4fa2", "#7f7f7f",
)  # fmt: skip
"""Colours of cables after Okabe and Ito, distinguishable for colour-blind readers; they repeat if
there are more cables."""

INK: Final = "#1c1c1a"
MUTED: Final = "#62625d"
RULE: Final = "#b9b9b5"
RULE_LIGHT: Final = "#e6e6e2"
BODY: Final = "#e9e7df"

FONT_SIZE: Final = 12.0
"""Size of text [px]."""


def cable_colour(index: int) -> str:
    """Colour of the cable with this index in the robot."""
    return CABLE_COLOURS[index % len(CABLE_COLOURS)]


Vector = NDArray[np.float64]
Points = NDArray[np.float64]

GHOST: Final = 0.28
"""Opacity of cables in poses other than the reference."""

MOST_GHOSTS: Final = 6
"""Largest number of joints for which the ends of the range are drawn."""

CLEAR: Final = 15.0
"""Least distance between two element numbers without overlap [px]."""


def ghost_poses(robot: Robot) -> Iterator[Vector]:
    """Poses with one joint at an end of its range and the others at the reference."""
    reference = np.array([joint.reference_angle for joint in robot.joints])
    for j, joint in enumerate(robot.joints[:MOST_GHOSTS]):
        for end in (joint.lower, joint.upper):
            pose = reference.copy()
            pose[j] = end
            if not np.array_equal(pose, reference):
                yield pose


def draw_placed(
    axes: Axes, inspection: Inspection, cables: Sequence[int], handles: list[Line2D], columns: int
) -> None:
    """Draw cables in all poses, the reference pose last and on top.

    Args:
        axes: to draw in.
        inspection: of the robot.
        cables: indices of the cables given by positions.
        handles: of ``legend_handles``.
        columns: of the legend.
    """
    robot = inspection.model.robot
    reference = np.array([joint.reference_angle for joint in robot.joints])
    for angle in (*ghost_poses(robot), reference):
        bold = angle is reference
        scene = scene_of(inspection.model, angle)
        drawn = {c: one for c, one in enumerate(by_cable(robot, scene)) if c in cables}
        _draw_frames(axes, robot, scene.pose, [b for _, own in drawn.values() for b in own], bold)
        for c, (paths, bodies) in drawn.items():
            line = np.concatenate(paths)[:, :2]
            axes.plot(
                line[:, 0], line[:, 1], color=cable_colour(c), linewidth=1.9 if bold else 1.0,
                alpha=1.0 if bold else GHOST, zorder=5 if bold else 3,
                solid_joinstyle="round", solid_capstyle="round",
            )  # fmt: skip
            _draw_nodes(axes, bodies, line, cable_colour(c), bold)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.04)
    axes.autoscale_view()
    axes.apply_aspect()  # the element numbers are placed in pixel coordinates
    _number_elements(axes, {c: paths for c, (paths, _) in drawn.items()})
    _dress(axes, handles, columns)


def _draw_frames(axes: Axes, robot: Robot, pose: Pose, bodies: Sequence[Body], bold: bool) -> None:
    """Draw moving frames as the hull of their nodes, with joint axes and rolling circles."""
    carried: dict[str, list[tuple[float, float]]] = {}
    for body in bodies:
        x, y = body.centre[:2].tolist()
        angles = np.linspace(0.0, 2.0 * pi, 24) if body.radius > 0.0 else np.zeros(1)
        circle = [(x + body.radius * cos(a), y + body.radius * sin(a)) for a in angles]
        carried.setdefault(body.frame, []).extend(circle)
    for frame in robot.frames:
        if frame.motion == "fixed" or frame.parent is None:
            continue
        x, y, _ = pose.frames[frame.name]
        if frame.name in carried:
            axis = [(x, y)] if frame.motion == "revolute" else []
            _draw_hull(axes, [*carried[frame.name], *axis], bold)
        if frame.motion == "rolling":
            px, py, _ = pose.frames[frame.parent]
            for centre in ((px + frame.x, py + frame.y), (x, y)):
                _draw_rolling_circle(axes, centre, frame.rolling_radius, bold)
        elif frame.motion == "revolute":
            axes.plot(
                [x], [y], marker="+", markersize=7, color=INK, alpha=1.0 if bold else 0.3,
                markeredgewidth=1.1, zorder=6 if bold else 2,
            )  # fmt: skip


def _draw_hull(axes: Axes, points: Sequence[tuple[float, float]], bold: bool) -> None:
    axes.add_patch(
        Polygon(
            _hull(points), closed=True, facecolor=BODY, edgecolor=RULE, linewidth=0.8,
            alpha=0.9 if bold else 0.3, zorder=1 if bold else 0.5, joinstyle="round",
        )
    )  # fmt: skip


def _draw_rolling_circle(
    axes: Axes, centre: tuple[float, float], radius: float, bold: bool
) -> None:
    axes.add_patch(
        Circle(
            centre, radius, fill=False, edgecolor=MUTED, linewidth=0.9, linestyle=(0, (5, 3)),
            alpha=0.8 if bold else 0.2, zorder=1.5,
        )
    )  # fmt: skip


def _hull(points: Sequence[tuple[float, float]]) -> Points:
    """Convex hull, counter-clockwise (Andrew's monotone chain)."""
    ordered = sorted(set(points))

    def half(sequence: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        chain: list[tuple[float, float]] = []
        for p in sequence:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2:]
                if (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax) > 0.0:
                    break
                chain.pop()
            chain.append(p)
        return chain[:-1]

    return np.array([*half(ordered), *half(ordered[::-1])] or ordered)


def _draw_nodes(axes: Axes, bodies: Sequence[Body], line: Points, colour: str, bold: bool) -> None:
    """Draw a cable's nodes; in faded poses only those on moving frames."""
    alpha = 1.0 if bold else GHOST
    zorder = 4 if bold else 2
    for body in bodies:
        if not bold and body.frame == "base":
            continue
        x, y = body.centre[:2].tolist()
        if body.kind == "anchor":
            end = line[0 if body is bodies[0] else -1].tolist()
            _draw_anchor(axes, (x, y), body.radius, end, colour, bold)
            continue
        edge, width = (INK, 1.6) if body.kind == "winch" else (MUTED, 0.9)
        axes.add_patch(
            Circle(
                (x, y), body.radius, facecolor="white", edgecolor=edge, linewidth=width,
                alpha=alpha, zorder=zorder,
            )
        )  # fmt: skip
        if body.kind == "winch":
            axes.add_patch(
                Circle((x, y), 0.35 * body.radius, facecolor=INK, alpha=alpha, zorder=zorder)
            )
        else:
            axes.plot([x], [y], marker="o", markersize=2.2, color=MUTED, alpha=alpha, zorder=zorder)


def _draw_anchor(
    axes: Axes,
    centre: tuple[float, float],
    radius: float,
    end: Sequence[float],
    colour: str,
    bold: bool,
) -> None:
    """Draw a square; for a sector at the cable's tangent point, with the sector's circle dotted."""
    alpha = 1.0 if bold else GHOST
    x, y = centre
    if radius > 0.0:
        x, y = end
        axes.add_patch(
            Circle(
                centre, radius, fill=False, edgecolor=colour, linewidth=1.2,
                linestyle=(0, (2, 2)), alpha=alpha, zorder=4 if bold else 2,
            )
        )  # fmt: skip
    axes.plot(
        [x], [y], marker="s", markersize=6 if bold else 4, color=colour, alpha=alpha,
        markeredgecolor=INK, markeredgewidth=0.8, zorder=7 if bold else 3,
    )  # fmt: skip


def _number_elements(axes: Axes, cables: Mapping[int, Sequence[Points]]) -> None:
    """Number the elements, each number beside its line and without overlap."""
    taken: list[tuple[float, float]] = []
    for c, paths in cables.items():
        for e, path in enumerate(paths):
            a, b = axes.transData.transform(straight_piece(path)[:, :2])
            place = _free_place(a, b, taken)
            taken.append((float(place[0]), float(place[1])))
            x, y = axes.transData.inverted().transform(place)
            text = axes.text(
                x, y, str(e + 1), fontsize=FONT_SIZE - 2, color=cable_colour(c), ha="center",
                va="center", weight="bold", zorder=9,
            )  # fmt: skip
            text.set_path_effects([patheffects.withStroke(linewidth=2.5, foreground="white")])


def _free_place(a: Vector, b: Vector, taken: Sequence[tuple[float, float]]) -> Vector:
    """First candidate position beside the line from ``a`` to ``b`` that is clear of ``taken`` [px].

    If there is none, the candidate with the largest distance to ``taken``.
    """
    along = (b - a) / max(hypot(*(b - a)), 1e-9)
    normal = np.array([-along[1], along[0]])
    best, most = (a + b) / 2.0, -1.0
    for share in (0.5, 0.4, 0.6, 0.3, 0.7):
        for side in (9.0, -9.0, 16.0, -16.0):
            at = a + share * (b - a) + side * normal
            room = min((hypot(*(at - other)) for other in taken), default=1e9)
            if room > CLEAR:
                return np.asarray(at)
            if room > most:
                best, most = at, room
    return np.asarray(best)


def legend_handles(robot: Robot, cables: Sequence[int]) -> list[Line2D]:
    """Entries of the legend: the cables, then a symbol for every kind of node."""
    handles = [
        Line2D([], [], color=cable_colour(c), linewidth=2.2, label=robot.cables[c].name)
        for c in cables
    ]
    for label, marker, size, edge, width in (
        ("winch", "o", 9.0, INK, 1.8),
        ("pulley", "o", 9.0, MUTED, 0.9),
        ("anchor", "s", 6.5, INK, 1.0),
    ):
        handles.append(
            Line2D(
                [], [], marker=marker, markersize=size, markerfacecolor="white",
                markeredgecolor=edge, markeredgewidth=width, linestyle="none", label=label,
            )
        )  # fmt: skip
    return handles


def _dress(axes: Axes, handles: list[Line2D], columns: int) -> None:
    """Add spines, ticks in millimetres, labels and the legend above the axes."""
    for side in ("right", "top"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set(color=RULE, linewidth=0.8)
    axes.tick_params(length=3, color=RULE, labelsize=FONT_SIZE - 1, labelcolor=MUTED)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
        axis.set_major_formatter(
            lambda value, _: f"{1e3 * value:.0f}".replace("-", "\N{MINUS SIGN}")
        )
    axes.set_xlabel("x [mm]", fontsize=FONT_SIZE, color=MUTED)
    axes.set_ylabel("y [mm]", fontsize=FONT_SIZE, color=MUTED)
    legend = axes.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns,
        frameon=False, fontsize=FONT_SIZE - 1, handlelength=1.4, columnspacing=1.3,
        labelcolor=MUTED, borderaxespad=0.2, borderpad=0.0,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)


def poses_text(robot: Robot, width: float) -> str:
    """Subtitle with the joint ranges drawn faded, without numbers if ``width`` is small [px]."""
    positions = robot.prismatic_joints
    ranges = [
        f"{joint.name} {joint.lower:g} to {joint.upper:g} m"
        if joint.name in positions
        else f"{joint.name} {degrees(joint.lower):.4g} to {degrees(joint.upper):.4g}°"
        for joint in robot.joints
    ]
    if not ranges:
        return "reference pose"
    text = "reference pose; faded: " + ", ".join(ranges).replace("-", "\N{MINUS SIGN}")
    fits = 0.55 * FONT_SIZE * len(text) < width - 32.0
    return text if fits else "reference pose; faded: ends of the joint ranges"
