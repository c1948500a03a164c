"""The core is C++20 as Clang reads it, too."""

import shutil
import subprocess

import pytest
from support.places import ROOT

SOURCES = sorted(
    path for path in (ROOT / "cdrj_ros" / "core").glob("*.cpp") if not path.name.startswith("bind_")
)


@pytest.mark.skipif(shutil.which("clang++") is None, reason="Clang is not installed")
def test_clang_takes_the_core_without_a_warning():
    command = ["clang++", "-std=c++20", "-fsyntax-only", "-Wall", "-Wextra", "-Werror"]
    done = subprocess.run(
        [*command, *map(str, SOURCES)], check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
