"""How a process of a node starts: where it logs, and how it is scheduled."""

import os
import subprocess
import sys

import pytest

SCRIPT = """
from cdrj_ros.nodes.spinning import LOG_FOLDERS, ros_context
with ros_context(["x", "--ros-args", "-p", "a:=1"]):
    import rclpy
    node = rclpy.create_node("x", automatically_declare_parameters_from_overrides=True)
    node.get_logger().info(f"a is {node.get_parameter('a').value}")
    print(rclpy.ok())
"""


def _run(**environment):
    kept = {k: v for k, v in os.environ.items() if k not in ("ROS_LOG_DIR", "ROS_HOME", "HOME")}
    return subprocess.run(
        [sys.executable, "-c", SCRIPT], env=kept | environment, capture_output=True, text=True,
        timeout=300, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("environment", "reason"),
    [
        ({}, "none of ROS_LOG_DIR, ROS_HOME, HOME is set"),
        ({"HOME": "/dev/null/home"}, "/dev/null is not a folder"),
    ],
)
def test_without_a_place_for_log_files_a_node_runs_and_says_so(environment, reason):
    done = _run(**environment)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["True"]
    said = done.stderr.splitlines()
    assert said[0].startswith("no log file: ")
    assert reason in said[0]
    assert len(said) == 2
    assert "a is 1" in said[1]
