"""What check_robot prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite, pi
from typing import TYPE_CHECKING, Final

import numpy as np

from cdrj_ros.estimation.encoder_errors import slips
from cdrj_ros.inspection.checks import Inspection, Suspicion
from cdrj_ros.inspection.shares import Cause, Shares
from cdrj_ros.model.prepared import Model
from cdrj_ros.report.parameters import CableTable, cable_tables, headline
from cdrj_ros.report.table import UNLIMITED
from cdrj_ros.robot.description import Robot

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

LEAST_WIDTH: Final = 132
"""Smallest width of the output; narrower terminals wrap its lines, and nothing is cut off."""

LEAST_SHARE: Final = 0.01
"""A cause with a smaller share in every element is not listed."""

NAMED: Final = 3
"""Number of causes for which the measurement is printed."""


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
    for sentence in (*mapping(robot), *_slips(inspection.model)):
        console.print(Text(sentence))
    for cable, table in zip(cables, tables, strict=True):
        console.print()
        wide.print(table)
        for fact in cable.facts:
            console.print(Text(f"  {fact}"))
    if shares is not None:
        _print_shares(inspection.model, shares, wide)
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


def _slips(model: Model) -> Iterator[str]:
    """What slips of every encoder do."""
    for one in slips(model):
        unit = "m" if one.axis in model.robot.prismatic_joints else "rad"
        parts = []
        if one.unseen > 0.0:
            parts.append(f"up to {one.unseen:.2g} {unit} ({one.tension:.2g} N) is not seen")
        if isfinite(one.unsure):
            parts.append(f"beyond {one.unsure:.2g} {unit}, if seen, makes all elements UNSURE")
        if parts:
            yield f"{one.axis}: a slip of its encoder {', '.join(parts)}"


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


def _print_shares(model: Model, shares: Shares, console: Console) -> None:
    """Print a table per cable, and the measurements that would help most."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    known = model.robot.uncertainty
    assumed = known is not None and len(known.parameters) > known.stated
    told: list[Cause] = []
    begin = 0
    for cable in model.robot.cables:
        part = slice(begin, begin + len(cable.element_names))
        begin = part.stop
        table = Table(
            title=f"{cable.name}: shares in the variance of the tensions [%]",
            title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False,
        )  # fmt: skip
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
    source = "the defaults of docs/uncertainty.md" if assumed else "the file"
    named = [cause for cause in shares.causes if cause in told][:NAMED]
    console.print(Text(f"These numbers make most of the uncertainty, by {source}; to halve it:"))
    for cause in named:
        console.print(Text(f"  {cause.what}: {cause.measure}"))
