"""Tests of the command reproduce, run in this process."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cdrj_ros.commands import reproduce
from cdrj_ros.reproduction.runs import Motion

PNG = b"\x89PNG\r\n\x1a\n"


def _one_line(capsys: pytest.CaptureFixture[str], *words: str) -> None:
    error = capsys.readouterr().err
    assert error.startswith("reproduce: ")
    assert error.count("\n") == 1
    for word in words:
        assert word in error


def test_reproduce_writes_every_figure_and_the_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from cdrj_ros.reproduction.figures import DRAWINGS

    out = tmp_path / "new" / "folder"
    assert reproduce.main(["--out", str(out), "--quick"]) == 0
    for name in DRAWINGS:
        assert (out / f"{name}.png").read_bytes().startswith(PNG)
    printed = capsys.readouterr().out
    text = (out / "tables.md").read_text()
    for heading in ("Table I:", "Table II:", "Errors:"):
        assert heading in printed
        assert f"## {heading}" in text
    assert "1.34 N, 13.65 %" in printed
    assert "diameter [mm]" in printed

    def refuse(token: str) -> float:
        raise AssertionError(f"{token} is no JSON number")

    numbers = json.loads((out / "figures.json").read_text(), parse_constant=refuse)
    assert set(numbers["experiments"]) == {"first", "second"}
    assert numbers["experiments"]["first"]["preload"] == [23.52, 6.66]
    assert numbers["motion"]["cycles"] == 1


def test_the_quick_look_takes_a_small_part_of_the_whole_work() -> None:
    """Work is counted in samples of contact cells, which take nearly all of the time."""

    def work_of(motion: Motion, cells: int) -> tuple[int, int]:
        steps = motion.path()[0].size
        return steps * cells, steps

    rig, estimates = work_of(*reproduce.QUICK)
    whole_rig, whole_estimates = work_of(*reproduce.WHOLE)
    assert rig < whole_rig / 20
    assert estimates < whole_estimates / 5


@pytest.mark.parametrize("name", ["tables.md", "figures.json", "fig09_rho.png"])
def test_earlier_results_are_replaced_only_with_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(reproduce, "work", lambda *_, **__: pytest.fail("ran before the refusal"))
    (tmp_path / name).write_text("kept")
    (tmp_path / "other.txt").write_text("kept")
    assert reproduce.main(["--out", str(tmp_path)]) == 2
    _one_line(capsys, f"{name} exists already; --force replaces it")
    assert (tmp_path / name).read_text() == "kept"
    with pytest.raises(pytest.fail.Exception, match="ran before"):
        reproduce.main(["--out", str(tmp_path), "--force"])


def test_out_is_required(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        reproduce.main([])
    assert left.value.code == 2
    assert "--out" in capsys.readouterr().err


def test_a_file_in_the_place_of_the_folder_is_refused_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = tmp_path / "there"
    there.write_text("kept")
    assert reproduce.main(["--out", str(there)]) == 2
    _one_line(capsys, "--out must be a folder", "there is a file")
    assert there.read_text() == "kept"
    assert reproduce.main(["--out", str(there / "below")]) == 2
    _one_line(capsys, "cannot be created")


def test_help_names_the_outputs(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        reproduce.main(["--help"])
    assert left.value.code == 0
    text = capsys.readouterr().out
    assert "figures.json" in text
    assert "--quick" in text
