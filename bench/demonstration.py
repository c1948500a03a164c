"""Time of ``make demo`` from nothing, once all packages are installed."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.figures import ROOT, Row, Spread, additions
from bench.making import Said, make

MESSAGES = "Building cdrj_msgs"
CORE = "Compiling the core"
PACKAGE = "Building cdrj_ros"
"""Beginnings of the lines that `make` ends when a stage ends, in order."""


def end_of(said: list[Said], stage: str) -> float:
    """When the line of a stage was complete [s].

    Raises:
        RuntimeError: there is none.
    """
    for after_s, line in said:
        if line.startswith(stage):
            return after_s
    raise RuntimeError(f"make did not say {stage}")


def measure() -> list[Row]:
    """`make demo` in a new clone of the last commit, which uses this environment [s]."""
    with TemporaryDirectory() as folder:
        clone = Path(folder, "clone")
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        (clone / ".venv").symlink_to(ROOT / ".venv")
        speed = [additions()]
        said = make(clone, "demo")
        speed.append(additions())
    messages, core, package = (end_of(said, stage) for stage in (MESSAGES, CORE, PACKAGE))
    whole = said[-1].after_s
    rows = {
        "make demo from nothing, packages installed": [whole],
        "of this, the messages": [messages],
        "of this, the core": [core - messages],
        "of this, the package": [package - core],
        "of this, the demonstration": [whole - package],
        "ten million additions in Python, before and after": speed,
    }
    first, *others = (Row("demo", what, "s", Spread.of(times)) for what, times in rows.items())
    return [replace(first, aim="≤ 30"), *others]
