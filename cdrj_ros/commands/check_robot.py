"""``check_robot``: check a robot file, inspect its cables and list suspicious values."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from typing import Any, Final

from cdrj_ros.commands.check_printed import print_details, print_summary
from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.estimation.conditioner import slips
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError, ordered
from cdrj_ros.foundation.files import check_outputs, write_text
from cdrj_ros.foundation.output import Json, json_text, plain, printable
from cdrj_ros.foundation.yaml import yaml_text
from cdrj_ros.inspection.ranges import Inspection, inspect_robot
from cdrj_ros.inspection.shares import MOST_CAUSES, Shares, uncertainty_shares
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.impossible import Suspicion
from cdrj_ros.model.prepared import Model, load_model, robot_path
from cdrj_ros.robot.description import Cable
from cdrj_ros.robot.reader import load_robot


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
    details = parser.add_mutually_exclusive_group()
    details.add_argument(
        "--cable", metavar="NAME,...", help="print everything about some cables, element by element"
    )
    details.add_argument("--all", action="store_true", help="print everything about all cables")
    details.add_argument(
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
    known = [cable.name for cable in model.robot.cables]
    named = arguments.cable.split(",") if arguments.cable else known
    if unknown := [name for name in named if name not in known]:
        raise UsageError(f"--cable: there is no cable {unknown[0]!r}; there are {ordered(known)}")
    inspection = inspect_robot(model)
    suspicions = find_suspicions(inspection)
    shares = uncertainty_shares(model)
    if to_terminal:
        print(json_text(results(inspection, suspicions, shares)), end="")
        return DONE
    if arguments.json:
        write_text(arguments.json, json_text(results(inspection, suspicions, shares)))
    if arguments.all or arguments.cable:
        print_details(inspection, suspicions, shares, named)
    else:
        print_summary(inspection, suspicions, shares, arguments.robot)
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


main = partial(run_command, "check_robot", _body)
"""Entry point; returns the exit code."""
