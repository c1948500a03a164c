"""Table of the figures outside their limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, TextIO

from cdrj_ros.foundation.output import say
from cdrj_ros.foundation.text import printable
from cdrj_ros.judgement.channels import QUANTITIES
from cdrj_ros.judgement.limits import Judgement, Outside
from cdrj_ros.report.columns import new_table, print_table
from cdrj_ros.report.numbers import (
    format_angle,
    format_percent,
    format_r2,
)

OUTSIDE_HEADINGS: Final = ("outside its limit", "figure", "is", "allowed", "beyond by", "in")
"""Headings of the table of figures outside their limits."""

FIGURE_NAMES: Final[Mapping[str, str]] = {
    "n": "samples",
    "mean_abs_error": "mean |error|",
    "mean_relative_error": "mean relative error",
    "rmse": "RMSE",
    "max_abs_error": "largest |error|",
    "r2": "R²",
    "reversal_error": "mean |error| at reversals",
    "smooth_error": "mean |error| elsewhere",
    "coverage": "share within ±2σ",
    "mean_direction_error_deg": "mean direction error",
    "max_direction_error_deg": "largest direction error",
}
"""Name of every figure in words."""


def judgement_rows(judgement: Judgement) -> list[tuple[str, str, str, str, str, str]]:
    """Figures outside their limits: channel, figure, value, bound, excess, and recording."""
    rows = []
    for one in judgement.outside:
        value, bound, by = (_figure_text(one, number) for number in (one.value, one.bound, one.by))
        if one.by is not None and one.bound:
            by += f" ({100.0 * one.by / abs(one.bound):.2g} %)"
        allowed = f"{'at least' if one.least else 'at most'} {bound}"
        rows.append((one.channel, FIGURE_NAMES[one.figure], value, allowed, by, one.where))
    return rows


def judgement_sentence(judgement: Judgement) -> str:
    """Summary of the comparison with limits in one sentence."""
    outside, checked = len(judgement.outside), judgement.checked
    if not outside:
        return f"Within all {checked} limits of {judgement.source}."
    are = "is" if outside == 1 else "are"
    return f"{outside} of {checked} figures {are} outside the limits of {judgement.source}."


def print_judgement(judgement: Judgement, file: TextIO | None = None) -> None:
    """Print the figures outside their limits and their excess."""
    from rich.text import Text

    say(judgement_sentence(judgement), file=file)
    if rows := judgement_rows(judgement):
        table = new_table()
        for heading in OUTSIDE_HEADINGS:
            table.add_column(heading, no_wrap=True)
        for row in rows:
            table.add_row(*(Text(printable(cell)) for cell in row))
        print_table(table, file)


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
