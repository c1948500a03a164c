"""``check_robot``: check a robot file, inspect its cables and list suspicious values."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from math import isfinite

from cdrj_ros.commands.check_robot_json import json_text
from cdrj_ros.commands.check_robot_text import print_inspection
from cdrj_ros.commands.running import DONE, CommandParser, run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs, write_text
from cdrj_ros.foundation.text import printable
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.shares import MOST_CAUSES, uncertainty_shares
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.loading import load_model, robot_path


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        prog="check_robot",
        description="Check a robot file: print the geometry and tensions of its "
        "cables and list suspicious values.",
    )
    parser.add_argument(
        "robot", metavar="ROBOT", help="robot file (YAML), or the name of an installed robot"
    )
    parser.add_argument(
        "--load", action="append", default=[], metavar="JOINT=EFFORT",
        help="effort that the cables must exert on a joint in every pose [N m], or [N] for a "
        "prismatic joint; repeatable",
    )  # fmt: skip
    parser.add_argument(
        "--json", metavar="FILE", help="write the results as JSON; -: to standard output"
    )
    return parser


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    to_terminal = arguments.json == "-"
    if not to_terminal:
        check_outputs({"--json": arguments.json}, [robot_path(arguments.robot)])
    model = load_model(arguments.robot)
    inspection = inspect_robot(model, _loads(arguments.load))
    suspicions = find_suspicions(inspection)
    shares = uncertainty_shares(model)
    if to_terminal:
        print(json_text(inspection, suspicions, shares), end="")
        return DONE
    if arguments.json:
        write_text(arguments.json, json_text(inspection, suspicions, shares))
    print_inspection(inspection, suspicions, shares)
    if shares is None and model.robot.uncertainty is not None:
        print(f"shares of the uncertainty left out: it has more than {MOST_CAUSES} causes")
    if arguments.json:
        print(printable(f"figures: {arguments.json}"))
    return DONE


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
