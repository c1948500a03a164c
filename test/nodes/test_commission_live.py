"""`commission` records from the running robot."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import yaml
from support.places import ROBOTS

from cdrj_ros.recordings import read_messages

ANGLES = ("/cdrj/motor_states", "/cdrj/joint_states")
PATIENCE_S = 120.0


def commissioned(start_executable: Any, folder: Path, *given: str) -> tuple[int, str, str]:
    process = start_executable(
        "commission", "--robot", str(ROBOTS / "prototype.yaml"), "--out", str(folder / "new.yaml"),
        "--force", "--rest", "live", "--yes", *given,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    output, errors = process.communicate(timeout=PATIENCE_S)
    return process.returncode, output.decode(), errors.decode()


def test_a_tare_is_recorded_from_the_running_robot_into_a_new_bag_each_time(
    start_executable: Any, start_node: Any, tmp_path: Path
) -> None:
    start_node("rig", "--ros-args", "-p", "robot:=prototype")
    for name in ("new_rest", "new_rest_2"):
        code, said, errors = commissioned(start_executable, tmp_path)
        assert code == 0, errors
        assert f"recorded: {tmp_path / name}\n" in said
        heard = {one.topic for one in read_messages(tmp_path / name, ANGLES)}
        assert heard == set(ANGLES)
    written = yaml.safe_load((tmp_path / "new.yaml").read_text(encoding="utf-8"))
    assert written["identified"]["numbers"]["joints.elbow.reference_angle"] == "tare, new_rest_2"


def test_a_topic_that_nobody_publishes_is_one_clear_line_and_leaves_no_bag(
    start_executable: Any, start_node: Any, tmp_path: Path
) -> None:
    start_node("rig", "--ros-args", "-p", "robot:=prototype")
    given = ("--motor-topic", "/wrong/motor_states")
    code, _, errors = commissioned(start_executable, tmp_path, *given)
    assert code == 2
    line = [one for one in errors.splitlines() if one.startswith("commission:")]
    assert line == ["commission: no message on /wrong/motor_states; there is /cdrj/motor_states"]
    assert not list(tmp_path.iterdir())
