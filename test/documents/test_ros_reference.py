"""The page of topics, services and parameters is what the nodes themselves say."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest
from support.places import ROOT

TOOL = ROOT / "tools" / "ros_reference.py"
PAGE = ROOT / "docs" / "ros_reference.md"


@pytest.fixture(scope="module")
def written() -> str:
    pytest.importorskip("rclpy")
    pytest.importorskip("viser", reason="viser, which the node view needs, is not installed")
    done = subprocess.run(
        [sys.executable, TOOL], capture_output=True, text=True, check=False, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_page_is_what_the_nodes_say(written: str) -> None:
    assert written == PAGE.read_text(), f"python {TOOL.relative_to(ROOT)} --write"


def test_every_parameter_has_a_description(written: str) -> None:
    rows = [line.split(" | ") for line in written.splitlines() if line.startswith("| `")]
    parameters = [row for row in rows if len(row) == 5]
    assert len(parameters) > 30
    for row in parameters:
        assert len(row[-1].rstrip(" |")) > 10, row[0]


def test_every_node_of_the_package_has_a_section(written: str) -> None:
    entry = (ROOT / "cdrj_ros" / "nodes" / "entry.py").read_text()
    nodes = set(re.findall(r"^    _run\(\"(\w+)\"\)", entry, re.MULTILINE))
    assert nodes == {line[3:] for line in written.splitlines() if line.startswith("## ")}
