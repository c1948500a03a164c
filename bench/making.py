"""``make`` as a user calls it, with the time of every line that it says."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

from bench.figures import ROOT

OF_MAKE = ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")
"""Variables of `make bench` itself."""

READY = tuple(f".venv/.{flavour}-is-ready" for flavour in ("wheels", "system"))
"""Files that `make` takes for up to date: the environment is there and is not made anew."""


class Said(NamedTuple):
    """A line of output."""

    after_s: float
    """Time from the start until the line was complete [s]."""
    line: str


def make(folder: Path, target: str) -> list[Said]:
    """Make a target of a folder whose environment is there.

    Returns:
        All lines that were said, and an empty one at the end.

    Raises:
        RuntimeError: it failed; the message has the failed tests, or the last line of what ran,
            and the file under build/ with the whole output.
    """
    command = ["make", target, *(f"--old-file={name}" for name in READY)]
    environment = {name: value for name, value in os.environ.items() if name not in OF_MAKE}
    begin = perf_counter()
    with subprocess.Popen(
        command, cwd=folder, env=environment, text=True, errors="replace",
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        said = [Said(perf_counter() - begin, line.strip()) for line in process.stdout]
    if process.returncode != 0:
        lines = [line for _, line in said if line and not line.startswith("make: ")]
        kept = ROOT / "build" / f"make_{target}.txt"
        kept.parent.mkdir(exist_ok=True)
        kept.write_text("\n".join(lines) + "\n", encoding="utf-8")
        failed = [line for line in lines if line.startswith(("FAILED ", "ERROR "))]
        message = "; ".join(failed or lines[-1:]) or "no message"
        raise RuntimeError(f"make {target}: {message} (output: {kept})")
    return [*said, Said(perf_counter() - begin, "")]
