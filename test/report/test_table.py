"""The table has the same content in a terminal and in a log file."""

from __future__ import annotations

import io

import pytest

from cdrj_ros.evaluation.metrics import NO_SAMPLES, ChannelError
from cdrj_ros.report.table import (
    decimals_for,
    errors_table,
    format_amount,
    format_number,
    format_percent,
    format_r2,
    plain,
    print_errors,
    r2_remark,
    table_groups,
)

ERRORS = {
    "effort/spindle": ChannelError(5, 0.00025, 0.021, 0.00041, 0.0012, 0.981),
    "tension/upper/7": ChannelError(5, 0.2, 0.004, 0.3, 1.0, 0.999),
    "tension/upper/8": ChannelError(5, 0.4, 0.008, 0.5, 2.5, 0.997),
    "nodal_force/upper/3": NO_SAMPLES,
}


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_channels_are_grouped_by_quantity_with_their_mean_last() -> None:
    tension, force, effort = table_groups(ERRORS)
    assert [group.title for group in (tension, force, effort)] == [
        "Tension [N]",
        "Nodal force [N]",
        "Effort [mN·m]",
    ]
    assert [row.label for row in tension.rows] == ["upper/7", "upper/8"]
    assert tension.rows[1].cells == ("0.400", "0.80 %", "0.500", "2.500", "0.9970")
    assert tension.summary is not None
    assert tension.summary.label == "all elements"
    assert tension.summary.cells == ("0.300", "0.60 %", "0.400", "2.500", "0.9980")
    assert effort.summary is None
    assert effort.rows[0].cells == ("0.250", "2.10 %", "0.410", "1.200", "0.9810")


def test_a_terminal_gets_a_drawn_table_and_a_file_plain_text(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("TERM", "xterm")
    terminal, file = Terminal(), io.StringIO()
    print_errors(ERRORS, file=terminal)
    print_errors(ERRORS, file=file)
    assert "─" in terminal.getvalue()
    assert file.getvalue() == plain(errors_table(ERRORS))
    assert "upper/8" in terminal.getvalue()
    monkeypatch.setenv("COLUMNS", "40")
    narrow = Terminal()
    print_errors(ERRORS, file=narrow)
    assert narrow.getvalue() == plain(errors_table(ERRORS))


def test_a_low_r2_beside_a_small_error_is_explained() -> None:
    steady = {**ERRORS, "tension/upper/8": ChannelError(5, 0.2, 0.0074, 0.3, 1.0, 0.08)}
    text = io.StringIO()
    print_errors(steady, file=text)
    remark = "R² of tension/upper/8 is low although its error is 0.74 %"
    assert text.getvalue() == plain(errors_table(steady)) + r2_remark(steady) + "\n"
    assert r2_remark(steady).startswith(remark)
    assert r2_remark(ERRORS) == ""


def test_names_are_not_markup() -> None:
    from rich.console import Console

    stream = io.StringIO()
    table = errors_table({"tension/[bold]a/1": ERRORS["tension/upper/8"]})
    Console(file=stream, width=100).print(table)
    assert "[bold]a/1" in stream.getvalue()


def test_a_name_without_known_prefix_is_refused() -> None:
    with pytest.raises(ValueError, match="torque/spindle"):
        table_groups({"torque/spindle": NO_SAMPLES})


def test_numbers_are_short_and_have_true_minus_signs() -> None:
    assert format_number(-1.234, 2) == "\N{MINUS SIGN}1.23"
    assert format_number(None, 2) == "\N{EN DASH}"
    assert format_percent(0.04444) == "4.44 %"
    assert format_percent(12.3) == "1230 %"
    assert format_r2(0.98765) == "0.9877"
    assert format_r2(-1234.5678) == "\N{MINUS SIGN}1234.6"
    assert [decimals_for(x) for x in (0.0, 420.0, 4.2, 0.42, 0.042)] == [2, 0, 2, 3, 4]
    assert format_amount(0.2134, "N") == "0.21 N"
    assert format_amount(1.71, "N") == "1.7 N"
    assert format_amount(0.00843, "N·m") == "8.4 mN·m"
    assert format_amount(123.4, "N") == "123 N"
    assert format_amount(0.0, "N") == "0.0 N"
