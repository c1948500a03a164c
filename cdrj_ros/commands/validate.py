"""``validate``: run the estimator on bags, offline, and compare it with their references."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from math import isfinite
from pathlib import Path

from cdrj_ros.commands.entry import BAD_INPUT, DONE, OUTSIDE_LIMITS, CommandParser, run_command
from cdrj_ros.commands.shared import (
    add_channel_options,
    add_result_options,
    add_robot_option,
    channels_of,
    print_results,
    topic_prefix,
    write_files,
)
from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.estimating import OUTPUTS
from cdrj_ros.evaluation.inputs import Window
from cdrj_ros.evaluation.limits import check_limits, load_limits
from cdrj_ros.evaluation.metrics import errors_of
from cdrj_ros.evaluation.parallel import (
    Failed,
    Progress,
    Work,
    default_jobs,
    processors,
    results_of,
)
from cdrj_ros.evaluation.validation import HEALTH, LOAD_CELLS, BagTask, compare_bag, prepared_model
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs, size_of
from cdrj_ros.foundation.output import ProgressBar, say
from cdrj_ros.recordings.writer import require_new
from cdrj_ros.robot.description import Robot

MOST_JOBS = 64


def _compared(
    arguments: argparse.Namespace, tasks: Sequence[BagTask], report: Progress
) -> list[BagComparison | Failed]:
    """The comparison of every bag; that of a single one here, with its errors."""
    sizes = [size_of(task.path) for task in tasks]
    work = Work(compare_bag, tasks, [task.path for task in tasks], sizes)
    if len(tasks) == 1:
        return [compare_bag(tasks[0], lambda share: report(share * work.sizes[0]))]
    jobs = default_jobs(work.sizes) if arguments.jobs is None else arguments.jobs or processors()
    return results_of(work, jobs, report)


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        prog="validate",
        description="Run bags through the estimator offline, in lock-step, and compare the "
        "estimates with the recorded references.",
        epilog="Exit code: 0 done, 1 outside the limits, 2 bad usage or input.",
    )
    parser.add_argument(
        "bags",
        nargs="+",
        metavar="BAG",
        help="rosbag2 folder or .mcap file, or a table with --columns",
    )
    add_robot_option(parser, several=True)
    add_channel_options(parser)
    parser.add_argument(
        "--start", type=float, default=0.0, metavar="S",
        help="compare from S seconds after the start of the bag; the estimator still processes "
        "what precedes, as friction depends on it (default %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--duration", type=float, metavar="S", help="compare for S seconds (default: all)"
    )
    parser.add_argument(
        "--jobs", type=int, metavar="N",
        help="number of bags processed at a time, each in its own process; 0: one per processor "
        "(default: one per processor, but a single one for less than 16 MB of bags)",
    )  # fmt: skip
    parser.add_argument(
        "--all", action="store_true",
        help="print all channels, even where they are more than a screen holds",
    )  # fmt: skip
    parser.add_argument(
        "--limits", metavar="FILE",
        help="limits of the figures (YAML, docs/recordings.md); exit code 1 if a figure is outside",
    )  # fmt: skip
    parser.add_argument(
        "--write-bag", metavar="OUT",
        help="write an MCAP bag with everything in the original and the estimates; for several "
        "bags, one each in the folder OUT",
    )  # fmt: skip
    parser.add_argument(
        "--health", choices=HEALTH, default="auto",
        help="say what motor efforts and load cells show about the robot (docs/reliability.md); "
        "auto: those that the node would hear; references: also recorded references (default "
        "%(default)s)",
    )  # fmt: skip
    add_result_options(parser)
    return parser


def _tasks(arguments: argparse.Namespace, robot: Robot) -> list[BagTask]:
    """One for each bag; refuses outputs that cannot be written before any bag is read."""
    bags, topics = arguments.bags, channels_of(arguments)
    window = _window(arguments.start, arguments.duration)
    # a bag has the status that the node would publish
    uncertainty = robot.uncertainty is not None or bool(arguments.write_bag)
    prefix = topic_prefix(arguments)
    outputs = tuple(prefix + topic for topic in OUTPUTS)
    return [
        BagTask(
            path,
            topics,
            arguments.robot,
            preload,
            window,
            outputs,
            uncertainty,
            written,
            arguments.health,
            prefix + LOAD_CELLS,
        )
        for path, preload, written in zip(
            bags, _preloads(arguments), _written(arguments.write_bag, bags), strict=True
        )
    ]


def _window(start: float, duration: float | None) -> Window:
    if not (isfinite(start) and start >= 0.0):
        raise UsageError(f"--start must be at least 0 s, got {start}")
    if duration is None:
        return (start, float("inf"))
    if not 0.0 < duration < float("inf"):
        raise UsageError(f"--duration must be more than 0 s, got {duration}")
    return (start, start + duration)


def _preloads(arguments: argparse.Namespace) -> list[str | None]:
    """The preloads of every bag: one for all of them, or one each."""
    given: list[str | None] = arguments.preload or [None]
    if len(given) not in (1, len(arguments.bags)):
        raise UsageError(
            f"--preload must be given once, or once for each of the {len(arguments.bags)} bags; "
            f"got {len(given)}"
        )
    return given if len(given) > 1 else given * len(arguments.bags)


def _written(out: str | None, bags: Sequence[str]) -> list[str]:
    """The bag to write for every bag that is read; empty for none."""
    if not out:
        return [""] * len(bags)
    names = [Path(path).resolve().name.partition(".mcap")[0] for path in bags]
    if len(set(names)) < len(names):
        raise UsageError(
            "--write-bag needs bags with different names, because it names the new bags after them"
        )
    written = [out] if len(names) == 1 else [str(Path(out) / name) for name in names]
    for path in written:
        require_new(Path(path))
    return written


def _check_files(arguments: argparse.Namespace) -> None:
    """Refuse outputs that cannot be written or name an input, before any work."""
    inputs = [*arguments.bags, arguments.robot, *([arguments.limits] if arguments.limits else [])]
    outputs = {"--json": arguments.json, "--html": arguments.html}
    new = Path(arguments.write_bag or "")
    if arguments.write_bag and not new.exists() and new.absolute().parent.is_dir():
        outputs["--write-bag"] = arguments.write_bag
    check_outputs(outputs, inputs)


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    if arguments.jobs is not None and not 0 <= arguments.jobs <= MOST_JOBS:
        raise UsageError(f"--jobs must be from 0 to {MOST_JOBS}, got {arguments.jobs}")
    _check_files(arguments)
    if arguments.write_bag and arguments.columns:
        raise UsageError("--write-bag needs bags, not tables")
    limits = load_limits(arguments.limits) if arguments.limits else None
    preloads = _preloads(arguments)
    model = prepared_model(arguments.robot, preloads[0])
    tasks = _tasks(arguments, model.robot)
    for task in tasks:
        prepared_model(task.robot, task.preload)
    with ProgressBar("validating", sum(size_of(task.path) for task in tasks)) as report:
        results = _compared(arguments, tasks, report)
    bags = [result for result in results if not isinstance(result, Failed)]
    failed = [result for result in results if isinstance(result, Failed)]
    _say_failed(failed, len(tasks))
    if not bags:
        return BAD_INPUT
    errors = errors_of(bags)
    limit_check = check_limits(limits, errors) if limits else None
    title = f"{model.robot.name}: estimate against reference"
    write_files(arguments, model, errors, title, limit_check)
    print_results(arguments, errors, title, limit_check, every=arguments.all)
    for task in tasks:
        if task.written and task.path not in {one.name for one in failed}:
            say(f"bag: {task.written} (estimates on {', '.join(task.outputs)})")
    outside = limit_check is not None and bool(limit_check.outside)
    if failed:
        return BAD_INPUT
    return OUTSIDE_LIMITS if outside else DONE


def _say_failed(failed: Sequence[Failed], total: int) -> None:
    for one in failed:
        say(f"validate: {one.reason}", file=sys.stderr)
    if failed and total > 1:
        rest = total - len(failed)
        text = f"the results are of the other {rest}" if rest else "there are no results"
        say(f"validate: {len(failed)} of {total} bags failed; {text}", file=sys.stderr)


main = partial(run_command, "validate", _body)
"""Entry point; returns the exit code."""
