"""Tests of the commands validate and simulate, run in this process."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from support.places import ROBOT, ROOT, SAMPLE

from cdrj_ros.commands import validate
from cdrj_ros.evaluation import metrics
from cdrj_ros.recordings import BagWriter

LOW = ROOT / "bags" / "prototype_preload_23_6"
ODD = ROOT.parent / "shared" / "data" / "odd_bags"

FIGURES = {"unit", "n", *metrics.FIGURES}


def _figures(path: Path) -> dict:  # type: ignore[type-arg]
    def refuse(text: str) -> float:
        raise AssertionError(f"{text} is no JSON number")

    return json.loads(path.read_text(), parse_constant=refuse)  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    ("bag", "preload", "last_element", "all_elements"),
    [(SAMPLE, [], 0.005, 0.004), (LOW, ["--preload", "23.52,6.66"], 0.015, 0.01)],
)
def test_errors_on_the_sample_recordings_are_far_below_those_of_the_source(
    bag: Path, preload: list[str], last_element: float, all_elements: float, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    out = tmp_path / "figures.json"

    assert validate.main([str(bag), "--robot", ROBOT, "--json", str(out), *preload]) == 0

    figures = _figures(out)
    assert figures["bags"][0]["duration_s"] == pytest.approx(60.0, abs=0.1)
    left_out = capsys.readouterr().out.splitlines()[0]
    assert left_out.endswith(" reference values before the first or after the last estimate")
    channels = figures["all"]["channels"]
    assert all(set(channel) == FIGURES for channel in channels.values())
    tensions = {name: c for name, c in channels.items() if name.startswith("tension/")}
    assert len(tensions) == 16
    assert tensions["tension/upper/8"]["mean_relative_error"] <= last_element
    assert tensions["tension/lower/8"]["mean_relative_error"] <= last_element
    mean = math.fsum(c["mean_relative_error"] for c in tensions.values()) / 16
    assert mean <= all_elements
    assert channels["nodal_force/upper/3"]["unit"] == "N"
    assert channels["effort/winch"]["r2"] > 0.999


def _one_line(capsys: pytest.CaptureFixture[str], *words: str) -> None:
    error = capsys.readouterr().err
    lines = [line for line in error.splitlines() if not line.startswith("validating: ")]
    assert len(lines) == 1, error
    for word in words:
        assert word in lines[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["/no/such/bag"], ["/no/such/bag", "does not exist"]),
        ([str(SAMPLE), "--motor-topic", "/x"], ["no topic /x", "/cdrj/motor_states"]),
        ([str(SAMPLE), "--motor-topic", "/reference/tensions"], ["JointState", "CableTensions"]),
        ([str(SAMPLE), "--reference", "/nothing"], ["no references", "--reference"]),
        ([str(SAMPLE), "--preload", "1,2,3"], ["preload needs 2"]),
        ([str(SAMPLE), "--json", "/no/such/folder/f.json"], ["/no/such/folder"]),
    ],
)
def test_wrong_arguments_are_one_line_and_exit_code_2(
    arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert validate.main([*arguments, "--robot", ROBOT]) == 2
    _one_line(capsys, *words)


@pytest.mark.skipif(not ODD.exists(), reason=f"{ODD} is absent")
def test_a_motor_that_is_missing_on_a_shared_topic_is_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = [
        f"{option}=/joint_states" for option in ("--motor-topic", "--joint-topic", "--reference")
    ]
    assert validate.main([str(ODD / "plain"), *arguments, "--robot", ROBOT]) == 2
    _one_line(capsys, "no motor named winch", "motor")


def test_a_bag_whose_readings_are_all_refused_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        stamps = [1, 2, 3]
        nan = [[math.nan]] * 3
        bag.write_joint_states("/cdrj/motor_states", stamps, ("winch",), position=nan)
        bag.write_joint_states("/cdrj/joint_states", stamps, ("elbow",), position=nan)
        bag.write_tensions("/reference/tensions", stamps, ("upper/1",), [[1.0]] * 3)
    assert validate.main([str(tmp_path / "bag"), "--robot", ROBOT]) == 2
    _one_line(capsys, "not one sample")
