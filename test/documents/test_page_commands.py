"""Commands on the pages that need nothing but this repository run as printed, only shorter.

Those of README and tutorial have tests of their own; options of all others are checked in
test_cross_references.py, names on lines of `ros2` in test_ros_commands.py.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from cdrj_ros.bag import read_recording
from cdrj_ros.commands.check_robot import main as check_robot
from cdrj_ros.commands.simulate import main as simulate

ROOT = Path(__file__).parents[2]
SHORT = ["--duration", "3", "--cells", "1"]


def lines(page: str, command: str) -> list[str]:
    """Lines of a page that begin with a command, without comments."""
    blocks = re.findall(r"```bash\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)
    text = re.sub(r"\\\n", " ", "".join(blocks))
    return [line for line in text.splitlines() if line.startswith(f"{command} ")]


@pytest.mark.parametrize("line", lines("rig.md", "simulate"))
def test_simulations_of_the_page_on_the_rig_run(line: str, tmp_path: Path) -> None:
    words = shlex.split(line.replace("@20:", "@2:"), comments=True)[1:]
    assert words[0] == "OUT"
    bag = tmp_path / "OUT"
    assert simulate([str(bag), *words[1:], *SHORT]) == 0
    assert len(read_recording(bag).motors["winch"].value) > 2_000


@pytest.mark.parametrize("line", lines("uncertainty.md", "check_robot"))
def test_checks_of_the_page_on_uncertainty_run(
    line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    assert check_robot(shlex.split(line, comments=True)[1:]) == 0
    assert "16 elements" in capsys.readouterr().out


def test_the_pages_have_such_lines() -> None:
    assert len(lines("rig.md", "simulate")) > 3
    assert lines("uncertainty.md", "check_robot")
