"""``check_robot``: check a robot file, inspect its cables and list suspicious values."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Final

from cdrj_ros.commands.check_robot_json import json_text
from cdrj_ros.commands.check_robot_text import print_inspection
from cdrj_ros.commands.running import DONE, CommandParser, run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs, write_text
from cdrj_ros.foundation.text import counted, printable
from cdrj_ros.inspection.geometry_table import geometry_table, read_poses
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.shares import MOST_CAUSES, uncertainty_shares
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.loading import load_model, robot_path

DESCRIPTION: Final = (
    "Check a robot file: print the geometry and tensions of its cables and list suspicious values."
)


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(prog="check_robot", description=DESCRIPTION)
    parser.add_argument(
        "robot", metavar="ROBOT", help="robot file (YAML), or the name of an installed robot"
    )
    parser.add_argument(
        "--preload", metavar="N,N,...", help="preload of every cable [N] (default: the file's)"
    )
    parser.add_argument(
        "--load", action="append", default=[], metavar="JOINT=EFFORT",
        help="effort that the cables must exert on a joint in every pose [N m], or [N] for a "
        "prismatic joint; repeatable",
    )  # fmt: skip
    parser.add_argument("--png", metavar="FILE", help="draw the cables")
    parser.add_argument(
        "--html",
        metavar="FILE",
        help="write a page with drawing, tables and findings",
    )
    parser.add_argument(
        "--poses", metavar="CSV",
        help="poses for --geometry-csv: a header of joint names, then one pose per line in SI",
    )  # fmt: skip
    parser.add_argument(
        "--geometry-csv", metavar="CSV",
        help="write length/CABLE, arm/CABLE/JOINT and wrap/CABLE/NODE in every one of --poses",
    )  # fmt: skip
    parser.add_argument(
        "--json", metavar="FILE", help="write the results as JSON; -: to standard output"
    )
    return parser


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    to_terminal = arguments.json == "-"
    if (arguments.poses is None) != (arguments.geometry_csv is None):
        raise UsageError("--poses and --geometry-csv belong together")
    check_outputs(
        {
            "--json": None if to_terminal else arguments.json,
            "--png": arguments.png,
            "--html": arguments.html,
            "--geometry-csv": arguments.geometry_csv,
        },
        [robot_path(arguments.robot), *([arguments.poses] if arguments.poses else [])],
    )
    model = load_model(arguments.robot, arguments.preload)
    told = []
    if arguments.poses:
        poses = read_poses(_text_of(arguments.poses), model.robot, arguments.poses)
        write_text(arguments.geometry_csv, geometry_table(model, poses).text())
        told.append(f"geometry of {counted(len(poses), 'pose')}: {arguments.geometry_csv}")
    inspection = inspect_robot(model, _loads(arguments.load))
    suspicions = find_suspicions(inspection)
    shares = uncertainty_shares(model)
    if shares is None and model.robot.uncertainty is not None:
        told.append(f"shares of the uncertainty left out: it has more than {MOST_CAUSES} causes")
    if arguments.json and not to_terminal:
        write_text(arguments.json, json_text(inspection, suspicions, shares))
        told.append(f"figures: {arguments.json}")
    if arguments.png:
        from cdrj_ros.report.drawing import draw_robot, write_png

        write_png(draw_robot(inspection), arguments.png)
        told.append(f"drawing: {arguments.png}")
    if arguments.html:
        from cdrj_ros.report.html import write_robot_page

        write_robot_page(arguments.html, inspection, suspicions)
        told.append(f"page: {arguments.html}")
    if to_terminal:
        print(json_text(inspection, suspicions, shares), end="")
    else:
        print_inspection(inspection, suspicions, shares)
    for line in told:
        print(printable(line), file=sys.stderr if to_terminal else None)
    return DONE


def _text_of(path: str) -> str:
    """Text of a file of poses."""
    try:
        return Path(path).read_text("utf-8")
    except (OSError, UnicodeDecodeError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise UsageError(f"cannot read the poses {printable(path)}: {reason}") from error


def _loads(entries: Sequence[str]) -> dict[str, float]:
    loads = {}
    for entry in (one for several in entries for one in several.split(",")):
        name, equals, value = entry.partition("=")
        try:
            effort = float(value)
        except ValueError:
            effort = float("nan")
        if not (name and equals and isfinite(effort)):
            raise UsageError(f"--load must be JOINT=EFFORT with a number, got {entry!r}")
        if name in loads:
            raise UsageError(f"--load gives {name} twice")
        loads[name] = effort
    return loads


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("check_robot", _body, argv)


if __name__ == "__main__":
    sys.exit(main())
