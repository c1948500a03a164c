"""Encoders whose counts are worth much are named where the robot file states no resolution."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.places import PROTOTYPE

from cdrj_ros.commands import simulate, validate


def test_validate_says_why_errors_are_large_with_unstated_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = PROTOTYPE.read_text()
    left_out = ("resolution", "tracking")
    lines = [one for one in text.splitlines() if not any(key in one for key in left_out)]
    robot, bag = tmp_path / "robot.yaml", tmp_path / "bag"
    robot.write_text("\n".join(lines))
    coarse = tmp_path / "coarse.yaml"
    coarse.write_text("joints: {counts: 4096}\n")
    simulated = [str(bag), "--robot", str(robot), "--rig", str(coarse), "--duration", "5"]
    assert simulate.main([*simulated, "--cells", "1"]) == 0
    assert validate.main([str(bag), "--robot", str(robot)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "elbow is read in counts of 0.00153, each worth" in said
    assert "state its resolution, and a tracking_bandwidth" in said
    assert "winch is read in counts" not in said, "those of the motor are worth little"
    assert validate.main([str(bag), "--robot", str(PROTOTYPE)]) == 0
    assert "is read in counts" not in capsys.readouterr().out
