"""``check_robot`` names the numbers that make tensions uncertain, and how to reduce them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.places import PROTOTYPE, ROBOT

from cdrj_ros.commands import check_robot
from cdrj_ros.inspection.shares import uncertainty_shares
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.writer import with_section

TEXT = PROTOTYPE.read_text(encoding="utf-8")


def report(tmp_path: Path, uncertainty: str | None) -> Any:
    robot, out = tmp_path / "robot.yaml", tmp_path / "figures.json"
    robot.write_text(with_section(TEXT, "uncertainty", uncertainty), encoding="utf-8")
    assert check_robot.main([str(robot), "--json", str(out)]) == 0
    return json.loads(out.read_text(encoding="utf-8"))["uncertainty"]


def test_a_fresh_file_is_wide_and_names_three_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = report(tmp_path, None)
    assert found["stddev"]["upper/8"] > 10.0
    assert found["causes"][0]["share"]["upper/8"] > 0.4
    for element in found["stddev"]:
        assert sum(cause["share"][element] for cause in found["causes"]) == pytest.approx(1.0)
    text = " ".join(capsys.readouterr().out.split())
    for cause in found["causes"][:3]:
        assert f"{cause['what']}: {cause['measure']}" in text
    assert found["causes"][0]["what"] == "zero of joint elbow"
    assert "~/tare" in found["causes"][0]["measure"]


def test_an_exact_file_has_nothing_to_reduce(tmp_path: Path) -> None:
    assert report(tmp_path, "uncertainty: {others: exact}") is None


def test_the_contribution_of_one_number_is_its_effect() -> None:
    """A preload known to 0.4 N changes every tension of a frictionless cable by as much."""
    model = load_model(ROBOT)
    document: Any = dict(model.robot.document)
    document["uncertainty"] = {
        "others": "exact", "parameters": ["cables.upper.preload"], "stddev": [0.4],
    }  # fmt: skip
    loose = with_numbers(document, {"friction.mu_c": 0.0, "friction.mu_s": 0.0,
                                    "friction.bearing_friction": 0.0})  # fmt: skip
    shares = uncertainty_shares(prepare(build_robot(loose, "test")))
    assert shares is not None
    assert shares.stddev[:8] == pytest.approx(0.4, rel=0.02)
    assert np.all(shares.stddev[8:] == 0.0)
    assert [cause.what for cause in shares.causes] == ["cables.upper.preload"]
