"""What check_robot prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import pi
from typing import TYPE_CHECKING, Final

from cdrj_ros.commands.check_robot_shares import print_shares
from cdrj_ros.inspection.checks import Inspection, Suspicion
from cdrj_ros.inspection.shares import Shares
from cdrj_ros.report.parameters import CableTable, cable_tables, headline
from cdrj_ros.report.table import UNLIMITED
from cdrj_ros.robot.description import Robot

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
    cables = cable_tables(inspection)
    tables = [_table(cable) for cable in cables]
    unlimited = console.options.update(max_width=UNLIMITED)
    widths = [console.measure(table, options=unlimited).maximum for table in tables]
    wide = Console(highlight=False, width=max(console.width, LEAST_WIDTH, *widths))
    console.print(Text(headline(inspection), style="bold"))
    for motor in inspection.motors:
        turns = motor.angle.width / (2.0 * pi)
        console.print(Text(f"motor {motor.name}: {turns:.2f} turns to follow the joints"))
    for conversion in mapping(robot):
        console.print(Text(conversion))
    for cable, table in zip(cables, tables, strict=True):
        console.print()
        wide.print(table)
        for fact in cable.facts:
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
        if parts:
            yield f"{axis.name}: {', '.join(parts)}"


def _table(cable: CableTable) -> Table:
    """The table of one cable for the terminal."""
    from rich import box
    from rich.table import Table
    from rich.text import Text  # markup would interpret [mm] as a style

    table = Table(
        title=cable.name, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD,
        pad_edge=False,
    )  # fmt: skip
    table.add_column("")
    for heading in cable.headings[1:]:
        table.add_column(Text(heading), justify="right", no_wrap=True)
    for k, row in enumerate(cable.rows[:-1]):
        table.add_row(*row, style="dim" if k % 2 else None)
    table.add_section()
    table.add_row(*cable.rows[-1], style="bold")
    return table
