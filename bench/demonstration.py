"""Time of ``make demo`` from nothing, once all packages are installed."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.figures import ROOT, Row, alone, seconds

OF_MAKE = ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")
"""Variables of `make bench` itself."""

READY = tuple(f".venv/.{flavour}-is-ready" for flavour in ("wheels", "system"))
"""Files that `make` takes for up to date: the environment is there and is not made anew."""


def measure() -> list[Row]:
    """`make demo` in a new clone of the last commit, which uses this environment [s].

    Raises:
        RuntimeError: it failed; the message has its last line.
    """
    command = ["make", "demo", *(f"--old-file={name}" for name in READY)]
    environment = {name: value for name, value in os.environ.items() if name not in OF_MAKE}
    with TemporaryDirectory() as folder:
        clone = Path(folder, "clone")
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        (clone / ".venv").symlink_to(ROOT / ".venv")

        def make() -> None:
            done = subprocess.run(
                command, cwd=clone, env=environment, text=True, errors="replace", check=False,
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            )  # fmt: skip
            if done.returncode != 0:
                raise RuntimeError(done.stdout.strip().splitlines()[-1])

        whole = seconds(make)
    return [alone("make demo from nothing, packages installed", "s", whole, "≤ 30")]
