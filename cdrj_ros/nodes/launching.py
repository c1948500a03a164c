"""What the launch files share.  Does not import launch."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from difflib import get_close_matches
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

PACKAGE = "cdrj_ros"
"""The package whose name stands before a launch file on the command line of ros2 launch."""


def refuse_unknown(file: Path, given: Sequence[str], known: Sequence[str]) -> None:
    """Refuse unknown arguments, since launch would ignore a misspelt one silently.

    Args:
        file: the launch file; nothing is refused if it is included by another one, which has
            arguments of its own.
        given: arguments of the command line, ``NAME:=VALUE``.
        known: names of the arguments.

    Raises:
        RuntimeError: an unknown argument; the message suggests the nearest known one.
    """
    if not _on_command_line(file, sys.argv):
        return
    for one in given:
        name, assigned, _ = one.partition(":=")
        if assigned and name not in known:
            close = get_close_matches(name, known, n=1)
            nearest = f"did you mean {close[0]}? " if close else ""
            raise RuntimeError(
                f"there is no argument {name!r}: {nearest}There are {', '.join(known)}"
            )


def _on_command_line(file: Path, argv: Sequence[str]) -> bool:
    """Whether `ros2 launch` starts this file itself."""
    return any(
        Path(one).name == file.name and (before == PACKAGE or Path(one).resolve() == file.resolve())
        for before, one in pairwise(argv)
    )


def view_is_installed() -> bool:
    """Whether the browser view can be started: it needs the extra ``view``."""
    return find_spec("viser") is not None and find_spec(f"{PACKAGE}.nodes.view") is not None
