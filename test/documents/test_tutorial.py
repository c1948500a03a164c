"""Commands of docs/tutorial.md and robot_file.md work, and its table is what a reader gets."""

import re
import shlex
import sys

import pytest
from support.page_lines import ROOT, command_lines, loaded_tool, shown_files, write_files

import cdrj_ros as cdrj
from cdrj_ros.commands import check_robot, import_robot

PAGE = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
FILES = shown_files("docs/tutorial.md")
RUN_HERE = "import_robot", "check_robot", "python -c"


def lines(page, *begins):
    """The words of the lines of a page that begin so."""
    found = command_lines(ROOT / "docs" / page)
    return [shlex.split(line, comments=True) for line in found if line.startswith(begins)]


def run_line(words):
    """Run a command in this process, and a line of Python likewise."""
    if words[0] == "python":
        exec(words[2], {})  # noqa: S102 our own page
    else:
        command = {"import_robot": import_robot, "check_robot": check_robot}[words[0]]
        assert command.main(words[1:]) == 0


def test_the_commands_of_the_page_run(tmp_path, monkeypatch, capsys):
    pytest.importorskip("mujoco", reason="the test extra mujoco is not installed")
    write_files(FILES, tmp_path)
    monkeypatch.chdir(tmp_path)
    for words in lines("tutorial.md", *RUN_HERE):
        if "index.yaml" not in words:  # of a hand whose model is not here
            run_line(words)
    said = capsys.readouterr().out
    assert "biceps" in said
    assert "no cable can decrease it" in said
    for name in ("arm.png", "gripper.png"):
        assert (tmp_path / name).stat().st_size > 10_000


def test_the_commands_that_import_and_compare_models_run(tmp_path, monkeypatch, capsys):
    pytest.importorskip("mujoco", reason="the test extra mujoco is not installed")
    (tmp_path / "FOLDER").mkdir()
    for name in ("hand.xml", "FOLDER/hand.xml"):
        (tmp_path / name).write_text(FILES["arm.xml"], encoding="utf-8")
    (tmp_path / "arm.urdf").write_text(FILES["gripper.urdf"], encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    imports = lines("robot_file.md", "import_robot")
    (compare,) = lines("validation.md", "python tools/compare_mujoco")
    assert [words[0] for words in imports] == ["import_robot", "import_robot"]
    for words in imports:
        run_line(words)
    monkeypatch.setattr(sys, "argv", [*compare[1:], "--poses", "20"])
    assert loaded_tool(ROOT / compare[1]).main() == 0
    assert "hand.xml | 1 | 1 | " in capsys.readouterr().out


def test_the_command_of_the_page_on_robot_files_runs(tmp_path, monkeypatch, capsys):
    page = (ROOT / "docs" / "robot_file.md").read_text(encoding="utf-8")
    (tmp_path / "one_joint.yaml").write_text(re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)[0])
    monkeypatch.chdir(tmp_path)
    for words in lines("robot_file.md", "check_robot", "python -c"):
        run_line(words)
    assert "one_joint: " in capsys.readouterr().out
    assert (tmp_path / "one_joint.png").stat().st_size > 10_000


SHOWN = dict(
    re.findall(r"^\| (the start|`tare`|`set_preload`).*?\| 5\.0 ± ([\d.]+) \|",
               PAGE, re.MULTILINE)
)  # fmt: skip


def largest_at_rest(estimator, begin_s):
    """Largest standard deviation after four seconds at rest in the reference pose [N]."""
    for k in range(400):
        stamp_ns = begin_s * 10**9 + k * 10**7
        estimate = estimator.update(stamp_ns, [0.0], [0.0, 0.0])
    return max(estimate.tension_stddevs.values())


def test_the_table_of_the_tutorial_shows_what_the_estimator_gives(tmp_path):
    write_files(FILES, tmp_path)
    estimator = cdrj.Estimator(cdrj.load(tmp_path / "gripper.yaml"))
    found = {"the start": largest_at_rest(estimator, 100)}
    estimator.tare()
    found["`tare`"] = largest_at_rest(estimator, 200)
    estimator.set_preload({"flexor": 5.0})
    found["`set_preload`"] = largest_at_rest(estimator, 300)
    assert {name: float(value) for name, value in SHOWN.items()} == pytest.approx(found, rel=0.05)
