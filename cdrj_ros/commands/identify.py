"""``identify``: numbers of the robot file from bags, with standard errors and hold-out figures."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from time import perf_counter

from cdrj_ros.bag import Recording, Topics
from cdrj_ros.campaign.cluster import check_address
from cdrj_ros.commands.compilation import announce_compilation
from cdrj_ros.commands.identify_model_error import model_errors
from cdrj_ros.commands.identify_results import (
    Compared,
    Outcome,
    Section,
    as_json,
    fold_line,
    print_outcome,
    provenance_section,
)
from cdrj_ros.commands.identify_uncertainty import COVARIANCE_LIMIT, uncertainty_section
from cdrj_ros.commands.running import DONE, CommandParser, run_command
from cdrj_ros.commands.shared import add_topic_options, topics_of
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_new, check_outputs, write_text
from cdrj_ros.foundation.output import say
from cdrj_ros.foundation.progress import progress_bar, progress_text
from cdrj_ros.identification.fit import Identification, Settings, identify
from cdrj_ros.identification.pose import (
    Moved,
    moved_ranges,
    pose_ranges,
    pose_unknowns,
    seeking_ranges,
)
from cdrj_ros.identification.residuals import WEIGHTS, Pool, Recorded
from cdrj_ros.identification.solution import LOSSES
from cdrj_ros.identification.unknowns import (
    Unknown,
    parse_unknowns,
    starting_values,
    with_bounds,
    with_priors,
)
from cdrj_ros.identification.wide import fitted_along
from cdrj_ros.judgement.bag_task import validate_bag
from cdrj_ros.judgement.channels import BagComparison
from cdrj_ros.judgement.metrics import pooled_errors
from cdrj_ros.judgement.validation import read_inputs
from cdrj_ros.model.loading import robot_path
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.document import Document, document_complaints, parse_document
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, load_document, parse_robot
from cdrj_ros.robot.writer import moved, with_numbers_in_text, with_section, yaml_number


def _parser() -> argparse.ArgumentParser:
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
        "--only", action="store_true",
        help="fit these alone; otherwise stiffness, preload, drum radius, zeros and drag are "
        "fitted along where the file states no accuracy, with the default tolerance as prior",
    )  # fmt: skip
    parser.add_argument(
        "--from", dest="source", metavar="FILE", help="identified robot file of another pose"
    )
    parser.add_argument(
        "--pose", action="store_true",
        help="with --from: fit only what another pose changes: zeros, rests of springs, preloads, "
        "and wraps and drag of the pulleys",
    )  # fmt: skip
    parser.add_argument("--out", metavar="FILE", help="robot file to write; comments are kept")
    parser.add_argument(
        "--force",
        action="store_true",
        help="replace an existing --out, also the file given by --robot",
    )
    parser.add_argument(
        "--json", metavar="FILE", help="write the figures as JSON, replacing the file"
    )
    _add_number_options(parser.add_argument_group("numbers"))
    _add_fit_options(parser.add_argument_group("fit"))
    _add_bag_options(parser.add_argument_group("other bags"))
    _add_machine_option(parser)
    add_topic_options(parser)
    return parser


def _add_number_options(group: argparse._ArgumentGroup) -> None:
    for option, form, text in (
        ("--start", "NAME=VALUE", "starting value, or the value of a number that is not fitted"),
        ("--bounds", "NAME=LOW:HIGH", "bounds of a number; either may be omitted"),
        ("--prior", "NAME=MEAN:STDDEV", "prior knowledge of a number"),
    ):
        group.add_argument(
            option, action="append", default=[], metavar=form, help=f"{text}; SI, repeatable"
        )


def _add_fit_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--channels", default="", metavar="NAME,...",
        help="references to fit, wildcards allowed: 'tension/*/8,nodal_force/upper/3' (all)",
    )  # fmt: skip
    group.add_argument(
        "--weights", choices=WEIGHTS, default="spread",
        help="divide residuals by the standard deviation of the references of their kind, or by "
        "their sensor's noise (%(default)s)",
    )  # fmt: skip
    group.add_argument(
        "--sigma", action="append", default=[], metavar="NAME=VALUE",
        help="divide the residuals of a reference by VALUE [N] or [N m]; repeatable",
    )  # fmt: skip
    group.add_argument(
        "--loss", choices=LOSSES, default="linear", help="loss function (%(default)s)"
    )
    group.add_argument("--starts", type=int, default=1, metavar="N", help="number of starts (1)")
    group.add_argument("--seed", type=int, default=0, help="seed of the random starts (0)")
    group.add_argument(
        "--settle", type=float, default=0.0, metavar="S",
        help="exclude the first S seconds of every bag, in which the friction state is unknown (0)",
    )  # fmt: skip
    group.add_argument(
        "--quick", action="store_true",
        help="use only samples thinned to about 100 Hz; omit the last round with all samples",
    )  # fmt: skip


def _add_machine_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scheduler", metavar="ADDRESS",
        help="compute residuals on the Dask cluster with this scheduler, such as "
        "tcp://10.0.0.5:8786; otherwise on all processors of this machine "
        "(docs/many_recordings.md)",
    )  # fmt: skip


def _add_bag_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--hold-out", action="append", nargs="+", default=[], metavar="BAG",
        help="bags that are not fitted, on which the result is evaluated",
    )  # fmt: skip
    group.add_argument(
        "--cross-validate", nargs="*", metavar="NAMES",
        help="fit again without each bag, or without matching bags, and evaluate these bags",
    )  # fmt: skip


@dataclass(frozen=True)
class _Task:
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


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    task = _task(arguments)
    if arguments.scheduler is None:
        return _identified(arguments, task, None)
    from cdrj_ros.campaign.cluster_pool import cluster_pool

    with cluster_pool(arguments.scheduler) as pool:
        return _identified(arguments, task, pool)


def _identified(arguments: argparse.Namespace, task: _Task, pool: Pool | None) -> int:
    """Fit, compare with the bags, write and print."""
    begin = perf_counter()
    announce_compilation()
    model = prepare(build_robot(task.document, task.source))
    recordings = _read(task.bags, task.topics, model)
    left: Moved = {}
    if task.pose:
        task, left = _posed(arguments, task, recordings)
        model = prepare(build_robot(task.document, task.source))
    read = perf_counter()
    with progress_text(_begins_a_round) as progress:
        found = identify(
            task.document, task.source, task.unknowns, recordings, task.settings, progress, pool
        )
    values = {**task.start, **_rounded(found)}
    values |= {path: _round(end) for path, end in pose_ranges(left, values).items()}
    seen = {path for k in found.seen.tolist() for path in found.unknowns[k].paths}
    written = {path: values[path] for path in values if path in seen or path in task.start}
    text = with_numbers_in_text(task.path.read_text(encoding="utf-8"), written, task.source)
    fitted = prepare(parse_robot(text, task.source))
    fitting_s = perf_counter() - read
    sections: dict[Section, Compared] = {"fit": _compared(task.bags, task.topics, fitted, model)}
    unseen: list[BagComparison] = []
    if task.held_out:
        unseen += _validated(task.held_out, task.topics, fitted)
        before = _validated(task.held_out, task.topics, model)
        sections["hold_out"] = Compared(pooled_errors(unseen), pooled_errors(before))
    fold_lines: tuple[str, ...] = ()
    if task.folds:
        judged, fold_lines = _cross_validated(task, found, recordings, pool)
        sections["cross_validation"] = Compared(pooled_errors(judged))
        unseen += judged
    outcome = Outcome(
        found, values, tuple(Path(bag).name for bag in task.bags),
        tuple(Path(bag).name for bag in task.held_out), task.settings.loss, sections, fold_lines,
        read - begin, fitting_s, Path(task.path).name if task.pose else "",
    )  # fmt: skip
    text = _with_uncertainty(text, task, found, unseen)
    _write(arguments, outcome, moved(text, task.source, arguments.out or task.source))
    print_outcome(outcome)
    if arguments.out and len(outcome.found.by_path) > COVARIANCE_LIMIT:
        print(f"note: more than {COVARIANCE_LIMIT} numbers; their covariance is not written")
    for name, written in (("robot file", arguments.out), ("figures", arguments.json)):
        if written:
            say(f"{name}: {written}")
    return DONE


def _task(arguments: argparse.Namespace) -> _Task:
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
    return _Task(
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
        unknowns = parse_unknowns(document, arguments.fit)
        if not arguments.only:
            unknowns += fitted_along(document, robot.uncertainty, unknowns)
    return with_priors(with_bounds(unknowns, arguments.bounds), arguments.prior)


def _posed(
    arguments: argparse.Namespace, task: _Task, recordings: Sequence[Recorded]
) -> tuple[_Task, Moved]:
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
    ranges = seeking_ranges(task.document, task.source, left)
    document = with_numbers(task.document, ranges)
    unknowns = _unknowns(arguments, document, task.source)
    for one in pose_unknowns(document, build_robot(document, task.source)):
        say(f"fitted: {one.unknown.name}: {one.why}")
    zeros = tuple(f"joints.{name}.reference_angle" for name in left)
    task = replace(
        task, document=document, unknowns=unknowns, start={**task.start, **ranges},
        settings=replace(task.settings, sought=zeros),
    )  # fmt: skip
    return task, left


def _check_files(arguments: argparse.Namespace, robot: Path, held_out: Sequence[str]) -> None:
    """Refuse outputs that cannot be written or that would replace an input."""
    bags = [*arguments.bags, *held_out]
    check_outputs({"--out": arguments.out, "--json": arguments.json}, bags)
    check_outputs({"--json": arguments.json}, [robot])
    check_new({"--out": arguments.out}, force=arguments.force)


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


def _write(arguments: argparse.Namespace, outcome: Outcome, text: str) -> None:
    """Write the files before anything is printed: standard output may be closed."""
    if arguments.out:
        text = with_section(text, "identified", provenance_section(outcome))
        parse_document(text, arguments.out)
        write_text(arguments.out, text)
    if arguments.json:
        write_text(arguments.json, json.dumps(as_json(outcome), indent=2) + "\n")


def _with_uncertainty(
    text: str, task: _Task, found: Identification, unseen: Sequence[BagComparison]
) -> str:
    """The robot file's text with the block ``uncertainty``."""
    before = dict(task.document.get("uncertainty", {}))
    stated = dict(before)
    if unseen:
        stated.pop("model_error", None)
    narrow = with_section(text, "uncertainty", uncertainty_section(found, stated, {}))
    if not unseen:
        return narrow
    model = prepare(parse_robot(narrow, task.source))
    errors = model_errors(model, unseen, task.topics, found.channels)
    return with_section(text, "uncertainty", uncertainty_section(found, stated, errors))


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
        judges_drums=True,
    )


def recorded(recording: Recording, name: str) -> Recorded:
    """A recording in the form that the identification expects."""
    return Recorded(
        name,
        recording.motors,
        recording.joints,
        {key: (series.stamp_ns, series.value) for key, series in recording.references.items()},
    )


def _read(bags: Sequence[str], topics: Topics, model: Model) -> list[Recorded]:
    recordings = []
    with progress_bar("reading", len(bags)) as report:
        for bag in bags:
            recordings.append(recorded(read_inputs(bag, topics, model), Path(bag).name))
            report(len(recordings))
    return recordings


def _validated(bags: Sequence[str], topics: Topics, model: Model) -> list[BagComparison]:
    """The comparisons that ``validate`` makes."""
    return [validate_bag(model, bag, topics) for bag in bags]


def _compared(bags: Sequence[str], topics: Topics, fitted: Model, before: Model) -> Compared:
    """Errors on some bags with the identified numbers and with the starting values."""
    return Compared(
        pooled_errors(_validated(bags, topics, fitted)),
        pooled_errors(_validated(bags, topics, before)),
    )


def _rounded(found: Identification) -> dict[str, float]:
    """The numbers rounded to the digits that are written."""
    return {path: _round(value) for path, value in found.by_path.items()}


def _round(value: float) -> float:
    return float(yaml_number(value))


def _begins_a_round(text: str) -> bool:
    """Whether a progress line announces the next round of a fit."""
    return "samples" in text


def _cross_validated(
    task: _Task, found: Identification, recordings: Sequence[Recorded], pool: Pool | None
) -> tuple[list[BagComparison], tuple[str, ...]]:
    """Compare every bag with the estimates of a fit without this bag.

    Returns:
        The comparisons, and a line for each fit.
    """
    unseen: list[BagComparison] = []
    lines = []
    settings = task.settings
    rough = Settings(
        found.channels, settings.weights, settings.sigmas, settings.loss, 1, 0,
        settings.settle_s, coarse=True,
    )  # fmt: skip
    begin = with_numbers(task.document, found.by_path)
    again = [replace(u, start=float(v)) for u, v in zip(found.unknowns, found.values, strict=True)]
    for pattern, out in task.folds.items():
        others = [one for k, one in enumerate(recordings) if k not in out]
        with progress_text(_begins_a_round) as progress:
            fold = identify(begin, task.source, again, others, rough, progress, pool)
        robot = build_robot(with_numbers(task.document, fold.by_path), task.source)
        judged = _validated([task.bags[k] for k in out], task.topics, prepare(robot))
        unseen += judged
        lines.append(fold_line(pattern, judged, found.channels))
    return unseen, tuple(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("identify", _body, argv)


if __name__ == "__main__":
    sys.exit(main())
