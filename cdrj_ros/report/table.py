"""Tables of the figures of a comparison, and of the figures outside their limits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TextIO

from cdrj_ros.foundation.text import printable
from cdrj_ros.judgement.channels import ANGLE, FORCE_VECTOR, FRICTION, QUANTITIES, quantity_of
from cdrj_ros.judgement.metrics import ChannelError, mean_over_channels
from cdrj_ros.judgement.placement import DROP_CAUSES
from cdrj_ros.model.channels import EFFORT, NODAL_FORCE, TENSION
from cdrj_ros.report.columns import new_table, print_table
from cdrj_ros.report.numbers import (
    decimals_for,
    format_angle,
    format_number,
    format_percent,
    format_r2,
    scale_for,
)

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

HEADINGS: Final = ("mean |error|", "mean rel.", "RMSE", "max |error|", "R²")
"""Headings of the figures in every table, in the order of metrics.FIGURES."""

MORE_HEADINGS: Final[Mapping[str, str]] = {
    "reversal_error": "at reversals",
    "smooth_error": "elsewhere",
    "coverage": "in ±2σ",
    "mean_direction_error_deg": "mean direction",
    "max_direction_error_deg": "max direction",
}
"""Headings of the figures that are shown only if a channel has them."""


SUMMARY_LABELS: Final[Mapping[str, str]] = {
    TENSION: "all elements",
    NODAL_FORCE: "all nodes",
    FORCE_VECTOR: "all nodes",
    FRICTION: "all nodes",
    EFFORT: "all efforts",
    ANGLE: "all angles",
}
"""Label of each quantity's summary line, the mean over its channels."""


@dataclass(frozen=True)
class Beside:
    """An additional column of a table."""

    heading: str
    texts: Mapping[str, str]
    """Texts by channel name; a quantity alone ("tension") refers to its summary line."""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    """Full channel name; empty in a summary line."""
    label: str
    """Name without its prefix, printed in the first column."""
    cells: tuple[str, ...]
    """Formatted figures, one for each of ``headings_of``."""
    aside: str
    """Text of the additional column; may be empty."""


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
    """Mean over the channels; None if there is only one channel."""


def headings_of(errors: Mapping[str, ChannelError]) -> tuple[str, ...]:
    """Headings of the table: HEADINGS, and those of MORE_HEADINGS whose figures are known."""
    return (*HEADINGS, *(MORE_HEADINGS[figure] for figure in _more(errors)))


def _more(errors: Mapping[str, ChannelError]) -> tuple[str, ...]:
    return tuple(
        figure
        for figure in MORE_HEADINGS
        if any(getattr(error, figure) is not None for error in errors.values())
    )


def table_groups(
    errors: Mapping[str, ChannelError], *, beside: Beside | None = None
) -> tuple[Group, ...]:
    """The table's text, grouped by quantity in the order of QUANTITIES.

    Args:
        errors: figures by channel name.
        beside: texts of the last column.

    Raises:
        ValueError: a channel name without a known prefix.
    """
    asides = beside.texts if beside else {}
    more = _more(errors)
    groups = []
    for quantity, (title, unit) in QUANTITIES.items():
        members = {name: e for name, e in errors.items() if quantity_of(name) == quantity}
        if not members:
            continue
        overall = mean_over_channels(members.values())
        factor, scaled_unit = scale_for(overall.max_abs_error, overall.unit or unit)
        decimals = _decimals(members.values(), factor)
        rows = tuple(
            Row(
                name,
                name.removeprefix(f"{quantity}/"),
                _cells(error, factor, decimals, more),
                asides.get(name, ""),
            )
            for name, error in members.items()
        )
        summary = None
        if len(rows) > 1:
            cells = _cells(overall, factor, decimals, more)
            summary = Row("", SUMMARY_LABELS[quantity], cells, asides.get(quantity, ""))
        groups.append(Group(quantity, f"{title} [{scaled_unit}]", rows, summary))
    return tuple(groups)


def errors_table(
    errors: Mapping[str, ChannelError], *, title: str = "", beside: Beside | None = None
) -> Table:
    """The figures as a table, one line per channel, grouped by quantity."""
    from rich.text import Text

    table = new_table(title)
    table.add_column("")
    for heading in headings_of(errors):
        table.add_column(heading, justify="right", no_wrap=True)
    if beside:
        table.add_column(Text(beside.heading))
    for group in table_groups(errors, beside=beside):
        table.add_row(Text(group.title, style="bold"))
        for row in group.rows:
            table.add_row(*_columns(row, beside))
        if group.summary is not None:
            table.add_row(*_columns(group.summary, beside), style="bold")
        table.add_section()
    return table


def print_errors(
    errors: Mapping[str, ChannelError],
    *,
    title: str = "",
    beside: Beside | None = None,
    file: TextIO | None = None,
) -> None:
    """Print the figures.

    Args:
        errors: by channel name.
        title: line above the table.
        beside: one more column, for example published figures.
        file: where to print; standard output by default.
    """
    print_table(errors_table(errors, title=title, beside=beside), file)


def cause_in_words(cause: str) -> str:
    """Reason for leaving out samples, from the name of the counter."""
    return DROP_CAUSES.get(cause, cause.replace("_", " "))


def _cells(
    error: ChannelError, factor: float, decimals: int, more: Sequence[str]
) -> tuple[str, ...]:
    """The figures as text, one per heading; errors are multiplied by ``factor``."""

    def scaled(value: float | None) -> str:
        return format_number(None if value is None else factor * value, decimals)

    formats: dict[str, Callable[[float | None], str]] = {
        "coverage": lambda value: format_percent(value, 1),
        "mean_direction_error_deg": format_angle,
        "max_direction_error_deg": format_angle,
    }
    return (
        scaled(error.mean_abs_error),
        format_percent(error.mean_relative_error),
        scaled(error.rmse),
        scaled(error.max_abs_error),
        format_r2(error.r2),
        *(formats.get(figure, scaled)(getattr(error, figure)) for figure in more),
    )


def _decimals(errors: Iterable[ChannelError], factor: float) -> int:
    """Common number of decimals of a group, which shows three digits of its median RMSE."""
    usual = sorted(error.rmse for error in errors if error.rmse)
    return decimals_for(factor * usual[(len(usual) - 1) // 2]) if usual else 3


def _columns(row: Row, beside: Beside | None) -> list[Text]:
    from rich.text import Text

    cells = [f"  {row.label}", *row.cells, *([row.aside] if beside else [])]
    return [Text(printable(cell)) for cell in cells]
