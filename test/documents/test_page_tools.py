"""The tools that the pages name for their tables run, with the options that shorten them."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SHORT = {
    "health.py": (["--only", "both −30 %", "--seeds", "1"], "| preload of both −30 % |"),
    "layouts.py": (["--out", "LAYOUTS"], "plotjuggler_prototype.xml"),
    "seen_by.py": ([], "| preload of both cables −10 % |"),
    "track_preload.py": (["--only", "calm", "--cycles", "6"], "| 20 mN·m | 18 | 0 |"),
    "wrong_files.py": (["--quick", "--heard"], "| joint zero off by 1° |"),
}
"""Arguments that shorten each tool, and what it prints."""

ELSEWHERE = {
    "compare_mujoco.py": "test/importing/test_public_models.py",
    "convert_continuum.py": "its own test",
    "continuum_figures.py": "its recordings are not part of this repository",
    "narrow_fits.py": "half a minute",
    "standard_errors.py": "half an hour",
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
