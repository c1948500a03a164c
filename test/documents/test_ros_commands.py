"""Lines of `ros2` on any page name nodes, launch files, parameters and services that exist.

`ros2` itself is not on PyPI.  The names are compared with docs/ros_reference.md, which is what the
nodes themselves say; options of the other commands are checked in test_cross_references.py.
"""

import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from support.page_lines import PAGES, ROOT, command_lines

TOOL = ROOT / "tools" / "ros_reference.py"
PAGE = (ROOT / "docs" / "ros_reference.md").read_text()
SECTIONS = {part.splitlines()[0]: part for part in PAGE.split("\n## ")[1:]}
"""Description of every node, by name."""
ROBOTS = {path.stem for path in (ROOT / "config" / "robots").glob("*.yaml")}
TRANSITIONS = ("configure", "activate", "deactivate", "cleanup", "shutdown")
LINES = [
    shlex.split(line, comments=True)
    for page in PAGES
    for line in command_lines(page)
    if line.startswith("ros2 ") and "$(ros2" not in line
]


def arguments_of_launch(file):
    text = (ROOT / "launch" / file).read_text()
    if "IncludeLaunchDescription(" in text:
        text += (ROOT / "launch" / "estimator.launch.py").read_text()
    return re.findall(r'DeclareLaunchArgument\(\s*"(\w+)"', text)


def is_known(words):
    """Whether the names of a line exist; those of assignments are checked for every line."""
    known = True
    match words:
        case ["run", "cdrj_ros", node, *rest]:
            given = [word.partition(":=")[0] for before, word in pairwise(rest) if before == "-p"]
            known = all(f"| `{name}` |" in SECTIONS[node] for name in given)
        case ["launch", "cdrj_ros", file, *rest]:
            known = {one.partition(":=")[0] for one in rest} <= {*arguments_of_launch(file)}
        case ["service", "call", name, kind, *_]:
            node, service = name.removeprefix("/cdrj/").split("/")
            known = f"| `~/{service}` | {kind.replace('/srv', '')} |" in SECTIONS[node]
        case ["topic", "pub", "--once", name, kind, *_]:
            row = f"| `{name.removeprefix('/cdrj/')}` | {kind.replace('/msg', '')} |"
            known = any(row in section for section in SECTIONS.values())
        case ["param", "set" | "get" | "describe", node, name, *_]:
            known = f"| `{name}` |" in SECTIONS[node.removeprefix("/cdrj/")]
        case ["lifecycle", "set", node, transition]:
            known = node == "/cdrj/estimator" and transition in TRANSITIONS
        case ["interface", "show", name]:
            package, kind, message = name.split("/")
            known = (ROOT / "msg_defs" / package / kind / f"{message}.{kind}").exists()
    return known


def test_names_on_the_lines_of_ros2_exist():
    for words in LINES:
        assert is_known(words[1:]), words
        for robot in (word.partition(":=")[2] for word in words if word.startswith("robot:=")):
            made_by_reader = "/path/to/" in robot or "$" in robot or Path(robot).stem[:3] == "my_"
            assert robot in ROBOTS or (ROOT / robot).exists() or made_by_reader, words


def test_the_page_is_what_every_node_of_the_package_says():
    pytest.importorskip("rclpy")
    pytest.importorskip("viser", reason="viser, which the node view needs, is not installed")
    done = subprocess.run([sys.executable, TOOL], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == (ROOT / "docs" / "ros_reference.md").read_text(), (
        f"python {TOOL.relative_to(ROOT)} > docs/ros_reference.md"
    )
    entry = (ROOT / "cdrj_ros" / "nodes" / "entry.py").read_text()
    nodes = set(re.findall(r"^(\w+) = partial\(_run", entry, re.MULTILINE)) - {"commission"}
    assert nodes == {line[3:] for line in done.stdout.splitlines() if line.startswith("## ")}
