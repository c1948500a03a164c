"""The converter of the continuum instrument's recordings, on a small input in their format."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pytest

from cdrj_ros.recordings import Topics, read_recording

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "tools" / "convert_continuum.py"
LABEL = "2024-11-15-10-57-45 -60"
FIRST_S = 1_731_635_865
TURN = 51 * 4 * 1024
"""Counts per turn of the ball screw, 2 mm of wire."""
ROWS = 40


@pytest.fixture(scope="module")
def converter() -> ModuleType:
    """The script as a module, without another process."""
    spec = spec_from_file_location("convert_continuum", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


class Converted(NamedTuple):
    code: int
    out: str
    err: str


Convert = Callable[[Path, Path], Converted]


@pytest.fixture
def convert(
    converter: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Convert:
    def run(datasets: Path, out: Path) -> Converted:
        monkeypatch.setattr(sys, "argv", [SCRIPT.name, str(datasets), "--out", str(out)])
        code = converter.main()
        return Converted(code, *capsys.readouterr())

    return run


@pytest.fixture
def datasets(tmp_path: Path) -> Path:
    """Forty images at 30 Hz: wire 0 is pulled by one turn, load cell 0 misreads row 20."""
    folder = tmp_path / "datasets" / "train"
    folder.mkdir(parents=True)
    header = ["sec", "nanosec", "image", "motor position #0", "motor position #1"]
    header += ["wire length #0", "wire length #1", "loadcell #0", "loadcell #1", "fx", "fy", "fz"]
    with (folder / f"data_{LABEL}.csv").open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(header)
        for k in range(ROWS):
            counts = round(TURN * k / (ROWS - 1))
            grams = 3000.0 if k == 20 else 1000.0
            seconds, nanoseconds = divmod(k * 33_333_333, 10**9)
            place = [FIRST_S + seconds, nanoseconds, f"{k}.png", counts, -counts]
            rows.writerow([*place, 0.0, 0.0, grams, 10.0 * k, 1, 2, 3])
    images = [
        {"Image Filename": f"{k}.png", "Joint Angles Relative": [0.01 * k * j for j in range(8)]}
        for k in range(ROWS)
        if k != 5
    ]
    name = f"curve_fit_result-joint_angle_{LABEL}.json"
    (folder / name).write_text(json.dumps(images))
    (folder / f"data_LPF_{LABEL}.csv").write_text("must not be read")
    return tmp_path / "datasets"


def test_counts_grams_and_angles_become_si_units(
    convert: Convert, datasets: Path, tmp_path: Path
) -> None:
    done = convert(datasets, tmp_path / "bags")
    assert (done.code, done.err) == (0, "")
    run = read_recording(str(tmp_path / "bags" / "train" / "2024-11-15-10-57-45_-60"), Topics())
    screw = run.motors["wire_0"]
    assert screw.stamp_ns[1] == FIRST_S * 10**9 + 33_333_333
    assert screw.value[[0, -1]] == pytest.approx([0.0, 2.0 * np.pi])
    np.testing.assert_allclose(run.motors["wire_1"].value, -screw.value)
    assert run.joints["segment_3"].value[-1] == pytest.approx(0.01 * (ROWS - 1) * 2)
    tension = {name: one.value for name, one in run.references.items()}
    assert tension["tension/wire_0/1"] == pytest.approx(9.80665)
    assert tension["tension/wire_1/1"][-1] == pytest.approx(10.0 * (ROWS - 1) * 9.80665e-3)


def test_what_is_missing_or_misread_is_left_out(
    convert: Convert, datasets: Path, tmp_path: Path
) -> None:
    done = convert(datasets, tmp_path / "bags")
    run = read_recording(str(tmp_path / "bags" / "train" / "2024-11-15-10-57-45_-60"), Topics())
    assert len(run.joints["segment_1"].value) == ROWS - 1
    assert len(run.references["tension/wire_0/1"].value) == ROWS - 1
    assert len(run.references["tension/wire_1/1"].value) == ROWS
    assert "40 images, 1 s, 1 misreadings" in done.out


def test_an_angle_too_few_is_refused_in_one_line(
    convert: Convert, datasets: Path, tmp_path: Path
) -> None:
    path = datasets / "train" / f"curve_fit_result-joint_angle_{LABEL}.json"
    images = json.loads(path.read_text())
    images[3]["Joint Angles Relative"].pop()
    path.write_text(json.dumps(images))
    done = convert(datasets, tmp_path / "bags")
    assert done.code == 2
    assert "'Joint Angles Relative' of 3.png must be 8 numbers" in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "bags").exists()


def test_a_folder_without_recordings_is_refused(convert: Convert, tmp_path: Path) -> None:
    done = convert(tmp_path, tmp_path / "bags")
    assert (done.code, done.out) == (2, "")
    assert "holds no file data_*.csv" in done.err
