"""Time of ``make demo`` from nothing, once all packages are installed."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.figures import ROOT, Row, Spread, additions
from bench.making import Said, make

MESSAGES = ("Building cdrj_msgs", "Compiling the numerical kernels of every start")
PACKAGE = ("Building cdrj_ros",)
"""Beginnings of the lines that `make` ends when stages end."""


def end_of(said: list[Said], stages: tuple[str, ...]) -> float:
    """When the last line of some stages was complete [s].

    Raises:
        RuntimeError: there is none.
    """
    ends = [after_s for after_s, line in said if line.startswith(stages)]
    if not ends:
        raise RuntimeError(f"make did not say {' or '.join(stages)}")
    return max(ends)


def measure() -> list[Row]:
    """`make demo` in a new clone of the last commit, which uses this environment [s]."""
    with TemporaryDirectory() as folder:
        clone = Path(folder, "clone")
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        (clone / ".venv").symlink_to(ROOT / ".venv")
        speed = [additions()]
        said = make(clone, "demo")
        speed.append(additions())
    messages, package, whole = end_of(said, MESSAGES), end_of(said, PACKAGE), said[-1].after_s
    rows = {
        "make demo from nothing, packages installed": [whole],
        "of this, the messages and the kernels of every start": [messages],
        "of this, the package": [package - messages],
        "of this, the demonstration and the other kernels": [whole - package],
        "ten million additions in Python, before and after": speed,
    }
    first, *others = (Row("demo", what, "s", Spread.of(times)) for what, times in rows.items())
    return [replace(first, aim="≤ 45"), *others]
