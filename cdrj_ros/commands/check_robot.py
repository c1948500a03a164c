"""``check_robot``: check a robot file, inspect its cables and list suspicious values."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from math import degrees, isfinite, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from cdrj_ros.commands.check_robot_shares import print_shares, shares_document
from cdrj_ros.commands.compilation import announce_compilation
from cdrj_ros.commands.running import DONE, CommandParser, run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs, write_text
from cdrj_ros.foundation.text import counted, fixed, printable
from cdrj_ros.inspection.geometry_table import geometry_table, read_poses
from cdrj_ros.inspection.ranges import (
    CableCheck,
    Extent,
    Inspection,
    inspect_robot,
    pose_text,
)
from cdrj_ros.inspection.shares import Shares, uncertainty_shares
from cdrj_ros.inspection.suspicions import Suspicion, find_suspicions
from cdrj_ros.model.loading import load_model, robot_path
from cdrj_ros.robot.description import Cable, Robot

if TYPE_CHECKING:
    from rich.table import Table

DESCRIPTION: Final = (
    "Check a robot file: print the geometry and tensions of its cables and list suspicious values."
)

LEAST_WIDTH: Final = 132
"""Smallest width of a table; narrower terminals wrap its lines, and nothing is cut off."""


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
            "--geometry-csv": arguments.geometry_csv,
        },
        [robot_path(arguments.robot), *([arguments.poses] if arguments.poses else [])],
    )
    announce_compilation()
    model = load_model(arguments.robot, arguments.preload)
    told = []
    if arguments.poses:
        poses = read_poses(_text_of(arguments.poses), model.robot, arguments.poses)
        write_text(arguments.geometry_csv, geometry_table(model, poses).text())
        told.append(f"geometry of {counted(len(poses), 'pose')}: {arguments.geometry_csv}")
    inspection = inspect_robot(model, _loads(arguments.load))
    suspicions = find_suspicions(inspection)
    shares = uncertainty_shares(model)
    if arguments.json and not to_terminal:
        write_text(arguments.json, _json_text(inspection, suspicions, shares))
        told.append(f"figures: {arguments.json}")
    if arguments.png:
        from cdrj_ros.report.drawing import draw_robot, write_png

        write_png(draw_robot(inspection), arguments.png)
        told.append(f"drawing: {arguments.png}")
    if to_terminal:
        print(_json_text(inspection, suspicions, shares), end="")
    else:
        _print(inspection, suspicions, shares)
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


# --- text -----------------------------------------------------------------------------------------


def _print(inspection: Inspection, suspicions: Sequence[Suspicion], shares: Shares | None) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    wide = Console(highlight=False, width=max(console.width, LEAST_WIDTH))
    robot = inspection.model.robot
    console.print(Text(_headline(inspection), style="bold"))
    for motor in inspection.motors:
        turns = motor.angle.width / (2.0 * pi)
        console.print(Text(f"motor {motor.name}: {turns:.2f} turns to follow the joints"))
    for cable in inspection.cables:
        console.print()
        wide.print(_table(inspection, cable))
        for fact in _facts(inspection, cable):
            console.print(Text(f"  {fact}"))
    if shares is not None:
        print_shares(inspection.model, shares, wide)
    console.print()
    grave = [suspicion for suspicion in suspicions if suspicion.grave]
    remarks = [suspicion for suspicion in suspicions if not suspicion.grave]
    if not grave:
        console.print(Text(f"{robot.name}: nothing suspicious", style="green"))
    for title, style, entries in (
        ("suspicious", "bold yellow", grave),
        ("good to know", "bold", remarks),
    ):
        if entries:
            console.print(Text(f"{title}:", style=style))
        for entry in entries:
            line = Text("  ")
            line.append(entry.where, style="bold").append(f": {entry.text}")
            console.print(line)


def _headline(inspection: Inspection) -> str:
    robot = inspection.model.robot
    layout = inspection.model.layout

    parts = [
        counted(len(robot.motors), "motor"),
        counted(len(robot.joints), "joint"),
        counted(len(robot.cables), "cable"),
        counted(len(layout.elements), "element"),
        counted(len(layout.pulleys), "pulley"),
    ]
    loads = "".join(
        f", load {value:g} {'N' if name in robot.prismatic_joints else 'N m'} on {name}"
        for name, value in inspection.loads.items()
    )
    return f"{robot.name}: {', '.join(parts)}; {len(inspection.poses)} poses{loads}"


def _table(inspection: Inspection, cable: CableCheck) -> Table:
    """Elements and pulleys in the order in which the cable meets them."""
    from rich import box
    from rich.table import Table
    from rich.text import Text  # markup would interpret [mm] as a style

    robot = inspection.model.robot
    table = Table(
        title=cable.name, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD,
        pad_edge=False,
    )  # fmt: skip
    table.add_column("")
    table.add_column(Text("length [mm]"), justify="right", no_wrap=True)
    for joint in robot.joints:
        unit = "-" if joint.name in robot.prismatic_joints else "mm"
        table.add_column(Text(f"arm {joint.name} [{unit}]"), justify="right", no_wrap=True)
    for heading in ("wrap [°]", "η at rest", "η sliding", "passes [mm]"):
        table.add_column(Text(heading), justify="right", no_wrap=True)
    blank = [""] * (1 + len(robot.joints))
    for k, element in enumerate(cable.elements):
        arms = _arms(robot, element.moment_arm)
        table.add_row(f"element {k + 1}", _shown(element.length, 1e3, 1), *arms)
        if k < len(cable.pulleys):
            pulley = cable.pulleys[k]
            table.add_row(
                f"{_cable_of(robot, cable).pulleys[k].kind} {k + 2}",
                *blank,
                _shown(pulley.wrap, 180.0 / pi, 1),
                _shown(pulley.transmission_at_rest, 1.0, 3),
                _shown(pulley.transmission_sliding, 1.0, 3),
                f"{1e3 * pulley.passing:.2f}",
                style="dim",
            )
    table.add_section()
    table.add_row(
        "whole cable",
        _shown(cable.length, 1e3, 1),
        *_arms(robot, cable.moment_arm),
        "",
        _shown(cable.transmission_at_rest, 1.0, 3),
        _shown(cable.transmission_sliding, 1.0, 3),
        "",
        style="bold",
    )
    return table


def _arms(robot: Robot, arms: Sequence[Extent]) -> list[str]:
    positions = robot.prismatic_joints
    return [
        _shown(arm, 1.0, 3) if joint.name in positions else _shown(arm, 1e3, 2)
        for joint, arm in zip(robot.joints, arms, strict=True)
    ]


def _shown(extent: Extent, factor: float, decimals: int) -> str:
    """``40.9`` or ``0.6 … 78.5``."""
    low, high = (fixed(factor * value, decimals) for value in (extent.low, extent.high))
    return low if low == high else f"{low} … {high}"


def _cable_of(robot: Robot, check: CableCheck) -> Cable:
    """The cable that was checked."""
    return next(cable for cable in robot.cables if cable.name == check.name)


def _facts(inspection: Inspection, check: CableCheck) -> Iterator[str]:
    robot = inspection.model.robot
    cable = _cable_of(robot, check)
    yield (
        f"EA {cable.axial_stiffness:.4g} N, {1e-3 * check.stiffness:.3g} N/mm, "
        f"preload {cable.preload:g} N, law {cable.law}"
    )
    limit = f"; max_tension {cable.maximum_tension:g} N" if isfinite(cable.maximum_tension) else ""
    loaded = "under the load" if inspection.loads else "when the motors follow"
    where = pose_text(robot, check.worst.high_at)
    yield (
        f"tension {loaded}: {_shown(check.followed, 1.0, 2)} N; worst {check.worst.high:.4g} N, at "
        f"the pulling end with every pulley slipping{f' ({where})' if where else ''}{limit}"
    )
    still = [
        f"{joint.name} moved by {1e3 * way:.2f} mm"
        if joint.name in robot.prismatic_joints
        else f"{joint.name} turned by {degrees(way):.2f}°"
        for joint, way in zip(robot.joints, check.slack_after, strict=True)
        if isfinite(way)
    ]
    if still and cable.preload > 0.0:
        yield f"with the motors held, its preload is lost with {' or '.join(still)}"


# --- JSON -----------------------------------------------------------------------------------------


def _json_text(
    inspection: Inspection, suspicions: Sequence[Suspicion], shares: Shares | None
) -> str:
    document = _document(inspection, suspicions)
    document["uncertainty"] = shares_document(inspection.model, shares)
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _document(inspection: Inspection, suspicions: Sequence[Suspicion]) -> dict[str, Any]:
    """All printed results in SI units; ``null`` for results without a value."""
    robot = inspection.model.robot
    names = inspection.model.layout.joints
    return {
        "robot": robot.name,
        "source": robot.source,
        "poses": len(inspection.poses),
        "loads": dict(inspection.loads),
        "motors": [
            {"name": motor.name, "angle": _extent(names, motor.angle)}
            for motor in inspection.motors
        ],
        "cables": [
            _cable_document(names, cable, check)
            for cable, check in zip(robot.cables, inspection.cables, strict=True)
        ],
        "suspicions": [
            {"where": entry.where, "text": entry.text, "grave": entry.grave} for entry in suspicions
        ],
    }


def _cable_document(names: Sequence[str], cable: Cable, check: CableCheck) -> dict[str, Any]:
    def arms(extents: Sequence[Extent]) -> dict[str, Any]:
        return dict(zip(names, (_extent(names, arm) for arm in extents), strict=True))

    slack_after = (way if isfinite(way) else None for way in check.slack_after)
    return {
        "name": check.name,
        "axial_stiffness": cable.axial_stiffness,
        "preload": cable.preload,
        "max_tension": cable.maximum_tension if isfinite(cable.maximum_tension) else None,
        "law": cable.law,
        "length": _extent(names, check.length),
        "stiffness": check.stiffness,
        "moment_arm": arms(check.moment_arm),
        "transmission_at_rest": _extent(names, check.transmission_at_rest),
        "transmission_sliding": _extent(names, check.transmission_sliding),
        "tension": _extent(names, check.followed),
        "worst_tension": _extent(names, check.worst),
        "slack_after": dict(zip(names, slack_after, strict=True)),
        "elements": [
            {
                "name": element.name,
                "length": _extent(names, element.length),
                "span": _extent(names, element.span),
                "moment_arm": arms(element.moment_arm),
            }
            for element in check.elements
        ],
        "pulleys": [
            {
                "name": pulley.name,
                "wrap_angle": _extent(names, pulley.wrap),
                "transmission_at_rest": _extent(names, pulley.transmission_at_rest),
                "transmission_sliding": _extent(names, pulley.transmission_sliding),
                "passing": pulley.passing,
                "needed_to_slip": pulley.needed,
            }
            for pulley in check.pulleys
        ],
    }


def _extent(names: Sequence[str], values: Extent) -> dict[str, Any]:
    return {
        "low": values.low,
        "high": values.high,
        "low_at": dict(zip(names, values.low_at, strict=True)),
        "high_at": dict(zip(names, values.high_at, strict=True)),
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("check_robot", _body, argv)


if __name__ == "__main__":
    sys.exit(main())
