"""Imports run one way, and nothing below the nodes needs ROS."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "cdrj_ros"

MAY_IMPORT = {
    "model": set(),
    "cdr": {"model"},
    "estimation": {"model"},
    "rig": {"model"},
    "bag": {"model", "cdr"},
    "report": {"model", "estimation"},
    "conversions": {"model", "cdr", "estimation"},
    "validation": {"model", "bag", "estimation"},
    "reproduction": {"model", "estimation", "rig"},
    "commands": {
        *("model", "bag", "cdr", "estimation", "report", "rig", "validation"),
        "reproduction",
    },
    "nodes": {"model", "bag", "cdr", "estimation", "conversions", "validation", "commands"},
}
"""What each part of the package may import, itself aside."""

ROS = (
    "rclpy",
    "cdrj_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "diagnostic_msgs",
    "rosgraph_msgs",
    "rcl_interfaces",
    "builtin_interfaces",
    "launch",
)


def _modules() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def _part(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@pytest.mark.parametrize("path", _modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_imports_only_what_lies_below_it(path: Path) -> None:
    part = _part(path)
    for name in _imported(path):
        parts = name.split(".")
        if parts[0] == "cdrj_ros" and len(parts) > 1 and parts[1] in MAY_IMPORT:
            assert parts[1] in MAY_IMPORT[part] | {part}, f"{path.name} imports {name}"
        if part != "nodes":
            assert parts[0] not in ROS, f"{path.name} imports {name}"


def test_everything_below_the_nodes_imports_without_ros() -> None:
    modules = [
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
        for path in _modules()
        if _part(path) != "nodes"
    ]
    program = (
        "import sys\n"
        f"sys.modules.update(dict.fromkeys({ROS!r}))\n"
        f"for name in {modules!r}: __import__(name)\n"
        "assert not any(name.startswith('cdrj_ros.nodes') for name in sys.modules)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", program],
        cwd=PACKAGE.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
