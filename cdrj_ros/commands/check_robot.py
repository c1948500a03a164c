"""``check_robot``: check a robot file, inspect its cables and list suspicious values."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from math import degrees, isfinite, pi
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.estimation.conditioner import slips
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.files import check_outputs, write_text
from cdrj_ros.foundation.output import Json, counted, fixed, json_text, plain, printable
from cdrj_ros.foundation.yaml import yaml_text
from cdrj_ros.inspection.ranges import CableCheck, Extent, Inspection, inspect_robot, pose_text
from cdrj_ros.inspection.shares import MOST_CAUSES, Cause, Shares, uncertainty_shares
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.impossible import Suspicion
from cdrj_ros.model.packing import EFFORT, TENSION
from cdrj_ros.model.prepared import Model, load_model, robot_path
from cdrj_ros.report.table import UNLIMITED, new_table
from cdrj_ros.robot.description import Cable, Robot
from cdrj_ros.robot.reader import load_robot

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


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
        "--json", metavar="FILE", help="write the results as JSON; -: to standard output"
    )
    parser.add_argument(
        "--expanded", action="store_true", help="print the file with its parts written out, in SI"
    )
    return parser


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    to_terminal = arguments.json == "-"
    if not to_terminal:
        check_outputs({"--json": arguments.json}, [robot_path(arguments.robot)])
    if arguments.expanded:
        print(yaml_text(load_robot(robot_path(arguments.robot)).document), end="")
        return DONE
    model = load_model(arguments.robot)
    inspection = inspect_robot(model)
    suspicions = find_suspicions(inspection)
    shares = uncertainty_shares(model)
    if to_terminal:
        print(json_text(results(inspection, suspicions, shares)), end="")
        return DONE
    if arguments.json:
        write_text(arguments.json, json_text(results(inspection, suspicions, shares)))
    print_inspection(inspection, suspicions, shares)
    if shares is None and model.robot.uncertainty is not None:
        print(f"shares of the uncertainty left out: it has more than {MOST_CAUSES} causes")
    if arguments.json:
        print(printable(f"figures: {arguments.json}"))
    return DONE


NAMES: Final = {
    "wrap": "wrap_angle", "needed": "needed_to_slip", "followed": "tension",
    "worst": "worst_tension",
}  # fmt: skip
"""Keys of the JSON document for fields of other names."""

PER_JOINT: Final = ("moment_arm", "slack_after", "low_at", "high_at")
"""Fields with one value for every joint."""


def results(inspection: Inspection, suspicions: Sequence[Suspicion], shares: Shares | None) -> Json:
    """All that is printed, in SI; null for what has no value."""
    model = inspection.model
    robot, joints = model.robot, model.layout.joints
    document = {
        "robot": robot.name,
        "source": robot.source,
        "poses": len(inspection.poses),
        "motors": inspection.motors,
        "encoders": [one._asdict() for one in slips(model)],
        "residual": [
            {key: getattr(one, key) for key in ("output", "bound", "stddev", "inputs")}
            for one in robot.residuals
        ],
        "cables": [
            _cable(cable) | _fields(joints, check)
            for cable, check in zip(robot.cables, inspection.cables, strict=True)
        ],
        "suspicions": suspicions,
        "uncertainty": shares and _shares(model, shares),
    }
    return plain(document, partial(_fields, joints))


def _cable(cable: Cable) -> dict[str, Any]:
    """The numbers of a cable in the file."""
    return {
        "axial_stiffness": cable.axial_stiffness,
        "bedding_strain": cable.bedding_strain,
        "bedding_tension": cable.bedding_tension if cable.bedding_strain else None,
        "creep_share": cable.creep_share,
        "creep_time": cable.creep_time if cable.creep_share else None,
        "flow_time": cable.flow_time,
        "preload": cable.preload,
        "max_tension": cable.maximum_tension,
        "law": cable.law,
    }


def _shares(model: Model, shares: Shares) -> dict[str, Any]:
    """All shares by element, without omissions."""

    def by_element(values: Vector) -> dict[str, float]:
        return dict(zip(model.layout.elements, values.tolist(), strict=True))

    causes = [vars(cause) | {"share": by_element(cause.share)} for cause in shares.causes]
    return {"stddev": by_element(shares.stddev), "causes": causes}


def _fields(joints: Sequence[str], one: Any) -> dict[str, Any]:
    """The fields of a dataclass; values per joint are by its name."""
    return {
        NAMES.get(name, name): dict(zip(joints, value, strict=True)) if name in PER_JOINT else value
        for name, value in vars(one).items()
    }


LEAST_WIDTH: Final = 132
"""Smallest width of the output; narrower terminals wrap its lines, and nothing is cut off."""

LEAST_SHARE: Final = 0.01
"""A cause with a smaller share in every element is not listed."""

NAMED: Final = 3
"""Number of causes for which the measurement is printed."""


def print_inspection(
    inspection: Inspection, suspicions: Sequence[Suspicion], shares: Shares | None
) -> None:
    """Print the results as tables and sentences."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    robot = inspection.model.robot
    cables = list(zip(robot.cables, inspection.cables, strict=True))
    tables = [_table(robot, *cable) for cable in cables]
    unlimited = console.options.update(max_width=UNLIMITED)
    widths = [console.measure(table, options=unlimited).maximum for table in tables]
    wide = Console(highlight=False, width=max(console.width, LEAST_WIDTH, *widths))
    console.print(Text(headline(inspection), style="bold"))
    for motor in inspection.motors:
        turns = motor.angle.width / (2.0 * pi)
        console.print(Text(f"motor {motor.name}: {turns:.2f} turns to follow the joints"))
    for sentence in (*mapping(robot), *_slips(inspection.model), *_corrections(robot)):
        console.print(Text(sentence))
    for cable, table in zip(cables, tables, strict=True):
        console.print()
        wide.print(table)
        for fact in _facts(inspection, *cable):
            console.print(Text(f"  {fact}"))
    if shares is not None:
        _print_shares(inspection.model, shares, wide)
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


def headline(inspection: Inspection) -> str:
    """Numbers of parts and poses."""
    robot = inspection.model.robot
    layout = inspection.model.layout
    parts = [
        counted(len(robot.motors), "motor"),
        counted(len(robot.joints), "joint"),
        counted(len(robot.cables), "cable"),
        counted(len(layout.elements), "element"),
        counted(len(layout.pulleys), "pulley"),
    ]
    return f"{robot.name}: {', '.join(parts)}; {len(inspection.poses)} poses"


def mapping(robot: Robot) -> Iterator[str]:
    """What published positions and efforts mean, for every axis where they are converted."""
    for axis in robot.axes:
        sensor = axis.sensor
        prismatic = axis.name in robot.prismatic_joints
        angle, effort = ("position [m]", "[N]") if prismatic else ("angle [rad]", "[N m]")
        parts = []
        if sensor.scale != 1.0 or sensor.offset or sensor.corrected_at:
            text = f"{angle} = {sensor.scale:.6g} * published"
            text += f" {sensor.offset:+.4g}" if sensor.offset else ""
            parts.append(text + (" + correction" if sensor.corrected_at else ""))
        if axis.effort_scale != 1.0:
            parts.append(f"effort {effort} = {axis.effort_scale:.6g} * published")
        if parts:
            yield f"{axis.name}: {', '.join(parts)}"


def _slips(model: Model) -> Iterator[str]:
    """What slips of every encoder do."""
    for one in slips(model):
        unit = "m" if one.axis in model.robot.prismatic_joints else "rad"
        parts = []
        if one.unseen > 0.0:
            parts.append(f"up to {one.unseen:.2g} {unit} ({one.tension:.2g} N) is not seen")
        if isfinite(one.unsure):
            parts.append(f"beyond {one.unsure:.2g} {unit}, if seen, makes all elements UNSURE")
        if parts:
            yield f"{one.axis}: a slip of its encoder {', '.join(parts)}"


def _corrections(robot: Robot) -> Iterator[str]:
    """Learned corrections, and where they are not extrapolated."""
    newtons = {f"{EFFORT}/{name}" for name in robot.prismatic_joints}
    for one in robot.residuals:
        unit = "N" if one.output.startswith(TENSION) or one.output in newtons else "N m"
        ranges = []
        for name, (low, high) in one.inputs.items():
            angle = "m" if name in robot.prismatic_joints else "rad"
            of = unit if name == one.output else angle
            ranges.append(f"{name} {low:.4g} … {high:.4g} {of}")
        yield (
            f"{one.output}: learned correction of at most {one.bound:.2g} {unit}, standard "
            f"deviation {one.stddev:.2g} {unit}; trusted within {', '.join(ranges)}"
        )


def _table(robot: Robot, cable: Cable, check: CableCheck) -> Table:
    """The table of one cable for the terminal."""
    from rich.text import Text  # markup would interpret [mm] as a style

    table = new_table(cable.name)
    moving = _moving(check)
    names = [robot.joints[j].name for j in moving]
    arms = [f"arm {name} [{'-' if name in robot.prismatic_joints else 'mm'}]" for name in names]
    table.add_column("")
    for heading in ("length [mm]", *arms, "wrap [°]", "η at rest", "η sliding", "passes [mm]"):
        table.add_column(Text(heading), justify="right", no_wrap=True)
    *parts, whole = _rows(robot, cable, check, moving)
    for k, row in enumerate(parts):
        table.add_row(*row, style="dim" if k % 2 else None)
    table.add_section()
    table.add_row(*whole, style="bold")
    return table


def _moving(check: CableCheck) -> list[int]:
    """Joints that move any part of a cable."""
    every = [element.moment_arm for element in check.elements]
    return [
        j for j, arms in enumerate(zip(*every, strict=True)) if any(a.low or a.high for a in arms)
    ]


def _rows(
    robot: Robot, cable: Cable, check: CableCheck, moving: Sequence[int]
) -> Iterator[tuple[str, ...]]:
    """Elements and pulleys in the order in which the cable meets them, then the whole cable."""
    blank = [""] * (1 + len(moving))
    for k, element in enumerate(check.elements):
        arms = _arms(robot, element.moment_arm, moving)
        yield (f"element {k + 1}", _shown(element.length, 1e3, 1), *arms, "", "", "", "")
        if k < len(check.pulleys):
            pulley = check.pulleys[k]
            yield (
                f"{cable.pulleys[k].kind} {k + 2}",
                *blank,
                _shown(pulley.wrap, 180.0 / pi, 1),
                _shown(pulley.transmission_at_rest, 1.0, 3),
                _shown(pulley.transmission_sliding, 1.0, 3),
                f"{1e3 * pulley.passing:.2f}",
            )
    yield (
        "whole cable",
        _shown(check.length, 1e3, 1),
        *_arms(robot, check.moment_arm, moving),
        "",
        _shown(check.transmission_at_rest, 1.0, 3),
        _shown(check.transmission_sliding, 1.0, 3),
        "",
    )


def _arms(robot: Robot, arms: Sequence[Extent], moving: Sequence[int]) -> list[str]:
    slides = [joint.name in robot.prismatic_joints for joint in robot.joints]
    return [_shown(arms[j], 1.0, 3) if slides[j] else _shown(arms[j], 1e3, 2) for j in moving]


def _shown(extent: Extent, factor: float, decimals: int) -> str:
    """``40.9`` or ``0.6 … 78.5``."""
    low, high = (fixed(factor * value, decimals) for value in (extent.low, extent.high))
    return low if low == high else f"{low} … {high}"


def _facts(inspection: Inspection, cable: Cable, check: CableCheck) -> Iterator[str]:
    """Sentences on its stiffness and tensions."""
    robot = inspection.model.robot
    yield (
        f"{elasticity_text(cable)}, {1e-3 * check.stiffness:.3g} N/mm, "
        f"preload {cable.preload:g} N, law {cable.law}"
    )
    limit = f"; max_tension {cable.maximum_tension:g} N" if isfinite(cable.maximum_tension) else ""
    where = pose_text(robot, check.worst.high_at)
    yield (
        f"tension when the motors follow: {_shown(check.followed, 1.0, 2)} N; worst "
        f"{check.worst.high:.4g} N, at the pulling end with every pulley slipping"
        f"{f' ({where})' if where else ''}{limit}"
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


def elasticity_text(cable: Cable) -> str:
    """``EA 6283 N``, followed by bedding of the strands and creep where a cable has them."""
    text = f"EA {cable.axial_stiffness:.4g} N"
    if cable.bedding_strain:
        text += f", bedding {cable.bedding_strain:.3g} at {cable.bedding_tension:.3g} N"
    if cable.creep_share:
        text += f", creep {cable.creep_share:.3g} in {cable.creep_time:.3g} s"
    if isfinite(cable.flow_time):
        text += f", flow in {cable.flow_time:.3g} s"
    return text


def _print_shares(model: Model, shares: Shares, console: Console) -> None:
    """Print a table per cable, and the measurements that would help most."""
    from rich.text import Text

    known = model.robot.uncertainty
    assumed = known is not None and len(known.parameters) > known.stated
    told: list[Cause] = []
    for cable, part in zip(model.robot.cables, model.robot.parts, strict=True):
        table = new_table(f"{cable.name}: shares in the variance of the tensions [%]")
        table.add_column("")
        for k in range(len(cable.element_names)):
            table.add_column(str(k + 1), justify="right", no_wrap=True)
        for cause in shares.causes:
            if np.abs(cause.share[part]).max() >= LEAST_SHARE:
                table.add_row(Text(cause.what), *(f"{100 * one:.0f}" for one in cause.share[part]))
                told += [] if cause in told else [cause]
        table.add_section()
        table.add_row("σ [N]", *(f"{one:.3g}" for one in shares.stddev[part]), style="bold")
        console.print()
        console.print(table)
    source = "the defaults of docs/uncertainty.md" if assumed else "the file"
    named = [cause for cause in shares.causes if cause in told][:NAMED]
    console.print(Text(f"These numbers make most of the uncertainty, by {source}; to halve it:"))
    for cause in named:
        console.print(Text(f"  {cause.what}: {cause.measure}"))


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("check_robot", _body, argv)


if __name__ == "__main__":
    sys.exit(main())
