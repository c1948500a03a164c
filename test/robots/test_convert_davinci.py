"""Conversion of the runs of da Vinci instruments, on a made-up file of their form."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.recordings import Topics, read_recording

ROOT = Path(__file__).parents[2]
RECORDED = ROOT.parent / "shared" / "data" / "davinci" / "validate" / "Tool_4_Maryland_L_4_11"
sys.path.insert(0, str(ROOT / "tools"))

import convert_davinci  # noqa: E402

HEADER = "%Used left spindle of tool number 5 with a 0.20 Hz Sine wave\n%idxPulse_0=0\n"
ROWS = (
    "0.000,1366,616,0.0550,196,-232,0.2000,-0.0390,-5906,1365.33",
    "0.001,1366,610,0.0550,196,-422,0.2000,-0.0390,-5906,1365.33",
    "0.002,1367,612,0.0550,195,-480,0.2000,-0.0390,-5906,1365.33",
)


def write_run(folder: Path, rows: tuple[str, ...] = ROWS) -> Path:
    folder.mkdir()
    (folder / "SerialLog.txt").write_text("not a run", encoding="utf-8")
    (folder / "11.TXT").write_text(HEADER + "\n".join(rows) + "\n", encoding="utf-8")
    return folder


def test_counts_become_si_units_and_the_name_tells_instrument_and_run(tmp_path: Path) -> None:
    source = write_run(tmp_path / "Tool_4_Maryland_L_4")
    assert convert_davinci.main([str(source), "--out", str(tmp_path / "bags")]) == 0
    (bag,) = (tmp_path / "bags").iterdir()
    assert bag.name == RECORDED.name
    run = read_recording(str(bag), Topics())
    spindle, jaw = run.motors["spindle"], run.joints["jaw"]
    assert spindle.value == pytest.approx(np.array([1366, 1366, 1367]) * 2.0 * np.pi / 8192.0)
    assert jaw.value == pytest.approx(np.array([196, 196, 195]) * 2.0 * np.pi / 4000.0)
    torques = run.references["effort/spindle"].value, run.references["effort/jaw"].value
    assert torques[0] == pytest.approx(np.array([616, 610, 612]) * 3.9811e-5)
    assert torques[1] == pytest.approx(np.array([-232, -422, -480]) * 3.9811e-5)
    assert np.diff(spindle.stamp_ns).tolist() == [1_000_000, 1_000_000]
    assert jaw.stamp_ns.tolist() == spindle.stamp_ns.tolist()


@pytest.mark.skipif(not RECORDED.is_dir(), reason="the converted recordings are missing")
def test_the_first_rows_are_those_of_the_converted_recording(tmp_path: Path) -> None:
    source = write_run(tmp_path / "Tool_4_Maryland_L_4")
    assert convert_davinci.main([str(source), "--out", str(tmp_path)]) == 0
    ours = read_recording(str(tmp_path / RECORDED.name), Topics())
    theirs = read_recording(str(RECORDED), Topics())
    for name in ("effort/spindle", "effort/jaw"):
        pair = [one.references[name].value[:2] for one in (ours, theirs)]
        assert pair[0] == pytest.approx(pair[1], abs=1e-12)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (("0.000,1,2,3",), "not rows of 10 finite numbers"),
        ((ROWS[1], ROWS[0]), "its time does not increase"),
        ((ROWS[0].replace("1366", "a"),), "11.TXT"),
        ((ROWS[0].replace("1366", "nan"),), "not rows of 10 finite numbers"),
    ],
)
def test_other_files_are_refused_with_one_line(
    rows: tuple[str, ...], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = write_run(tmp_path / "runs", rows)
    assert convert_davinci.main([str(source), "--out", str(tmp_path / "bags")]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1


def test_a_folder_without_runs_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert convert_davinci.main([str(tmp_path), "--out", str(tmp_path / "bags")]) == 2
    assert "holds no run" in capsys.readouterr().err
