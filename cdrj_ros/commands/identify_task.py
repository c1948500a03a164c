"""What ``identify`` is asked to do, checked before any bag is read."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

from cdrj_ros.commands.shared import topics_of
from cdrj_ros.evaluation.parallel import check_address
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_new, check_outputs
from cdrj_ros.foundation.output import say
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.pose import (
    Moved,
    moved_ranges,
    outdated_corrections,
    pose_unknowns,
    search_ranges,
)
from cdrj_ros.identification.problem import Settings
from cdrj_ros.identification.unknowns import (
    Unknown,
    fitted_along,
    known_before,
    parse_unknowns,
    starting_values,
    with_bounds,
    with_priors,
    without_priors,
)
from cdrj_ros.model.loading import robot_path
from cdrj_ros.recordings import Topics
from cdrj_ros.robot.document import Document, document_complaints
from cdrj_ros.robot.parameters import split_outside, with_numbers
from cdrj_ros.robot.reader import build_robot, load_document


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
    topics: Topics
    bags: tuple[str, ...]
    held_out: tuple[str, ...]
    folds: Mapping[str, tuple[int, ...]]
    """Indices of the bags that each cross-validation fit leaves out, by their pattern."""
    pose: bool = False
    """Whether only what another pose changes is fitted."""


def task_of(arguments: argparse.Namespace) -> Task:
    """The request on the command line, checked before any bag is read.

    Raises:
        CdrjError: the request is impossible, or an output would overwrite a file.
    """
    if arguments.scheduler is not None:
        check_address(arguments.scheduler)
    path = robot_path(_chosen_file(arguments))
    held_out = tuple(bag for group in arguments.hold_out for bag in group)
    _check_files(arguments, path, held_out)
    settings = _settings(arguments)
    document, source = load_document(path)
    start = starting_values(document, arguments.start)
    document = with_numbers(document, start)
    for complaint in document_complaints(document):
        raise UsageError(f"--start: {complaint}")
    unknowns = _unknowns(arguments, document, source)
    both = {Path(bag).resolve() for bag in arguments.bags} & {Path(b).resolve() for b in held_out}
    if both:
        raise UsageError(f"{both.pop().name} cannot be fitted and held out at once")
    return Task(
        path, document, source, start, unknowns, settings, topics_of(arguments),
        tuple(arguments.bags), held_out, _folds(arguments), arguments.pose,
    )  # fmt: skip


def _chosen_file(arguments: argparse.Namespace) -> str:
    """The robot file to start from, by ``--robot`` or by ``--from``.

    Raises:
        UsageError: options that do not go together, or a missing one.
    """
    if arguments.pose != (arguments.source is not None):
        raise UsageError("--from FILE and --pose go together: the file of one pose, and another")
    if not arguments.pose:
        for option in ("robot", "fit"):
            if getattr(arguments, option) is None:
                raise UsageError(f"--{option} is missing; or give --from FILE and --pose")
        return str(arguments.robot)
    for option in ("robot", "fit", "start"):
        if getattr(arguments, option):
            raise UsageError(f"--{option} does not go with --pose, which chooses it")
    return str(arguments.source)


def _unknowns(
    arguments: argparse.Namespace, document: Document, source: str
) -> tuple[Unknown, ...]:
    """The numbers to fit, with bounds and priors."""
    robot = build_robot(document, source)
    if arguments.pose:
        unknowns = tuple(one.unknown for one in pose_unknowns(document, robot))
    else:
        unknowns = known_before(
            document, robot.uncertainty, parse_unknowns(document, arguments.fit)
        )
        if not arguments.only:
            unknowns += fitted_along(document, robot.uncertainty, unknowns)
    free = split_outside(arguments.free, ",") if arguments.free else ()
    unknowns = without_priors(with_bounds(unknowns, arguments.bounds), free)
    return with_priors(unknowns, arguments.prior)


def _settings(arguments: argparse.Namespace) -> Settings:
    sigmas = {}
    for text in arguments.sigma:
        name, _, given = text.rpartition("=")
        try:
            sigma = float(given)
        except ValueError:
            sigma = 0.0
        if not name or not 0.0 < sigma < float("inf"):
            raise UsageError(f"--sigma must be NAME=VALUE with a positive value, got {text!r}")
        sigmas[name] = sigma
    if not 0.0 <= arguments.settle < 1e6:
        raise UsageError(f"--settle must be in [0, 1e6), got {arguments.settle}")
    return Settings(
        tuple(name.strip() for name in arguments.channels.split(",") if name.strip()),
        arguments.weights,
        sigmas,
        arguments.loss,
        arguments.starts,
        arguments.seed,
        arguments.settle,
        arguments.quick,
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


def _check_files(arguments: argparse.Namespace, robot: Path, held_out: Sequence[str]) -> None:
    """Refuse outputs that cannot be written or that would replace an input."""
    bags = [*arguments.bags, *held_out]
    check_outputs({"--out": arguments.out, "--json": arguments.json}, bags)
    check_outputs({"--json": arguments.json}, [robot])
    check_new({"--out": arguments.out}, force=arguments.force)


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
    unknowns = _unknowns(arguments, document, task.source)
    for one in pose_unknowns(document, build_robot(document, task.source)):
        say(f"fitted: {one.unknown.name}: {one.why}")
    zeros = tuple(f"joints.{name}.reference_angle" for name in left)
    task = replace(
        task, document=document, unknowns=unknowns, start={**task.start, **changed},
        settings=replace(task.settings, sought=zeros),
    )  # fmt: skip
    return task, left
