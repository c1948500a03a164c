"""The tools that the pages name for their tables run, with the options that shorten them."""

from __future__ import annotations

import importlib
import re
import runpy
import sys
from pathlib import Path
from types import ModuleType

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


def test_wrong_files_prints_every_row(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With 3 s of motion."""
    tool = loaded_tool(ROOT / "tools" / "wrong_files.py")
    motion = tool.true_motion
    monkeypatch.setattr(tool, "true_motion", lambda model, seconds: motion(model, seconds / 5.0))
    monkeypatch.setattr(sys, "argv", ["wrong_files.py", "--quick", "--heard"])
    tool.main()
    printed = capsys.readouterr().out
    assert all(f"| {row.what} | " in printed for row in tool.ROWS)
    assert "| joint zero off by 1° |" in printed


@pytest.mark.usefixtures("short_fits")
def test_narrow_fits_prints_a_row(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With one wrong number, 5 s of motion and fits of two steps."""
    tool = loaded_tool(ROOT / "tools" / "narrow_fits.py")
    motion = tool.motion
    monkeypatch.setattr(tool, "motion", lambda seconds: motion(seconds / 4.0))
    monkeypatch.setattr(tool, "WRONG", dict([next(iter(tool.WRONG.items()))]))
    tool.main()
    assert "| drum radius by 1 % | " in capsys.readouterr().out


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


def test_the_health_monitor_watches_a_change(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With 17 s of motion."""
    tool = loaded_tool(ROOT / "tools" / "health.py")
    motion = tool.motion_of
    monkeypatch.setattr(
        tool, "motion_of", lambda robot, case, _, seed: motion(robot, case, 17.0, seed)
    )
    monkeypatch.setattr(sys, "argv", ["health.py", "--only", "both −30 %", "--seeds", "1"])
    tool.main()
    assert "| preload of both −30 % |" in capsys.readouterr().out


def test_the_false_alarms_of_the_health_monitor_are_counted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["health.py", "--hours", "0.005"])
    loaded_tool(ROOT / "tools" / "health.py").main()
    assert "alarms in 0.005 h" in capsys.readouterr().out


def test_preloads_are_tracked_without_false_jumps(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With one seed and six cycles."""
    tool = loaded_tool(ROOT / "tools" / "track_preload.py", SEEDS=(0,))
    monkeypatch.setattr(sys, "argv", ["track_preload.py", "--only", "calm", "--cycles", "6"])
    tool.main()
    assert "| 20 mN·m | 6 | 0 |" in capsys.readouterr().out


def test_seen_by_prints_its_rows(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With 20 s of motion."""
    monkeypatch.syspath_prepend(ROOT / "tools")
    wrong_files = importlib.import_module("wrong_files")
    motion = wrong_files.true_motion
    monkeypatch.setattr(
        wrong_files, "true_motion", lambda model, seconds: motion(model, seconds / 3.0)
    )
    loaded_tool(ROOT / "tools" / "seen_by.py").main()
    assert "| preload of both cables −10 % |" in capsys.readouterr().out
