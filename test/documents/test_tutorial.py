"""The commands of docs/tutorial.md work on the files that the page shows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cdrj_ros.commands import check_robot, import_robot

PAGE = (Path(__file__).parents[2] / "docs" / "tutorial.md").read_text(encoding="utf-8")
FILES = re.findall(r"Save (?:it|this one)\s+as\s+`([\w.]+)`[^`]*```\w+\n(.*?)```", PAGE, re.DOTALL)
COMMANDS = [
    line.split()
    for block in re.findall(r"```bash\n(.*?)```", PAGE, re.DOTALL)
    for line in block.splitlines()
    if line.startswith(("import_robot", "check_robot"))
]


def write_files(folder: Path) -> None:
    for name, text in FILES:
        (folder / name).write_text(text, encoding="utf-8")


def test_the_page_shows_three_files_and_three_commands() -> None:
    assert [name for name, _ in FILES] == ["arm.xml", "gripper.urdf", "gripper.yaml"]
    assert [command[0] for command in COMMANDS] == ["import_robot", "check_robot", "check_robot"]


def test_the_commands_of_the_page_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco", reason="the test extra mujoco is not installed")
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    for program, *arguments in COMMANDS:
        command = {"import_robot": import_robot, "check_robot": check_robot}[program]
        assert command.main(arguments) == 0
    said = capsys.readouterr().out
    assert "biceps" in said
    assert "no cable can decrease it" in said
    for name in ("arm.png", "arm.html", "gripper.png"):
        assert (tmp_path / name).stat().st_size > 10_000


@pytest.mark.parametrize("value", ["name: biceps_motor", "radius: 0.01", "winding: 1"])
def test_the_values_to_be_replaced_are_in_the_imported_file(
    value: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco", reason="the test extra mujoco is not installed")
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert import_robot.main(COMMANDS[0][1:]) == 0
    assert value in (tmp_path / "arm.yaml").read_text()
