"""What check_robot prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import degrees, isfinite, pi
from typing import TYPE_CHECKING, Final

from cdrj_ros.commands.check_robot_shares import print_shares
from cdrj_ros.foundation.text import counted, fixed
from cdrj_ros.inspection.checks import CableCheck, Extent, Inspection, pose_text
from cdrj_ros.inspection.shares import Shares
from cdrj_ros.inspection.suspicions import Suspicion
from cdrj_ros.report.columns import UNLIMITED
from cdrj_ros.robot.description import Cable, Robot

if TYPE_CHECKING:
    from rich.table import Table


LEAST_WIDTH: Final = 132
"""Smallest width of the output; narrower terminals wrap its lines, and nothing is cut off."""


def print_inspection(
    inspection: Inspection, suspicions: Sequence[Suspicion], shares: Shares | None
) -> None:
    """Print the results as tables and sentences."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    robot = inspection.model.robot
    tables = [_table(inspection, cable) for cable in inspection.cables]
    unlimited = console.options.update(max_width=UNLIMITED)
    widths = [console.measure(table, options=unlimited).maximum for table in tables]
    wide = Console(highlight=False, width=max(console.width, LEAST_WIDTH, *widths))
    console.print(Text(_headline(inspection), style="bold"))
    for motor in inspection.motors:
        turns = motor.angle.width / (2.0 * pi)
        console.print(Text(f"motor {motor.name}: {turns:.2f} turns to follow the joints"))
    for cable, table in zip(inspection.cables, tables, strict=True):
        console.print()
        wide.print(table)
        for fact in _facts(inspection, cable):
            console.print(Text(f"  {fact}"))
    if shares is not None:
        print_shares(inspection.model, shares, wide)
    console.print()
    grave = [suspicion for suspicion in suspicions if suspicion.grave]
    remarks = [suspicion for suspicion in suspicions if not suspicion.grave]
    if not grave:
        console.print(Text(f"{robot.name}: nothing suspicious", style="green"))
    for title, style, entries in (
        ("suspicious", "bold yellow", grave),
        ("good to know", "bold", remarks),
    ):
        if entries:
            console.print(Text(f"{title}:", style=style))
        for entry in entries:
            line = Text("  ")
            line.append(entry.where, style="bold").append(f": {entry.text}")
            console.print(line)


def _headline(inspection: Inspection) -> str:
    robot = inspection.model.robot
    layout = inspection.model.layout

    parts = [
        counted(len(robot.motors), "motor"),
        counted(len(robot.joints), "joint"),
        counted(len(robot.cables), "cable"),
        counted(len(layout.elements), "element"),
        counted(len(layout.pulleys), "pulley"),
    ]
    loads = "".join(
        f", load {value:g} {'N' if name in robot.prismatic_joints else 'N m'} on {name}"
        for name, value in inspection.loads.items()
    )
    return f"{robot.name}: {', '.join(parts)}; {len(inspection.poses)} poses{loads}"


def _table(inspection: Inspection, cable: CableCheck) -> Table:
    """Elements and pulleys in the order in which the cable meets them."""
    from rich import box
    from rich.table import Table
    from rich.text import Text  # markup would interpret [mm] as a style

    robot = inspection.model.robot
    table = Table(
        title=cable.name, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD,
        pad_edge=False,
    )  # fmt: skip
    table.add_column("")
    table.add_column(Text("length [mm]"), justify="right", no_wrap=True)
    for joint in robot.joints:
        unit = "-" if joint.name in robot.prismatic_joints else "mm"
        table.add_column(Text(f"arm {joint.name} [{unit}]"), justify="right", no_wrap=True)
    for heading in ("wrap [°]", "η at rest", "η sliding", "passes [mm]"):
        table.add_column(Text(heading), justify="right", no_wrap=True)
    blank = [""] * (1 + len(robot.joints))
    for k, element in enumerate(cable.elements):
        arms = _arms(robot, element.moment_arm)
        table.add_row(f"element {k + 1}", _shown(element.length, 1e3, 1), *arms)
        if k < len(cable.pulleys):
            pulley = cable.pulleys[k]
            table.add_row(
                f"{_cable_of(robot, cable).pulleys[k].kind} {k + 2}",
                *blank,
                _shown(pulley.wrap, 180.0 / pi, 1),
                _shown(pulley.transmission_at_rest, 1.0, 3),
                _shown(pulley.transmission_sliding, 1.0, 3),
                f"{1e3 * pulley.passing:.2f}",
                style="dim",
            )
    table.add_section()
    table.add_row(
        "whole cable",
        _shown(cable.length, 1e3, 1),
        *_arms(robot, cable.moment_arm),
        "",
        _shown(cable.transmission_at_rest, 1.0, 3),
        _shown(cable.transmission_sliding, 1.0, 3),
        "",
        style="bold",
    )
    return table


def _arms(robot: Robot, arms: Sequence[Extent]) -> list[str]:
    positions = robot.prismatic_joints
    return [
        _shown(arm, 1.0, 3) if joint.name in positions else _shown(arm, 1e3, 2)
        for joint, arm in zip(robot.joints, arms, strict=True)
    ]


def _shown(extent: Extent, factor: float, decimals: int) -> str:
    """``40.9`` or ``0.6 … 78.5``."""
    low, high = (fixed(factor * value, decimals) for value in (extent.low, extent.high))
    return low if low == high else f"{low} … {high}"


def _cable_of(robot: Robot, check: CableCheck) -> Cable:
    """The cable that was checked."""
    return next(cable for cable in robot.cables if cable.name == check.name)


def _facts(inspection: Inspection, check: CableCheck) -> Iterator[str]:
    robot = inspection.model.robot
    cable = _cable_of(robot, check)
    yield (
        f"EA {cable.axial_stiffness:.4g} N, {1e-3 * check.stiffness:.3g} N/mm, "
        f"preload {cable.preload:g} N, law {cable.law}"
    )
    limit = f"; max_tension {cable.maximum_tension:g} N" if isfinite(cable.maximum_tension) else ""
    loaded = "under the load" if inspection.loads else "when the motors follow"
    where = pose_text(robot, check.worst.high_at)
    yield (
        f"tension {loaded}: {_shown(check.followed, 1.0, 2)} N; worst {check.worst.high:.4g} N, at "
        f"the pulling end with every pulley slipping{f' ({where})' if where else ''}{limit}"
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
