"""The examples in the README must run as printed and give the stated errors."""

import os
import re
import subprocess

import pytest
from support.places import ROOT

import cdrj_ros as cdrj
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

README = (ROOT / "README.md").read_text()


def test_the_robot_file_of_the_readme_is_valid():
    (text,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    model = prepare(parse_robot(text, "README.md"))
    assert model.layout.elements == ("flexor/1", "flexor/2")
    assert not [each for each in find_suspicions(inspect_robot(model)) if each.grave]


COMMANDS = [
    line.partition(" #")[0].strip()
    for block in re.findall(r"```bash\n(.*?)```", README, re.DOTALL)
    for line in block.splitlines()
    if line.partition(" #")[0].strip()
]
"""All lines of all blocks, without comments."""

RUN = [line for line in COMMANDS if not line.startswith(("make ", "colcon ", "ros2 "))]
"""No wheel provides `ros2` and colcon; test_ros_commands.py checks the names on their lines."""


def test_every_other_command_runs_as_pasted(tmp_path):
    """Run in a folder with the README's robot file."""
    pytest.importorskip("rclpy")
    assert {line.split()[0] for line in RUN} == {
        "check_robot", "simulate", "validate", "identify",
    }  # fmt: skip
    (text,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    (tmp_path / "my_arm.yaml").write_text(text)
    script = f". {ROOT}/tools/env.sh\nset -e\n" + "\n".join(RUN)
    path = os.environ["PATH"].split(":")
    environment = dict(os.environ)
    environment["PATH"] = ":".join(part for part in path if "cdrj_ros" not in part)
    ended = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    assert "command not found" not in ended.stderr
    for made in ("my_bag/metadata.yaml", "report.html", "identified.yaml"):
        assert (tmp_path / made).stat().st_size > 0
    figures = cdrj.validate(str(tmp_path / "my_arm.yaml"), str(tmp_path / "my_bag"))
    assert not any("resolution" in note for note in figures.bags[0].notes)
    assert figures.pooled["tension/flexor/2"].mean_relative_error < 0.01
    assert min(one.r2 for one in figures.pooled.values()) > 0.98


def test_the_folders_that_colcon_builds_are_packages():
    (build,) = (line.partition(" && ")[0] for line in COMMANDS if line.startswith("colcon"))
    for folder in build.partition("--base-paths ")[2].split():
        assert (ROOT / folder / "package.xml").exists()
