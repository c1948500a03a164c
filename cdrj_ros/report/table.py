"""Tables of figures in a terminal, of those outside their limits, and the format of numbers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING, Final

from cdrj_ros.evaluation.channels import QUANTITIES, BagComparison, quantity_of
from cdrj_ros.evaluation.comparison import DROP_CAUSES
from cdrj_ros.evaluation.limits import LimitCheck, Outside
from cdrj_ros.evaluation.metrics import ChannelError, mean_over_channels
from cdrj_ros.evaluation.recorded_verdict import Alarm, Verdict
from cdrj_ros.foundation.output import (
    decimals_for,
    format_angle,
    format_number,
    format_percent,
    format_r2,
    printable,
    say,
    scale_for,
)
from cdrj_ros.model.packing import TENSION

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text


UNLIMITED: Final = 100_000
"""Width at which no table is wrapped [characters]."""


def new_table(title: str = "") -> Table:
    """An empty table."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    heading = Text(printable(title), style="bold") if title else None
    return Table(title=heading, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)


def print_table(table: Table) -> None:
    """Print a table with rules if the terminal is wide enough, otherwise as plain columns."""
    from rich.console import Console

    if sys.stdout.isatty():
        console = Console()
        room = console.options.update(max_width=UNLIMITED)
        if console.measure(table, options=room).maximum <= console.width:
            console.print(table)
            return
    sys.stdout.write(plain(table))


def print_rows(
    headings: Sequence[str], rows: Iterable[Sequence[str]], *, right: bool = False
) -> None:
    """Print texts as a table; ``right``: all columns but the first are numbers."""
    from rich.text import Text

    table = new_table()
    for k, heading in enumerate(headings):
        table.add_column(heading, justify="right" if right and k else "left", no_wrap=True)
    for row in rows:
        table.add_row(*(Text(printable(cell)) for cell in row))
    print_table(table)


def plain(table: Table) -> str:
    """A table as aligned columns of text without rules, of any width."""
    from rich.console import Console

    table.box, table.show_edge = None, False
    console = Console(file=StringIO(), width=UNLIMITED, color_system=None, force_terminal=False)
    with console.capture() as captured:
        console.print(table)
    return "".join(f"{line.rstrip()}\n" for line in captured.get().splitlines())


MOST_ROWS: Final = 45
"""Number of channels that fit on one screen."""

WORST: Final = 5
"""Channels of a quantity other than tension that are printed where all are too many."""

SMALL_ERROR: Final = 0.02
"""Mean relative error that is small [-]."""

LOW_R2: Final = 0.9
"""R² that needs an explanation beside a small error."""

WORST_ALONE: Final = f"the worst element of every cable, and the {WORST} worst of other quantities"
"""What a short table shows."""

HEADINGS: Final = ("mean |error|", "mean rel.", "RMSE", "max |error|", "R²")
"""Headings of the figures in every table, in the order of metrics.FIGURES."""

MORE_HEADINGS: Final[Mapping[str, str]] = {
    "coverage": "in ±2σ",
    "mean_direction_error_deg": "mean direction",
    "max_direction_error_deg": "max direction",
}
"""Headings of the figures that are shown only if a channel has them."""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    """Full channel name; empty in a summary line."""
    label: str
    """Name without its prefix, printed in the first column."""
    cells: tuple[str, ...]
    """Formatted figures, one for each of ``headings_of``."""


@dataclass(frozen=True)
class Group:
    """The lines of one quantity."""

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
    errors: Mapping[str, ChannelError], shown: Sequence[str] | None = None
) -> tuple[Group, ...]:
    """The table's text, grouped by quantity in the order of QUANTITIES.

    Args:
        errors: figures by channel name.
        shown: names of the channels with a line, in their order; None: all.

    Raises:
        ValueError: a channel name without a known prefix.
    """
    more = _more(errors)
    groups = []
    for quantity, known in QUANTITIES.items():
        members = {name: e for name, e in errors.items() if quantity_of(name) == quantity}
        if not members:
            continue
        overall = mean_over_channels(members.values())
        factor, scaled_unit = scale_for(overall.max_abs_error, overall.unit or known.unit)
        decimals = _decimals(members.values(), factor)
        rows = tuple(
            Row(name, name.removeprefix(f"{quantity}/"),
                _cells(members[name], factor, decimals, more))
            for name in shown or members
            if name in members
        )  # fmt: skip
        summary = None
        if len(members) > 1:
            cells = _cells(overall, factor, decimals, more)
            summary = Row("", f"all {known.place}s", cells)
        groups.append(Group(f"{known.title} [{scaled_unit}]", rows, summary))
    return tuple(groups)


def worst_channels(errors: Mapping[str, ChannelError]) -> list[str] | None:
    """The worst element of every cable, and the ``WORST`` worst channels of other quantities.

    Elements are compared by their mean relative error, others by their RMSE; the worst is first.
    None if all channels fit on one screen.
    """
    if len(errors) <= MOST_ROWS:
        return None
    found: list[str] = []
    for quantity in QUANTITIES:
        figure = "mean_relative_error" if quantity == TENSION else "rmse"
        own = {
            name: getattr(error, figure) or 0.0
            for name, error in errors.items()
            if quantity_of(name) == quantity
        }
        worst = sorted(own, key=own.__getitem__, reverse=True)
        if quantity == TENSION:
            cables = dict.fromkeys(name.rpartition("/")[0] for name in worst)
            found += [next(n for n in worst if n.rpartition("/")[0] == one) for one in cables]
        else:
            found += worst[:WORST]
    return found


def errors_table(
    errors: Mapping[str, ChannelError], *, title: str = "", shown: Sequence[str] | None = None
) -> Table:
    """The figures as a table, one line per channel, grouped by quantity.

    Args:
        errors: by channel name.
        title: line above the table.
        shown: names of the channels with a line, in their order; None: all.
    """
    from rich.text import Text

    table = new_table(title)
    table.add_column("")
    for heading in headings_of(errors):
        table.add_column(heading, justify="right", no_wrap=True)
    for group in table_groups(errors, shown):
        table.add_row(Text(group.title, style="bold"))
        for row in group.rows:
            table.add_row(*_columns(row))
        if group.summary is not None:
            table.add_row(*_columns(group.summary), style="bold")
        table.add_section()
    return table


def r2_remark(errors: Mapping[str, ChannelError]) -> str:
    """What a low R² beside a small error means, if a channel has both; otherwise empty."""
    for name, error in errors.items():
        relative, r2 = error.mean_relative_error, error.r2
        if relative is not None and r2 is not None and relative < SMALL_ERROR and r2 < LOW_R2:
            return (
                f"R² of {name} is low although its error is {format_percent(relative)}: it is "
                "relative to the variation of the reference, which hardly varies."
            )
    return ""


def print_errors(
    errors: Mapping[str, ChannelError], *, title: str = "", every: bool = True
) -> None:
    """Print the figures.

    Args:
        errors: by channel name.
        title: line above the table.
        every: whether all channels are printed, even if they are more than ``MOST_ROWS``.
    """
    shown = None if every else worst_channels(errors)
    print_table(errors_table(errors, title=title, shown=shown))
    if shown is not None:
        say(f"{WORST_ALONE}; --all prints all {len(errors)} channels")
    if remark := r2_remark(errors):
        say(remark)


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


def _columns(row: Row) -> list[Text]:
    from rich.text import Text

    return [Text(printable(cell)) for cell in (f"  {row.label}", *row.cells)]


OUTSIDE_HEADINGS: Final = ("outside its limit", "figure", "is", "allowed", "beyond by", "in")
"""Headings of the table of figures outside their limits."""

FIGURE_NAMES: Final[Mapping[str, str]] = {
    "n": "samples",
    "mean_abs_error": "mean |error|",
    "mean_relative_error": "mean relative error",
    "rmse": "RMSE",
    "max_abs_error": "largest |error|",
    "r2": "R²",
    "coverage": "share within ±2σ",
    "mean_direction_error_deg": "mean direction error",
    "max_direction_error_deg": "largest direction error",
}
"""Name of every figure in words."""


def outside_rows(limit_check: LimitCheck) -> list[tuple[str, str, str, str, str, str]]:
    """Figures outside their limits: channel, figure, value, bound, excess, and recording."""
    rows = []
    for one in limit_check.outside:
        value, bound, by = (_figure_text(one, number) for number in (one.value, one.bound, one.by))
        if one.by is not None and one.bound:
            by += f" ({100.0 * one.by / abs(one.bound):.2g} %)"
        allowed = f"{'at least' if one.least else 'at most'} {bound}"
        rows.append((one.channel, FIGURE_NAMES[one.figure], value, allowed, by, one.where))
    return rows


def limits_sentence(limit_check: LimitCheck) -> str:
    """Summary of the comparison with limits in one sentence."""
    outside, checked = len(limit_check.outside), limit_check.checked
    if not outside:
        return f"Within all {checked} limits of {limit_check.source}."
    are = "is" if outside == 1 else "are"
    return f"{outside} of {checked} figures {are} outside the limits of {limit_check.source}."


def print_limits(limit_check: LimitCheck) -> None:
    """Print the figures outside their limits and their excess."""
    say(limits_sentence(limit_check))
    if rows := outside_rows(limit_check):
        print_rows(OUTSIDE_HEADINGS, rows)


def _figure_text(one: Outside, value: float | None) -> str:
    figure = one.figure
    if value is None:
        return "not known"
    if figure in ("mean_relative_error", "coverage"):
        return format_percent(value)
    if figure.endswith("_deg"):
        return format_angle(value)
    if figure == "r2":
        return format_r2(value)
    if figure == "n":
        return f"{value:.0f}"
    quantity = QUANTITIES.get(one.channel.partition("/")[0])
    unit = one.unit or (quantity.unit if quantity else "")
    return f"{value:.4g} {unit}".rstrip()


def usable_share(bags: Sequence[BagComparison]) -> float | None:
    """The share of estimated tensions with status OK; None without a status."""
    judged = sum(bag.judged for bag in bags)
    return sum(bag.ok for bag in bags) / judged if judged else None


def status_lines(bags: Sequence[BagComparison]) -> list[str]:
    """The share of OK, and verdicts in lines that name the recording; none that is not known."""
    share = usable_share(bags)
    lines = (
        []
        if share is None
        else [f"status OK: {format_percent(share)} of all tensions (docs/commission.md)"]
    )
    for bag in bags:
        verdict = health_lines(bag.health) if bag.health else []
        lines += [f"health: {bag.path}: {line}" for line in verdict]
    return lines


def health_lines(verdict: Verdict) -> list[str]:
    """The verdict first, then one line for every alarm."""
    compared = f"by {', '.join(verdict.sensors)}"
    if not verdict.alarms:
        return [f"{verdict.message} ({compared})"]
    return [f"alarm ({compared})", *(_line(one) for one in verdict.alarms)]


def _line(alarm: Alarm) -> str:
    return f"{alarm.level}, {alarm.begin_s:.1f} to {alarm.end_s:.1f} s: {alarm.message}"
