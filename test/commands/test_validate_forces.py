"""validate compares nodal forces as vectors where the reference has components."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.turned_forces import ROBOT, turned_bag

from cdrj_ros.commands import validate

DEGREES = 7.5
CHORD = 2.0 * np.sin(np.radians(DEGREES) / 2.0)
"""Relative vector error of a force turned by DEGREES."""


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return turned_bag(tmp_path_factory.mktemp("turned"), DEGREES)


def run(
    folder: Path, bag: Path, *arguments: object, robot: Path = ROBOT
) -> tuple[int, dict[str, Any]]:
    out = folder / "figures.json"
    code = validate.main(
        [str(bag), "--robot", str(robot), "--json", str(out), *map(str, arguments)]
    )
    return code, json.loads(out.read_text())


def split(figures: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Channels of magnitudes and channels of vectors."""
    channels = figures["all"]["channels"]
    return (
        {name: one for name, one in channels.items() if name.startswith("nodal_force/")},
        {name: one for name, one in channels.items() if name.startswith("force_vector/")},
    )


def test_a_turned_reference_is_seen_in_the_vectors_and_not_in_the_magnitudes(
    turned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, figures = run(tmp_path, turned)
    assert code == 0
    magnitudes, vectors = split(figures)
    assert len(magnitudes) == len(vectors) == 14
    for one in magnitudes.values():
        assert one["mean_relative_error"] < 1e-12
        assert one["mean_direction_error_deg"] is None
    for one in vectors.values():
        assert one["unit"] == "N"
        assert one["mean_direction_error_deg"] == pytest.approx(DEGREES, rel=1e-9)
        assert one["max_direction_error_deg"] == pytest.approx(DEGREES, rel=1e-9)
        assert one["mean_relative_error"] == pytest.approx(CHORD, rel=1e-9)
        assert one["reversal_error"] is not None or one["smooth_error"] is not None
    table = capsys.readouterr().out
    assert "Force vector [N]" in table
    assert "mean direction" in table
    assert "7.5°" in table


def test_forces_in_a_named_frame_are_compared_only_with_a_robot_that_has_positions(
    tmp_path: Path,
) -> None:
    code, figures = run(tmp_path, turned_bag(tmp_path, DEGREES, frame_id="base"))
    assert code == 0
    magnitudes, vectors = split(figures)
    assert len(magnitudes) == 14
    assert not vectors
    (note,) = figures["bags"][0]["notes"]
    assert note.startswith("The recorded forces are in the frame base, but the robot file gives no")
    positions = ROBOT.with_name("prototype_positions.yaml")
    (tmp_path / "placed").mkdir()
    bag = turned_bag(tmp_path / "placed", DEGREES, robot=positions, frame_id="base")
    code, figures = run(tmp_path, bag, robot=positions)
    assert code == 0
    _, vectors = split(figures)
    assert figures["bags"][0]["notes"] == []
    assert vectors
    for one in vectors.values():
        assert one["max_direction_error_deg"] == pytest.approx(DEGREES, rel=1e-9)
