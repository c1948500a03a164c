"""`commission` records from the running robot."""

import subprocess

import pytest
import yaml
from support.places import ROBOTS

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.nodes import commission
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.source import read_messages

ANGLES = ("/cdrj/motor_states", "/cdrj/joint_states")
PATIENCE_S = 120.0


def test_a_tare_is_recorded_from_the_running_robot_into_a_new_bag_until_enter(
    start_executable, tmp_path, monkeypatch
):
    start_executable("rig", "--ros-args", "-p", "robot:=prototype")
    (tmp_path / "new_rest").mkdir()
    process = start_executable(
        "commission", "--robot", str(ROBOTS / "prototype.yaml"), "--out",
        str(tmp_path / "new.yaml"),
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    said, errors = process.communicate(b"live\n\nupper=36\n", timeout=PATIENCE_S)
    assert process.returncode == 0, errors
    assert b"live: record it now, until Enter" in said
    assert b"> preload: OK" in said, "the line after Enter answers the next question"
    assert f"recorded: {tmp_path / 'new_rest_2'}\n" in said.decode()
    heard = {one.topic for one in read_messages(tmp_path / "new_rest_2", ANGLES)}
    assert heard == set(ANGLES)
    written = yaml.safe_load((tmp_path / "new.yaml").read_text(encoding="utf-8"))
    assert written["identified"]["numbers"]["joints.elbow.reference_angle"] == "tare, new_rest_2"

    monkeypatch.setattr(commission, "PATIENCE_S", 1.0)
    wrong, nobody = tmp_path / "wrong", Topics(motors="/wrong/motor_states")
    with pytest.raises(BagError) as refused:
        commission.record(wrong, nobody, 1.0, False)
    assert str(refused.value).startswith("no message on /wrong/motor_states")
    assert not wrong.exists()
