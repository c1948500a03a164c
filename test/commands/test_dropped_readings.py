"""Recordings in which every fifth reading is lost, most of them in long bursts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cdrj_ros.commands import simulate, validate

LIMITS = "channels: {tension: {coverage: {min: 0.99}}, tension/*: {coverage: {min: 0.98}}}\n"


def test_lost_readings_are_part_of_the_standard_deviations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The truth beside the estimates is the rig's; the line between two readings is far off."""
    bag, limits, figures = (tmp_path / name for name in ("bag", "limits.yaml", "f.json"))
    limits.write_text(LIMITS)
    rig = tmp_path / "rig.yaml"
    losses = "{dropout: 0.2, burst: 0.8}"
    rig.write_text(f"{{motors: {losses}, joints: {losses}}}")
    words = ["--rig", str(rig), "--duration", "16"]
    assert simulate.main([str(bag), "--robot", "prototype", *words]) == 0
    judged = ["--limits", str(limits), "--json", str(figures)]
    assert validate.main([str(bag), "--robot", "prototype", *judged]) == 0, capsys.readouterr().out
    found = json.loads(figures.read_text())
    channels = found["all"]["channels"]
    tensions = [one for name, one in channels.items() if name.startswith("tension/")]
    assert len(tensions) == 16
    assert max(one["max_abs_error"] for one in tensions) > 4.0, "the losses matter"
    assert min(one["n"] for one in tensions) > 500
