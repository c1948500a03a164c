"""A picture of a robot's cables: where they run, and how that changes over the joint ranges.

Cables given by positions are drawn to scale: the reference pose in full colour, the ends of every
joint's range faded.  Cables given by spans have no shape; they are drawn unrolled, as a straight
line with their pulleys on it.

Importing this module imports matplotlib, which is slow; import it where pictures are made.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import cos, degrees, hypot, pi, sin
from typing import Final

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Circle, Polygon
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from cdrj_ros.foundation.files import replacing
from cdrj_ros.inspection.ranges import CableCheck, Inspection
from cdrj_ros.report.pose import Pose, cable_line, centre_of, pose_of, strands_and_arcs
from cdrj_ros.robot.description import Anchor, Cable, Robot, Winch

Vector = NDArray[np.float64]
Points = NDArray[np.float64]

CABLE_COLOURS: Final = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#5e4fa2", "#7f7f7f",
)  # fmt: skip
"""After Okabe and Ito: told apart by colour-blind readers.  More cables begin anew."""

INK: Final = "#1c1c1a"
MUTED: Final = "#62625d"
RULE: Final = "#b9b9b5"
BODY: Final = "#e9e7df"

LARGEST: Final = (900.0, 720.0)
"""Room for the cables of a picture [px]."""

NARROWEST: Final = 480.0
"""Width of a picture below which its legend has no room [px]."""

FONT_SIZE: Final = 12.0
"""Size of text [px]."""

GHOST: Final = 0.28
"""Opacity of cables in poses other than the reference."""

MOST_GHOSTS: Final = 6
"""Joints of which the ends of the range are drawn."""

_TITLE: Final = 34.0
_LEGEND_COLUMN: Final = 128.0
_UNROLLED_HEAD: Final = 34.0
_UNROLLED_ROW: Final = 128.0


def draw_robot(inspection: Inspection, size: tuple[float, float] | None = None) -> Figure:
    """A robot's cables, by positions to scale, by spans unrolled; both where it has both.

    Args:
        inspection: of ``cdrj_ros.inspection.ranges``.
        size: width and height [px]; one unit of the drawing is one pixel.  Default: what fits it.
            Below some 600 px labels of long cables come to lie on each other.
    """
    robot = inspection.model.robot
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
        handles = _handles(robot, placed)
        columns = max(2, int(width // _LEGEND_COLUMN))
        head = _TITLE + 20.0 + 19.0 * -(-len(handles) // columns)
        axes = _axes(figure, (64.0, below + 46.0, width - 78.0, height - below - 46.0 - head))
        _draw_placed(axes, inspection, placed, handles, columns)
        figure.text(
            16.0 / width, 1.0 - _TITLE / height, _poses_text(robot, width), fontsize=FONT_SIZE - 1,
            color=MUTED, va="top", parse_math=False,
        )  # fmt: skip
    if unrolled:
        axes = _axes(figure, (14.0, 4.0, width - 28.0, below - _UNROLLED_HEAD))
        _draw_unrolled(axes, inspection, unrolled)
    figure.text(
        16.0 / width, 1.0 - 12.0 / height, robot.name, fontsize=FONT_SIZE + 3, color=INK,
        weight="bold", va="top", parse_math=False,
    )  # fmt: skip
    return figure


def _axes(figure: Figure, box: tuple[float, float, float, float]) -> Axes:
    """Axes in pixels: left, bottom, width, height."""
    width, height = 72.0 * figure.get_size_inches()
    left, bottom, wide, high = box
    wide, high = max(wide, 10.0), max(high, 10.0)
    return figure.add_axes((left / width, bottom / height, wide / width, high / height))


def _fitting_size(
    inspection: Inspection, placed: Sequence[int], below: float
) -> tuple[float, float]:
    """As large as LARGEST allows with the proportions of what is drawn."""
    widest, tallest = LARGEST
    if not placed:
        return widest, below + _TITLE
    robot = inspection.model.robot
    points = np.vstack(
        [
            cable_line(inspection, pose_of(inspection, pose), c)
            for pose in [inspection.poses[0], *_ghost_poses(robot)]
            for c in placed
        ]
    )
    across, up = np.maximum(np.ptp(points, axis=0), 1e-6)
    scale = min(widest / across, tallest / up)
    return max(NARROWEST, scale * across + 78.0), scale * up + 130.0 + below


def write_png(figure: Figure, path: str) -> None:
    """Write a picture at twice its size, for screens and print, whole or not at all.

    Raises:
        OSError: the file cannot be written.
    """
    with replacing(path) as stream:
        figure.savefig(stream, format="png", dpi=144.0)


def _colour(index: int) -> str:
    return CABLE_COLOURS[index % len(CABLE_COLOURS)]


# --- by positions ---------------------------------------------------------------------------------


def _ghost_poses(robot: Robot) -> Iterator[Vector]:
    """Every joint at the ends of its range, the others in the reference."""
    reference = np.array([joint.reference_angle for joint in robot.joints])
    for j, joint in enumerate(robot.joints[:MOST_GHOSTS]):
        for end in (joint.lower, joint.upper):
            pose = reference.copy()
            pose[j] = end
            if not np.array_equal(pose, reference):
                yield pose


def _draw_placed(
    axes: Axes, inspection: Inspection, cables: Sequence[int], handles: list[Line2D], columns: int
) -> None:
    robot = inspection.model.robot
    reference = np.array([joint.reference_angle for joint in robot.joints])
    poses = [pose_of(inspection, angle) for angle in _ghost_poses(robot)]
    poses.append(pose_of(inspection, reference))
    for k, pose in enumerate(poses):
        bold = k == len(poses) - 1
        _draw_bodies(axes, robot, pose, cables, bold)
        for c in cables:
            line = cable_line(inspection, pose, c)
            axes.plot(
                line[:, 0], line[:, 1], color=_colour(c), linewidth=1.9 if bold else 1.0,
                alpha=1.0 if bold else GHOST, zorder=5 if bold else 3,
                solid_joinstyle="round", solid_capstyle="round",
            )  # fmt: skip
            _draw_nodes(axes, robot.cables[c], pose, line, _colour(c), bold)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.04)
    axes.autoscale_view()
    axes.apply_aspect()  # numbers are placed in pixels
    _number_elements(axes, inspection, poses[-1], cables)
    _dress(axes, handles, columns)


def _carried(
    robot: Robot, pose: Pose, cables: Sequence[int]
) -> dict[str, list[tuple[float, float]]]:
    """Outlines of the nodes that each frame carries [m]."""
    carried: dict[str, list[tuple[float, float]]] = {}
    for c in cables:
        for node in robot.cables[c].nodes:
            if node.place is None:
                continue
            x, y = centre_of(pose, node.place)
            angles = np.linspace(0.0, 2.0 * pi, 24) if node.radius > 0.0 else np.zeros(1)
            circle = [(x + node.radius * cos(a), y + node.radius * sin(a)) for a in angles]
            carried.setdefault(node.place.frame, []).extend(circle)
    return carried


def _draw_bodies(axes: Axes, robot: Robot, pose: Pose, cables: Sequence[int], bold: bool) -> None:
    """Moving frames as the hull of what they carry, joints' axes, rolling circles."""
    carried = _carried(robot, pose, cables)
    for frame in robot.frames:
        x, y, _ = pose.frames[frame.name]
        if frame.motion == "fixed" or frame.parent is None:
            continue
        points = carried.get(frame.name, [])
        if frame.motion == "revolute":
            points = [*points, (x, y)]
        if frame.name in carried:
            hull = _hull(points)
            axes.add_patch(
                Polygon(
                    hull, closed=True, facecolor=BODY, edgecolor=RULE, linewidth=0.8,
                    alpha=0.9 if bold else 0.3, zorder=1 if bold else 0.5, joinstyle="round",
                )
            )  # fmt: skip
        if frame.motion == "rolling":
            px, py, _ = pose.frames[frame.parent]
            for centre in ((px + frame.x, py + frame.y), (x, y)):
                axes.add_patch(
                    Circle(
                        centre, frame.rolling_radius, fill=False, edgecolor=MUTED,
                        linewidth=0.9, linestyle=(0, (5, 3)), alpha=0.8 if bold else 0.2,
                        zorder=1.5,
                    )
                )  # fmt: skip
        elif frame.motion == "revolute":
            axes.plot(
                [x], [y], marker="+", markersize=7, color=INK, alpha=1.0 if bold else 0.3,
                markeredgewidth=1.1, zorder=6 if bold else 2,
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


def _draw_nodes(
    axes: Axes, cable: Cable, pose: Pose, line: Points, colour: str, bold: bool
) -> None:
    ends = (line[0].tolist(), line[-1].tolist())
    for node in cable.nodes:
        assert node.place is not None
        if not bold and node.place.frame == "base":
            continue  # it has not moved
        x, y = centre_of(pose, node.place)
        alpha = 1.0 if bold else GHOST
        zorder = 4 if bold else 2
        if isinstance(node, Winch):
            axes.add_patch(
                Circle(
                    (x, y), node.radius, facecolor="white", edgecolor=INK, linewidth=1.6,
                    alpha=alpha, zorder=zorder,
                )
            )  # fmt: skip
            axes.add_patch(
                Circle((x, y), 0.35 * node.radius, facecolor=INK, alpha=alpha, zorder=zorder)
            )
        elif isinstance(node, Anchor):
            if node.radius > 0.0:  # a sector: the square where the cable comes to lie on it
                x, y = ends[0 if node is cable.nodes[0] else 1]
                axes.add_patch(
                    Circle(
                        centre_of(pose, node.place), node.radius, fill=False, edgecolor=colour,
                        linewidth=1.2,
                        linestyle=(0, (2, 2)), alpha=alpha, zorder=zorder,
                    )
                )  # fmt: skip
            axes.plot(
                [x], [y], marker="s", markersize=6 if bold else 4, color=colour, alpha=alpha,
                markeredgecolor=INK, markeredgewidth=0.8, zorder=7 if bold else 3,
            )  # fmt: skip
        else:
            axes.add_patch(
                Circle(
                    (x, y), node.radius, facecolor="white", edgecolor=MUTED, linewidth=0.9,
                    alpha=alpha, zorder=zorder,
                )
            )  # fmt: skip
            axes.plot([x], [y], marker="o", markersize=2.2, color=MUTED, alpha=alpha, zorder=zorder)


def _number_elements(axes: Axes, inspection: Inspection, pose: Pose, cables: Sequence[int]) -> None:
    """Numbers beside the elements, each pushed off its line until it stands clear of the others."""
    to_pixels = axes.transData.transform
    taken: list[tuple[float, float]] = []
    for c in cables:
        for e, (start, end, _) in enumerate(strands_and_arcs(inspection, pose, c)):
            a, b = to_pixels([start, end])
            along = (b - a) / max(hypot(*(b - a)), 1e-9)
            normal = np.array([-along[1], along[0]])
            best, most = (a + b) / 2.0, -1.0
            for share in (0.5, 0.4, 0.6, 0.3, 0.7):
                for side in (9.0, -9.0, 16.0, -16.0):
                    at = a + share * (b - a) + side * normal
                    room = min((hypot(*(at - other)) for other in taken), default=1e9)
                    if room > most:
                        best, most = at, room
                    if room > 15.0:
                        break
                if most > 15.0:
                    break
            taken.append((float(best[0]), float(best[1])))
            x, y = axes.transData.inverted().transform(best)
            text = axes.text(
                x, y, str(e + 1), fontsize=FONT_SIZE - 2, color=_colour(c), ha="center",
                va="center", weight="bold", zorder=9,
            )  # fmt: skip
            text.set_path_effects([patheffects.withStroke(linewidth=2.5, foreground="white")])


def _handles(robot: Robot, cables: Sequence[int]) -> list[Line2D]:
    """The legend's entries: the cables, then what the kinds of nodes look like."""
    handles = [
        Line2D([], [], color=_colour(c), linewidth=2.2, label=robot.cables[c].name) for c in cables
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


def _poses_text(robot: Robot, width: float) -> str:
    """What is drawn faded, as far as there is room [px] to say it."""
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


# --- by spans -------------------------------------------------------------------------------------

_NODE: Final = 13.0
"""Radius of a pulley in an unrolled drawing [px]."""

_LEAST: Final = 66.0
"""Shortest element of an unrolled drawing: room for its label [px]."""


def _draw_unrolled(axes: Axes, inspection: Inspection, cables: Sequence[int]) -> None:
    """Every cable a straight line, spans to scale where there is room for their labels."""
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
        axes.plot([x[0], x[-1]], [y, y], color=_colour(c), linewidth=2.2, zorder=2)
        axes.text(
            left - 16.0, y + 44.0, robot.cables[c].name, fontsize=FONT_SIZE + 1, color=_colour(c),
            weight="bold", parse_math=False,
        )  # fmt: skip
        _unrolled_elements(axes, check, x, y, _colour(c))
        _unrolled_nodes(axes, robot.cables[c], check, x, y, _colour(c))
    scale = ", to scale" if to_scale else ", short ones drawn longer"
    note = f"unrolled; below the line free spans [mm]{scale}; above it wrap angles"
    if 0.55 * FONT_SIZE * len(note) > box.width:
        note = "unrolled; free spans [mm], wrap angles"
    axes.text(
        box.width, box.height + 18.0, note, fontsize=FONT_SIZE - 1,
        color=MUTED, ha="right",
    )  # fmt: skip


def _laid_out(spans: Sequence[float], room: float) -> tuple[Vector, bool]:
    """Drawn lengths [px] that fill the room, none shorter than its label, and if all are true."""
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
    a, b = f"{low:.{decimals}f}", f"{high:.{decimals}f}"
    return a if a == b else f"{a}–{b}"


def _unrolled_elements(axes: Axes, check: CableCheck, x: Vector, y: float, colour: str) -> None:
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
            wrap = check.pulleys[pulley].wrap
            pulley += 1
            axes.add_patch(
                Circle((x[k], y), _NODE, facecolor="white", edgecolor=RULE, linewidth=1.2, zorder=3)
            )
            # the wrapped arc, symmetric about the top; the widest faded, the narrowest full
            for angle, alpha, width in ((wrap.high, 0.35, 3.2), (wrap.low, 1.0, 3.2)):
                half = min(0.5 * degrees(angle), 180.0)
                axes.add_patch(
                    Arc(
                        (x[k], y), 2.0 * _NODE, 2.0 * _NODE, theta1=90.0 - half,
                        theta2=90.0 + half, color=colour, linewidth=width, alpha=alpha, zorder=3.5,
                    )
                )  # fmt: skip
            text = _range_text(degrees(wrap.low), degrees(wrap.high), 1)
            axes.text(
                x[k], y + 24.0, f"{text}°", fontsize=FONT_SIZE - 1,
                color=INK if "–" in text else MUTED, weight="bold" if "–" in text else "normal",
                ha="center", va="center",
            )  # fmt: skip
            axes.text(
                x[k], y, str(k + 1), fontsize=FONT_SIZE - 2, color=MUTED, ha="center",
                va="center", zorder=4,
            )  # fmt: skip
