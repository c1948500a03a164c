"""``import_robot``: convert a model of another program to a robot file."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Final

from cdrj_ros.commands.check_printed import LISTED
from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs
from cdrj_ros.foundation.output import counted, printable, said_once
from cdrj_ros.model.prepared import prepare
from cdrj_ros.model.untouched import untouched_bodies
from cdrj_ros.robot.from_urdf import import_urdf
from cdrj_ros.robot.imported import import_mjcf
from cdrj_ros.robot.reader import load_robot
from cdrj_ros.robot.urdf import expanding

DESCRIPTION: Final = (
    "Turn the spatial tendons of a MuJoCo model into the cables of a robot file. Its stiffness, "
    "preload, friction and drums are assumptions, marked as such: replace them. From a URDF, begin "
    "a robot file with the names, gears and limits of its ros2_control; the cables are to be added."
)


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(prog="import_robot", description=DESCRIPTION)
    parser.add_argument("model", metavar="MODEL", help="MuJoCo model (MJCF, .xml) or URDF (.urdf)")
    parser.add_argument(
        "--tendons", metavar="NAME,NAME,...", help="tendons to import (default: all spatial ones)"
    )
    parser.add_argument("--out", metavar="FILE", required=True, help="robot file to write (YAML)")
    return parser


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    check_outputs({"--out": arguments.out}, [arguments.model])
    path = Path(arguments.model)
    if Path(arguments.out).is_file():
        raise UsageError(
            f"--out {printable(arguments.out)} is there already, and may have values that were "
            "measured: delete it, or write another file"
        )
    if not path.exists():
        raise UsageError(f"there is no model {printable(arguments.model)}")
    if path.suffix == ".urdf":
        return _begun(path, arguments)
    if path.suffix == ".xacro":
        raise UsageError(f"{printable(arguments.model)} is a xacro file; {expanding(path)}")
    if path.suffix != ".xml":
        raise UsageError(
            f"MODEL must be an MJCF file named .xml, or a URDF named .urdf, got "
            f"{printable(arguments.model)}"
        )
    wanted = arguments.tendons.split(",") if arguments.tendons else None
    remarks = import_mjcf(path, arguments.out, wanted)
    robot = load_robot(arguments.out)
    bodies = sorted(
        untouched_bodies(prepare(robot, check_range=False)), key=lambda one: not one.grave
    )
    notes = [*remarks, *said_once(f"{one.where}: {one.text}" for one in bodies[:LISTED])]
    if more := len(bodies[LISTED:]):
        notes.append(f"and {more} more of bodies: check_robot --all prints them")
    for note in notes:
        print(printable(f"note: {note}"))
    print(
        f"{printable(arguments.out)}: {counted(len(robot.cables), 'cable')}, "
        f"{counted(len(robot.joints), 'joint')}; replace the values marked as assumed, then run "
        "check_robot"
    )
    return DONE


def _begun(path: Path, arguments: argparse.Namespace) -> int:
    """Begin a robot file from a URDF."""
    if arguments.tendons:
        raise UsageError(f"--tendons: {printable(path.name)} is a URDF, which has no tendons")
    for remark in import_urdf(path, arguments.out):
        print(printable(f"note: {remark}"))
    print(f"{printable(arguments.out)} is begun; add its cables, then run check_robot")
    return DONE


main = partial(run_command, "import_robot", _body)
"""Entry point; returns the exit code."""
