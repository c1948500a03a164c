"""``import_robot``: convert a model of another program to a robot file."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from cdrj_ros.commands.running import DONE, CommandParser, run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs, write_text
from cdrj_ros.foundation.text import counted, printable
from cdrj_ros.importing.mjcf import read_mjcf
from cdrj_ros.importing.writing import robot_text
from cdrj_ros.robot.reader import parse_robot

DESCRIPTION: Final = (
    "Turn the spatial tendons of a MuJoCo model into the cables of a robot file. Its stiffness, "
    "preload, friction and drums are assumptions, marked as such: replace them."
)


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
    if not path.is_file():
        raise UsageError(f"there is no model {printable(arguments.model)}")
    if path.suffix != ".xml":
        raise UsageError(
            f"MODEL must be an MJCF file named .xml, got {printable(arguments.model)}; frames of a "
            "URDF have to be written by hand, with origin, rpy and axis as they are there"
        )
    wanted = arguments.tendons.split(",") if arguments.tendons else None
    imported = read_mjcf(path, wanted)
    text = robot_text(imported.document, imported.remarks, path.name)
    robot = parse_robot(text, arguments.out)
    write_text(arguments.out, text)
    for remark in imported.remarks:
        print(printable(f"note: {remark}"))
    print(
        f"{printable(arguments.out)}: {counted(len(robot.cables), 'cable')}, "
        f"{counted(len(robot.joints), 'joint')}; replace the values marked as assumed, then run "
        "check_robot"
    )
    return DONE


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("import_robot", _body, argv)


if __name__ == "__main__":
    sys.exit(main())
