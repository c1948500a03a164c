"""``validate``: run the estimator on bags, offline, and compare it with their references."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from math import isfinite

from cdrj_ros.commands.entry import BAD_INPUT, DONE, CommandParser, run_command
from cdrj_ros.commands.shared import (
    add_result_options,
    add_robot_option,
    add_topic_options,
    print_results,
    topic_prefix,
    topics_of,
    write_files,
)
from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.inputs import Window
from cdrj_ros.evaluation.metrics import errors_of
from cdrj_ros.evaluation.parallel import (
    Failed,
    Progress,
    Work,
    default_jobs,
    in_processes,
    in_this_process,
    processors,
)
from cdrj_ros.evaluation.validation import HEALTH, LOAD_CELLS, BagTask, compare_bag, prepared_model
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs, size_of
from cdrj_ros.foundation.output import ProgressBar, say
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
    if jobs == 1:
        return in_this_process(work, report)
    return in_processes(work, jobs, report)


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        prog="validate",
        description="Run bags through the estimator offline, in lock-step, and compare the "
        "estimates with the recorded references.",
        epilog="Exit code: 0 done, 2 bad usage or input.",
    )
    parser.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 folder or .mcap file")
    add_robot_option(parser, several=True)
    add_topic_options(parser)
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
        "--health", choices=HEALTH, default="auto",
        help="let the health monitor compare motor efforts and load cells with the robot file "
        "(docs/reliability.md); auto: those that the node would hear; references: also recorded "
        "references (default %(default)s)",
    )  # fmt: skip
    add_result_options(parser)
    return parser


def _tasks(arguments: argparse.Namespace, robot: Robot) -> list[BagTask]:
    """One for each bag."""
    topics, window = topics_of(arguments), _window(arguments.start, arguments.duration)
    load_cells = topic_prefix(arguments) + LOAD_CELLS
    return [
        BagTask(
            path,
            topics,
            arguments.robot,
            preload,
            window,
            robot.uncertainty is not None,
            arguments.health,
            load_cells,
        )
        for path, preload in zip(arguments.bags, _preloads(arguments), strict=True)
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


def _check_files(arguments: argparse.Namespace) -> None:
    """Refuse outputs that cannot be written or name an input, before any work."""
    outputs = {"--json": arguments.json, "--html": arguments.html}
    check_outputs(outputs, [*arguments.bags, arguments.robot])


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    if arguments.jobs is not None and not 0 <= arguments.jobs <= MOST_JOBS:
        raise UsageError(f"--jobs must be from 0 to {MOST_JOBS}, got {arguments.jobs}")
    _check_files(arguments)
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
    title = f"{model.robot.name}: estimate against reference"
    write_files(arguments, model, errors, title)
    print_results(arguments, errors, title)
    return BAD_INPUT if failed else DONE


def _say_failed(failed: Sequence[Failed], total: int) -> None:
    for one in failed:
        say(f"validate: {one.reason}", file=sys.stderr)
    if failed and total > 1:
        rest = total - len(failed)
        text = f"the results are of the other {rest}" if rest else "there are no results"
        say(f"validate: {len(failed)} of {total} bags failed; {text}", file=sys.stderr)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("validate", _body, argv)


if __name__ == "__main__":
    raise SystemExit(main())
