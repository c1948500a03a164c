"""What ``identify`` is asked to do: command line and settings, checked before a bag is read."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

from cdrj_ros.commands.entry import CommandParser
from cdrj_ros.commands.shared import add_channel_options, channels_of
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs
from cdrj_ros.foundation.output import say
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.priors import (
    Moved,
    chosen_unknowns,
    moved_ranges,
    outdated_corrections,
    pose_unknowns,
    search_ranges,
)
from cdrj_ros.identification.problem import Settings, refuse_hidden
from cdrj_ros.identification.unknowns import (
    Unknown,
    starting_values,
    with_bounds,
    with_priors,
)
from cdrj_ros.model.prepared import robot_path
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.table import Columns
from cdrj_ros.robot.document import (
    check_document,
    document_complaints,
    load_schema,
    read_text,
    yaml_mapping,
)
from cdrj_ros.robot.parameters import split_outside, with_numbers
from cdrj_ros.robot.reader import build_robot, load_document
from cdrj_ros.robot.writer import refuse_aliases


def parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = CommandParser(
        prog="identify",
        description="Identify parameters of the robot file from bags, with standard errors and "
        "the errors on held-out bags.",
        epilog="Parameters are paths of the robot file in SI, such as cables.upper.preload, "
        "friction.rho, cables.b.nodes.3.bearing_torque, or short forms: rho, mu_c, mu_s, v_s, "
        "f_d, EA, preload, drum_radius, joint_offset, joint_scale, clock_offset. "
        "docs/identification.md",
    )
    parser.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 folder or .mcap file")
    parser.add_argument("--robot", metavar="FILE", help="robot file to start from")
    parser.add_argument(
        "--fit", metavar="NAME,...",
        help="parameters to identify; 'cables.*.preload': one value for all cables, "
        "'cables.{*}.preload': one for each, 'a=b' and 'a=-b': two tied parameters",
    )  # fmt: skip
    parser.add_argument(
        "--free", default="", metavar="NAME,...",
        help="fitted parameters of which nothing is known: otherwise each keeps its value in the "
        "file with the default standard deviation as a prior, unless the file states one",
    )  # fmt: skip
    parser.add_argument(
        "--start", action="append", default=[], metavar="NAME=VALUE",
        help="starting value [SI], or the value of a parameter that is not fitted; repeatable",
    )  # fmt: skip
    parser.add_argument(
        "--from", dest="source", metavar="FILE",
        help="instead of --robot and --fit: identified robot file of another pose; only what "
        "another pose changes is fitted: zeros, rests of springs, preloads, and wraps and drag of "
        "the pulleys",
    )  # fmt: skip
    parser.add_argument(
        "--settings", metavar="FILE",
        help="bounds, priors, references to fit, loss and more (YAML; all keys "
        "with their defaults in config/identify.yaml)",
    )  # fmt: skip
    parser.add_argument("--out", metavar="FILE", help="robot file to write; comments are kept")
    parser.add_argument(
        "--force", action="store_true",
        help="replace an existing --out, also the file given by --robot",
    )  # fmt: skip
    parser.add_argument(
        "--quick", action="store_true",
        help="use only samples thinned to about 100 Hz; omit the last round with all samples",
    )  # fmt: skip
    parser.add_argument(
        "--hold-out", action="append", nargs="+", default=[], metavar="BAG",
        help="bags that are not fitted, on which the result is evaluated",
    )  # fmt: skip
    parser.add_argument(
        "--cross-validate", nargs="*", metavar="NAMES",
        help="fit again without each bag, or without matching bags, and evaluate these bags",
    )  # fmt: skip
    parser.add_argument("--residual", action="store_true", help="learn what the model leaves over")
    add_channel_options(parser)
    return parser


def load_settings(path: str | None) -> Document:
    """The content of a settings file; empty without one, since every key may be left out.

    Raises:
        RobotFileError: with one line that names the key, what was given and what is allowed.
    """
    if path is None:
        return {}
    document = yaml_mapping(read_text(path, "settings"), path, "settings of identify")
    check_document(document, load_schema("cdrj_ros.commands", "identify.schema.json"), path)
    return document


@dataclass(frozen=True)
class Task:
    """A checked request: parameters, bags and outputs; complete before any bag is read."""

    path: Path
    """The robot file."""
    document: Document
    """Content of the robot file, with the numbers of ``--start``."""
    source: str
    start: Mapping[str, float]
    """Numbers of ``--start`` by path [SI]."""
    unknowns: tuple[Unknown, ...]
    settings: Settings
    topics: Topics | Columns
    bags: tuple[str, ...]
    held_out: tuple[str, ...]
    folds: Mapping[str, tuple[int, ...]]
    """Indices of the bags that each cross-validation fit leaves out, by their pattern."""
    chosen: Document
    """Content of the settings file."""
    pose: bool = False
    """Whether only what another pose changes is fitted."""


def task_of(arguments: argparse.Namespace) -> Task:
    """The request on the command line, checked before any bag is read.

    Raises:
        CdrjError: the request is impossible, or an output would overwrite a file.
    """
    path = robot_path(_chosen_file(arguments))
    held_out = tuple(bag for group in arguments.hold_out for bag in group)
    inputs = [*arguments.bags, *held_out]
    check_outputs({"--out": arguments.out}, inputs, force=arguments.force)
    if arguments.out:
        refuse_aliases(read_text(path, "robot file"), str(path))
    chosen = load_settings(arguments.settings)
    document, source = load_document(path)
    if document.pop("residual", None) and not arguments.residual:
        say("left out: residual, which was learned with the numbers as they were")
    start = starting_values(document, arguments.start)
    document = with_numbers(document, start)
    for complaint in document_complaints(document):
        raise UsageError(f"--start: {complaint}")
    unknowns = _unknowns(arguments, chosen, document, source)
    both = {Path(bag).resolve() for bag in arguments.bags} & {Path(b).resolve() for b in held_out}
    if both:
        raise UsageError(f"{both.pop().name} cannot be fitted and held out at once")
    return Task(
        path, document, source, start, unknowns, _settings(chosen, arguments.quick),
        channels_of(arguments), tuple(arguments.bags), held_out, _folds(arguments), chosen,
        arguments.source is not None,
    )  # fmt: skip


def _chosen_file(arguments: argparse.Namespace) -> str:
    """The robot file to start from, by ``--robot`` or by ``--from``.

    Raises:
        UsageError: options that do not go together, or a missing one.
    """
    if arguments.source is None:
        for option in ("robot", "fit"):
            if getattr(arguments, option) is None and not (arguments.residual and arguments.robot):
                raise UsageError(f"--{option} is missing; or give --from FILE")
        needs_fit = {
            "hold-out": arguments.hold_out,
            "cross-validate": arguments.cross_validate is not None,
            "free": arguments.free,
        }
        for option, given in needs_fit.items():
            if given and arguments.fit is None:
                raise UsageError(f"--{option} needs --fit")
        return str(arguments.robot)
    for option in ("robot", "fit", "start"):
        if getattr(arguments, option):
            raise UsageError(f"--{option} does not go with --from, which chooses it")
    return str(arguments.source)


def _unknowns(
    arguments: argparse.Namespace, chosen: Document, document: Document, source: str
) -> tuple[Unknown, ...]:
    """The numbers to fit, with bounds and priors."""
    robot = build_robot(document, source)
    refuse_hidden(robot)
    free = split_outside(arguments.free, ",") if arguments.free else ()
    if arguments.source is not None:
        unknowns = tuple(one.unknown for one in pose_unknowns(document, robot))
        unknowns = with_priors(unknowns, dict.fromkeys(free), "--free")
    elif arguments.fit is None:
        return ()
    else:
        only = chosen.get("only", False)
        unknowns = chosen_unknowns(document, robot, arguments.fit, free, only=only)
    unknowns = with_bounds(unknowns, chosen.get("bounds", {}))
    priors = {
        name: (float(one["mean"]), float(one["stddev"]))
        for name, one in chosen.get("priors", {}).items()
    }
    return with_priors(unknowns, priors)


def _settings(chosen: Document, quick: bool) -> Settings:
    usual = Settings()
    return Settings(
        tuple(chosen.get("channels", usual.channels)),
        usual.weights,
        chosen.get("loss", usual.loss),
        float(chosen.get("settle", usual.settle_s)),
        coarse=quick,
        compares_drums=True,
    )


def _folds(arguments: argparse.Namespace) -> dict[str, tuple[int, ...]]:
    """Indices of the bags left out by each fit; empty without ``--cross-validate``.

    Raises:
        UsageError: a pattern matches no bag, or all of them.
    """
    if arguments.cross_validate is None:
        return {}
    names = [Path(bag).name for bag in arguments.bags]
    folds = {}
    for pattern in arguments.cross_validate or names:
        out = tuple(k for k, name in enumerate(names) if fnmatchcase(name, pattern))
        if not 0 < len(out) < len(names):
            raise UsageError(
                f"--cross-validate {pattern} must match some of the bags and not all: "
                f"{', '.join(names)}"
            )
        folds[pattern] = out
    return folds


def posed(
    arguments: argparse.Namespace, task: Task, recordings: Sequence[Recorded]
) -> tuple[Task, Moved]:
    """The task with ranges that contain the new pose, and the joints that have left the old ones.

    Raises:
        RobotFileError: the geometry does not allow the readings.
    """
    left = moved_ranges(task.document, task.source, recordings)
    for name, span in left.items():
        say(
            f"{name}: readings from {span.lowest:.4g} to {span.highest:.4g} leave the range of the "
            "file; the new file has a range of its own"
        )
    robot = build_robot(task.document, task.source)
    outdated = outdated_corrections(robot, left)
    for name in dict.fromkeys(path.partition(".value.")[0] for path in outdated):
        say(f"set to zero: {name}: it was fitted to readings of the file's pose")
    changed = outdated | search_ranges(task.document, task.source, left)
    document = with_numbers(task.document, changed)
    unknowns = _unknowns(arguments, task.chosen, document, task.source)
    for one in pose_unknowns(document, build_robot(document, task.source)):
        say(f"fitted: {one.unknown.name}: {one.why}")
    zeros = tuple(f"joints.{name}.reference_angle" for name in left)
    task = replace(
        task, document=document, unknowns=unknowns, start={**task.start, **changed},
        settings=replace(task.settings, sought=zeros),
    )  # fmt: skip
    return task, left
