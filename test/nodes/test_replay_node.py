"""The replay command as a user runs it, beside an estimator process."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
ROBOT = str(ROOT / "config" / "robots" / "prototype.yaml")
SAMPLE = ROOT / "bags" / "prototype_preload_36_26"
PATIENCE_S = 60.0


def _run(start_node: Any, *arguments: str) -> tuple[int, str, str]:
    process = start_node("replay", *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    out, errors = process.communicate(timeout=2 * PATIENCE_S)
    return process.returncode, out.decode(), errors.decode()


def test_replay_judges_the_node_and_writes_figures_and_report(
    start_node: Any, short_bag: str, tmp_path: Path
) -> None:
    start_node("estimator", "--ros-args", "-p", f"robot:={ROBOT}")
    figures, report = tmp_path / "f.json", tmp_path / "r.html"

    code, out, errors = _run(
        start_node, short_bag, "--robot", ROBOT, "--json", str(figures), "--html", str(report)
    )

    assert code == 0, errors
    assert "all elements" in out
    (bag,) = json.loads(figures.read_text())["bags"]
    assert bag["channels"]["tension/upper/8"]["mean_relative_error"] < 0.015
    assert not any("did not arrive" in note for note in bag["notes"])
    assert "tension/upper/8" in report.read_text()


def test_replay_without_an_estimator_says_so(start_node: Any, short_bag: str) -> None:
    code, _, errors = _run(start_node, short_bag, "--robot", ROBOT, "--patience", "1")
    assert code == 2
    assert "no estimator" in errors
    assert "Traceback" not in errors


@pytest.mark.parametrize("rate", ["0", "-1", "nan"])
def test_a_rate_that_makes_no_sense_is_refused(start_node: Any, rate: str) -> None:
    code, _, errors = _run(start_node, str(SAMPLE), "--robot", ROBOT, "--rate", rate)
    assert code == 2
    assert "--rate" in errors
