"""Lines of `ros2` on any page name nodes, launch files, parameters and services that exist.

`ros2` itself is not on PyPI.  The names are compared with docs/ros_reference.md, which the nodes
write themselves; options of the other commands are checked in test_cross_references.py.
"""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path

from support.page_lines import PAGES, ROOT, command_lines

SECTIONS = {
    part.splitlines()[0]: part
    for part in (ROOT / "docs" / "ros_reference.md").read_text().split("\n## ")[1:]
}
"""Description of every node, by name."""

ROBOTS = {path.stem for path in (ROOT / "config" / "robots").glob("*.yaml")}


def ros_lines() -> list[list[str]]:
    """Words of every line of the pages that starts with ``ros2``, comments removed."""
    return [
        shlex.split(line, comments=True)
        for page in PAGES
        for line in command_lines(page)
        if line.startswith("ros2 ") and "$(ros2" not in line
    ]


def check_robot_name(value: str) -> None:
    """A shipped robot, a file of this repository, or a file that the reader is to have."""
    made_by_reader = "/path/to/" in value or "$" in value or Path(value).stem.startswith("my_")
    assert value in ROBOTS or (ROOT / value).exists() or made_by_reader, value


def check_run(node: str, words: list[str]) -> None:
    assert node in SECTIONS, node
    for before, word in pairwise(words):
        name, assigned, value = word.partition(":=")
        if before == "-p" and assigned:
            assert f"| `{name}` |" in SECTIONS[node], f"{node} has no parameter {name}"
            if name == "robot":
                check_robot_name(value)


def check_launch(file: str, words: list[str]) -> None:
    text = (ROOT / "launch" / file).read_text()
    if "IncludeLaunchDescription(" in text:
        text += (ROOT / "launch" / "estimator.launch.py").read_text()
    known = re.findall(r'DeclareLaunchArgument\(\s*"(\w+)"', text)
    for word in words:
        name, assigned, value = word.partition(":=")
        if assigned:
            assert name in known, f"{file} has no argument {name}"
            if name == "robot":
                check_robot_name(value)


def check_service(name: str, kind: str) -> None:
    node, service = name.removeprefix("/cdrj/").split("/")
    assert f"| `~/{service}` | {kind.replace('/srv', '')} |" in SECTIONS[node], (name, kind)


def check_topic(name: str, kind: str) -> None:
    row = f"| `{name.removeprefix('/cdrj/')}` | {kind.replace('/msg', '')} |"
    assert any(row in section for section in SECTIONS.values()), (name, kind)


def test_names_on_the_lines_of_ros2_exist() -> None:
    for words in ros_lines():
        match words[1:]:
            case ["run", "cdrj_ros", node, *rest]:
                check_run(node, rest)
            case ["launch", "cdrj_ros", file, *rest]:
                check_launch(file, rest)
            case ["service", "call", name, kind, *_]:
                check_service(name, kind)
            case ["topic", "pub", "--once", name, kind, *_]:
                check_topic(name, kind)
            case ["param", "set" | "get" | "describe", node, name, *_]:
                assert f"| `{name}` |" in SECTIONS[node.removeprefix("/cdrj/")], words
            case ["lifecycle", "set", node, transition]:
                assert node == "/cdrj/estimator"
                assert transition in ("configure", "activate", "deactivate", "cleanup", "shutdown")
            case ["interface", "show", name]:
                package, kind, message = name.split("/")
                folder = ROOT / "msg_defs" / package
                assert (folder / kind / f"{message}.{kind}").exists(), name
