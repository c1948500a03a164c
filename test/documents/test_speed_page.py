"""docs/speed.md shows what `make bench` measured, and missed aims are recognised."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bench import suite
from bench.demonstration import CORE, MESSAGES, PACKAGE, end_of
from bench.figures import Row, Spread, turns
from bench.making import Said, make
from bench.page import BEGIN, END, LIMITS, renewed, written

DOCS = Path(__file__).parents[2] / "docs"
ONE = Spread(1.0, 0.9, 1.1)
HALF = Spread(0.5, 0.4, 0.6)


def test_the_page_shows_the_figures_of_the_last_run() -> None:
    found = json.loads((DOCS / "speed.json").read_text(encoding="utf-8"))
    rows = [Row.from_json(row) for row in found["rows"]]
    page = (DOCS / "speed.md").read_text(encoding="utf-8")
    assert len(rows) > 20
    text = written(rows, found["machine"], found["versions"], found["failed"])
    assert renewed(page, text) == page, "run make bench"
    if found["failed"]:  # a section that was not measured has no rows
        return
    for what in LIMITS:
        assert any(row.what.startswith(what) for row in rows), what


@pytest.mark.parametrize(
    ("row", "missed"),
    [
        (Row("s", "w", "s", ONE, aim="≤ 0.9"), True),
        (Row("s", "w", "s", ONE, aim="≤ 1.0"), False),
        (Row("s", "w", "s", ONE, aim="< 12 s"), False),
        (Row("s", "w", "%", ONE, aim="≥ 100"), True),
        (Row("s", "w", "%", ONE, aim="≥ 1"), False),
        (Row("s", "w", "s", ONE, "peer", ONE, HALF, "≤ 0.6"), False),
        (Row("s", "w", "s", HALF, "peer", HALF, ONE, "≤ 0.6"), True),
        (Row("s", "w", "s", ONE, aim="flat"), False),
        (Row("s", "w", "s", ONE), False),
    ],
)
def test_a_missed_aim_is_recognised_and_listed(row: Row, missed: bool) -> None:
    assert row.missed is missed
    text = written([row], "machine", "versions", [])
    assert ("**missed**" in text) is missed
    assert ("Aims missed" in text) is missed
    assert Row.from_json(row.as_json()) == row


def test_only_the_text_between_the_markers_changes() -> None:
    page = renewed(f"before\n{BEGIN}\nold\n{END}\nafter\n", "new\n")
    assert page == f"before\n{BEGIN}\n\nnew\n\n{END}\nafter\n"
    assert renewed(page, "new\n") == page
    with pytest.raises(ValueError, match="needs the lines"):
        renewed("without markers", "new\n")


def test_a_section_that_failed_is_listed() -> None:
    assert "- the start: not finished" in written(
        [], "machine", "versions", ["the start: not finished"]
    )


def test_rounds_end_when_the_time_is_used_up() -> None:
    assert list(turns(5, 1000.0)) == [0, 1, 2, 3, 4]
    assert list(turns(5, 0.0)) == [0]


RULES = """
demo:
\t@echo 'Building cdrj_msgs ... 1 s'
\t@echo 'Compiling the core ... 2 s'
\t@echo 'Building cdrj_ros ... 2 s'
test:
\t@echo '1 failed, 2 passed in 3.50s'
\t@false
"""


def test_lines_of_make_are_timed_and_its_failure_is_its_last_line(tmp_path: Path) -> None:
    (tmp_path / "Makefile").write_text(RULES, encoding="utf-8")
    said = make(tmp_path, "demo")
    assert [line for _, line in said] == [
        "Building cdrj_msgs ... 1 s",
        "Compiling the core ... 2 s",
        "Building cdrj_ros ... 2 s",
        "",
    ]
    ends = [end_of(said, stage) for stage in (MESSAGES, CORE, PACKAGE)]
    assert 0.0 < ends[0] <= ends[1] <= ends[2] <= said[-1].after_s
    with pytest.raises(RuntimeError, match="did not say Running"):
        end_of(said, "Running")
    with pytest.raises(RuntimeError, match="make test: 1 failed, 2 passed"):
        make(tmp_path, "test")


def test_the_time_of_the_tests_is_read_from_their_last_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said = [Said(309.0, "== 2345 passed, 3 skipped in 300.11s (0:05:00) =="), Said(310.0, "")]
    monkeypatch.setattr(suite, "make", lambda *_: said)
    monkeypatch.setattr(suite, "additions", lambda: 0.4)
    assert [row.ours.median for row in suite.measure()] == [310.0, 300.11, 0.4]
    monkeypatch.setattr(suite, "make", lambda *_: said[1:])
    with pytest.raises(RuntimeError, match="how long"):
        suite.measure()
