"""The page of topics, services and parameters is what the nodes themselves say."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from support.places import ROOT

TOOL = ROOT / "tools" / "ros_reference.py"
PAGE = ROOT / "docs" / "ros_reference.md"


def test_the_page_is_what_every_node_of_the_package_says() -> None:
    pytest.importorskip("rclpy")
    pytest.importorskip("viser", reason="viser, which the node view needs, is not installed")
    done = subprocess.run([sys.executable, TOOL], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == PAGE.read_text(), f"python {TOOL.relative_to(ROOT)} --write"
    entry = (ROOT / "cdrj_ros" / "nodes" / "entry.py").read_text()
    nodes = set(re.findall(r"^    _run\(\"(\w+)\"\)", entry, re.MULTILINE))
    assert nodes == {line[3:] for line in done.stdout.splitlines() if line.startswith("## ")}
