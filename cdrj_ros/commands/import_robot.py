"""``import_robot``: convert a model of another program to a robot file."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from cdrj_ros.commands.running import DONE, CommandParser, run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs
from cdrj_ros.foundation.text import counted, printable
from cdrj_ros.robot.imported import import_mjcf
from cdrj_ros.robot.reader import load_robot
from cdrj_ros.robot.urdf import read_urdf

DESCRIPTION: Final = (
    "Turn the spatial tendons of a MuJoCo model into the cables of a robot file. Its stiffness, "
    "preload, friction and drums are assumptions, marked as such: replace them."
)

MOST_NAMES: Final = 8
"""Number of links or joints that a message names."""


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(prog="import_robot", description=DESCRIPTION)
    parser.add_argument("model", metavar="MODEL", help="MuJoCo model (MJCF, .xml)")
    parser.add_argument(
        "--tendons", metavar="NAME,NAME,...", help="tendons to import (default: all spatial ones)"
    )
    parser.add_argument("--out", metavar="FILE", required=True, help="robot file to write (YAML)")
    return parser


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    check_outputs({"--out": arguments.out}, [arguments.model])
    path = Path(arguments.model)
    if not path.exists():
        raise UsageError(f"there is no model {printable(arguments.model)}")
    if path.suffix == ".urdf":
        raise UsageError(_without_cables(path))
    if path.suffix != ".xml":
        raise UsageError(
            f"MODEL must be an MJCF file named .xml, or a URDF named .urdf, got "
            f"{printable(arguments.model)}"
        )
    wanted = arguments.tendons.split(",") if arguments.tendons else None
    remarks = import_mjcf(path, arguments.out, wanted)
    robot = load_robot(arguments.out)
    for remark in remarks:
        print(printable(f"note: {remark}"))
    print(
        f"{printable(arguments.out)}: {counted(len(robot.cables), 'cable')}, "
        f"{counted(len(robot.joints), 'joint')}; replace the values marked as assumed, then run "
        "check_robot"
    )
    return DONE


def _without_cables(path: Path) -> str:
    """How to begin a robot file from a URDF, which has no cables."""
    joints = read_urdf(path, str(path))
    moving = [joint.name for joint in joints if joint.motion != "fixed" and not joint.mimic]
    links = [joint.child for joint in joints]
    return printable(
        f"{path.name} has no cables; write a robot file with frames: {{urdf: {path.name}}}, whose "
        f"nodes are on its links ({_few(links)}); its joints ({_few(moving)}) come from there; "
        "docs/tutorial.md has an example"
    )


def _few(names: Sequence[str]) -> str:
    """Some names in a row."""
    return ", ".join(names[:MOST_NAMES]) + (", ..." if len(names) > MOST_NAMES else "")


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("import_robot", _body, argv)


if __name__ == "__main__":
    sys.exit(main())
