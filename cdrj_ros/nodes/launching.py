"""What the launch files share.  Does not import launch."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from difflib import get_close_matches
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from cdrj_ros.model.loading import robot_path
from cdrj_ros.robot.reader import load_document

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


def exact_copy(robot: str, folder: Path) -> Path:
    """Write a robot file whose numbers count as exact, as those of a simulated robot are.

    Args:
        robot: the file, or the name of an installed one.
        folder: where the copy is written.

    Raises:
        RobotFileError: there is no such file, or it is not valid.
    """
    from ruamel.yaml import YAML

    source = robot_path(robot)
    load_document(source)  # refuses what is none
    yaml = YAML()
    document = yaml.load(source.read_text(encoding="utf-8"))
    document["uncertainty"] = {"others": "exact"}
    frames = document.get("frames")
    if isinstance(frames, dict) and (source.parent / str(frames.get("urdf"))).exists():
        frames["urdf"] = str((source.parent / frames["urdf"]).resolve())
    copy = folder / source.name
    with copy.open("w", encoding="utf-8") as file:
        yaml.dump(document, file)
    return copy


def view_is_installed() -> bool:
    """Whether the browser view can be started: it needs the extra ``view``."""
    return find_spec("viser") is not None and find_spec(f"{PACKAGE}.nodes.view") is not None
