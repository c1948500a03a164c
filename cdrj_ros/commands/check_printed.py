"""Output of ``check_robot`` in a terminal: a line per cable, or all about some cables."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from math import copysign, degrees, isfinite, pi
from typing import TYPE_CHECKING, Final

import numpy as np

from cdrj_ros.estimation.conditioner import slips
from cdrj_ros.foundation.output import counted, fixed
from cdrj_ros.inspection.poses import pose_text
from cdrj_ros.inspection.ranges import CableCheck, Extent, Inspection
from cdrj_ros.inspection.shares import Cause, Shares
from cdrj_ros.model.impossible import Suspicion
from cdrj_ros.model.packing import EFFORT, TENSION
from cdrj_ros.model.prepared import Model
from cdrj_ros.report.table import UNLIMITED, new_table
from cdrj_ros.robot.description import Cable, Motor, Robot

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


LEAST_WIDTH: Final = 132
"""Smallest width of the output; narrower terminals wrap its lines, and nothing is cut off."""

LEAST_SHARE: Final = 0.01
"""A cause with a smaller share in every element is not listed."""

NAMED: Final = 3
"""Number of causes for which the measurement is printed."""


LISTED: Final = 8
"""Number of suspicions and of remarks in the summary."""


def print_summary(
    inspection: Inspection, suspicions: Sequence[Suspicion], shares: Shares | None, name: str
) -> None:
    """Print a line per cable, the worst first.

    Args:
        inspection: the robot.
        suspicions: what was found.
        shares: causes of the uncertainty, if there are any.
        name: of the robot, as on the command line.
    """
    from rich.text import Text

    console = _console([table := _summary(inspection, suspicions, shares)])
    console.print(Text(headline(inspection), style="bold"))
    turns = sorted((one.angle.width / (2.0 * pi), one.name) for one in inspection.motors)
    if turns:
        least, most = (f"{count:.2f} ({motor})" for count, motor in (turns[0], turns[-1]))
        console.print(Text(f"turns of the motors that follow the joints: {least} to {most}"))
    console.print(table)
    if shares is not None:
        _print_measures(inspection.model, shares.causes, console)
    _print_suspicions(inspection.model.robot.name, suspicions, console, LISTED)
    console.print(Text(f"check_robot {name} --cable NAME,... prints all about some cables, --all"
                       " about all"))  # fmt: skip


def print_details(
    inspection: Inspection,
    suspicions: Sequence[Suspicion],
    shares: Shares | None,
    named: Collection[str],
) -> None:
    """Print all results about some cables as tables and sentences.

    Args:
        inspection: the robot.
        suspicions: what was found.
        shares: causes of the uncertainty, if there are any.
        named: names of the cables; with those of all, results about motors and joints follow, too.
    """
    from rich.text import Text

    robot = inspection.model.robot
    whole = len(named) == len(robot.cables)
    pairs = zip(robot.cables, inspection.cables, strict=True)
    cables = [pair for pair in pairs if pair[0].name in named]
    tables = [_table(robot, *cable) for cable in cables]
    console = _console(tables)
    console.print(Text(headline(inspection), style="bold"))
    if whole:
        for motor in inspection.motors:
            turns = motor.angle.width / (2.0 * pi)
            console.print(Text(f"motor {motor.name}: {turns:.2f} turns to follow the joints"))
        for sentence in (*mapping(robot), *_slips(inspection.model), *_corrections(robot)):
            console.print(Text(sentence))
    for cable, table in zip(cables, tables, strict=True):
        console.print()
        console.print(table)
        for fact in _facts(inspection, *cable):
            console.print(Text(f"  {fact}"))
    if shares is not None:
        _print_shares(inspection.model, shares, console, named)
    console.print()
    if not whole:
        suspicions = [one for one in suspicions if any(_about(one, name) for name in named)]
    _print_suspicions(robot.name, suspicions, console)


def _console(tables: Sequence[Table]) -> Console:
    """A console wide enough for some tables; sentences are not wrapped."""
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    unlimited = console.options.update(max_width=UNLIMITED)
    widths = [console.measure(table, options=unlimited).maximum for table in tables]
    width = max(console.width, LEAST_WIDTH, *widths)
    return Console(highlight=False, soft_wrap=True, width=width)


def _about(suspicion: Suspicion, cable: str) -> bool:
    """Whether a suspicion is about a cable, or about one of its nodes and elements."""
    places = suspicion.where.split(", ")
    return any(place == cable or place.startswith(f"{cable}/") for place in places)


def _summary(
    inspection: Inspection, suspicions: Sequence[Suspicion], shares: Shares | None
) -> Table:
    """A line per cable, the worst first.

    First are those with suspicions, then those of the largest standard deviation over tension, or
    of the largest loss where no number is uncertain.
    """
    from rich.text import Text

    table = new_table()
    table.add_column("cable")
    headings = ["length [mm]", "tension [N]", "worst [N]", "η at rest", "found"]
    for heading in headings + (["σ [N]", "mostly by"] if shares is not None else []):
        left = heading == "mostly by"
        table.add_column(Text(heading), justify="left" if left else "right", no_wrap=True)
    robot = inspection.model.robot
    rows: list[tuple[tuple[float, ...], list[str], bool]] = []
    for cable, part, check in zip(robot.cables, robot.parts, inspection.cables, strict=True):
        own = [one for one in suspicions if _about(one, cable.name)]
        grave = sum(one.grave for one in own)
        row = [
            cable.name,
            _shown(check.length, 1e3, 1),
            _shown(check.followed, 1.0, 2),
            f"{check.worst.high:.4g}",
            f"{check.transmission_at_rest.low:.3f}",
            str(len(own)) if own else "",
        ]
        worse = 1.0 - check.transmission_at_rest.low
        if shares is not None:
            stddev = shares.stddev[part]
            at = int(np.argmax(stddev))
            worse = float(stddev[at]) / max(check.followed.high, 1e-12)
            most = max(shares.causes, key=lambda one: one.share[part][at], default=None)
            by = f"{most.what}, {most.share[part][at]:.0%}" if most and stddev[at] > 0.0 else ""
            row += [f"{stddev[at]:.3g}", by]
        rows.append(((-grave, -worse), row, bool(grave)))
    for _, row, grave_row in sorted(rows, key=lambda one: one[0]):
        table.add_row(*map(Text, row), style="bold yellow" if grave_row else None)
    return table


def _print_suspicions(
    robot: str, suspicions: Sequence[Suspicion], console: Console, most: int | None = None
) -> None:
    """Print suspicions, then remarks, at most ``most`` texts of each, each with all its places."""
    from rich.text import Text

    grave = [suspicion for suspicion in suspicions if suspicion.grave]
    remarks = [suspicion for suspicion in suspicions if not suspicion.grave]
    if not grave:
        console.print(Text(f"{robot}: nothing suspicious", style="green"))
    for title, style, entries in (
        ("suspicious", "bold yellow", grave),
        ("good to know", "bold", remarks),
    ):
        if entries:
            console.print(Text(f"{title}:", style=style))
        alike: dict[str, list[str]] = {}
        for entry in entries:
            alike.setdefault(entry.text, []).append(entry.where)
        shown = list(alike.items())[:most]
        for text, where in shown:
            console.print(Text("  ").append(", ".join(where), style="bold").append(f": {text}"))
        if more := len(alike) - len(shown):
            console.print(Text(f"  and {more} more: --all prints them"))


def headline(inspection: Inspection) -> str:
    """The robot and what it consists of."""
    robot = inspection.model.robot
    layout = inspection.model.layout
    parts = [
        counted(len(robot.motors), "motor"),
        counted(len(robot.joints), "joint"),
        counted(len(robot.cables), "cable"),
        counted(len(layout.elements), "element"),
        counted(len(layout.pulleys), "pulley"),
    ]
    return f"{robot.name}: {', '.join(parts)}"


def mapping(robot: Robot) -> Iterator[str]:
    """What published positions and efforts mean, for every axis where they are converted."""
    for axis in robot.axes:
        sensor = axis.sensor
        prismatic = axis.name in robot.prismatic_joints
        angle, effort = ("position [m]", "[N]") if prismatic else ("angle [rad]", "[N m]")
        parts = []
        if sensor.scale != 1.0 or sensor.offset or sensor.corrected_at:
            text = f"{angle} = {sensor.scale:.6g} * published"
            text += f" {sensor.offset:+.4g}" if sensor.offset else ""
            parts.append(text + (" + correction" if sensor.corrected_at else ""))
        if axis.effort_scale != 1.0:
            parts.append(f"effort {effort} = {axis.effort_scale:.6g} * published")
        if parts and isinstance(axis, Motor):
            parts.append(f"efforts are {_effort_of(axis)} in the sense of the published position")
        if parts:
            yield f"{axis.name}: {', '.join(parts)}"


def _effort_of(motor: Motor) -> str:
    """What exerts the published efforts by the signs of a motor's entry.

    Efforts and positions of one drive have one sense of rotation: with a negative ``scale``, and
    ``effort_scale`` of the same sign, both are turned.
    """
    turned = copysign(1.0, motor.effort_scale) * copysign(1.0, motor.sensor.scale)
    return "torques of the cables" if turned * motor.effort_sign > 0.0 else "the motor's torques"


def _slips(model: Model) -> Iterator[str]:
    """What slips of every encoder do."""
    for one in slips(model):
        unit = model.robot.unit_of(one.axis)
        parts = []
        if one.unseen > 0.0:
            parts.append(f"up to {one.unseen:.2g} {unit} ({one.tension:.2g} N) is not seen")
        if isfinite(one.unsure):
            parts.append(f"beyond {one.unsure:.2g} {unit}, if seen, makes its cables UNSURE")
        if parts:
            yield f"{one.axis}: a slip of its encoder {', '.join(parts)}"


def _corrections(robot: Robot) -> Iterator[str]:
    """Learned corrections, and where they are not extrapolated."""
    newtons = {f"{EFFORT}/{name}" for name in robot.prismatic_joints}
    for one in robot.residuals:
        unit = "N" if one.output.startswith(TENSION) or one.output in newtons else "N m"
        ranges = []
        for name, (low, high) in one.inputs.items():
            of = unit if name == one.output else robot.unit_of(name)
            ranges.append(f"{name} {low:.4g} … {high:.4g} {of}")
        yield (
            f"{one.output}: learned correction of at most {one.bound:.2g} {unit}, standard "
            f"deviation {one.stddev:.2g} {unit}; trusted within {', '.join(ranges)}"
        )


def _table(robot: Robot, cable: Cable, check: CableCheck) -> Table:
    """The table of one cable for the terminal."""
    from rich.text import Text  # markup would interpret [mm] as a style

    table = new_table(cable.name)
    moving = _moving(check)
    names = [robot.joints[j].name for j in moving]
    arms = [f"arm {name} [{'-' if name in robot.prismatic_joints else 'mm'}]" for name in names]
    table.add_column("")
    for heading in ("length [mm]", *arms, "wrap [°]", "η at rest", "η sliding", "passes [mm]"):
        table.add_column(Text(heading), justify="right", no_wrap=True)
    *parts, whole = _rows(robot, cable, check, moving)
    for k, row in enumerate(parts):
        table.add_row(*row, style="dim" if k % 2 else None)
    table.add_section()
    table.add_row(*whole, style="bold")
    return table


def _moving(check: CableCheck) -> list[int]:
    """Joints that move any part of a cable."""
    every = [element.moment_arm for element in check.elements]
    return [
        j for j, arms in enumerate(zip(*every, strict=True)) if any(a.low or a.high for a in arms)
    ]


def _rows(
    robot: Robot, cable: Cable, check: CableCheck, moving: Sequence[int]
) -> Iterator[tuple[str, ...]]:
    """Elements and pulleys in the order in which the cable meets them, then the whole cable."""
    blank = [""] * (1 + len(moving))
    for k, element in enumerate(check.elements):
        arms = _arms(robot, element.moment_arm, moving)
        yield (f"element {k + 1}", _shown(element.length, 1e3, 1), *arms, "", "", "", "")
        if k < len(check.pulleys):
            pulley = check.pulleys[k]
            yield (
                f"{cable.pulleys[k].kind} {k + 2}",
                *blank,
                _shown(pulley.wrap, 180.0 / pi, 1),
                _shown(pulley.transmission_at_rest, 1.0, 3),
                _shown(pulley.transmission_sliding, 1.0, 3),
                f"{1e3 * pulley.passing:.2f}",
            )
    yield (
        "whole cable",
        _shown(check.length, 1e3, 1),
        *_arms(robot, check.moment_arm, moving),
        "",
        _shown(check.transmission_at_rest, 1.0, 3),
        _shown(check.transmission_sliding, 1.0, 3),
        "",
    )


def _arms(robot: Robot, arms: Sequence[Extent], moving: Sequence[int]) -> list[str]:
    slides = [joint.name in robot.prismatic_joints for joint in robot.joints]
    return [_shown(arms[j], 1.0, 3) if slides[j] else _shown(arms[j], 1e3, 2) for j in moving]


def _shown(extent: Extent, factor: float, decimals: int) -> str:
    """``40.9`` or ``0.6 … 78.5``."""
    low, high = (fixed(factor * value, decimals) for value in (extent.low, extent.high))
    return low if low == high else f"{low} … {high}"


def _facts(inspection: Inspection, cable: Cable, check: CableCheck) -> Iterator[str]:
    """Sentences on its stiffness and tensions."""
    robot = inspection.model.robot
    yield (
        f"{elasticity_text(cable)}, {1e-3 * check.stiffness:.3g} N/mm, "
        f"preload {cable.preload:g} N, law {cable.law}"
    )
    limit = f"; max_tension {cable.maximum_tension:g} N" if isfinite(cable.maximum_tension) else ""
    where = pose_text(robot, check.worst.high_at, cable)
    yield (
        f"tension when the motors follow: {_shown(check.followed, 1.0, 2)} N; worst "
        f"{check.worst.high:.4g} N, at the pulling end with every pulley slipping"
        f"{f' ({where})' if where else ''}{limit}"
    )
    still = [
        f"{joint.name} moved by {1e3 * way:.2f} mm"
        if joint.name in robot.prismatic_joints
        else f"{joint.name} turned by {degrees(way):.2f}°"
        for joint, way in zip(robot.joints, check.slack_after, strict=True)
        if isfinite(way)
    ]
    if still and cable.preload > 0.0:
        yield f"with the motors held, its preload is lost with {' or '.join(still)}"


def elasticity_text(cable: Cable) -> str:
    """``EA 6283 N``, followed by bedding of the strands and creep where a cable has them."""
    text = f"EA {cable.axial_stiffness:.4g} N"
    if cable.bedding_strain:
        text += f", bedding {cable.bedding_strain:.3g} at {cable.bedding_tension:.3g} N"
    if cable.creep_share:
        text += f", creep {cable.creep_share:.3g} in {cable.creep_time:.3g} s"
    if isfinite(cable.flow_time):
        text += f", flow in {cable.flow_time:.3g} s"
    return text


def _print_shares(model: Model, shares: Shares, console: Console, named: Collection[str]) -> None:
    """Print a table per cable, and the measurements that would help most."""
    from rich.text import Text

    told: list[Cause] = []
    for cable, part in zip(model.robot.cables, model.robot.parts, strict=True):
        if cable.name not in named:
            continue
        table = new_table(f"{cable.name}: shares in the variance of the tensions [%]")
        table.add_column("")
        for k in range(len(cable.element_names)):
            table.add_column(str(k + 1), justify="right", no_wrap=True)
        for cause in shares.causes:
            if np.abs(cause.share[part]).max() >= LEAST_SHARE:
                table.add_row(Text(cause.what), *(f"{100 * one:.0f}" for one in cause.share[part]))
                told += [] if cause in told else [cause]
        table.add_section()
        table.add_row("σ [N]", *(f"{one:.3g}" for one in shares.stddev[part]), style="bold")
        console.print()
        console.print(table)
    _print_measures(model, [cause for cause in shares.causes if cause in told], console)


def _print_measures(model: Model, causes: Sequence[Cause], console: Console) -> None:
    """Print the measurements that would help most."""
    from rich.text import Text

    known = model.robot.uncertainty
    assumed = known is not None and len(known.parameters) > known.stated
    source = "the defaults of docs/estimation.md" if assumed else "the file"
    console.print(Text(f"These numbers make most of the uncertainty, by {source}; to halve it:"))
    for cause in causes[:NAMED]:
        console.print(Text(f"  {cause.what}: {cause.measure}"))
