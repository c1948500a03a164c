"""The tools that the pages name for their tables run, with the options that shorten them."""

from __future__ import annotations

import inspect
import re
import runpy
import sys
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import pytest
from support.page_lines import loaded_tool

from cdrj_ros.identification.unknowns import parse_unknowns

ROOT = Path(__file__).parents[2]
SHORT = {
    "layouts.py": (["--out", "LAYOUTS"], "plotjuggler_prototype.xml"),
}
"""Arguments that shorten each tool, and what it prints."""

ELSEWHERE = {
    "compare_mujoco.py": "test_tutorial.py",
    "convert_continuum.py": "its own test",
    "convert_davinci.py": "its own test",
    "davinci_bounds.py": "it reads recordings that are not part of this repository",
    "drum_slip.py": "below, shortened",
    "health.py": "below, shortened",
    "spread_causes.py": "below, shortened",
    "continuum_figures.py": "it draws recordings that are not part of this repository",
    "narrow_fits.py": "below, shortened",
    "seen_by.py": "below, shortened",
    "standard_errors.py": "below, shortened",
    "track_preload.py": "below, shortened",
    "wrong_files.py": "below, shortened",
}
"""Tools on the pages that are not run here, and why."""


def test_every_tool_on_a_page_is_run_or_excused() -> None:
    pages = [path.read_text() for path in ROOT.glob("docs/*.md")]
    named = {
        name
        for page in pages
        for block in re.findall(r"```bash\n(.*?)```", page, re.DOTALL)
        for name in re.findall(r"^python tools/(\w+\.py)", block, re.MULTILINE)
    }
    assert named == SHORT.keys() | ELSEWHERE.keys()


@pytest.mark.parametrize("tool", SHORT)
def test_a_tool_prints_its_table(
    tool: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments, expected = SHORT[tool]
    given = [str(tmp_path) if word == "LAYOUTS" else word for word in arguments]
    monkeypatch.setattr(sys, "argv", [tool, *given])
    monkeypatch.syspath_prepend(ROOT / "tools")
    runpy.run_path(str(ROOT / "tools" / tool), run_name="__main__")
    assert expected in capsys.readouterr().out


def made_shorter(tool: ModuleType, monkeypatch: pytest.MonkeyPatch, name: str, to: float) -> None:
    """Let a function of a tool make a motion of some seconds only."""
    whole = getattr(tool, name)

    def part(*given: object) -> object:
        bound = inspect.signature(whole).bind(*given)
        bound.arguments["seconds"] = to
        return whole(*bound.args)

    monkeypatch.setattr(tool, name, part)


class Table(NamedTuple):
    """A tool that prints a table of a motion."""

    motion: str
    """Function that makes the motion."""
    seconds: float
    """What is left of it [s]."""
    arguments: list[str]
    rows: list[str]
    """Patterns of rows."""
    cases: str = ""
    """Constant with all that has a row, if none is left out."""
    tables: int = 1
    """Number of tables that have these rows."""
    constants: tuple[tuple[str, object], ...] = ()
    """Other values of constants of the tool."""


SENSORS = ("effort", "cells", "effort and cells")
TABLES = {
    "health.py": Table(
        "motion_of", 17.0, ["--only", "both −30 %", "--seeds", "1"],
        [rf"preload of both −30 % \| {of} \| 1.8 cycles \| .* has lost 30\b.*" for of in SENSORS],
    ),
    "seen_by.py": Table(
        "true_motion", 20.0, [],
        [
            r"preload of both cables −10 % \| \+1\d \| \+2\d \| -1\d\d \| 3.7 \| 6.\d",
            r"joint zero off by 1° \| -3\d\d \| .* \| \+2\d\d\d \| 1\d.\d \| 4.\d",
            r"cable slips on its drum \| .* \| [1-9].\d \| [1-9].\d",
            r"upper cable broken \| \+5\d\d \| \+2\d\d \| -3\d\d\d \| 3\d.\d \| 3\d.\d",
        ],
        "CHANGES",
    ),
    "wrong_files.py": Table(
        "true_motion", 40.0, [],
        [
            r"nothing \| 0.\d% / 0.\d% \| 100%, 0% \| .* \| 100%, 8\d%",
            r"joint zero off by 1° \| 4\d.\d% / \d+.\d%( \| 100%, \d+%){3} \| \d%, 8\d%",
            r"nothing( \| 8\d, 8\d, 8\d %; 0%){4}",
            r"joint zero off by 1° \| 8\d, 8\d, 8\d %; 8\d%( \| 8\d, \d\d, 0 %; 0%){3}",
        ],
        "ROWS", 2, (("RATE", 5.0),),
    ),
}  # fmt: skip


@pytest.mark.usefixtures("few_members")
@pytest.mark.parametrize("name", TABLES)
def test_a_tool_prints_its_table_of_a_short_motion(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = TABLES[name]
    monkeypatch.syspath_prepend(ROOT / "tools")
    tool = loaded_tool(ROOT / "tools" / name, **dict(shown.constants))
    # seen_by.py moves as wrong_files.py does
    made_shorter(getattr(tool, "wrong_files", tool), monkeypatch, shown.motion, shown.seconds)
    monkeypatch.setattr(sys, "argv", [name, *shown.arguments])
    tool.main()
    printed = capsys.readouterr().out
    for row in shown.rows:
        assert re.search(rf"^\| {row} \|$", printed, re.MULTILINE), row
    for case in getattr(tool, shown.cases, ()):
        assert printed.count(f"\n| {case.what} | ") == shown.tables, case.what


@pytest.mark.usefixtures("short_fits")
def test_narrow_fits_prints_a_row(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With one wrong number, 5 s of motion and fits of two steps."""
    tool = loaded_tool(ROOT / "tools" / "narrow_fits.py")
    made_shorter(tool, monkeypatch, "motion", 5.0)
    monkeypatch.setattr(tool, "WRONG", dict([next(iter(tool.WRONG.items()))]))
    tool.main()
    found = re.search(r"\| drum radius by 1 % \| (.+) %, .+ % \| (.+) %, ", capsys.readouterr().out)
    assert found is not None
    assert float(found[2]) < 0.1 * float(found[1]), "the others along"


@pytest.mark.usefixtures("short_fits")
def test_standard_errors_prints_a_row(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With one recording of 4 s and fits of two steps."""
    tool = loaded_tool(ROOT / "tools" / "standard_errors.py", SECONDS=4.0)
    monkeypatch.setattr(
        sys, "argv", ["standard_errors.py", "--draws", "1", "--cases", "fitted", "--fit", "rho"]
    )
    tool.main()
    assert "| fitted numbers drawn, all others as in the file | 4 | " in capsys.readouterr().out


def tool_beside_standard_errors(
    name: str, monkeypatch: pytest.MonkeyPatch, **constants: object
) -> ModuleType:
    """A tool that draws its robots by standard_errors.py, with recordings of 12 s."""
    monkeypatch.syspath_prepend(ROOT / "tools")
    monkeypatch.setattr("standard_errors.SECONDS", 12.0)
    monkeypatch.setattr("standard_errors.OTHER_SECONDS", 6.0)
    monkeypatch.setattr(sys, "argv", [name, "--draws", "1"])
    return loaded_tool(ROOT / "tools" / name, **constants)


def test_drum_slip_prints_what_both_truths_show(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    choices = {"effort of the motor": ("effort/winch",)}
    tool = tool_beside_standard_errors("drum_slip.py", monkeypatch, CHOICES=choices)
    monkeypatch.setattr(tool, "fitted_numbers", lambda file, _: parse_unknowns(file, "preload"))
    monkeypatch.setattr(tool, "truths", lambda *_: [{}])  # that of the file, which takes less time
    tool.main()
    printed = capsys.readouterr().out
    assert "| effort of the motor | holds | hold: cable that slips makes the residuals" in printed
    assert "| without memory | may_slip: cable that holds makes the residuals" in printed


def test_spread_causes_prints_its_table(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tool = tool_beside_standard_errors("spread_causes.py", monkeypatch, BEGINS_S=(0.0,))
    tool.main()
    printed = capsys.readouterr().out
    rows = {line.split(" | ")[0]: line.split(" | ")[2] for line in printed.splitlines()[2:]}
    assert float(rows["| all, drums may slip"]) > 1.5 * float(rows["| all, drums hold"])
    assert float(rows["| none"]) < float(rows["| all, drums hold"])


@pytest.mark.parametrize(("case", "alarms"), [("nothing", "0"), ("joint zero off by 1°", "[3-9]")])
def test_the_false_alarms_of_the_health_monitor_are_counted(
    case: str, alarms: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In four cycles, with each of three sets of sensors."""
    tool = loaded_tool(ROOT / "tools" / "health.py")
    monkeypatch.setattr(tool, "CASES", [one for one in tool.CASES if one.what == case])
    monkeypatch.setattr(sys, "argv", ["health.py", "--hours", "0.005", "--seeds", "1"])
    tool.main()
    counted = rf"^{alarms} alarms in 0.005 h of motion .* \(12 cycles\)$"
    assert re.search(counted, capsys.readouterr().out, re.MULTILINE)


def test_preloads_are_tracked_without_false_jumps(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With one seed, six calm cycles, and four with friction or a jump."""
    tool = loaded_tool(
        ROOT / "tools" / "track_preload.py",
        SEEDS=(0,), CYCLES=4, BEGIN=9.0, FRICTIONS=(0.02,), SHARES=(0.9,), YIELDS=(1e-3,),
    )  # fmt: skip
    monkeypatch.setattr(sys, "argv", ["track_preload.py", "--cycles", "6"])
    tool.main()
    printed = capsys.readouterr().out
    friction = r"\| 20 mN·m \| 1.\d\d N, 100%, 9\d% \| 1\d.\d ± \d.\d \|"
    jump = r"\| 1 mm \| 0.\d\d N, 100%, 9\d% \| 3.\d\d N, 9\d%, 2\d% \|( 1.+ N, 100%, \d+% \|){2}"
    calm = r"\| 20 mN·m \| 6 \| 0 \| 0.\d\d N, 100%, 100% \|"
    for row in (friction, jump, calm):
        assert re.search(rf"^{row}$", printed, re.MULTILINE), row
