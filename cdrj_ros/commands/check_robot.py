"""``check_robot``: check a robot file, inspect its cables and list suspicious values."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from math import isfinite
from typing import Any

from cdrj_ros.commands.check_robot_text import print_inspection
from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.estimation.reading_limits import slips
from cdrj_ros.foundation.files import check_outputs, write_text
from cdrj_ros.foundation.output import printable
from cdrj_ros.inspection.checks import CableCheck, Extent, Inspection, Suspicion
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.shares import MOST_CAUSES, Shares, uncertainty_shares
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.loading import load_model, robot_path
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Cable


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
    return parser


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    to_terminal = arguments.json == "-"
    if not to_terminal:
        check_outputs({"--json": arguments.json}, [robot_path(arguments.robot)])
    model = load_model(arguments.robot)
    inspection = inspect_robot(model)
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


def json_text(
    inspection: Inspection, suspicions: Sequence[Suspicion], shares: Shares | None
) -> str:
    """The results as a JSON document."""
    document = _document(inspection, suspicions)
    document["uncertainty"] = _shares_document(inspection.model, shares)
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _document(inspection: Inspection, suspicions: Sequence[Suspicion]) -> dict[str, Any]:
    """All printed results in SI units; ``null`` for results without a value."""
    robot = inspection.model.robot
    names = inspection.model.layout.joints
    return {
        "robot": robot.name,
        "source": robot.source,
        "poses": len(inspection.poses),
        "motors": [
            {"name": motor.name, "angle": _extent(names, motor.angle)}
            for motor in inspection.motors
        ],
        "encoders": [
            one._asdict() | {"unsure": one.unsure if isfinite(one.unsure) else None}
            for one in slips(inspection.model)
        ],
        "residual": [
            {
                "output": one.output,
                "bound": one.bound,
                "stddev": one.stddev,
                "inputs": {name: list(ends) for name, ends in one.inputs.items()},
            }
            for one in robot.residuals
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
        "bedding_strain": cable.bedding_strain,
        "bedding_tension": cable.bedding_tension if cable.bedding_strain else None,
        "creep_share": cable.creep_share,
        "creep_time": cable.creep_time if cable.creep_share else None,
        "flow_time": cable.flow_time if isfinite(cable.flow_time) else None,
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


def _shares_document(model: Model, shares: Shares | None) -> dict[str, Any] | None:
    """All shares as plain values for JSON, without omissions."""
    if shares is None:
        return None
    names = model.layout.elements
    return {
        "stddev": dict(zip(names, shares.stddev.tolist(), strict=True)),
        "causes": [
            {
                "what": cause.what,
                "measure": cause.measure,
                "share": dict(zip(names, cause.share.tolist(), strict=True)),
            }
            for cause in shares.causes
        ],
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("check_robot", _body, argv)


if __name__ == "__main__":
    sys.exit(main())
