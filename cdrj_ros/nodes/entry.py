"""What starts nodes: entry points, which handle Ctrl-C before they import ROS, and launch files.

Does not import launch.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import NoReturn

from cdrj_ros.foundation.errors import nearest
from cdrj_ros.foundation.interruption import INTERRUPTED, run_module


def _run(name: str) -> NoReturn:
    """Import the node's module and run its ``main``.

    A node that takes ``--supervised`` ends with code 0 after Ctrl-C, also while it is imported.
    """
    supervised = name in ("estimator", "rig", "markers") and "--supervised" in sys.argv[1:]
    run_module(name, f"cdrj_ros.nodes.{name}", 0 if supervised else INTERRUPTED)


commission = partial(_run, "commission")
estimator = partial(_run, "estimator")
markers = partial(_run, "markers")
replay = partial(_run, "replay")
rig = partial(_run, "rig")
view = partial(_run, "view")
watch = partial(_run, "watch")
"""Each runs the node of its name; ``commission`` is no node until it records."""

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
            raise RuntimeError(f"there is no argument {name!r}: {nearest(name, known)}")


def _on_command_line(file: Path, argv: Sequence[str]) -> bool:
    """Whether `ros2 launch` starts this file itself."""
    return any(
        Path(one).name == file.name and (before == PACKAGE or Path(one).resolve() == file.resolve())
        for before, one in pairwise(argv)
    )


def view_is_installed() -> bool:
    """Whether the browser view can be started: it needs the extra ``view``."""
    return find_spec("viser") is not None and find_spec(f"{PACKAGE}.nodes.view") is not None
