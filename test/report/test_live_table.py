"""Rendering of the live table without ROS and without a terminal."""

from __future__ import annotations

import re
from io import StringIO

import pytest
from rich.console import Console

from cdrj_ros.model.packing import INVALID, OK, SLACK, STALE, UNSURE
from cdrj_ros.report.live_table import Line, Section, View, live_table, plain_line

NAN = float("nan")
LINES = (
    Line("upper/1", 40.0, 1.5, OK),
    Line("upper/2", 20.0, None, SLACK),
    Line("lower/1", 10.0, 2.0, UNSURE | STALE),
    Line("lower/2", 0.0, 0.0, INVALID | UNSURE),
)
VIEW = View("/cdrj/tensions", (Section("element", LINES),), "prototype", 998.4, 0.004)


def drawn(view: View, width: int = 80, colour: bool = False) -> list[str]:
    stream = StringIO()
    console = Console(
        file=stream, width=width, force_terminal=colour, color_system="standard" if colour else None
    )
    console.print(live_table(view))
    return stream.getvalue().splitlines()


def row(lines: list[str], name: str) -> str:
    return next(line for line in lines[::-1] if name in line)  # the summary has names, too


@pytest.mark.parametrize("width", [40, 60, 80, 200])
def test_every_line_fits_the_terminal_and_every_number_is_readable(width: int) -> None:
    lines = drawn(VIEW, width)
    assert max(len(line) for line in lines) <= width
    assert re.search(r"upper/1 +40\.00 +3\.00 ", row(lines, "upper/1"))
    assert "OK" in row(lines, "upper/1")
    assert "STALE" in "\n".join(lines)


@pytest.mark.parametrize("value", [NAN, float("inf"), -float("inf")])
def test_invalid_values_and_those_that_are_not_finite_are_not_drawn(value: float) -> None:
    assert re.fullmatch(r" ?lower/2 +- +INVALID *", row(drawn(VIEW), "lower/2"))
    lines = (Line("a/1", value, 1.0, OK), Line("a/2", 1.0, value, OK))
    table = drawn(View("t", (Section("element", lines),)))
    assert re.search(r"a/1 +- ", row(table, "a/1"))
    assert "largest a/2 1.00 N" in plain_line(View("t", (Section("element", lines),)))


def test_an_unknown_flag_is_not_taken_for_ok() -> None:
    table = drawn(View("t", (Section("element", (Line("a/1", 1.0, None, 64),)),)))
    assert "FLAG 64" in row(table, "a/1")
    assert " OK" not in "\n".join(table)


def test_escapes_in_names_and_notes_reach_no_terminal() -> None:
    evil = "\x1b]0;[red]evil[/red]\x07/1"
    view = View(evil, (Section("element", (Line(evil, 1.0, None, SLACK),)),), evil, notes=(evil,))
    assert "\x1b" not in "\n".join(drawn(view))
    assert "[red]evil[/red]" in "\n".join(drawn(view))
    assert not re.search(r"[\x00-\x1f]", plain_line(view))
