"""docs/ros2_control.md: its numbers, its robot file, its messages and its C++ program."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from support.places import ROOT

TEXT = (ROOT / "docs" / "ros2_control.md").read_text("utf-8")


def test_the_program_in_c_plus_plus_compiles(tmp_path):
    prefixes = [Path(one) for one in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if one]
    includes = [one / "include" for one in prefixes if (one / "include").is_dir()]
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None or not any((one / "rclcpp").is_dir() for one in includes):
        pytest.skip("rclcpp is not installed")
    (program,) = re.findall(r"```cpp\n(.*?)```", TEXT, re.DOTALL)
    assert len(program.splitlines()) < 45
    (tmp_path / "guard.cpp").write_text(program)
    folders = [
        place for one in includes for place in (one, *(p for p in one.iterdir() if p.is_dir()))
    ]
    done = subprocess.run(
        [compiler, "-std=c++17", "-fsyntax-only", "-Wall", "-Werror",
         *(f"-isystem{one}" for one in folders), str(tmp_path / "guard.cpp")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
