"""The comparison as a table: drawn in a terminal, plain columns elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TextIO

from cdrj_ros.estimation.comparison import QUANTITIES, quantity_of
from cdrj_ros.estimation.metrics import ChannelError, mean_over_channels
from cdrj_ros.report.numbers import (
    decimals_for,
    format_number,
    format_percent,
    format_r2,
    scale_for,
)

if TYPE_CHECKING:
    from rich.table import Table

HEADINGS: Final = ("mean |error|", "mean rel.", "RMSE", "max |error|", "R²")
"""Headings of the figures, in the order of metrics.FIGURES."""

SUMMARY_LABELS: Final[Mapping[str, str]] = {
    "tension": "all elements",
    "nodal_force": "all nodes",
    "friction": "all nodes",
    "effort": "all efforts",
}
"""Label of each quantity's last line, the mean over its channels."""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    """Full channel name, empty in a group's last line."""
    label: str
    """What is printed in front: the name without its prefix."""
    cells: tuple[str, ...]
    """Formatted figures, one for each of HEADINGS."""
    aside: str
    """What the caller wants beside it, for example a published figure; may be empty."""


@dataclass(frozen=True)
class Group:
    """The lines of one quantity."""

    quantity: str
    """Key of QUANTITIES."""
    title: str
    """Quantity and the unit of its errors: "Tension [N]", "Effort [mN·m]"."""
    rows: tuple[Row, ...]
    """One line per channel, in the given order."""
    summary: Row | None
    """The mean over the channels; None where there is only one."""


def table_groups(
    errors: Mapping[str, ChannelError], *, beside: Mapping[str, str] | None = None
) -> tuple[Group, ...]:
    """The table's text, grouped by quantity in the order of QUANTITIES.

    Args:
        errors: figures by channel name.
        beside: text for the last column by channel name; a quantity's prefix alone ("tension")
            names its last line.

    Raises:
        ValueError: a channel name without a known prefix.
    """
    asides = beside or {}
    groups = []
    for quantity, (title, unit) in QUANTITIES.items():
        members = {name: e for name, e in errors.items() if quantity_of(name) == quantity}
        if not members:
            continue
        overall = mean_over_channels(members.values())
        factor, scaled_unit = scale_for(overall.max_abs_error, unit)
        decimals = _decimals(members.values(), factor)
        rows = tuple(
            Row(
                name,
                name.removeprefix(f"{quantity}/"),
                _cells(error, factor, decimals),
                asides.get(name, ""),
            )
            for name, error in members.items()
        )
        summary = None
        if len(rows) > 1:
            cells = _cells(overall, factor, decimals)
            summary = Row("", SUMMARY_LABELS[quantity], cells, asides.get(quantity, ""))
        groups.append(Group(quantity, f"{title} [{scaled_unit}]", rows, summary))
    return tuple(groups)


def rich_table(
    errors: Mapping[str, ChannelError],
    *,
    title: str = "",
    beside: Mapping[str, str] | None = None,
    beside_heading: str = "",
) -> Table:
    """The table for a terminal; arguments as for ``print_table``."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title or None, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("")
    for heading in HEADINGS:
        table.add_column(heading, justify="right", no_wrap=True)
    if beside:
        table.add_column(beside_heading)
    for group in table_groups(errors, beside=beside):
        table.add_row(Text(group.title, style="bold"))
        for row in group.rows:
            table.add_row(*map(Text, _columns(row, "  ", bool(beside))))
        if group.summary is not None:
            table.add_row(*map(Text, _columns(group.summary, "  ", bool(beside))), style="bold")
        table.add_section()
    return table


def plain_table(
    errors: Mapping[str, ChannelError],
    *,
    title: str = "",
    beside: Mapping[str, str] | None = None,
    beside_heading: str = "",
) -> str:
    """The table for a log file: aligned columns of text; arguments as for ``print_table``."""
    lines: list[Sequence[str]] = [["", *HEADINGS, *([beside_heading] if beside else [])]]
    for group in table_groups(errors, beside=beside):
        lines.append([group.title])
        lines.extend(_columns(row, "  ", bool(beside)) for row in group.rows)
        if group.summary is not None:
            lines.append(_columns(group.summary, "  ", bool(beside)))
    widths = [
        max((len(line[column]) for line in lines if column < len(line)), default=0)
        for column in range(len(lines[0]))
    ]
    text = [title] if title else []
    for line in lines:
        cells = [line[0].ljust(widths[0])]
        for column, cell in enumerate(line[1:], start=1):
            right = column <= len(HEADINGS)
            cells.append(cell.rjust(widths[column]) if right else cell.ljust(widths[column]))
        text.append("  ".join(cells).rstrip())
    return "\n".join(text) + "\n"


def print_table(
    errors: Mapping[str, ChannelError],
    *,
    title: str = "",
    beside: Mapping[str, str] | None = None,
    beside_heading: str = "",
    file: TextIO | None = None,
) -> None:
    """Print the table, drawn where ``file`` is a terminal wide enough for it, plain elsewhere.

    Args:
        errors: figures by channel name.
        title: line above the table.
        beside: text for one more column by channel name, for example published figures; a
            quantity's prefix alone ("tension") names the line of its mean over channels.
        beside_heading: heading of that column.
        file: where to print; standard output by default.
    """
    stream = sys.stdout if file is None else file
    if stream.isatty():
        from rich.console import Console

        console = Console(file=stream)
        table = rich_table(errors, title=title, beside=beside, beside_heading=beside_heading)
        room = console.options.update(max_width=10_000)
        if console.measure(table, options=room).maximum <= console.width:
            console.print(table)
            return
    stream.write(plain_table(errors, title=title, beside=beside, beside_heading=beside_heading))


def _cells(error: ChannelError, factor: float, decimals: int) -> tuple[str, ...]:
    """The figures as text, one for each of HEADINGS; errors times ``factor``."""

    def scaled(value: float | None) -> str:
        return format_number(None if value is None else factor * value, decimals)

    return (
        scaled(error.mean_abs_error),
        format_percent(error.mean_relative_error),
        scaled(error.rmse),
        scaled(error.max_abs_error),
        format_r2(error.r2),
    )


def _decimals(errors: Iterable[ChannelError], factor: float) -> int:
    """One number of decimals for a group, so that points align: three digits of a usual error."""
    usual = sorted(error.rmse for error in errors if error.rmse)
    return decimals_for(factor * usual[(len(usual) - 1) // 2]) if usual else 3


def _columns(row: Row, indent: str, with_aside: bool) -> list[str]:
    return [indent + row.label, *row.cells, *([row.aside] if with_aside else [])]
